"""The integrator: closed forms, fitted order, energy, saturation, stops, coupled hands."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.twin import ActuatorParameters, Integrator, Twin, actuator_parameters
from pepper_kin.twin.command import Command

PENDULUM = """
<robot name="pendulum">
  <link name="world"/>
  <link name="arm"><inertial><origin xyz="0 0 -0.4"/><mass value="2"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="J" type="revolute"><parent link="world"/><child link="arm"/><axis xyz="{axis}"/>
    <limit lower="-9" upper="{upper}" velocity="100" effort="1000"/></joint>
</robot>"""
INERTIA = 0.01 + 2 * 0.4**2
WEIGHT = 2 * 9.81 * 0.4
ZERO = np.zeros(1)


def pendulum(axis="0 1 0", upper=9):
    return pk.load_robot(PENDULUM.format(axis=axis, upper=upper))


def servo(robot, stiffness=0.0, damping=0.0, torque_limit=np.inf):
    return actuator_parameters(robot).changed(stiffness=stiffness, damping=damping, torque_limit=torque_limit)


def simulate(integrator, q, v, steps, q_ref=None, v_ref=None, forward=None, load=None):
    n = len(q)
    q_ref, v_ref = (np.zeros(n) if x is None else x for x in (q_ref, v_ref))
    forward = np.zeros(n) if forward is None else forward
    log = []
    for _ in range(steps):
        q, v, tau = integrator.step(q, v, q_ref, v_ref, forward, load)
        log.append((q, v, tau))
    return tuple(np.array(x) for x in zip(*log, strict=True))


@pytest.mark.parametrize("ratio", [0.2, 1.0])
def test_order_of_a_servo_under_gravity_is_one(ratio):
    """Slope of the error over the timestep, against an integrator of order 8."""
    robot = pendulum()
    kp, kd = 40.0, 2 * ratio * np.sqrt(40.0 * INERTIA)
    q_ref = np.array([1.0])

    def slope(t, y):
        return [y[1], (kp * (1.0 - y[0]) - kd * y[1] - WEIGHT * np.sin(y[0])) / INERTIA]

    exact = solve_ivp(slope, (0, 0.4), [0.3, 0.0], method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
    steps = np.array([1e-3, 5e-4, 2.5e-4, 1.25e-4])
    errors = []
    for h in steps:
        q, v, _ = simulate(
            Integrator(robot, h, servo(robot, kp, kd)), np.array([0.3]), ZERO, round(0.4 / h), q_ref
        )
        errors.append(np.hypot(q[-1, 0] - exact[0], v[-1, 0] - exact[1]))
    order = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert order == pytest.approx(1.0, abs=0.05)


def test_order_for_the_whole_body_is_one():
    pepper = pk.load_pepper()
    q = pepper.posture("Stand")
    compliant = actuator_parameters(pepper)
    compliant = compliant.changed(
        stiffness=compliant.stiffness / 20, damping=compliant.damping / 4, torque_limit=np.inf
    )
    target = q + 0.1 * (-1.0) ** np.arange(pepper.n) * (np.arange(pepper.n) != 3)
    target = np.clip(target, pepper.lower_limits + 0.1, pepper.upper_limits - 0.1)

    def end(h):
        return simulate(Integrator(pepper, h, compliant), q, np.zeros(15), round(0.064 / h), target)[0][-1]

    best = 2 * end(2.5e-5) - end(5e-5)  # Richardson
    steps = np.array([8e-4, 4e-4, 2e-4])
    errors = [np.linalg.norm(end(h) - best) for h in steps]
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("ratio", [0.3, 1.0, 3.0])
def test_step_response_of_one_joint_is_the_closed_form(ratio):
    robot = pendulum(axis="0 0 1")
    kp, inertia = 50.0, 0.01
    omega = np.sqrt(kp / inertia)
    h = 1e-5
    integrator = Integrator(robot, h, servo(robot, kp, 2 * ratio * omega * inertia))
    q, _, _ = simulate(integrator, ZERO, ZERO, 6000, np.array([1.0]))
    t = h * np.arange(1, 6001)
    root = np.sqrt(complex(ratio**2 - 1))
    if ratio == 1.0:
        exact = 1 - np.exp(-omega * t) * (1 + omega * t)
    else:
        a, b = omega * (-ratio + root), omega * (-ratio - root)
        exact = (1 + (b * np.exp(a * t) - a * np.exp(b * t)) / (a - b)).real
    np.testing.assert_allclose(q[:, 0], exact, atol=2e-3)


def test_frictionless_swing_keeps_its_energy():
    """For a minute, by machine code."""
    robot = pendulum()
    twin = Twin(robot, 1e-3, actuators=servo(robot), feedforward="none")
    twin.reset([1.5])
    run = twin.follow(np.zeros((60_000, 1)))
    q, v = run.position, run.velocity
    energy = INERTIA * v[:, 0] ** 2 / 2 + WEIGHT * (1 - np.cos(q[:, 0]))
    start = WEIGHT * (1 - np.cos(1.5))
    assert np.abs(energy / start - 1).max() < 0.01
    first, last = energy[:6000].mean(), energy[-6000:].mean()
    assert abs(last / first - 1) < 1e-4
    assert np.abs(q).max() == pytest.approx(1.5, abs=0.01)


def test_body_swinging_freely_keeps_its_energy():
    """The mass matrix varies: drift and oscillation shrink with the step."""
    pepper = pk.load_pepper()
    limp = actuator_parameters(pepper).changed(stiffness=0, damping=0)
    start = pepper.joint_vector({"LShoulderPitch": 0.5, "RShoulderPitch": 0.8, "LElbowRoll": -0.8})
    free = [5, 10]
    start[7::5] = 0.3
    level = pk.dynamics.potential_energy(pepper, start)
    spread = []
    for h in (1e-3, 2.5e-4):
        q, v, _ = simulate(Integrator(pepper, h, limp), start, np.zeros(15), round(0.1 / h))
        energy = pk.dynamics.kinetic_energy(pepper, q, v) + pk.dynamics.potential_energy(pepper, q)
        assert np.all(q > pepper.lower_limits)
        assert np.all(q < pepper.upper_limits)
        spread.append(np.abs(energy - level).max() / pk.dynamics.kinetic_energy(pepper, q, v).max())
        assert np.abs(v[-1, free]).max() > 0.1
    assert spread[0] < 0.03
    assert spread[1] < 0.35 * spread[0]


@pytest.mark.parametrize("h", [1e-4, 1e-3, 5e-3, 0.02])
def test_at_rest_it_rests(h):
    pepper = pk.load_pepper()
    q = pepper.posture("Stand")
    integrator = Integrator(pepper, h, actuator_parameters(pepper))
    held = pk.dynamics.gravity_torque(pepper, q)
    positions, velocities, torques = simulate(integrator, q, np.zeros(15), 200, q, forward=held)
    assert np.abs(positions - q).max() < 1e-12
    assert np.abs(velocities).max() < 1e-10
    np.testing.assert_allclose(torques[-1], held, atol=1e-9)


@pytest.mark.parametrize("h", [1e-4, 1e-3, 5e-3, 0.02, 0.05])
def test_stiff_servos_are_stable_at_every_timestep(h):
    pepper = pk.load_pepper()
    start = pepper.posture("Stand")
    target = start + 0.02 * (-1.0) ** np.arange(15)
    integrator = Integrator(pepper, h, actuator_parameters(pepper))
    held = pk.dynamics.gravity_torque(pepper, target)
    q, v, _ = simulate(integrator, start, np.zeros(15), round(1.5 / h), target, forward=held)
    assert np.abs(q - start).max() < 0.1
    np.testing.assert_allclose(q[-1], target, atol=1e-4)
    assert np.abs(v[-1]).max() < 1e-3


def test_saturated_joint_accelerates_uniformly():
    robot = pendulum(axis="0 0 1")
    q, v, tau = simulate(
        Integrator(robot, 1e-3, servo(robot, 1e4, 0.0, 0.5)), ZERO, ZERO, 100, np.array([9.0])
    )
    np.testing.assert_allclose(tau, 0.5)
    np.testing.assert_allclose(v[:, 0], 0.5 / 0.01 * 1e-3 * np.arange(1, 101), rtol=1e-9)
    np.testing.assert_allclose(q[-1], 0.5 * 50 * 0.1**2, rtol=0.02)


@pytest.mark.parametrize("h", [1e-4, 1e-3, 5e-3])
def test_joint_stop_holds_and_swallows_the_impact(h):
    robot = pendulum(axis="0 0 1", upper=0.5)
    integrator = Integrator(robot, h, servo(robot))
    q, v, _ = simulate(integrator, ZERO, np.array([10.0]), round(0.3 / h))
    assert q.max() < 0.5 + 1e-3
    assert q.max() > 0.49
    assert v[-1, 0] <= 1e-6
    assert v.min() > -0.5  # hardly any rebound
    push, _, tau = simulate(integrator, q[-1], v[-1], round(0.3 / h), load=np.array([5.0]))
    assert push[-1, 0] == pytest.approx(0.5, abs=1e-3)
    assert np.all(tau == 0.0)
    away, _, _ = simulate(integrator, push[-1], ZERO, 3, load=np.array([-5.0]))
    np.testing.assert_allclose(np.diff(away[:, 0], 2), -5.0 / 0.01 * h**2, rtol=0.05)  # nothing sticks


def test_stop_passes_its_load_on_to_the_other_joints():
    pepper = pk.load_pepper()
    params = actuator_parameters(pepper)
    integrator = Integrator(pepper, 1e-3, params)
    q = pepper.posture("Stand")
    j = pepper.joint_index("LElbowRoll")
    v = 3.0 * (np.arange(15) == j)
    target = q.copy()
    target[j] = 1.0  # beyond the upper limit, -0.0087
    for _ in range(600):
        q, v, tau = integrator.step(q, v, target, 0 * v, pk.dynamics.gravity_torque(pepper, q))
    assert abs(q[j] - pepper.upper_limits[j]) < 1e-3
    assert tau[j] == pytest.approx(params.torque_limit[j])
    assert np.abs(v).max() < 1e-4


def test_the_shared_model_is_not_changed():
    pepper = pk.load_pepper()
    before = np.array(pepper.pinocchio_model.armature)
    tau = pk.dynamics.forward_dynamics(pepper, pepper.posture("Stand"), np.zeros(15), np.zeros(15))
    integrator = Integrator(pepper, 1e-3, actuator_parameters(pepper))
    simulate(integrator, pepper.posture("Stand"), np.zeros(15), 3)
    np.testing.assert_array_equal(pepper.pinocchio_model.armature, before)
    again = pk.dynamics.forward_dynamics(pepper, pepper.posture("Stand"), np.zeros(15), np.zeros(15))
    np.testing.assert_array_equal(tau, again)


def test_bad_timesteps_are_refused():
    for h in [0, -1e-3, np.nan, np.inf, "fast", 0.051, 1.0]:
        pepper = pk.load_pepper()
        with pytest.raises(InvalidValueError, match="timestep: got"):
            Integrator(pepper, h, actuator_parameters(pepper))


def test_actuators_of_other_joints_are_refused():
    with pytest.raises(InvalidValueError, match="joints of the actuators: got J, expected KneePitch"):
        Integrator(pk.load_pepper(), 1e-3, actuator_parameters(pendulum()))


def test_pepper_parameters_state_their_source():
    pepper = pk.load_pepper(base="planar", hands="mimic")
    params = actuator_parameters(pepper)
    assert set(params.sources) == {"assumed"}
    np.testing.assert_array_equal(params.torque_limit, pepper.effort_limits)
    assert params.stiffness[pepper.joint_index("KneePitch")] == 5500
    left, right = ([pepper.joint_index(s + k) for k in ("ShoulderPitch", "Hand")] for s in "LR")
    np.testing.assert_array_equal(params.damping[left], params.damping[right])


def test_other_robots_get_generic_parameters():
    params = actuator_parameters(pendulum())
    assert params.stiffness == 1000 / 0.005
    assert params.damping == pytest.approx(2 * np.sqrt(2e5 * INERTIA))
    assert "assumed" in params.sources[0]


def test_bad_gains_are_refused():
    for change, message in [
        ({"stiffness": np.nan}, "stiffness: got nan"),
        ({"stiffness": -1.0}, "stiffness of J: got -1.0, expected a number of at least 0"),
        ({"damping": -1.0}, "damping of J: got -1.0"),
        ({"torque_limit": 0.0}, "torque_limit of J: got 0.0, expected a number above 0"),
        ({"torque_limit": np.nan}, "torque_limit of J: got nan"),
        ({"stiffness": [1.0, 2.0]}, r"stiffness: got shape \(2,\)"),
    ]:
        with pytest.raises(InvalidValueError, match=message):
            actuator_parameters(pendulum()).changed(**change)


def test_gains_are_copied_and_read_only():
    gain = np.array([1.0])
    params = ActuatorParameters(("J",), gain, gain, gain, gain, gain, ("assumed",))
    gain[0] = 7
    assert params.stiffness == 1.0
    with pytest.raises(ValueError, match="read-only"):
        params.stiffness[0] = 2.0


def test_arrays_too_short_for_machine_code_are_refused(pepper):
    for change in [
        {"q": np.zeros(14)},
        {"q": np.zeros(14), "command": Command(*np.zeros((3, 1, 15))), "every": 1},
        {"command": Command(np.zeros((4, 15)), np.zeros((3, 15)), np.zeros((4, 15)))},
        {"command": Command(*np.zeros((3, 4, 14)))},
        {"load": np.zeros((3, 15))},
        {"every": 3},
        {"every": 0},
    ]:
        integrator = pk.twin.Integrator(pepper, 0.001, pk.Twin(pepper).actuators)
        rest = {"q": np.zeros(15), "v": np.zeros(15), "load": np.zeros((1, 15)), "every": 2}
        given = {**rest, "command": Command(*np.zeros((3, 4, 15)))}
        assert integrator.run(**given).good == 2
        with pytest.raises(InvalidValueError, match=r"state, command and load: got shapes .* \(T, 15\)"):
            integrator.run(**{**given, **change})
