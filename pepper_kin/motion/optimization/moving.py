"""Some joints of a robot that move, the others standing still."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2, Ints1
from pepper_kin.model import PepperModel


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


@compiled(lean=True)
def whole_states(states: Floats1, joints: Ints1, rest: Floats1, whole: Floats2) -> None:
    """Write whole vectors, shape (m, n), of the moving joints' ones, shape (m k,); others are as at rest."""
    n = joints.size
    for k in range(whole.shape[0]):
        for j in range(whole.shape[1]):
            whole[k, j] = rest[j]
        for j in range(n):
            whole[k, joints[j]] = states[k * n + j]
