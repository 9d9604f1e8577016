"""Motion planning: collision-free paths, optimized motions, and gestures.

    plan, Plan, PlanStatus                    start + goal + scene -> path
    plan_batch, PlanProblem, PlanBatch        many problems on all cores
    plan_constrained, manifold_of             a path along which IK tasks stay met
    plan_costed, PathCost, CostAlong          a path with small soft costs
    plan_legs, Leg, PlanInLegs                several goals, with constraints for each leg
    replan                                    a new goal in motion, along a planned path if necessary
    validate, Validation, ValidationStatus    examination of a given path
    simplify_path, interpolate_path
    follow, Followed, FollowStatus            tasks along a whole path, at a given speed
    sequence, PTP, LIN, CIRC, SPLINE          commands of industrial robots
    HandCurve, Line, Arc, Route               curves of a hand
    cartesian_path, CartesianPath, CartesianStatus   a hand along curves, as far as possible
    optimize, Cost, Figures, Optimized, OptimizedStatus       path and timing together
    minimum_torque_trajectory, MinimumTorqueTrajectory, MinimumTorqueStatus   minimum torque, rest to rest
    LiveMotion, LiveState, LiveStatus         motion to changing goals among moving obstacles
    executed                                  the commanded motion of a live motion, as one trajectory
    gesture, gesture_names, gesture_meaning
    retarget, Retargeted, RetargetStatus      a person's motion, made by the robot
    KeyPoints, read_key_points                a person's motion, as points over time

If no solution is found, `status` and `message` say why, and `report()` says what to try.
"""

from pepper_kin.call_errors import name_options
from pepper_kin.motion.batch_planning import PlanBatch, PlanProblem, plan_batch
from pepper_kin.motion.cartesian import CartesianPath, CartesianStatus, cartesian_path
from pepper_kin.motion.constrained_plan import plan_constrained
from pepper_kin.motion.constraints import manifold_of
from pepper_kin.motion.costed_plan import plan_costed
from pepper_kin.motion.curves import CIRC, LIN, SPLINE, Arc, HandCurve, Line, Route
from pepper_kin.motion.executed_motion import executed
from pepper_kin.motion.follow_result import Followed, FollowStatus
from pepper_kin.motion.following import follow
from pepper_kin.motion.gesture import gesture, gesture_meaning, gesture_names
from pepper_kin.motion.key_points import KeyPoints, read_key_points
from pepper_kin.motion.legs import Leg, PlanInLegs, plan_legs
from pepper_kin.motion.live_motion import LiveMotion, LiveState, LiveStatus
from pepper_kin.motion.optimization.cost import Cost, Figures
from pepper_kin.motion.optimization.minimum_torque import (
    MinimumTorqueStatus,
    MinimumTorqueTrajectory,
    minimum_torque_trajectory,
)
from pepper_kin.motion.optimization.optimize import optimize
from pepper_kin.motion.optimization.optimized import Optimized, OptimizedStatus
from pepper_kin.motion.path_costs import CostAlong, PathCost
from pepper_kin.motion.path_tools import interpolate_path, simplify_path
from pepper_kin.motion.plan_result import Plan, PlanStatus
from pepper_kin.motion.planning import plan, replan
from pepper_kin.motion.retargeting import Retargeted, RetargetStatus, retarget
from pepper_kin.motion.sequence import PTP, sequence
from pepper_kin.motion.validation import Validation, ValidationStatus, validate

__all__ = [
    "CIRC",
    "LIN",
    "PTP",
    "SPLINE",
    "Arc",
    "CartesianPath",
    "CartesianStatus",
    "Cost",
    "CostAlong",
    "Figures",
    "FollowStatus",
    "Followed",
    "HandCurve",
    "KeyPoints",
    "Leg",
    "Line",
    "LiveMotion",
    "LiveState",
    "LiveStatus",
    "MinimumTorqueStatus",
    "MinimumTorqueTrajectory",
    "Optimized",
    "OptimizedStatus",
    "PathCost",
    "Plan",
    "PlanBatch",
    "PlanInLegs",
    "PlanProblem",
    "PlanStatus",
    "RetargetStatus",
    "Retargeted",
    "Route",
    "Validation",
    "ValidationStatus",
    "cartesian_path",
    "executed",
    "follow",
    "gesture",
    "gesture_meaning",
    "gesture_names",
    "interpolate_path",
    "manifold_of",
    "minimum_torque_trajectory",
    "optimize",
    "plan",
    "plan_batch",
    "plan_constrained",
    "plan_costed",
    "plan_legs",
    "read_key_points",
    "replan",
    "retarget",
    "sequence",
    "simplify_path",
    "validate",
]

name_options(__name__)
