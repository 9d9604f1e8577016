"""Check of a robot's dynamics against Newton-Euler, finite differences and conservation of energy."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from inspect import signature
from typing import Any

import numpy as np

from pepper_kin import batch, dynamics, kinematics, symbolic
from pepper_kin.arrays import Array
from pepper_kin.dynamics import newton_euler
from pepper_kin.dynamics.tree_tables import SOLVERS
from pepper_kin.exceptions import ModelError
from pepper_kin.jobs.dynamics_check import DynamicsCheck, DynamicsCheckRow
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import check_seed, check_whole

AGREEMENT_LIMIT = 1e-9
"""Maximum relative error between two exact algorithms, which differ by rounding only."""
DIFFERENCE_LIMIT = 1e-7
"""Maximum relative error of finite differences of fourth order, which lose up to half of the digits."""
ENERGY_LIMIT = 1e-8
"""Maximum relative error of the energy; the integrator keeps 1e-11 in each step."""
STEP = 1e-3
"""Step of finite differences along directions of norm one [rad or m, rad/s or m/s]."""
SMALLEST_SHARE = {AGREEMENT_LIMIT: 1e-5, DIFFERENCE_LIMIT: 1e-4}
"""Minimum scale of a joint's relative errors, as a fraction of the largest joint's values, for each limit."""


@dataclass(frozen=True)
class _States:
    """Random states with torques tau of the accelerations a, and unit directions of differentiation."""

    q: Array
    v: Array
    a: Array
    tau: Array
    direction: Array


def check_dynamics(
    pepper: PepperModel,
    *,
    states: int = 200,
    seed: int = 0,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> DynamicsCheck:
    """Compare a robot's dynamics with independent computations.

    Inverse dynamics, forward dynamics and mass matrix are compared with `dynamics.newton_euler`, which reads
    the URDF itself and shares no code with Pinocchio; derivatives with finite differences of fourth order.
    Each quantity has four forms: single states by Pinocchio and by machine code, symbolic (CasADi) and batch
    (kernels); Jacobians of single states are Pinocchio's only. Accelerations are compared by the torques that
    they need according to Newton-Euler, so that rounding does not fail for light fingers on a heavy arm. The
    change of energy over a second of motion under random torques is compared with the torques' work.

    Args:
        pepper: Any robot.
        states: Number of random states: positions within limits (and within 3 rad), velocities and
            accelerations of normal distribution with deviations 1 and 3 [rad/s, rad/s^2].
        seed: Seed of all random choices.
        progress: Function that is called with the numbers of finished and of all parts.

    Returns:
        Errors, limits and the verdict. A quantity that the robot does not have (forward dynamics with a joint
        that moves no mass) has a note.

    Raises:
        InvalidValueError: for a number of states or a seed that is not an integer in range.
    """
    check_whole("states", states, 1)
    check_seed(seed)
    rng = np.random.default_rng(seed)
    random = _random_states(pepper, states, rng)
    frame = _deepest_frame(pepper)
    parts: tuple[Callable[[], Iterable[DynamicsCheckRow]], ...] = (
        lambda: _algorithm_rows(pepper, random),
        lambda: _kinematic_rows(pepper, random, frame),
        lambda: _derivative_rows(pepper, random),
        lambda: [_energy_row(pepper, rng)],
    )
    rows: list[DynamicsCheckRow] = []
    for index, part in enumerate(parts):
        progress(index, len(parts))
        rows += part()
    progress(len(parts), len(parts))
    return DynamicsCheck(pepper.name, pepper.n, frame, states, seed, tuple(rows))


def _random_states(pepper: PepperModel, count: int, rng: np.random.Generator) -> _States:
    """Return random states with their torques by Newton-Euler."""
    lower, upper = np.clip(pepper.lower_limits, -3, 3), np.clip(pepper.upper_limits, -3, 3)
    shape = (count, pepper.n)
    q, v, a = rng.uniform(lower, upper, shape), rng.normal(size=shape), 3 * rng.normal(size=shape)
    direction = rng.normal(size=shape)
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    return _States(q, v, a, newton_euler(pepper, q, v, a), direction)


def _deepest_frame(pepper: PepperModel) -> str:
    """Return the first frame with the most joints above it."""
    model = pepper.inner_model
    depth = {
        name: len(model.supports[model.frames[pepper.frame_id(name)].parentJoint])
        for name in pepper.frame_names
    }
    return max(depth, key=lambda name: depth[name])


def _forms(
    pepper: PepperModel, single: Callable[..., Any], inputs: tuple[Array, ...], *args: str
) -> dict[str, Array]:
    """Return a quantity at each state in all its forms, shape (states, ...) each."""
    name = single.__name__
    by_solver = {solver: {"solver": solver} for solver in SOLVERS}
    ways = by_solver if "solver" in signature(single).parameters else {"pinocchio": {}}
    one_by_one = {
        form: np.array([single(pepper, *state, *args, **options) for state in zip(*inputs, strict=True)])
        for form, options in ways.items()
    }
    function = symbolic.function(pepper, name, *args)
    compiled = batch.kernel(pepper, name, *args)(*inputs)
    results = [_plain(function(*state)) for state in zip(*inputs, strict=True)]
    batched = np.stack(compiled, axis=1) if isinstance(compiled, tuple) else compiled
    shape = one_by_one["pinocchio"].shape
    return {
        **one_by_one,
        "symbolic": np.array(results).reshape(shape),
        "batch": np.reshape(batched, shape),  # a kernel returns a matrix of one column as a vector
    }


def _plain(result: Any) -> Array:
    """Return the result of a CasADi function as an array."""
    return np.array([np.array(part) for part in result]) if isinstance(result, tuple) else np.array(result)


def _row(
    quantity: str, against: str, limit: float, forms: dict[str, Array], expected: Array, size: float = 0.0
) -> DynamicsCheckRow:
    """Return the maximum errors over states, each entry relative to its maximum value over states.

    Values and `expected` have shape (states, ...). `size` is the magnitude of the values from which
    differences were taken, whose rounding remains after cancellation.
    """
    sizes = np.abs(expected).max(axis=0)
    scale = np.maximum(sizes, SMALLEST_SHARE[limit] * max(sizes.max(), size))
    # If all values are zero, errors are absolute.
    scale = np.where(scale > 0, scale, 1.0)
    errors = {
        form: float((np.abs(found - expected).max(axis=0) / scale).max()) for form, found in forms.items()
    }
    return DynamicsCheckRow(quantity, against, limit, errors)


def _needed_torques(pepper: PepperModel, q: Array, a: Array) -> Array:
    """Return M(q) a [N m or N] by Newton-Euler; q, a and the result have shape (N, n)."""
    rest = np.zeros_like(q)
    return newton_euler(pepper, q, rest, a) - newton_euler(pepper, q, rest, rest)


def _algorithm_rows(pepper: PepperModel, s: _States) -> list[DynamicsCheckRow]:
    """Check RNEA, CRBA and ABA."""
    torques = _forms(pepper, dynamics.inverse_dynamics, (s.q, s.v, s.a))
    masses = _forms(pepper, dynamics.mass_matrix, (s.q,))
    columns = [_needed_torques(pepper, s.q, np.broadcast_to(e, s.q.shape)) for e in np.eye(pepper.n)]
    against, limit = "Newton-Euler", AGREEMENT_LIMIT
    rows = [
        _row("inverse dynamics", against, limit, torques, s.tau),
        _row("mass matrix", against, limit, masses, np.stack(columns, axis=-1)),
    ]
    against = "Newton-Euler torques of the acceleration"
    try:
        found = _forms(pepper, dynamics.forward_dynamics, (s.q, s.v, s.tau))
    except ModelError as error:
        rows.append(DynamicsCheckRow("forward dynamics", against, limit, {}, str(error)))
    else:
        back = {form: newton_euler(pepper, s.q, s.v, a) for form, a in _finite(found).items()}
        rows.append(_row("forward dynamics", against, limit, {**found, **back}, s.tau))
    return rows


def _finite(forms: dict[str, Array]) -> dict[str, Array]:
    """Return the forms with finite values, shape (N, n); Newton-Euler would refuse others, which fail."""
    return {form: values for form, values in forms.items() if np.isfinite(values).all()}


def _difference(function: Callable[[float], Array]) -> Array:
    """Return df/dh at h = 0: (8 f(h) - 8 f(-h) - f(2h) + f(-2h)) / 12h, with the error f''''' h^4 / 30.

    The result has the shape of f(0).
    """
    h = STEP
    return (8 * (function(h) - function(-h)) - (function(2 * h) - function(-2 * h))) / (12 * h)


def _along(matrices: dict[str, Array], direction: Array) -> dict[str, Array]:
    """Return matrices, shape (N, m, n), times a direction per state, shape (N, n)."""
    return {form: np.einsum("...ij,...j->...i", matrix, direction) for form, matrix in matrices.items()}


def _kinematic_rows(pepper: PepperModel, s: _States, frame: str) -> list[DynamicsCheckRow]:
    """Check Jacobians along the directions, and the Jacobian's rate along the velocity."""

    def one_by_one(function: Callable[..., Array], q: Array, *args: str) -> Array:
        return np.array([function(pepper, state, *args) for state in q])

    pose = _difference(lambda h: one_by_one(kinematics.frame_pose, s.q + h * s.direction, frame))
    turn = pose[:, :3, :3] @ np.swapaxes(one_by_one(kinematics.frame_pose, s.q, frame)[:, :3, :3], 1, 2)
    twist = np.concatenate([pose[:, :3, 3], turn[:, [2, 0, 1], [1, 2, 0]]], axis=1)
    size = np.maximum(1.0, np.linalg.norm(s.v, axis=-1))[:, None, None]
    unit = s.v / size[:, 0]
    rate = size * _difference(lambda h: one_by_one(kinematics.frame_jacobian, s.q + h * unit, frame))
    center = _difference(lambda h: one_by_one(dynamics.center_of_mass, s.q + h * s.direction))
    against, limit = "finite differences", DIFFERENCE_LIMIT
    jacobians = _forms(pepper, kinematics.frame_jacobian, (s.q,), frame)
    rates = _forms(pepper, kinematics.frame_jacobian_rate, (s.q, s.v), frame)
    centers = _forms(pepper, dynamics.center_of_mass_jacobian, (s.q,))
    return [
        _row("frame Jacobian", against, limit, _along(jacobians, s.direction), twist, 1.0),
        _row("frame Jacobian rate", against, limit, rates, rate, 1.0),
        _row("center-of-mass Jacobian", against, limit, _along(centers, s.direction), center, 1.0),
    ]


def _derivative_rows(pepper: PepperModel, s: _States) -> list[DynamicsCheckRow]:
    """Check the derivatives of inverse and forward dynamics along the directions.

    For constant tau(q, v, a), dtau/dq d + M da/dq d = 0, and likewise for v, so M times the derivatives of
    forward dynamics follows from differences of Newton-Euler torques.
    """
    by_q = _difference(lambda h: newton_euler(pepper, s.q + h * s.direction, s.v, s.a))
    by_v = _difference(lambda h: newton_euler(pepper, s.q, s.v + h * s.direction, s.a))
    by_a = _needed_torques(pepper, s.q, s.direction)
    against, limit, size = "finite differences of Newton-Euler", DIFFERENCE_LIMIT, float(np.abs(s.tau).max())
    rows = []
    found = _forms(pepper, dynamics.inverse_dynamics_derivatives, (s.q, s.v, s.a))
    for k, (name, expected) in enumerate(
        (("d tau / d q", by_q), ("d tau / d v", by_v), ("d tau / d a", by_a))
    ):
        part = _along({form: blocks[:, k] for form, blocks in found.items()}, s.direction)
        rows.append(_row(name, against, limit, part, expected, size))
    names = ("d a / d q", "d a / d v", "d a / d tau")
    try:
        found = _forms(pepper, dynamics.forward_dynamics_derivatives, (s.q, s.v, s.tau))
    except ModelError as error:
        return rows + [DynamicsCheckRow(name, against, limit, {}, str(error)) for name in names]
    for k, (name, expected) in enumerate(zip(names, (-by_q, -by_v, s.direction), strict=True)):
        part = _along({form: blocks[:, k] for form, blocks in found.items()}, s.direction)
        torques = {form: _needed_torques(pepper, s.q, a) for form, a in _finite(part).items()}
        rows.append(_row(name, against, limit, {**part, **torques}, expected, size))
    return rows


def _energy_row(pepper: PepperModel, rng: np.random.Generator) -> DynamicsCheckRow:
    """Move for a second under random torques and compare the change of energy with the work done.

    The torques hold the first posture and add sines of random phase that would accelerate each joint alone by
    some rad/s^2. Position, velocity and work are integrated together by Dormand and Prince's method of order
    8.
    """
    from scipy.integrate import solve_ivp

    n, quantity, against = pepper.n, "energy over one second", "work of the torques"
    start = pepper.neutral()
    try:
        dynamics.inverse_mass_matrix(pepper, start)
    except ModelError as error:
        return DynamicsCheckRow(quantity, against, ENERGY_LIMIT, {}, str(error))
    hold = dynamics.gravity_torque(pepper, start)
    size = np.diag(dynamics.mass_matrix(pepper, start)) * rng.normal(size=n) * 5
    pace, phase = rng.uniform(2, 10, n), rng.uniform(0, 2 * np.pi, n)
    begin = np.concatenate([start, 0.1 * rng.normal(size=n), [0.0]])
    errors = {}
    for solver in SOLVERS:

        def rate(time: float, y: Array, solver: str = solver) -> Array:
            q, v = y[:n], y[n : 2 * n]
            tau = hold + size * np.sin(pace * time + phase)
            return np.concatenate([v, dynamics.forward_dynamics(pepper, q, v, tau, solver=solver), [tau @ v]])

        run = solve_ivp(rate, (0.0, 1.0), begin, method="DOP853", rtol=1e-11, atol=1e-12)
        if not run.success:
            return DynamicsCheckRow(quantity, against, ENERGY_LIMIT, {solver: np.inf}, str(run.message))
        kinetic = np.array([dynamics.kinetic_energy(pepper, y[:n], y[n : 2 * n]) for y in run.y.T])
        potential = np.array([dynamics.potential_energy(pepper, y[:n]) for y in run.y.T])
        gain = kinetic + potential - kinetic[0] - potential[0]
        turned_over = (kinetic + np.abs(potential - potential[0])).max()
        errors[solver] = float(np.abs(gain - run.y[-1]).max() / turned_over)
    return DynamicsCheckRow(quantity, against, ENERGY_LIMIT, errors)
