"""Solvers: the compiled one, and two of other libraries as references."""

from __future__ import annotations

from pepper_kin.ik.fast.search import FastSolver
from pepper_kin.ik.problem import Problem
from pepper_kin.ik.solver import TaskSolver

SOLVERS = ("placo", "proxsuite")
ALL_SOLVERS = ("fast", *SOLVERS)

__all__ = ["ALL_SOLVERS", "SOLVERS", "TaskSolver", "make_solver"]


def make_solver(name: str, problem: Problem) -> TaskSolver:
    """Return the solver of a name, made for a problem.

    Args:
        name: One of `ALL_SOLVERS`, checked by the caller.
        problem: The problem.

    Raises:
        InvalidValueError: where the solver cannot take the robot; names one that can.
    """
    if name == "fast":
        return FastSolver(problem)
    from pepper_kin.ik.solvers.reference import ReferenceSolver  # few need it

    return ReferenceSolver(name, problem)
