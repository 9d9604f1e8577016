"""Solvers: the compiled one, and two of other libraries for reference."""

from __future__ import annotations

from importlib.util import find_spec

from pepper_kin.ik.fast.search import FastSolver
from pepper_kin.ik.problem import TaskProblem
from pepper_kin.ik.solver import TaskSolver
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import check_choice

SOLVERS = ("placo", "proxsuite")
ALL_SOLVERS = ("fast", *SOLVERS)

__all__ = ["ALL_SOLVERS", "SOLVERS", "TaskSolver", "chosen_solver", "make_solver"]


def chosen_solver(pepper: PepperModel, solver: str) -> str:
    """Return the name of a solver; "robot" stands for the robot's `solvers`.

    For "reference" it is placo if it is installed and supports the robot's mimic joints, else proxsuite.

    Raises:
        InvalidValueError: for an unknown name, listing the known ones.
    """
    if check_choice("solver", solver, ("robot", *ALL_SOLVERS)) != "robot":
        return solver
    if pepper.solvers == "fast":
        return "fast"
    return "placo" if find_spec("placo") and not pepper.full_offset.any() else "proxsuite"


def make_solver(name: str, problem: TaskProblem) -> TaskSolver:
    """Return a solver by name, made for a problem.

    Args:
        name: One of `ALL_SOLVERS`, checked by the caller.
        problem: The problem.

    Raises:
        InvalidValueError: if the solver does not support the robot, naming one that does.
    """
    if name == "fast":
        return FastSolver(problem)
    from pepper_kin.ik.solvers.reference import ReferenceSolver  # imported late, since it is rarely used

    return ReferenceSolver(name, problem)
