"""Motions that are cheap, not only possible: path and timing optimized together."""

from pepper_kin.motion.optimization.cost import Cost, Figures
from pepper_kin.motion.optimization.minimum_torque import (
    MinimumTorqueStatus,
    MinimumTorqueTrajectory,
    minimum_torque_trajectory,
)
from pepper_kin.motion.optimization.optimize import optimize
from pepper_kin.motion.optimization.optimized import Optimized, OptimizedStatus

__all__ = [
    "Cost",
    "Figures",
    "MinimumTorqueStatus",
    "MinimumTorqueTrajectory",
    "Optimized",
    "OptimizedStatus",
    "minimum_torque_trajectory",
    "optimize",
]
