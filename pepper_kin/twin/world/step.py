"""One step's contact problem, solved by either method."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pepper_kin.twin.world.problem import ContactProblem
from pepper_kin.twin.world.programme import ImpulseProgramme
from pepper_kin.twin.world.slip import LIFT, SWEEPS, first_shift, follow, lift, solve_compiled, velocities

Array = NDArray[np.float64]

SOLVERS = ("compiled", "proxsuite")


@dataclass(frozen=True, eq=False)
class StepSolution:
    """Velocities after a step, and the impulses that made them.

    Attributes:
        velocity: u, shape (N,).
        impulses: Normal, first and second tangent of each point [N s], shape (3 k,).
        solver: Who found them.
        problems: Convex problems solved.
        lift: Normal velocity by which slips deviate from Coulomb's law [m/s].
    """

    velocity: Array
    impulses: Array
    solver: str
    problems: int
    lift: float


def solve_step(
    problem: ContactProblem, rows: Array, solver: str, programme: ImpulseProgramme
) -> StepSolution | None:
    """Return the solution of a step; None where neither method finds it.

    Args:
        problem: The problem; its tangents are turned in place.
        rows: Points, normals and gaps, shape (k, 7).
        solver: "compiled" (proxsuite stands in where it fails) or "proxsuite".
        programme: Kept by the caller, so that it starts warm.
    """
    if not np.isfinite(problem.free).all():
        return None
    u, pushes = np.empty(len(problem.free)), np.empty(len(problem.jacobian))
    if solver == "compiled":
        steps, sweeps, left = solve_compiled(
            problem.mass, problem.free, problem.start, problem.jacobian, problem.response, problem.soft,
            problem.drop, problem.friction, problem.tangents, rows, u, pushes,
        )  # fmt: skip
        if steps >= 0:
            return StepSolution(u, pushes, "compiled", sweeps, left)
    return _by_programme(problem, rows, programme)


def _by_programme(problem: ContactProblem, rows: Array, programme: ImpulseProgramme) -> StepSolution | None:
    shift, slip = np.empty(len(problem.drop)), np.empty(len(problem.jacobian))
    u = np.empty(len(problem.free))
    first_shift(problem.jacobian, problem.start, problem.friction, shift)
    for sweep in range(1, SWEEPS + 1):
        found = programme.solve(problem, problem.drop + shift)
        if found is None:
            return None
        pushes = found
        velocities(problem.free, problem.response, pushes, u)
        left = lift(problem.jacobian, u, pushes, problem.drop, problem.friction, shift, slip)
        if left <= LIFT or sweep == SWEEPS:
            break
        follow(
            problem.jacobian, problem.response, problem.tangents, rows, slip, problem.friction, shift, sweep
        )
    return StepSolution(u, pushes, "proxsuite", sweep, left)
