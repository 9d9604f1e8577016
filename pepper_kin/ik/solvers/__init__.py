"""Solvers: what proposes the steps."""

from __future__ import annotations

from pepper_kin.ik.problem import Problem
from pepper_kin.ik.solvers.step_solver import HalfSpaces, StepSolver

SOLVERS = ("placo", "proxsuite")

__all__ = ["SOLVERS", "HalfSpaces", "StepSolver", "make_solver"]


def make_solver(name: str, problem: Problem) -> StepSolver:
    """Return the solver of a name, made for a problem.

    Args:
        name: One of `SOLVERS`, checked by the caller.
        problem: The problem.

    Raises:
        InvalidValueError: where the solver cannot take the robot or a task; names one that can.
    """
    if name == "placo":
        from pepper_kin.ik.solvers.placo import PlacoSolver

        return PlacoSolver(problem)
    from pepper_kin.ik.solvers.proxsuite import ProxsuiteSolver

    return ProxsuiteSolver(problem)
