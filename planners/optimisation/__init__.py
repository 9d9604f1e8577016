"""Motions from rest to rest, made cheap within limits: B-splines and a feasible interior-point method.

spline = RestSpline(start, goal, intervals=20)
objective = Objective(spline, Bounds(lower, upper, velocity, acceleration), Weights(1.0, 1e-4, scale), [term])
found = descend(objective, spline.fit(states), duration)
"""

from pepper_kin.planners.optimisation.assembly import Bounds, Objective
from pepper_kin.planners.optimisation.descend import Descent, OptimisationStatus, descend
from pepper_kin.planners.optimisation.rows import Rows, Term, Wall, Weights
from pepper_kin.planners.optimisation.spline import RestSpline

__all__ = [
    "Bounds",
    "Descent",
    "Objective",
    "OptimisationStatus",
    "RestSpline",
    "Rows",
    "Term",
    "Wall",
    "Weights",
    "descend",
]
