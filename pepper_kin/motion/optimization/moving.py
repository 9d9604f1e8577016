"""Joints of a robot that move while the others rest, and joints that may move at all."""

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
    """Moving joints of a robot, while the other joints rest.

    Attributes:
        pepper: The robot.
        joints: Indices of the joints that move, increasing, shape (k,).
        rest: A whole configuration with the other joints' positions [rad or m], shape (n,).
    """

    pepper: PepperModel
    joints: NDArray[np.int64]
    rest: Array


def free_joints(pepper: PepperModel, limits: Limits) -> NDArray[np.bool_]:
    """Return which joints may move, shape (n,): joints with nonzero limits and a nonzero range."""
    has_range = pepper.upper_limits > pepper.lower_limits
    return np.asarray(has_range & (limits.velocity > 0) & (limits.acceleration > 0))


@compiled(lean=True)
def whole_states(states: Floats1, joints: Ints1, rest: Floats1, whole: Floats2) -> None:
    """Write whole vectors, shape (m, n), from vectors of the moving joints, shape (m k,), and from `rest`."""
    n = joints.size
    for k in range(whole.shape[0]):
        for j in range(whole.shape[1]):
            whole[k, j] = rest[j]
        for j in range(n):
            whole[k, joints[j]] = states[k * n + j]
