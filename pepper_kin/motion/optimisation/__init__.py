"""Motions that are cheap, not only possible: path and timing optimised together."""

from pepper_kin.motion.optimisation.cost import Cost, Figures
from pepper_kin.motion.optimisation.optimise import optimise
from pepper_kin.motion.optimisation.optimised import Optimised, OptimisedStatus
from pepper_kin.motion.optimisation.swing import Swing, SwingStatus, minimum_effort_swing

__all__ = [
    "Cost",
    "Figures",
    "Optimised",
    "OptimisedStatus",
    "Swing",
    "SwingStatus",
    "minimum_effort_swing",
    "optimise",
]
