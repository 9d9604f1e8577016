"""Torques as shares of the joints' efforts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pepper_kin.batch import kernel
from pepper_kin.motion.optimisation.kernel_term import KernelTerm
from pepper_kin.motion.optimisation.moving import Moving
from pepper_kin.planners.optimisation import Wall

Array = NDArray[np.float64]


class TorqueTerm(KernelTerm):
    """tau / limit of all joints with a finite effort, with exact derivatives from `symbolic`.

    Args:
        moving: The joints that move; torques of the others count, too.
        limits: Torques that count as 1 [N m or N], shape (n,), inf for none.
        per_interval: Samples in each interval of the spline.
    """

    def __init__(self, moving: Moving, limits: Array, per_interval: int) -> None:
        names = ("inverse_dynamics", "inverse_dynamics_derivatives")
        values, slopes = (kernel(moving.pepper, name) for name in names)
        shares = np.diag(1.0 / limits)[np.isfinite(limits)]
        finite = np.flatnonzero(np.isfinite(limits))
        self.joint_names = tuple(moving.pepper.joint_names[j] for j in finite)
        super().__init__(moving, (values, slopes), shares, per_interval, Wall.WITHIN_ONE)
