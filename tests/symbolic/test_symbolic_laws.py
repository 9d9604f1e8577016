"""Laws that expressions keep whatever library they are compared with."""

import casadi
import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin import symbolic
from pepper_kin.symbolic.states import State, make_state, new_inputs
from pepper_kin.symbolic.tree import read_tree


def call(function, *args):
    return np.array(function(*args))


def central(function, x, direction, step=1e-6):
    return (function(x + step * direction) - function(x - step * direction)) / (2 * step)


def test_passivity(lawful_robot, states):
    """dM/dt - 2 C is skew: Coriolis forces do no work."""
    robot = lawful_robot
    mass, coriolis = symbolic.mass_matrix(robot), symbolic.coriolis_matrix(robot)
    q, v, _ = states(robot)["random again"]
    rate = central(lambda x: call(mass, x), q, v)
    difference = rate - 2 * call(coriolis, q, v)
    assert np.abs(difference + difference.T).max() < 1e-7 * np.abs(rate).max()
    zero = np.zeros(robot.n)
    bias = call(symbolic.inverse_dynamics(robot), q, v, zero) - call(symbolic.gravity_torque(robot), q)
    np.testing.assert_allclose(
        call(coriolis, q, v) @ v, bias.ravel(), atol=1e-10 * np.abs(bias).max() + 1e-12
    )


def test_forward_undoes_inverse(lawful_robot, states):
    robot = lawful_robot
    forward, inverse = symbolic.forward_dynamics(robot), symbolic.inverse_dynamics(robot)
    q, v, a = states(robot)["random again"]
    np.testing.assert_allclose(call(forward, q, v, inverse(q, v, a)).ravel(), a, rtol=1e-6, atol=1e-7)


def test_analytical_derivatives_equal_automatic_ones(small_robot, states):
    n = small_robot.n
    q, v, a = (casadi.SX.sym(name, n) for name in "qva")
    for by_hand, plain, third in (
        (symbolic.inverse_dynamics_derivatives, symbolic.inverse_dynamics, "a"),
        (symbolic.forward_dynamics_derivatives, symbolic.forward_dynamics, "tau"),
    ):
        result = plain(small_robot)(q, v, a)
        jacobian = casadi.Function("jacobian", [q, v, a], [casadi.jacobian(result, casadi.vertcat(q, v, a))])
        for name in ("random", "lower limits at rest", "in line"):
            state = states(small_robot)[name]
            found = np.hstack([np.array(block) for block in by_hand(small_robot)(*state)])
            expected = call(jacobian, *state)
            assert np.abs(found - expected).max() < 1e-8 * np.abs(expected).max(), (third, name)


def test_derivatives_by_finite_differences(small_robot, states):
    function, derivatives = (
        symbolic.inverse_dynamics(small_robot),
        symbolic.inverse_dynamics_derivatives(small_robot),
    )
    state = states(small_robot)["random"]
    for k, found in enumerate(derivatives(*state)):
        for j in range(small_robot.n):

            def along(x, k=k):
                return call(function, *(x if m == k else y for m, y in enumerate(state))).ravel()

            expected = central(along, state[k], np.eye(small_robot.n)[j])
            np.testing.assert_allclose(
                np.array(found)[:, j], expected, atol=1e-5 * np.abs(expected).max() + 1e-6
            )


def test_acceleration_is_the_rate_of_velocity_and_velocity_of_pose(lawful_robot, states):
    robot = lawful_robot
    frame = robot.frame_names[-1]
    q, v, a = states(robot)["random again"]
    step = 1e-5

    def at(t):
        return q + t * v + t * t / 2 * a, v + t * a

    pose = symbolic.frame_pose(robot, frame)
    before, now, after = (call(pose, at(t)[0]) for t in (-step, 0.0, step))
    velocity = call(symbolic.frame_velocity(robot, frame), q, v).ravel()
    spin = (after - before)[:3, :3] / (2 * step) @ now[:3, :3].T
    expected = [*(after - before)[:3, 3] / (2 * step), spin[2, 1], spin[0, 2], spin[1, 0]]
    np.testing.assert_allclose(velocity, expected, atol=1e-6 * (1 + np.abs(velocity).max()))
    twists = [call(symbolic.frame_velocity(robot, frame), *at(t)).ravel() for t in (-step, step)]
    acceleration = call(symbolic.frame_acceleration(robot, frame), q, v, a).ravel()
    rate = (twists[1] - twists[0]) / (2 * step)
    np.testing.assert_allclose(acceleration, rate, atol=1e-6 * (1 + np.abs(rate).max()))


