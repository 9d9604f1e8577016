"""The contact problem's solution against its own conditions, proxsuite and non-negative least squares."""

import numpy as np
import pytest
from scipy.optimize import nnls

from pepper_kin.core.simulation.contact_solver import ContactProblem, newton, room_for
from pepper_kin.twin.world.proxsuite_solver import ImpulseProblem, ImpulseProgram


def random_problem(seed, count, size):
    """A problem like those of boxes: fewer velocities than edges, impulses not unique but for R."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(size, size))
    mass = root @ root.T + 0.1 * np.eye(size)
    jacobian = rng.normal(size=(3 * count, size))
    response = np.linalg.solve(mass, jacobian.T).T.copy()
    diagonal = np.einsum("ij,ij->i", jacobian, response)
    friction = rng.uniform(0.0, 1.0, count)
    return ContactProblem(
        mass=mass,
        free=rng.normal(size=size),
        start=np.zeros(size),
        jacobian=jacobian,
        response=response,
        compliance=1e-5 * diagonal.reshape(-1, 3).sum(axis=1),
        bias=rng.uniform(-0.2, 0.2, count),
        friction=friction,
        tangents=np.zeros((count, 3)),
        columns=np.zeros(0, np.int64),
        room=np.empty(room_for(count, size)),
        sound=True,
    )


def impulses_of(problem):
    return ImpulseProblem(*(getattr(problem, name) for name in ImpulseProblem._fields))


def edge_matrix(friction):
    """Edges of all pyramids in terms of normals and tangents, shape (4 k, 3 k)."""
    rows = np.zeros((4 * len(friction), 3 * len(friction)))
    for c, mu in enumerate(friction):
        for e, (first, second) in enumerate(((mu, 0), (-mu, 0), (0, mu), (0, -mu))):
            rows[4 * c + e, 3 * c : 3 * c + 3] = 1.0, first, second
    return rows


def by_least_squares(problem):
    """The same minimum by Lawson and Hanson's active sets."""
    edges = edge_matrix(problem.friction)
    rows = edges @ problem.jacobian
    matrix = rows @ np.linalg.solve(problem.mass, rows.T) + np.diag(np.repeat(problem.compliance, 4))
    gradient = rows @ problem.free + np.repeat(problem.bias, 4)
    upper = np.linalg.cholesky(matrix).T
    forces, _ = nnls(upper, -np.linalg.solve(upper.T, gradient), maxiter=10000)
    return forces @ edges, forces, matrix @ forces + gradient


def by_newton(problem):
    pushes = np.empty(len(problem.jacobian))
    u = problem.start.copy()
    steps = newton(problem, problem.bias, u, pushes)
    assert steps >= 0
    return pushes, u


CASES = [(seed, count, size) for seed in range(8) for count, size in ((1, 6), (4, 6), (6, 21), (12, 27))]


@pytest.mark.parametrize(("seed", "count", "size"), CASES)
def test_newton_agrees_with_non_negative_least_squares(seed, count, size):
    problem = random_problem(seed, count, size)
    pushes, u = by_newton(problem)
    wanted, forces, slack = by_least_squares(problem)
    assert forces.min() >= 0.0
    assert slack.min() > -1e-9
    scale = np.abs(wanted).max() + 1e-3
    assert np.abs(pushes - wanted).max() < 1e-5 * scale
    after = problem.free + problem.response.T @ wanted
    assert np.abs(u - after).max() < 1e-8


@pytest.mark.parametrize(("seed", "count", "size"), CASES)
def test_proxsuite_agrees_with_newton(seed, count, size):
    problem = random_problem(seed, count, size)
    pushes = ImpulseProgram().solve(impulses_of(problem))
    _, u = by_newton(problem)
    assert pushes is not None
    assert np.abs(problem.free + problem.response.T @ pushes - u).max() < 1e-6


def test_a_program_solved_again_starts_where_it_ended():
    problem = random_problem(3, 4, 6)
    program = ImpulseProgram()
    first = program.solve(impulses_of(problem))
    again = program.solve(impulses_of(problem._replace(free=problem.free + 1e-3)))
    fresh = ImpulseProgram().solve(impulses_of(problem._replace(free=problem.free + 1e-3)))
    assert np.abs(first - again).max() > 1e-6
    assert np.abs(problem.response.T @ (again - fresh)).max() < 1e-7


def test_newton_says_when_the_matrix_is_not_positive_definite():
    problem = random_problem(0, 1, 6)
    steps = newton(problem._replace(mass=-problem.mass), problem.bias, problem.start.copy(), np.empty(3))
    assert steps == -1
