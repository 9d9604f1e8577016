"""One state by machine code over tables: Pinocchio's results on many robots, and laws without it."""

import threading

import numpy as np
import pytest
from robots import NAMES, ODD, loaded

import pepper_kin as pk
from pepper_kin import dynamics
from pepper_kin.exceptions import InvalidValueError, ModelError

STATES = 200


def robot_of(name):
    """Return a robot; the odd one as its URDF has it, since gears can only be added by hand."""
    return pk.load_robot(ODD) if name == "odd" else loaded(name)


@pytest.fixture(scope="module", params=NAMES)
def robot(request):
    return robot_of(request.param)


def random_states(robot, count, seed=0):
    rng = np.random.default_rng(seed)
    lower, upper = np.clip(robot.lower_limits, -3, 3), np.clip(robot.upper_limits, -3, 3)
    q = rng.uniform(lower, upper, (count, robot.n))
    return q, rng.normal(size=q.shape) * 3, rng.normal(size=q.shape) * 10


def error_of(found, expected):
    """Greatest difference beside the greatest number, of each matrix or vector by itself."""
    pairs = zip(found, expected, strict=True) if isinstance(found, tuple) else [(found, expected)]
    return max(np.abs(x - y).max() / np.abs(y).max() for x, y in pairs)


@pytest.mark.parametrize(
    ("function", "inputs"),
    [
        (dynamics.inverse_dynamics, 3),
        (dynamics.forward_dynamics, 3),
        (dynamics.gravity_torque, 1),
        (dynamics.mass_matrix, 1),
        (dynamics.inverse_dynamics_derivatives, 3),
    ],
)
def test_results_are_those_of_pinocchio(robot, function, inputs):
    for state in zip(*random_states(robot, STATES)[:inputs], strict=True):
        found, expected = function(robot, *state), function(robot, *state, solver="pinocchio")
        assert error_of(found, expected) < 1e-12


def test_inverses_multiply_to_one_and_derivatives_follow(robot):
    """Where light fingers make M stiff, Pinocchio's inverse is less exact than the product can be."""
    for q, v, a in zip(*random_states(robot, 20, seed=1), strict=True):
        inverse = dynamics.inverse_mass_matrix(robot, q)
        np.testing.assert_array_equal(inverse, inverse.T)
        mass = dynamics.mass_matrix(robot, q, solver="pinocchio")
        bound = 1e-14 * np.linalg.cond(mass)
        assert np.abs(mass @ inverse - np.eye(robot.n)).max() < bound
        by = dynamics.forward_dynamics_derivatives(robot, q, v, a)
        torque = dynamics.inverse_dynamics_derivatives(robot, q, v, dynamics.forward_dynamics(robot, q, v, a))
        np.testing.assert_array_equal(by.da_dtau, inverse)
        for found, expected in ((by.da_dq, -torque.dtau_dq), (by.da_dv, -torque.dtau_dv)):
            assert error_of(mass @ found, expected) < bound


def changes(function, state, place, step):
    """Return the slopes of a function of joint vectors by one of them: central differences."""
    columns = []
    for j in range(len(state[0])):
        ends = []
        for sign in (1, -1):
            moved = [x.copy() for x in state]
            moved[place][j] += sign * step
            ends.append(function(*moved))
        columns.append((ends[0] - ends[1]) / (2 * step))
    return np.stack(columns, axis=1)


@pytest.mark.parametrize("name", ["odd", "pepper-planar-mimic", "panda"])
def test_derivatives_are_slopes(name):
    """Sliding and turning joints, branches, and joints that follow others by a factor and an offset."""
    robot = robot_of(name)
    for state in zip(*random_states(robot, 3, seed=2), strict=True):
        for function, derivatives in (
            (dynamics.inverse_dynamics, dynamics.inverse_dynamics_derivatives),
            (dynamics.forward_dynamics, dynamics.forward_dynamics_derivatives),
        ):
            for place, found in enumerate(derivatives(robot, *state)):
                slope = changes(lambda *x, f=function: f(robot, *x), state, place, 1e-5)
                assert error_of(found, slope) < 1e-6


