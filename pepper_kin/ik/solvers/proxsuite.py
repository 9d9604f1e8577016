"""Steps by the dense quadratic program of ProxSuite."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.core.inverse_kinematics.local_solver import STEP_BOUND
from pepper_kin.ik.problem import POSTURE_WEIGHT, TaskProblem
from pepper_kin.ik.solver import HalfSpaces, StepSolver
from pepper_kin.proxsuite_library import proxqp

ACCURACY = 1e-9


class ProxsuiteSolver(StepSolver):
    """Solver of steps by ProxQP with warm start, on a program built from the tasks' Jacobians.

    Bambade et al., ProxQP: an efficient and versatile quadratic programming solver for real-time robotics
    applications and beyond (2023).

    Args:
        problem: The problem; joints that may not move are left out of the program.

    Raises:
        MissingDependencyError: if proxsuite cannot be loaded.
    """

    def __init__(self, problem: TaskProblem) -> None:
        self._library = proxqp()
        self._problem = problem
        self._index = np.flatnonzero(problem.movable)
        self._diagonal = np.diag_indices(self._index.size)
        self._programs: dict[int, Any] = {}

    def step(
        self,
        q: Array,
        residuals: Sequence[Array],
        reference: Array,
        damping: float,
        half_spaces: HalfSpaces | None = None,
    ) -> Array | None:
        """Return the step dq from q, shape (n,) each [rad or m]; see `StepSolver`."""
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
        """Return the change of the k movable joints that minimizes the quadratic program.

        Args:
            hessian: Second derivative of the cost, shape (k, k).
            gradient: First derivative of the cost, shape (k,).
            lower: Lower bound of the change [rad or m], shape (k,).
            upper: Upper bound of the change [rad or m], shape (k,).
            half_spaces: Further inequalities, or None.

        Returns:
            The change [rad or m], shape (k,); None where the program has no solution.
        """
        library = self._library
        rows = 0 if half_spaces is None else half_spaces.offsets.size
        normals = None if half_spaces is None else half_spaces.normals[:, self._index]
        offsets = None if half_spaces is None else half_spaces.offsets
        least = None if half_spaces is None else np.full(rows, -1e20)
        program = self._programs.get(rows)
        if program is None:
            program = library.dense.QP(self._index.size, 0, rows, True)
            program.settings.eps_abs = ACCURACY
            # After a warm start, small residuals alone do not show that the active bounds are right.
            program.settings.check_duality_gap = True
            program.settings.eps_duality_gap_abs = ACCURACY
            program.settings.max_iter = 1000
            program.settings.initial_guess = library.InitialGuess.WARM_START_WITH_PREVIOUS_RESULT
            program.init(hessian, gradient, None, None, normals, least, offsets, lower, upper)
            self._programs[rows] = program
        else:
            program.update(
                H=hessian, g=gradient, A=None, b=None, C=normals, l=least, u=offsets,
                l_box=lower, u_box=upper, update_preconditioner=True,
            )  # fmt: skip
        program.solve()
        solved = program.results.info.status == library.QPSolverOutput.PROXQP_SOLVED
        change = np.array(program.results.x)
        return change if solved and np.isfinite(change).all() else None
