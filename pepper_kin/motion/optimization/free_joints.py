"""Joints that may move at all."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pepper_kin.model import PepperModel
from pepper_kin.trajectory.limits import Limits


def free_joints(pepper: PepperModel, limits: Limits) -> NDArray[np.bool_]:
    """Return which joints may move, shape (n,): those of which no limit is zero, nor the range."""
    has_range = pepper.upper_limits > pepper.lower_limits
    return np.asarray(has_range & (limits.velocity > 0) & (limits.acceleration > 0))
