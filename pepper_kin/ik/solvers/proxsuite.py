"""Steps by the dense quadratic programme of ProxSuite."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pepper_kin.ik.problem import POSTURE_WEIGHT, Problem
from pepper_kin.ik.solvers.step_solver import STEP_BOUND, HalfSpaces, StepSolver
from pepper_kin.ik.tasks.task import Array

ACCURACY = 1e-9


class ProxsuiteSolver(StepSolver):
    """Builds the programme from the tasks' own Jacobians and solves it with ProxQP, started warm.

    Bambade et al., ProxQP: an efficient and versatile quadratic programming solver for real-time robotics
    applications and beyond (2023).

    Args:
        problem: The problem; its joints that may not move are left out of the programme.
    """

    def __init__(self, problem: Problem) -> None:
        self._problem = problem
        self._index = np.flatnonzero(problem.movable)
        self._diagonal = np.diag_indices(self._index.size)
        self._programmes: dict[int, Any] = {}

    def step(
        self,
        q: Array,
        residuals: Sequence[Array],
        reference: Array,
        damping: float,
        half_spaces: HalfSpaces | None = None,
    ) -> Array | None:
        """Return the step; see `StepSolver`."""
        problem, index = self._problem, self._index
        if not index.size:
            return np.zeros(problem.pepper.n)
        residual, jacobian = problem.stack(residuals), problem.jacobian(q)[:, index]
        hessian = jacobian.T @ jacobian
        hessian[self._diagonal] += damping * problem.scale[index] ** 2 + POSTURE_WEIGHT**2
        gradient = jacobian.T @ residual + POSTURE_WEIGHT**2 * (q - reference)[index]
        lower = np.maximum(problem.lower[index] - q[index], -STEP_BOUND)
        upper = np.minimum(problem.upper[index] - q[index], STEP_BOUND)
        change = self._solve(hessian, gradient, lower, upper, half_spaces)
        if change is None:
            return None
        step = np.zeros(problem.pepper.n)
        step[index] = np.clip(change, lower, upper)
        return step

    def _solve(
        self, hessian: Array, gradient: Array, lower: Array, upper: Array, half_spaces: HalfSpaces | None
    ) -> Array | None:
        from proxsuite import proxqp

        rows = 0 if half_spaces is None else half_spaces.offsets.size
        normals = None if half_spaces is None else half_spaces.normals[:, self._index]
        offsets = None if half_spaces is None else half_spaces.offsets
        least = None if half_spaces is None else np.full(rows, -1e20)
        programme = self._programmes.get(rows)
        if programme is None:
            programme = proxqp.dense.QP(self._index.size, 0, rows, True)
            programme.settings.eps_abs = ACCURACY
            # Started warm, small residuals alone do not show that the bounds which hold have been found.
            programme.settings.check_duality_gap = True
            programme.settings.eps_duality_gap_abs = ACCURACY
            programme.settings.max_iter = 1000
            programme.settings.initial_guess = proxqp.InitialGuess.WARM_START_WITH_PREVIOUS_RESULT
            programme.init(hessian, gradient, None, None, normals, least, offsets, lower, upper)
            self._programmes[rows] = programme
        else:
            programme.update(
                H=hessian, g=gradient, A=None, b=None, C=normals, l=least, u=offsets,
                l_box=lower, u_box=upper, update_preconditioner=True,
            )  # fmt: skip
        programme.solve()
        solved = programme.results.info.status == proxqp.QPSolverOutput.PROXQP_SOLVED
        change = np.array(programme.results.x)
        return change if solved and np.isfinite(change).all() else None
