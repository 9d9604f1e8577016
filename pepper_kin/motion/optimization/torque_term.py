"""Torques relative to the joints' effort limits."""

from __future__ import annotations

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.batch import kernel
from pepper_kin.dynamics.load import Loads
from pepper_kin.motion.optimization.carried import carrying_kernels
from pepper_kin.motion.optimization.kernel_term import KernelTerm
from pepper_kin.motion.optimization.moving import Moving
from pepper_kin.planners.optimization import BarrierBound


class TorqueTerm(KernelTerm):
    """Term tau / limit of all joints with a finite effort, with exact derivatives from `symbolic`.

    Args:
        moving: The joints that move; torques of the other joints count, too.
        limits: Torques that count as 1 [N m or N], shape (n,), inf for no limit.
        per_interval: Samples in each interval of the spline.
        loads: Carried loads.
    """

    def __init__(self, moving: Moving, limits: Array, per_interval: int, loads: Loads = ()) -> None:
        pepper, constants = moving.pepper, None
        if loads:
            kernels, constants = carrying_kernels(pepper, "inverse_dynamics", loads)
        else:
            kernels = kernel(pepper, "inverse_dynamics"), kernel(pepper, "inverse_dynamics_derivatives")
        shares = np.diag(1.0 / limits)[np.isfinite(limits)]
        finite = np.flatnonzero(np.isfinite(limits))
        self.joint_names = tuple(pepper.joint_names[j] for j in finite)
        super().__init__(moving, kernels, shares, per_interval, BarrierBound.WITHIN_ONE, constants)
