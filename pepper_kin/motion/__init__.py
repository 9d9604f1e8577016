"""From a goal and a scene to a checked path, and from a path to a motion that is short and smooth."""

from pepper_kin.motion.optimisation import (
    Cost,
    Optimised,
    OptimisedStatus,
    Swing,
    SwingStatus,
    minimum_effort_swing,
    optimise,
)
from pepper_kin.motion.plan_result import Plan, PlanStatus
from pepper_kin.motion.planning import plan

__all__ = [
    "Cost",
    "Optimised",
    "OptimisedStatus",
    "Plan",
    "PlanStatus",
    "Swing",
    "SwingStatus",
    "minimum_effort_swing",
    "optimise",
    "plan",
]
