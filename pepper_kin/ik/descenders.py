"""The solvers by name, as searches down from a start."""

from __future__ import annotations

from pepper_kin.ik.descent import Descender, StepDescender
from pepper_kin.ik.problem import Problem
from pepper_kin.ik.solvers import SOLVERS, make_solver

ALL_SOLVERS = ("fast", *SOLVERS)


def make_descender(name: str, problem: Problem) -> Descender:
    """Return the descender of a solver's name, made for a problem.

    Args:
        name: One of `ALL_SOLVERS`, checked by the caller.
        problem: The problem.

    Raises:
        InvalidValueError: where the solver cannot take the robot or a task; names one that can.
    """
    if name == "fast":
        from pepper_kin.ik.fast import FastDescender

        return FastDescender(problem)
    return StepDescender(problem, make_solver(name, problem))
