"""Optimization of motions from rest to rest within limits: B-splines and a feasible interior-point method.

spline = RestSpline(start, goal, intervals=20)
objective = Objective(spline, Bounds(lower, upper, velocity, acceleration), Weights(1.0, 1e-4, scale), [term])
found = descend(objective, spline.fit(states), duration)
"""

from pepper_kin.call_errors import name_options

from .assembly import Bounds, Objective
from .banded import add_row
from .compiled_term import FAILED, KINDS, RAISED, ROWS, START, TIGHTEN, VALUES, CompiledTerm
from .descend import LocalResult, OptimizationStatus, descend
from .general import FATROP, EffortMotion, EffortStatus, check_no_timeout, descend_by, minimum_effort
from .rows import BarrierBound, Rows, Term, Weights
from .spline import RestSpline

__all__ = [
    "FAILED",
    "FATROP",
    "KINDS",
    "RAISED",
    "ROWS",
    "START",
    "TIGHTEN",
    "VALUES",
    "BarrierBound",
    "Bounds",
    "CompiledTerm",
    "EffortMotion",
    "EffortStatus",
    "LocalResult",
    "Objective",
    "OptimizationStatus",
    "RestSpline",
    "Rows",
    "Term",
    "Weights",
    "add_row",
    "check_no_timeout",
    "descend",
    "descend_by",
    "minimum_effort",
]

name_options(__name__)
