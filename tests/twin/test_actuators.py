"""Actuators: closed forms of one joint for every part of the law, and what is refused."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.twin import Twin, actuator_parameters

ROTOR = """
<robot name="rotor"><link name="world"/>
  <link name="disc"><inertial><mass value="2"/>
    <inertia ixx="0.5" iyy="0.5" izz="0.5" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="J" type="revolute"><parent link="world"/><child link="disc"/><axis xyz="0 0 1"/>
    <limit lower="-90" upper="90" velocity="100" effort="1000"/></joint>
</robot>"""
INERTIA = 0.5


@pytest.fixture(scope="module")
def rotor():
    return pk.load_robot(ROTOR)


def twin(rotor, h=1e-3, substeps=1, **changes):
    limp = {"stiffness": 0.0, "damping": 0.0, "torque_limit": np.inf}
    params = actuator_parameters(rotor).changed(**{**limp, **changes})
    return Twin(rotor, h, actuators=params, substeps=substeps, feedforward="none")


def spin(machine, steps, v=0.0, target=0.0, **more):
    """Follow one constant reference from rest or from a speed."""
    machine.reset([0.0], [v])
    return machine.follow(np.full((steps, 1), target), **{k: np.full((steps, 1), x) for k, x in more.items()})


def test_every_parameter_stands_in_the_table_of_its_page():
    page = (Path(__file__).parents[2] / "docs" / "twin.md").read_text("utf-8")
    rows = re.findall(r"^\| (`[^|]+) \|", page, re.MULTILINE)
    named = {name for row in rows for name in re.findall(r"`(\w+)`", row)}
    fields = {field.name for field in dataclasses.fields(pk.twin.ActuatorParameters)}
    missing = sorted(fields - named - {"joint_names", "sources"})
    assert not missing, f"add a row to the table of actuators in docs/twin.md for {missing}"


def test_coulomb_friction_slows_down_evenly_and_then_holds(rotor):
    run = spin(twin(rotor, coulomb_friction=0.25), 300, v=0.1)
    falling = run.time[run.time <= 0.2]
    np.testing.assert_allclose(run.velocity[: falling.size, 0], 0.1 - 0.25 / INERTIA * falling, atol=1e-8)
    assert np.abs(run.velocity[202:]).max() < 1e-8
    end = 0.1**2 / (2 * 0.25 / INERTIA)
    assert run.position[-1, 0] == pytest.approx(end, abs=0.1 * 1e-3)


def test_coulomb_friction_holds_up_to_its_torque_and_no_further(rotor):
    machine = twin(rotor, coulomb_friction=0.25)
    stuck = spin(machine, 1000, load=0.2499)
    assert stuck.position[-1, 0] < 1e-8  # a creep of at most 1e-8 rad/s
    loose = spin(machine, 1000, load=0.26)
    np.testing.assert_allclose(loose.velocity[1:, 0], 0.01 / INERTIA * loose.time[1:], atol=2e-8)


def test_viscous_friction_decays_exponentially(rotor):
    ends = []
    for h in (1e-3, 5e-4):
        run = spin(twin(rotor, h, viscous_friction=2.0), round(0.5 / h), v=1.0)
        ends.append(run.velocity[-1, 0])
    exact = np.exp(-2.0 / INERTIA * 0.5)
    assert 2 * ends[1] - ends[0] == pytest.approx(exact, rel=1e-4)


def test_speed_ends_where_the_line_meets_the_friction(rotor):
    """stall (1 - v / no_load) = D v + C."""
    motor = {"stall_torque": 3.0, "no_load_speed": 6.0, "viscous_friction": 0.2, "coulomb_friction": 0.5}
    run = spin(twin(rotor, 0.01, mode="torque", **motor), 2000, effort=2.0)
    assert run.velocity[-1, 0] == pytest.approx((3.0 - 0.5) / (0.2 + 3.0 / 6.0), rel=1e-6)
    assert run.torque[1, 0] == pytest.approx(2.0)  # at rest what is wanted
    v = run.velocity[1:, 0]
    np.testing.assert_allclose(run.torque[1:, 0], np.minimum(2.0, 3.0 * (1 - v / 6.0)), rtol=1e-9)


def test_supply_brakes_above_the_no_load_speed(rotor):
    motor = {"stall_torque": 3.0, "no_load_speed": 6.0, "torque_limit": 2.0}
    run = spin(twin(rotor, mode="torque", **motor), 10, v=12.0, effort=2.0)
    np.testing.assert_allclose(run.torque[1:], -2.0)  # the line says -3, the current limit -2


def test_rotor_adds_its_inertia(rotor):
    run = spin(twin(rotor, mode="torque", rotor_inertia=1.5), 100, effort=4.0)
    np.testing.assert_allclose(run.velocity[1:, 0], 4.0 / (INERTIA + 1.5) * run.time[1:], rtol=1e-9)


def test_strength_scales_the_torque_as_stiffness_does_on_the_robot(rotor):
    """Gains, feed-forward and limit: half the strength is half of everything."""
    gains = {"stiffness": 40.0, "damping": 2.0, "torque_limit": 3.0}
    for target in (0.01, 5.0):
        whole = spin(twin(rotor, **{k: v / 2 for k, v in gains.items()}), 200, target=target)
        half = spin(twin(rotor, strength=0.5, **gains), 200, target=target)
        np.testing.assert_allclose(half.position, whole.position, rtol=1e-12)
        assert half.peak_torque <= 1.5
    limp = spin(twin(rotor, strength=0.0, **gains), 50, v=1.0, target=5.0)
    assert not limp.torque.any()
    np.testing.assert_allclose(limp.velocity, 1.0)


def test_velocity_mode_holds_a_speed_wherever_the_joint_is(rotor):
    """v+ = (J v + h Kd v_r) / (J + h Kd): first order with the time J / Kd."""
    machine = twin(rotor, mode="velocity", stiffness=1e6, damping=5.0)
    machine.reset([3.0])
    run = machine.follow(np.zeros((800, 1)), np.full((800, 1), 2.0))
    k = np.arange(801)
    exact = 2.0 * (1 - (1 + 1e-3 * 5.0 / INERTIA) ** -k)
    np.testing.assert_allclose(run.velocity[:, 0], exact, rtol=1e-9, atol=1e-12)


def test_torque_mode_gives_the_effort_and_takes_no_feedforward():
    pepper = pk.load_pepper()
    params = actuator_parameters(pepper).changed(mode={"LElbowYaw": "torque"})
    j = pepper.joint_index("LElbowYaw")
    machine = Twin(pepper, actuators=params)
    q = pepper.posture("Stand")
    state = machine.step(q, effort=0.2 * (np.arange(15) == j))
    assert state.torque[j] == pytest.approx(0.2, rel=1e-12)
    state = machine.step(q + 1.0)
    assert state.torque[j] == 0.0
    assert abs(state.torque[3]) > 1.0
    for feedforward in ("none", "inverse_dynamics"):
        machine = Twin(pepper, actuators=params, feedforward=feedforward)
        alone = machine.step(q)
        machine.reset()
        np.testing.assert_array_equal(machine.follow(q[None]).torque[1], alone.torque)
        assert alone.torque[j] == 0.0


@pytest.mark.parametrize("ticks", [1, 7])
def test_latency_shifts_the_response_by_its_ticks(rotor, ticks):
    gains = {"stiffness": 40.0, "damping": 2.0}
    prompt = spin(twin(rotor, **gains), 60, target=1.0)
    late = spin(twin(rotor, latency=ticks * 1e-3, **gains), 60, target=1.0)
    np.testing.assert_array_equal(late.position[ticks:], prompt.position[:-ticks])
    assert not late.position[: ticks + 1].any()
    machine = twin(rotor, latency=ticks * 1e-3, **gains)
    machine.reset([0.0])
    for k in range(1, 61):
        assert machine.step([1.0]).position == late.position[k]


def test_servo_sees_what_the_encoder_resolves(rotor):
    """Half a step from the target shows no error; beyond, a whole step."""
    machine = twin(rotor, stiffness=40.0, encoder_resolution=0.01)
    for start, error in ((0.0049, 0.0), (0.0051, -0.01), (-0.0149, 0.01)):
        machine.reset([start])
        torque = machine.step([0.0]).torque[0]
        assert torque == pytest.approx(40.0 * error, rel=1e-4, abs=1e-12)


@pytest.mark.thorough
@pytest.mark.parametrize("h", [1e-4, 1e-3, 5e-3, 0.02])
def test_a_pepper_with_all_of_it_comes_to_rest_and_stays(h):
    pepper = pk.load_pepper()
    machine = Twin(pepper, h, actuators=actuator_parameters(pepper, "motor"))
    target = pepper.posture("Stand") + 0.05 * (-1.0) ** np.arange(15)
    run = machine.follow(np.tile(target, (round(3 / h), 1)))
    assert run.success
    assert np.abs(run.position[-1] - target).max() < 0.003
    assert np.ptp(run.position[-len(run) // 10 :], axis=0).max() < 0.002


def test_motors_of_the_data_file():
    pepper = pk.load_pepper(hands="mimic", base="planar")
    params = actuator_parameters(pepper, "motor")
    moved = np.array([not name.startswith("Base") for name in pepper.joint_names])
    for quantity in ("rotor_inertia", "viscous_friction", "coulomb_friction", "encoder_resolution"):
        assert np.all((getattr(params, quantity) > 0) == moved), quantity
    assert np.all(params.no_load_speed[moved] > pepper.velocity_limits[moved])
    assert np.all(params.stall_torque[moved] > params.torque_limit[moved])
    assert np.all(params.coulomb_friction < 0.1 * params.torque_limit)
    assert params.latency == 0.02
    left, right = ([pepper.joint_index(s + k) for k in ("ElbowRoll", "Hand")] for s in "LR")
    np.testing.assert_array_equal(params.rotor_inertia[left], params.rotor_inertia[right])
    assert not actuator_parameters(pepper).coulomb_friction.any()


def test_bad_parameters_are_refused(rotor):
    for change, message in [
        ({"strength": 1.1}, "strength of J: got 1.1, expected a number from 0 to 1"),
        ({"strength": np.nan}, "strength: got nan"),
        ({"coulomb_friction": -1}, "coulomb_friction of J: got -1.0, expected a number of at least 0"),
        ({"rotor_inertia": np.inf}, "rotor_inertia: got inf"),
        ({"stall_torque": 0.0}, "stall_torque of J: got 0.0, expected a number above 0"),
        (
            {"no_load_speed": 5.0},
            "stall_torque of J: got inf, expected a number, as there is",
        ),
        ({"mode": "brake"}, "mode of J: got 'brake', expected one of 'position', 'velocity', 'torque'"),
        ({"mode": ("position", "torque")}, "mode: got 2 modes, expected one for each of 1 joints"),
        ({"latency": -1}, "latency: got -1, expected a finite time of at least 0 s"),
        ({"latency": np.nan}, "latency: got nan"),
    ]:
        with pytest.raises(InvalidValueError, match=message):
            actuator_parameters(rotor).changed(**change)


def test_unknown_names_are_refused(rotor):
    with pytest.raises(UnknownNameError, match="unknown quantity of an actuator 'gain'; available: "):
        actuator_parameters(rotor).changed(gain=1.0)
    with pytest.raises(UnknownNameError, match="unknown joint 'K'; available: J"):
        actuator_parameters(rotor).changed(damping={"K": 1.0})
    with pytest.raises(InvalidValueError, match="detail: got 'all', expected one of 'servo', 'motor'"):
        actuator_parameters(rotor, "all")
