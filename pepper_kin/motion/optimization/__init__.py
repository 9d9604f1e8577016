"""Motions that are cheap, not only possible: path and timing optimized together."""

from pepper_kin.motion.optimization.cost import Cost, Figures
from pepper_kin.motion.optimization.optimize import optimize
from pepper_kin.motion.optimization.optimized import Optimized, OptimizedStatus
from pepper_kin.motion.optimization.swing import Swing, SwingStatus, minimum_effort_swing

__all__ = [
    "Cost",
    "Figures",
    "Optimized",
    "OptimizedStatus",
    "Swing",
    "SwingStatus",
    "minimum_effort_swing",
    "optimize",
]
