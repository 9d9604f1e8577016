"""From a goal and a scene to a checked path."""

from pepper_kin.motion.plan_result import Plan, PlanStatus
from pepper_kin.motion.planning import plan

__all__ = ["Plan", "PlanStatus", "plan"]
