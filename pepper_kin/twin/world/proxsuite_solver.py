"""Contact solver by a quadratic program for impulses with proxsuite."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.model.joint_vectors import check_choice
from pepper_kin.proxsuite_library import proxqp

ACCURACY = 1e-9
"""Tolerance of ProxQP's residuals; an impulse of 1 changes its own edge's velocity by 1 m/s."""
ITERATIONS = 200
SOLVERS = ("compiled", "proxsuite")


def check_solver(name: str) -> str:
    """Return the name of a contact solver that can be used here.

    Raises:
        InvalidValueError: for another name than those of `SOLVERS`.
        MissingDependencyError: for "proxsuite" where it cannot be loaded.
    """
    if check_choice("solver", name, SOLVERS) == "proxsuite":
        proxqp()
    return name


class ImpulseProblem(NamedTuple):
    """A convex problem of k points and N velocities; see `core.simulation.contact_solver.ContactProblem`.

    Attributes:
        jacobian: Jacobian J with rows normal, first and second tangent of each point, shape (3 k, N).
        response: Matrix J M^-1, shape (3 k, N).
        free: Velocities without contact, shape (N,).
        compliance: Compliance R of each point's edges, shape (k,).
        bias: Bias of each point, including the contribution of sliding speeds, shape (k,).
        friction: Coefficient of friction mu of each point, shape (k,).
    """

    jacobian: Array
    response: Array
    free: Array
    compliance: Array
    bias: Array
    friction: Array


class ImpulseProgram:
    """Minimize f^T (A + R) f / 2 + f^T b over f >= 0, an impulse along each edge of the friction pyramids.

    With D the edges of all points (normal + mu tangent, normal - mu tangent, the same for the other tangent)
    in terms of their normals and tangents: A = D J M^-1 J^T D^T, b = D J u_free + bias.  Rows are scaled by
    the root of their diagonal.  One ProxQP object is kept for each number of points, and started from its
    last result.

    Bambade et al., ProxQP: an efficient and versatile quadratic programming solver for real-time robotics
    applications and beyond (2023).
    """

    def __init__(self) -> None:
        self._kept: dict[int, Any] = {}

    def solve(self, problem: ImpulseProblem) -> Array | None:
        """Return the impulses (normal, first, second tangent) of all points, shape (3 k,); None for none."""
        library, count = proxqp(), len(problem.bias)
        edges = _edges(problem.friction)
        rows, response = _edge_rows(edges, problem.jacobian), _edge_rows(edges, problem.response)
        hessian = response @ rows.T
        hessian[np.diag_indices(4 * count)] += np.repeat(problem.compliance, 4)
        scale = 1.0 / np.sqrt(hessian.diagonal())
        hessian = scale[:, None] * (0.5 * (hessian + hessian.T)) * scale
        gradient = scale * (rows @ problem.free + np.repeat(problem.bias, 4))
        solver = self._kept.get(count)
        if solver is None:
            none, ever = np.zeros(4 * count), np.full(4 * count, 1e20)
            solver = self._kept[count] = library.dense.QP(4 * count, 0, 0, True)
            solver.settings.eps_abs = ACCURACY
            solver.settings.eps_rel = 0.0
            solver.settings.max_iter = ITERATIONS
            solver.settings.initial_guess = library.InitialGuess.WARM_START_WITH_PREVIOUS_RESULT
            solver.init(hessian, gradient, None, None, None, None, None, none, ever)
        else:
            solver.update(H=hessian, g=gradient, update_preconditioner=False)
        solver.solve()
        solved = solver.results.info.status == library.QPSolverOutput.PROXQP_SOLVED
        forces = scale * np.maximum(solver.results.x, 0.0)
        if not (solved and np.isfinite(forces).all()):
            self._kept.pop(count)  # the next call starts cold
            return None
        return np.einsum("ke,kei->ki", forces.reshape(count, 4), edges).ravel()


def _edges(friction: Array) -> Array:
    """Return the edges of each point's pyramid as (normal, first, second tangent), shape (k, 4, 3).

    Args:
        friction: Coefficients of the points, shape (k,).
    """
    edges = np.zeros((len(friction), 4, 3))
    edges[:, :, 0] = 1.0
    edges[:, 0, 1], edges[:, 1, 1] = friction, -friction
    edges[:, 2, 2], edges[:, 3, 2] = friction, -friction
    return edges


def _edge_rows(edges: Array, rows: Array) -> Array:
    """Return rows of the edges, shape (4 k, N).

    Args:
        edges: Edges of each point's pyramid, shape (k, 4, 3).
        rows: Rows of normal, first and second tangent of each point, shape (3 k, N).
    """
    return np.einsum("kei,kin->ken", edges, rows.reshape(len(edges), 3, -1)).reshape(4 * len(edges), -1)
