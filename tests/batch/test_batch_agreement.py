"""The same numbers from Pinocchio, from the CasADi function and from the kernel."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin import batch, dynamics, kinematics, symbolic

TOLERANCE = 1e-9


def frame_of(robot):
    return "LArm_effector" if "LArm_effector" in robot.frame_names else robot.frame_names[-1]


def three(public, robot, inputs, *args):
    """Single, symbolic and batch results; the public function must itself give those of single and batch."""
    name = public.__name__
    single = np.array([public(robot, *state, *args) for state in zip(*inputs, strict=True)])
    function = symbolic.function(robot, name, *args)
    symbols = []
    for state in zip(*inputs, strict=True):
        result = function(*state)
        parts = result if isinstance(result, tuple) else (result,)
        symbols.append(np.array([np.array(part) for part in parts]))
    compiled = batch.kernel(robot, name, *args)(*inputs)
    compiled = np.stack(compiled, axis=1) if isinstance(compiled, tuple) else compiled
    many = public(robot, *inputs, *args)
    if isinstance(many, tuple):
        many = np.stack(many, axis=1)
    return single, np.array(symbols).reshape(single.shape), compiled.reshape(single.shape), many


def same(public, robot, inputs, *args):
    """Each state's results agree relative to its largest number."""
    single, *others = three(public, robot, inputs, *args)
    axes = tuple(range(1, single.ndim))
    scale = np.maximum(np.abs(single).max(axis=axes, keepdims=True), 1e-9)
    for form, other in zip(("symbolic", "batch", "public"), others, strict=True):
        assert other.shape == single.shape
        error = np.abs((other - single) / scale).max()
        assert error < TOLERANCE, f"{public.__name__}, {form}: {error:.1e}"


def test_kinematics(robot, states):
    q, v, a = states(robot)
    frame = frame_of(robot)
    same(kinematics.frame_poses, robot, (q,), tuple(robot.frame_names[::7]))
    same(kinematics.frame_jacobian, robot, (q,), frame)
    same(kinematics.frame_velocity, robot, (q, v), frame)
    same(kinematics.frame_acceleration, robot, (q, v, a), frame)


@pytest.mark.thorough
def test_torques_and_mass(robot, states):
    q, v, a = states(robot)
    same(dynamics.inverse_dynamics, robot, (q, v, a))
    same(dynamics.gravity_torque, robot, (q,))
    same(dynamics.mass_matrix, robot, (q,))
    same(dynamics.center_of_mass, robot, (q,))


@pytest.mark.thorough
def test_accelerations(robot, states):
    """Light fingers make M stiff: accelerations are compared by the torques that they explain."""
    q, v, a = states(robot)
    tau = dynamics.inverse_dynamics(robot, q, v, a)
    mass = dynamics.mass_matrix(robot, q)
    bias = dynamics.inverse_dynamics(robot, q, v, np.zeros(robot.n))
    scale = np.maximum(np.abs(tau).max(axis=1), np.abs(bias).max(axis=1)) + 1e-9
    single, *others = three(dynamics.forward_dynamics, robot, (q, v, tau))
    for form, other in zip(("given", "symbolic", "batch", "public"), (a, *others), strict=True):
        torque = np.einsum("kij,kj->ki", mass, other - single)
        assert np.abs(torque / scale[:, None]).max() < TOLERANCE, form


@pytest.mark.thorough
def test_derivatives_and_matrices(small_robot, states):
    robot = small_robot
    q, v, a = states(robot)
    frame = frame_of(robot)
    same(kinematics.frame_jacobian_rate, robot, (q, v), frame)
    same(dynamics.inverse_dynamics_derivatives, robot, (q, v, a))
    same(dynamics.coriolis_matrix, robot, (q, v))
    same(dynamics.center_of_mass_jacobian, robot, (q,))
    same(dynamics.centroidal_map, robot, (q,))
    same(dynamics.centroidal_inertia, robot, (q,))
    same(dynamics.centroidal_momentum, robot, (q, v))
    same(dynamics.kinetic_energy, robot, (q, v))
    same(dynamics.potential_energy, robot, (q,))
    same(dynamics.base_wrench, robot, (q, v, a))
    same(dynamics.regressor, robot, (q, v, a))
    same(dynamics.inverse_mass_matrix, robot, (q,))