def test_energy_is_what_torques_put_in():
    """d/dt (v . M v / 2) = v . (tau - g) at the acceleration that tau causes."""
    robot = pk.load_pepper("planar")
    for q, v, tau in zip(*random_states(robot, 5, seed=3), strict=True):
        a = dynamics.forward_dynamics(robot, q, v, tau)

        def energy(t, q=q, v=v, a=a):
            rate = v + a * t
            return rate @ dynamics.mass_matrix(robot, q + v * t + a * t * t / 2) @ rate / 2

        slope = (energy(1e-6) - energy(-1e-6)) / 2e-6
        assert slope == pytest.approx(v @ (tau - dynamics.gravity_torque(robot, q)), rel=1e-5)


def test_what_is_changed_in_a_model_counts():
    """Gears and gravity."""
    plain = pk.load_pepper()
    model = plain.pinocchio_model
    q, v, tau = (x[0] for x in random_states(plain, 1))
    mass = dynamics.mass_matrix(plain, q)
    for armature in (0.1, 0.3):
        model.armature[:] = armature
        robot = plain.with_pinocchio_model(model)
        heavier = dynamics.mass_matrix(robot, q)
        np.testing.assert_allclose(heavier - mass, armature * np.eye(robot.n), atol=1e-12)
        a = dynamics.forward_dynamics(robot, q, v, tau)
        np.testing.assert_allclose(dynamics.inverse_dynamics(robot, q, v, a), tau, atol=1e-11)
        np.testing.assert_allclose(dynamics.inverse_mass_matrix(robot, q) @ heavier, np.eye(15), atol=1e-11)
    model.gravity.linear = np.zeros(3)
    robot = plain.with_pinocchio_model(model)
    np.testing.assert_array_equal(dynamics.gravity_torque(robot, q), 0.0)
    by = dynamics.inverse_dynamics_derivatives(robot, q, 0 * q, 0 * q)
    np.testing.assert_array_equal(by.dtau_dq, 0.0)
    np.testing.assert_allclose(dynamics.mass_matrix(plain, q), mass, atol=1e-12)


def chain(count):
    """A chain of equal links about axes in turn."""
    link = (
        '<link name="l{0}"><inertial><origin xyz="0.05 0 0.02"/><mass value="0.5"/>'
        '<inertia ixx="1e-3" ixy="0" ixz="0" iyy="2e-3" iyz="0" izz="2e-3"/></inertial></link>'
    )
    joint = (
        '<joint name="j{0}" type="continuous"><parent link="l{1}"/><child link="l{0}"/>'
        '<origin xyz="0.1 0 0"/><axis xyz="{2}"/></joint>'
    )
    axes = "1 0 0", "0 1 0", "0 0 1"
    parts = [link.format(i) for i in range(count + 1)]
    parts += [joint.format(i, i - 1, axes[i % 3]) for i in range(1, count + 1)]
    return pk.load_robot(f'<robot name="chain">{"".join(parts)}</robot>')


@pytest.mark.parametrize("count", [30, 60, 70])
def test_long_chains_agree_by_the_torques_that_accelerations_explain(count):
    """The longest through Pinocchio's recursion, which then takes less time than a mass matrix."""
    robot = chain(count)
    for q, v, tau in zip(*random_states(robot, 3), strict=True):
        a = dynamics.forward_dynamics(robot, q, v, tau)
        explained = dynamics.inverse_dynamics(robot, q, v, a, solver="pinocchio")
        size = np.abs(dynamics.inverse_dynamics(robot, q, v, 0 * a)).max()
        assert np.abs(explained - tau).max() < 1e-11 * size
        mass = dynamics.mass_matrix(robot, q)
        unit = dynamics.inverse_mass_matrix(robot, q) @ mass
        np.testing.assert_allclose(unit, np.eye(count), atol=1e-14 * np.linalg.cond(mass))


