"""Joints of a robot that move, the others standing still, and those that may move at all."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2, Ints1
from pepper_kin.model import PepperModel
from pepper_kin.trajectory.limits import Limits


@dataclass(frozen=True, eq=False)
class Moving:
    """Some joints of a robot, the others standing still.

    Attributes:
        pepper: The robot.
        joints: Places of the joints that move, rising, shape (k,).
        rest: A whole configuration, whose other joints hold, shape (n,) [rad or m].
    """

    pepper: PepperModel
    joints: NDArray[np.int64]
    rest: Array


def free_joints(pepper: PepperModel, limits: Limits) -> NDArray[np.bool_]:
    """Return which joints may move, shape (n,): those of which no limit is zero, nor the range."""
    has_range = pepper.upper_limits > pepper.lower_limits
    return np.asarray(has_range & (limits.velocity > 0) & (limits.acceleration > 0))


@compiled(lean=True)
def whole_states(states: Floats1, joints: Ints1, rest: Floats1, whole: Floats2) -> None:
    """Write whole vectors, shape (m, n), of the moving joints' ones, shape (m k,); others are as at rest."""
    n = joints.size
    for k in range(whole.shape[0]):
        for j in range(whole.shape[1]):
            whole[k, j] = rest[j]
        for j in range(n):
            whole[k, joints[j]] = states[k * n + j]
