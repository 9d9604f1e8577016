"""Robot-agnostic motion planners: vectors, bounds, a metric and the validity of states.

    problem = Problem(lower, upper, start, goals, validity)
    result = rrt_connect(problem, seed=0, timeout=5.0)
    if result.success:
        curve = smooth(problem, shortcut(problem, result.path))

    Problem, GoalSampler, StateValidityChecker, MotionValidator, CompiledMotionValidator, Metric, Deadline
    Result, Status, StopReason, Improvement, Path, SmoothPath
    rrt_connect, aorrtc, Roadmap              search, optimal search, one graph for many queries
    ompl_plan, available_ompl_planners, OMPL_PLANNERS
    shortcut, rejoin, smooth, rounded_waypoints
    certify, PathCertificate                  an examination of a path
    ConstraintManifold, CompiledManifold, cbirrt, project, constrained_shortcut, constrained_smooth
    StateCost, transition_rrt, descend_cost   soft costs
    car_connect, CarResult, car_curve, CarCurve   paths of a car
    first_invalid_states, first_blocked_states    what is in the way where no path is found

A state is a vector of n numbers; a checker decides whether it is valid.
"""

from pepper_kin.call_errors import name_options

from .aorrtc import aorrtc
from .car_connect import CarResult, car_connect
from .car_curves import CarCurve, car_curve
from .cbirrt import cbirrt
from .certificate import PathCertificate, certify
from .constrained_shortcut import constrained_shortcut, constrained_smooth, project
from .constraint_manifold import CompiledManifold, ConstraintManifold
from .cost_descent import StateCost, descend_cost
from .deadline import Deadline
from .frontier import first_invalid_states
from .manifold_frontier import first_blocked_states
from .metric import Metric
from .motion_validator import CompiledMotionValidator, MotionValidator, StateValidityChecker
from .ompl_planner import OMPL_PLANNERS, available_ompl_planners, ompl_plan
from .path import Path
from .problem import GoalSampler, Problem
from .rejoin import rejoin
from .result import Improvement, Result, Status, StopReason
from .roadmap import Roadmap
from .rrt_connect import rrt_connect
from .shortcut import shortcut
from .smooth import SmoothPath, rounded_waypoints, smooth
from .transition_rrt import transition_rrt

__all__ = [
    "OMPL_PLANNERS",
    "CarCurve",
    "CarResult",
    "CompiledManifold",
    "CompiledMotionValidator",
    "ConstraintManifold",
    "Deadline",
    "GoalSampler",
    "Improvement",
    "Metric",
    "MotionValidator",
    "Path",
    "PathCertificate",
    "Problem",
    "Result",
    "Roadmap",
    "SmoothPath",
    "StateCost",
    "StateValidityChecker",
    "Status",
    "StopReason",
    "aorrtc",
    "available_ompl_planners",
    "car_connect",
    "car_curve",
    "cbirrt",
    "certify",
    "constrained_shortcut",
    "constrained_smooth",
    "descend_cost",
    "first_blocked_states",
    "first_invalid_states",
    "ompl_plan",
    "project",
    "rejoin",
    "rounded_waypoints",
    "rrt_connect",
    "shortcut",
    "smooth",
    "transition_rrt",
]

name_options(__name__)
