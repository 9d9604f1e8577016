"""From a goal and a scene to a checked path."""

from pepper_kin.motion.plan import plan
from pepper_kin.motion.plan_result import Plan, PlanStatus

__all__ = ["Plan", "PlanStatus", "plan"]
