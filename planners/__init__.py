"""Robot-agnostic motion planners: vectors, bounds, a metric and an oracle of validity, never a robot.

problem = Problem(lower, upper, start, goals, oracle)
result = rrt_connect(problem, seed=0, timeout=5.0)
if result.success:
    curve = smooth(problem, shortcut(problem, result.path))
"""

from .certificate import Certificate, certify
from .compiled_validity import CompiledValidity
from .constrained_connect import constrained_connect
from .constrained_shortcut import constrained_shortcut, constrained_smooth, project
from .deadline import Deadline
from .goal_source import GoalSampler
from .improve import improve
from .manifold import MachineCodeManifold, Manifold
from .metric import Metric
from .ompl_planner import OMPL_PLANNERS, available_ompl_planners, ompl_plan
from .oracle import Advance, Oracle, StateValidity
from .path import Path
from .problem import Problem
from .rejoin import rejoin
from .result import Improvement, Result, Status
from .roadmap import Roadmap
from .rrt_connect import rrt_connect
from .rrt_star import rrt_star
from .shortcut import shortcut
from .smooth import smooth
from .smooth_path import SmoothPath

__all__ = [
    "OMPL_PLANNERS",
    "Advance",
    "Certificate",
    "CompiledValidity",
    "Deadline",
    "GoalSampler",
    "Improvement",
    "MachineCodeManifold",
    "Manifold",
    "Metric",
    "Oracle",
    "Path",
    "Problem",
    "Result",
    "Roadmap",
    "SmoothPath",
    "StateValidity",
    "Status",
    "available_ompl_planners",
    "certify",
    "constrained_connect",
    "constrained_shortcut",
    "constrained_smooth",
    "improve",
    "ompl_plan",
    "project",
    "rejoin",
    "rrt_connect",
    "rrt_star",
    "shortcut",
    "smooth",
]