def test_momentum_changes_by_the_floor(lawful_robot, states):
    """Newton and Euler for the whole robot: d/dt momentum = wrench of the floor + weight."""
    robot = lawful_robot
    q, v, a = states(robot)["random again"]
    mass, gravity = pk.dynamics.total_mass(robot), np.array([0, 0, -9.81])
    center = call(symbolic.center_of_mass(robot), q).ravel()
    momentum = symbolic.centroidal_momentum(robot)
    step = 1e-6

    def at(t):
        return call(momentum, q + t * v + t * t / 2 * a, v + t * a).ravel()

    rate = (at(step) - at(-step)) / (2 * step)
    wrench = call(symbolic.base_wrench(robot), q, v, a).ravel()
    force = wrench[:3] + mass * gravity
    # About the moving center of mass, which has a velocity along the linear momentum of all links.
    moment = wrench[3:] - np.cross(center, wrench[:3])
    scale = 1e-6 * (np.abs(wrench).max() + 1)
    np.testing.assert_allclose(rate[:3], force, atol=scale)
    np.testing.assert_allclose(rate[3:], moment, atol=scale)
    linear = call(symbolic.center_of_mass_jacobian(robot), q) @ v * mass
    np.testing.assert_allclose(at(0.0)[:3], linear, atol=1e-9 * (1 + np.abs(linear).max()))


def test_power_is_the_rate_of_energy(lawful_robot, states):
    robot = lawful_robot
    q, v, a = states(robot)["random again"]
    tau = call(symbolic.inverse_dynamics(robot), q, v, a).ravel()
    kinetic, potential = symbolic.kinetic_energy(robot), symbolic.potential_energy(robot)
    step = 1e-5

    def energy(t):
        moved = q + t * v + t * t / 2 * a
        return float(kinetic(moved, v + t * a)) + float(potential(moved))

    rate = (energy(step) - energy(-step)) / (2 * step)
    assert rate == pytest.approx(tau @ v, rel=1e-5, abs=1e-5)
    gravity = [central(lambda x: float(potential(x)), q, e) for e in np.eye(robot.n)]
    torque = call(symbolic.gravity_torque(robot), q).ravel()
    np.testing.assert_allclose(torque, gravity, atol=1e-6 * (1 + np.abs(torque).max()))


def test_torques_are_linear_in_inertial_parameters(small_robot, states):
    robot = small_robot
    parameters = np.concatenate([i.toDynamicParameters() for i in list(robot.pinocchio_model.inertias)[1:]])
    for q, v, a in states(robot).values():
        tau = call(symbolic.inverse_dynamics(robot), q, v, a).ravel()
        linear = call(symbolic.regressor(robot), q, v, a) @ parameters
        np.testing.assert_allclose(linear, tau, atol=1e-9 * np.abs(tau).max() + 1e-12)


def test_cosines_and_sines_may_be_given_instead_of_angles(states):
    """The recursions see cosines and sines only: any pair on the unit circle gives the same as its angle."""
    from pepper_kin.symbolic.functions import make_function
    from pepper_kin.symbolic.inverse_dynamics import full_torques

    pepper = pk.load_pepper()
    tree = read_tree(pepper, compact=True)
    graph, inputs = new_inputs(tree, "c", "s", "v", "a")
    state = State(tree, inputs["c"], inputs["s"], [0.0] * 15, inputs["v"], inputs["a"])
    function = make_function("f", graph, inputs, {"tau": [[t] for t in full_torques(state)]})
    q, v, a = states(pepper)["random"]
    found = call(function, np.cos(q), np.sin(q), v, a)
    np.testing.assert_allclose(found, call(symbolic.inverse_dynamics(pepper), q, v, a), rtol=1e-12)
    graph, inputs = new_inputs(tree, "q")
    assert make_state(tree, inputs["q"]).cosines[3].graph is graph