def test_balance_agrees_where_it_exists():
    """At ordinary accelerations the floor pushes and the point is defined."""
    pepper = pk.load_pepper()
    rng = np.random.default_rng(1)
    q = rng.uniform(pepper.lower_limits, pepper.upper_limits, (40, pepper.n))
    v, a = 0.3 * rng.normal(size=(2, 40, pepper.n))
    single, *others = three(dynamics.zero_moment_point, pepper, (q, v, a))
    for other in others:
        np.testing.assert_allclose(other, single, rtol=0, atol=1e-9)


@pytest.mark.parametrize("count", [0, 1, batch.KERNEL_FROM - 1, batch.KERNEL_FROM, batch.KERNEL_FROM + 1])
def test_the_number_of_states_changes_nothing(panda, states, count):
    """Below and above the number from which kernels are used."""
    q, v, a = (x[:count] for x in states(panda))
    all_states = dynamics.inverse_dynamics(panda, *states(panda))
    found = dynamics.inverse_dynamics(panda, q, v, a)
    assert found.shape == (count, panda.n)
    np.testing.assert_allclose(found, all_states[:count], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("axes", [(2, 3), (7, 8), (4, 1, 14), (56, 1), (2, 0, 3)])
def test_several_batch_axes(panda, states, axes):
    count = int(np.prod(axes))
    q, v, a = (x[:count] for x in states(panda))
    flat = dynamics.inverse_dynamics(panda, q, v, a)
    found = dynamics.inverse_dynamics(panda, *(x.reshape(*axes, panda.n) for x in (q, v, a)))
    np.testing.assert_array_equal(found, flat.reshape(*axes, panda.n))
    jacobian = kinematics.frame_jacobian(panda, q.reshape(*axes, panda.n), frame_of(panda))
    assert jacobian.shape == (*axes, 6, panda.n)
    shaped = (x.reshape(*axes, panda.n) for x in (q, v, a))
    derivatives = dynamics.inverse_dynamics_derivatives(panda, *shaped)
    assert derivatives.dtau_dq.shape == (*axes, panda.n, panda.n)


@pytest.mark.parametrize("count", [5, 40])
def test_batch_axes_broadcast(panda, states, count):
    q, v, a = (x[:count] for x in states(panda))
    one = dynamics.inverse_dynamics(panda, q, v[0], a[0])
    grid = dynamics.inverse_dynamics(panda, q[:, None], v[None, :3], a[0])
    assert grid.shape == (count, 3, panda.n)
    np.testing.assert_allclose(grid[:, 0], one, rtol=1e-9, atol=1e-9)
    alone = dynamics.inverse_dynamics(panda, q[2], v[1], a[0])
    np.testing.assert_allclose(grid[2, 1], alone, rtol=1e-9, atol=1e-9)


def test_a_model_that_was_given_a_payload_gets_kernels_of_its_own():
    plain = pk.load_pepper()
    dynamics.gravity_torque(plain, np.zeros((50, plain.n)))  # its kernel is on disk now
    model = plain.pinocchio_model
    model.inertias[model.getJointId("LWristYaw")].mass += 0.5
    loaded = plain.with_pinocchio_model(model)
    q = np.random.default_rng(0).uniform(-0.5, 0.5, (50, plain.n))
    light, heavy = dynamics.gravity_torque(plain, q), dynamics.gravity_torque(loaded, q)
    assert np.abs(heavy - light).max() > 0.1
    for state, tau in zip(q[:5], heavy[:5], strict=True):
        np.testing.assert_allclose(dynamics.gravity_torque(loaded, state), tau, atol=1e-9)
