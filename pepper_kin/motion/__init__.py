"""From a goal and a scene to a checked path."""

from pepper_kin.motion.cartesian import CartesianPath, CartesianStatus, cartesian_path
from pepper_kin.motion.constrained_plan import plan_constrained
from pepper_kin.motion.constraints import manifold_of
from pepper_kin.motion.curves import Arc, Curve, Line
from pepper_kin.motion.frame_in_plane import FrameInPlane
from pepper_kin.motion.plan_result import Plan, PlanStatus
from pepper_kin.motion.planning import plan

__all__ = [
    "Arc",
    "CartesianPath",
    "CartesianStatus",
    "Curve",
    "FrameInPlane",
    "Line",
    "Plan",
    "PlanStatus",
    "cartesian_path",
    "manifold_of",
    "plan",
    "plan_constrained",
]
