"""Data with which machine code avoids self-collisions and collisions with the world."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array, read_only
from pepper_kin.collision import Scene, checker_for
from pepper_kin.collision.checker import CollisionChecker
from pepper_kin.collision.motion_tree import bounds_anywhere
from pepper_kin.collision.near_pairs import measure_by_coal, near_tables
from pepper_kin.core.collision.distances import KNOWN, NearTable, near_points
from pepper_kin.core.collision.scene_rows import KIND
from pepper_kin.core.near_state import NearWorld, OtherMeasures
from pepper_kin.kernels.callback import Callback
from pepper_kin.kernels.intrinsics import floats_at, words_at
from pepper_kin.model import PepperModel, kept_for_robot


@kept_for_robot(most=32)
def frame_motion_bounds(pepper: PepperModel) -> Array:
    """Return R, shape (n,) [m/rad or 1]: no point of the body moves by more than sum_i R_i |dq_i|."""
    return read_only(bounds_anywhere(pepper))


class ClearanceGuard:
    """Velocity dampers on nearby pairs, and a check of the braking path.

    Damper (Faverjon and Tournassoud, A local based approach for path planning of manipulators with a high
    number of degrees of freedom, 1987): g . v >= -gain max(d - d_min, 0) with g = dd/dq.
    Pairs nearer than d_min may only separate, and are driven to.

    Args:
        pepper: The robot.
        scene: The world; an empty one checks the robot against itself.
        clearance: d_min [m].
        gain: Maximum ratio of the free distance that is used up per second [1/s].

    Attributes:
        clearance: d_min [m].
        gain: Maximum ratio of the free distance that is used up per second [1/s].
        world: Pairs for machine code, valid as long as the guard.
    """

    def __init__(self, pepper: PepperModel, scene: Scene, clearance: float, gain: float) -> None:
        checker, self.clearance, self.gain = checker_for(pepper, scene), clearance, gain
        tables, count = near_tables(checker), checker.pair_count
        self._names, counts, within = tables.names, np.zeros(2, np.int64), np.zeros(1)
        # Shapes that machine code does not support are measured by coal only where they may be near.
        shapes, (first, second) = tables.near.shapes[:, KIND], tables.near.pairs[:, :2].T
        asked = ~(np.isin(shapes, KNOWN)[first] & np.isin(shapes, KNOWN)[second])
        seen = np.full((int(asked.sum()), 1 + pepper.n), np.inf)
        self._callback = callback = Callback(partial(_answer, checker, counts, within))
        self.world = NearWorld(
            True, tables.near, near_points(tables.near, count, count), tables.movers, tables.cores,
            tables.owners, checker.pairs_to_world, frame_motion_bounds(pepper), pepper.full_map,
            pepper.full_offset,
            OtherMeasures(callback.address, callback.mail, counts, within),
            np.where(asked, np.cumsum(asked) - 1, -1), seen,
        )  # fmt: skip

    def check(self) -> None:
        """Raise the exception of coal, or of a signal handler, during the last call."""
        error = self._callback.raised()
        if error is not None:
            raise error

    def name(self, pair: int) -> str:
        """Return the clearance constraint of a pair in words."""
        return "clearance of {} and {}".format(*self._names[pair])


def _answer(
    checker: CollisionChecker, counts: NDArray[np.int64], within: Array, states: int, pairs: int, answers: int
) -> int:
    """Measure pairs that machine code does not support by coal, see `OtherMeasures`; return 0."""
    rows, size = counts.tolist()
    full = checker.pepper.full_offset.size
    configurations, indices = floats_at(states, rows * full).reshape(rows, full), words_at(pairs, size)
    found = measure_by_coal(checker, configurations, indices, float(within[0]))
    floats_at(answers, found.size)[:] = found.ravel()
    return 0


def unexamined() -> NearWorld:
    """Return the world of a robot without collision checks."""
    rows, words, numbers = np.empty((0, 0)), np.empty(0, np.int64), np.empty(0)
    table = NearTable(rows, rows, rows, rows, words.reshape(0, 0), numbers, numbers)
    return NearWorld(
        False, table, near_points(table, 0, 0), rows.astype(bool), numbers, words, words.astype(bool),
        numbers, rows, numbers, OtherMeasures(0, words, words, numbers), words, rows,
    )  # fmt: skip
