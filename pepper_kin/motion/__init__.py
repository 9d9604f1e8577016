"""From a goal and a scene to a checked path."""

from pepper_kin.motion.plan import Plan, PlanStatus, plan

__all__ = ["Plan", "PlanStatus", "plan"]
