"""From a goal and a scene to a checked path, and a library of gestures."""

from pepper_kin.motion.gesture import gesture, gesture_meaning, gesture_names
from pepper_kin.motion.plan_result import Plan, PlanStatus
from pepper_kin.motion.planning import plan

__all__ = ["Plan", "PlanStatus", "gesture", "gesture_meaning", "gesture_names", "plan"]
