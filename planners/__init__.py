"""Robot-agnostic motion planners: vectors, bounds, a metric and an oracle of validity, never a robot.

problem = Problem(lower, upper, start, goals, oracle)
result = rrt_connect(problem, seed=0, timeout=5.0)
if result.success:
    curve = smooth(problem, shortcut(problem, result.path))
"""

from .deadline import Deadline
from .metric import Metric
from .oracle import Advance, Oracle, StateValidity
from .path import Path
from .problem import Problem

__all__ = [
    "Advance",
    "Deadline",
    "Metric",
    "Oracle",
    "Path",
    "Problem",
    "StateValidity",
]