@pytest.mark.parametrize("function", [dynamics.forward_dynamics, dynamics.forward_dynamics_derivatives])
def test_what_is_nearly_singular_is_left_to_pinocchio(function):
    """Rounding leaves little of the last pivot of joints in line, but not nothing."""
    link = """<link name="arm"><inertial><origin xyz="0.1 0.2 0"/><mass value="1"/>
      <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>"""
    joint = """<joint name="{}" type="continuous"><parent link="{}"/><child link="{}"/>
      <origin xyz="0 0 {}"/><axis xyz="{}"/></joint>"""
    parts = ['<link name="base"/><link name="a"/><link name="b"/>', link]
    parts += [joint.format("lift", "base", "a", 0.3, "0 1 0")]
    parts += [joint.format("first", "a", "b", 0.1, "0 0.6 0.8")]
    parts += [joint.format("second", "b", "arm", 0, "0 0.6 0.8")]
    robot = pk.load_robot(f'<robot name="r">{"".join(parts)}</robot>')
    for q in np.random.default_rng(0).uniform(-3, 3, (20, 3)):
        try:
            expected = function(robot, q, 0 * q, 0 * q + 1, solver="pinocchio")
        except ModelError:
            with pytest.raises(ModelError, match="no mass is moved when these move together: first, second"):
                function(robot, q, 0 * q, 0 * q + 1)
        else:
            np.testing.assert_array_equal(function(robot, q, 0 * q, 0 * q + 1), expected)


def test_any_arrays_of_numbers_give_the_same():
    robot = pk.load_pepper()
    state = [x[0] for x in random_states(robot, 1)]
    expected = dynamics.forward_dynamics(robot, *state)
    wide = [np.repeat(x, 2)[::2] for x in state]
    for other in (wide, [x.tolist() for x in state], [x.astype(np.longdouble) for x in state]):
        np.testing.assert_array_equal(dynamics.forward_dynamics(robot, *other), expected)
    few = dynamics.forward_dynamics(robot, *(np.tile(x, (2, 3, 1)) for x in state))
    np.testing.assert_array_equal(few, np.broadcast_to(expected, (2, 3, robot.n)))


def test_threads_do_not_disturb_each_other():
    robot = pk.load_pepper(hands="independent")
    states = list(zip(*random_states(robot, 40), strict=True))
    expected = [dynamics.forward_dynamics(robot, *state) for state in states]
    wrong = []

    def work():
        for _ in range(20):
            for state, a in zip(states, expected, strict=True):
                if not np.array_equal(dynamics.forward_dynamics(robot, *state), a):
                    wrong.append(state)

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


def test_other_solvers_are_refused_by_name():
    robot = pk.load_pepper()
    q = robot.neutral()
    for call in (
        lambda: dynamics.mass_matrix(robot, q, solver="pinochio"),
        lambda: dynamics.inverse_dynamics(robot, q, q, q, {"Head": np.zeros(6)}, solver="pinochio"),
        lambda: dynamics.forward_dynamics_derivatives(robot, q, q, q, solver="pinochio"),
    ):
        with pytest.raises(InvalidValueError, match="solver: got 'pinochio', expected one of 'robot'"):
            call()


@pytest.mark.parametrize("count", [1, 2, 23, 24])
def test_a_few_rows_are_their_states_one_by_one(count):
    robot = pk.load_pepper()
    q, v, a = (array[:count] for array in random_states(robot, 24))
    for function, state in (
        (dynamics.inverse_dynamics, (q, v, a)),
        (dynamics.forward_dynamics, (q, v, a)),
        (dynamics.mass_matrix, (q,)),
        (dynamics.gravity_torque, (q,)),
    ):
        expected = np.array([function(robot, *row, solver="pinocchio") for row in zip(*state, strict=True)])
        for given in (state, [np.asfortranarray(x) for x in state], [list(x) for x in state]):
            np.testing.assert_allclose(function(robot, *given), expected, rtol=1e-10, atol=1e-10)
    shared = dynamics.inverse_dynamics(robot, q, v[0], a[0])
    np.testing.assert_allclose(shared[-1], dynamics.inverse_dynamics(robot, q[-1], v[0], a[0]), atol=1e-11)
    q[-1, 3] = np.nan
    with pytest.raises(InvalidValueError, match=f"q: got nan at joint {robot.joint_names[3]}"):
        dynamics.inverse_dynamics(robot, q, v, a)
