"""Starts near a target: postures without self-collision, indexed by a frame's position."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from pepper_kin.arrays import Array, read_only
from pepper_kin.collision import Scene, in_collision
from pepper_kin.kinematics import frame_pose
from pepper_kin.model import PepperModel
from pepper_kin.model.digest import kept_for_robot

DRAWN, STARTS = 20_000, 48
"""Number of drawn postures, and maximum number of collision-free ones tried for a target."""


class Nearby(NamedTuple):
    """Postures and a frame's positions in them.

    Attributes:
        postures: Joint positions free of self-collision [rad or m], shape (k, n).
        tree: `scipy.spatial.cKDTree` of the frame's origins in the world [m].
    """

    postures: Array
    tree: Any

    def starts(self, point: Array) -> Array:
        """Return the postures nearest to a point [m], shape (3,), the nearest first, shape (<= STARTS, n)."""
        count = min(STARTS, len(self.postures))
        _, places = self.tree.query(point, k=np.arange(1, count + 1))
        return self.postures[places]


@kept_for_robot(most=8)
def nearby(pepper: PepperModel, frame: str, moves: tuple[bool, ...], resting: tuple[float, ...]) -> Nearby:
    """Return random postures, uniform in the joint box; joints without limits are within half a turn of 0.

    Args:
        pepper: The robot.
        frame: Name of the frame.
        moves: Whether each joint may move, n values.
        resting: Positions of the joints that may not move [rad or m], n values.
    """
    from scipy.spatial import cKDTree

    free = np.array(moves)
    low = np.where(free, np.maximum(pepper.lower_limits, -np.pi), resting)
    high = np.where(free, np.minimum(pepper.upper_limits, np.pi), resting)
    q = np.random.default_rng(0).uniform(low, high, (DRAWN, pepper.n))
    q = q[~in_collision(pepper, q, Scene())]
    return Nearby(read_only(q), cKDTree(frame_pose(pepper, q, frame)[:, :3, 3]))


def resting_of(
    pepper: PepperModel, starts: Array, movable: np.ndarray | None
) -> tuple[tuple[bool, ...], tuple[float, ...]] | None:
    """Return which joints may move, and the other joints' positions [rad or m]; None if these differ by row.

    Args:
        pepper: The robot.
        starts: q0 of each row [rad or m], shape (N, n), N > 0.
        movable: Joints that may move, shape (n,); None for all.
    """
    moves = np.ones(pepper.n, dtype=bool) if movable is None else np.asarray(movable, dtype=bool)
    resting = np.where(moves, 0.0, starts[0])
    if np.any(starts[:, ~moves] != resting[~moves]):
        return None
    return tuple(moves.tolist()), tuple(resting.tolist())
