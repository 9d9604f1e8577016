"""Which configurations a motion may pass through."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pepper_kin.collision import CollisionChecker
from pepper_kin.dynamics import gravity_torque
from pepper_kin.model import PepperModel

if TYPE_CHECKING:
    from pepper_kin.collision.fast import FastChecker

TORQUE_SHARE = 0.95
"""Share of each joint's effort that holding still may take; the rest is left to move with."""


def validity(
    checker: CollisionChecker | FastChecker, frozen: NDArray[np.float64], free: NDArray[np.int64]
) -> Callable[[NDArray[np.float64]], NDArray[np.bool_]]:
    """Return the planner's oracle for some joints of a robot, the others standing still.

    A state is valid where nothing touches, the margin to the scene is kept, and the joints can hold the
    posture against gravity.

    Args:
        checker: Robot, scene and margin.
        frozen: A whole configuration [rad or m], shape (n,).
        free: Indices of the joints that the planner moves, shape (k,).

    Returns:
        A callable from states of the free joints, shape (m, k), to booleans, shape (m,).
    """

    def valid(states: NDArray[np.float64]) -> NDArray[np.bool_]:
        q = np.tile(frozen, (len(states), 1))
        q[:, free] = states
        ok = holds(checker.pepper, q)
        ok[ok] = ~checker.in_collision(q[ok])
        return ok

    return valid


def holds(pepper: PepperModel, q: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether the joints can hold q, shape (m, n), still, with a little to spare; shape (m,)."""
    return np.asarray(
        np.all(np.abs(gravity_torque(pepper, q)) <= TORQUE_SHARE * pepper.effort_limits, axis=-1)
    )
