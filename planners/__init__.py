"""Robot-agnostic motion planners: vectors, bounds, a metric and an oracle of validity, never a robot.

problem = Problem(lower, upper, start, goals, oracle)
result = rrt_connect(problem, seed=0, timeout=5.0)
if result.success:
    curve = smooth(problem, shortcut(problem, result.path))
"""

from .certificate import Certificate, certify
from .compiled_validity import CompiledValidity
from .deadline import Deadline
from .goal_source import GoalSampler
from .metric import Metric
from .oracle import Advance, Oracle, StateValidity
from .path import Path
from .problem import Problem
from .result import Result, Status
from .rrt_connect import rrt_connect
from .shortcut import shortcut
from .smooth import smooth
from .smooth_path import SmoothPath

__all__ = [
    "Advance",
    "Certificate",
    "CompiledValidity",
    "Deadline",
    "GoalSampler",
    "Metric",
    "Oracle",
    "Path",
    "Problem",
    "Result",
    "SmoothPath",
    "StateValidity",
    "Status",
    "certify",
    "rrt_connect",
    "shortcut",
    "smooth",
]
