"""Backlash and heat of the drives, against closed forms and an operator written down apart from the twin."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.core.simulation.actuator_model import CONTINUOUS as CONTINUOUS_ROW
from pepper_kin.core.simulation.actuator_model import LIMIT, ActuatorTable
from pepper_kin.core.simulation.actuator_model import PLAY as PLAY_ROW
from pepper_kin.core.simulation.drive_state import HELD
from pepper_kin.core.simulation.implicit_step import CONSTANT, CONSTANT_LIMIT
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.twin import Recorder, Twin, TwinBatch, actuator_parameters
from pepper_kin.twin.step_kernel import Variant, parameters
from pepper_kin.twin.world import World

DISC = """
<robot name="rotor"><link name="world"/>
  <link name="disc"><inertial><mass value="2"/>
    <inertia ixx="0.5" iyy="0.5" izz="0.5" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="J" type="revolute"><parent link="world"/><child link="disc"/><axis xyz="0 0 1"/>
    <limit lower="-9000" upper="9000" velocity="100" effort="1000"/></joint>
</robot>"""
H, PLAY, CONTINUOUS, TIME = 2e-3, 0.03, 2.0, 4.0
HEAT = {"continuous_torque": CONTINUOUS, "thermal_time": TIME}


@pytest.fixture(scope="module")
def rotor():
    return pk.load_robot(DISC)


def twin(rotor, **changes):
    stiff = {"stiffness": 5e4, "damping": 400.0, "torque_limit": np.inf}
    return Twin(
        rotor, H, actuators=actuator_parameters(rotor).changed(**{**stiff, **changes}), feedforward="none"
    )


def column(values):
    return np.asarray(values, dtype=float)[:, np.newaxis]


def test_loop_under_a_slow_sine_is_as_wide_as_the_play(rotor):
    t = H * np.arange(1, 12_001)
    reference = 0.2 * np.sin(0.8 * t)
    machine = twin(rotor, backlash=PLAY)
    run = machine.follow(column(reference), column(0.16 * np.cos(0.8 * t)))
    q, expected = run.position[1:, 0], []
    for wanted in reference:  # by cases, and from rest at 0
        last = expected[-1] if expected else 0.0
        if wanted - PLAY > last:
            last = wanted - PLAY
        elif wanted + PLAY < last:
            last = wanted + PLAY
        expected.append(last)
    np.testing.assert_allclose(q, expected, atol=2e-3)
    rising, falling = (np.diff(reference, prepend=0.0) * sign > 0 for sign in (1, -1))
    middle = (np.abs(reference) < 0.1) & (t > np.pi / 0.8)
    width = np.median((reference - q)[rising & middle]) - np.median((reference - q)[falling & middle])
    assert width == pytest.approx(2 * PLAY, abs=1e-3)
    assert np.ptp(q[t > 8]) == pytest.approx(2 * (0.2 - PLAY), abs=1e-3)
    area = np.abs(np.sum(q[-3926:] * np.diff(reference[-3927:])))  # of one period, 7.854 s
    assert area == pytest.approx(2 * PLAY * 2 * (0.2 - PLAY), rel=0.02)


def test_motion_within_the_play_moves_nothing_and_outlives_a_call(rotor):
    machine = twin(rotor, backlash=PLAY)
    small = 0.99 * PLAY * np.sin(np.arange(1, 501) / 40)
    assert np.abs(machine.follow(column(small), column(np.gradient(small, H))).position).max() == 0.0
    machine.follow(np.full((2000, 1), 0.1))
    assert machine.state.position[0] == pytest.approx(0.1 - PLAY, abs=1e-6)
    machine.follow(np.full((2000, 1), 0.1 - 1.9 * PLAY))
    assert machine.state.position[0] == pytest.approx(0.1 - PLAY, abs=1e-6)
    machine.reset([0.1])
    machine.follow(np.full((2000, 1), 0.1 - 0.9 * PLAY))
    assert machine.state.position[0] == pytest.approx(0.1, abs=1e-6)


def test_a_joint_within_its_play_sags_by_its_stiffness_and_creeps_no_further(rotor):
    machine = twin(rotor, backlash=PLAY)
    for _ in range(3):
        machine.follow(np.zeros((2000, 1)), load=np.full((2000, 1), 50.0))
        assert machine.state.position[0] == pytest.approx(50.0 / 5e4, rel=1e-6)


def test_constant_torque_heats_as_the_closed_form(rotor):
    machine = twin(rotor, mode="torque", **HEAT)
    for count in (1, 499, 700):
        machine.follow(np.zeros((count, 1)), effort=np.full((count, 1), 1.7))
        r = (1.7 / CONTINUOUS) ** 2
        expected = r * (1 - np.exp(-machine.state.time / TIME))
        assert machine.temperature[0] == pytest.approx(expected, rel=1e-11)
    hot = machine.temperature[0]
    machine.follow(np.zeros((1000, 1)))
    assert machine.temperature[0] == pytest.approx(hot * np.exp(-1000 * H / TIME), rel=1e-11)
    machine.reset()
    assert machine.temperature[0] == 0.0


@pytest.mark.parametrize("limit", [8.0, np.inf])
def test_torque_demanded_for_ever_ends_at_the_continuous_one(rotor, limit):
    """Full until warm, at ln(r / (r - 0.8)) time constants, then falling continuously and never too hot."""
    machine = twin(rotor, mode="torque", torque_limit=limit, **HEAT)
    machine.reset()
    run = machine.follow(np.zeros((20_000, 1)), effort=np.full((20_000, 1), 8.0))
    torque, r = run.torque[1:, 0], (8.0 / CONTINUOUS) ** 2
    theta = 0.8 + 0.2 * CONTINUOUS / 8.0  # where the derated limit meets the demand
    until = TIME * np.log(r / (r - theta))
    assert np.flatnonzero(torque < 8.0)[0] * H == pytest.approx(until, abs=2 * H)
    assert np.all(np.diff(torque) <= 1e-12)
    steepest = CONTINUOUS / 0.2 * (8.0 / CONTINUOUS) ** 2  # of tau_c / s, at its beginning
    assert np.abs(np.diff(torque)).max() < steepest * r * H / TIME
    assert torque[-1] == pytest.approx(CONTINUOUS, rel=1e-6)
    assert machine.temperature[0] == pytest.approx(1.0, rel=1e-6)
    hot = machine.follow(np.zeros((1, 1)), effort=np.full((1, 1), 8.0))
    assert hot.torque[1, 0] == pytest.approx(CONTINUOUS, rel=1e-6)
    machine.reset()
    again = machine.follow(np.zeros((1, 1)), effort=np.full((1, 1), 8.0))
    assert again.torque[1, 0] == 8.0


def test_heat_is_the_integral_of_the_torque_squared(rotor):
    """T_th theta + integral of theta = integral of (tau / tau_c)^2, by quadrature of a servo's torques."""
    machine = twin(rotor, stiffness=400.0, damping=4.0, **HEAT)
    gone, supplied = 0.0, 0.0
    for k in range(1500):
        before = machine.temperature[0]
        state = machine.step([0.05 * np.sin(6 * k * H)])
        gone += H * (before + machine.temperature[0]) / 2
        supplied += H * (state.torque[0] / CONTINUOUS) ** 2
    assert TIME * machine.temperature[0] + gone == pytest.approx(supplied, rel=1e-6)


def drives(pepper, count):
    """Return actuators and what varies among robots, so that some joints are derated within a second."""
    rng = np.random.default_rng(4)
    base = actuator_parameters(pepper, "motor").changed(thermal_time=0.3)
    vary = {
        "backlash": rng.uniform(0, 0.02, (count, pepper.n)) * (rng.random((count, pepper.n)) < 0.7),
        "continuous_torque": base.torque_limit * rng.uniform(0.1, 0.4, (count, pepper.n)),
    }
    return base, vary


def moves(pepper, steps):
    t = H * np.arange(1, steps + 1)[:, np.newaxis]
    return pepper.posture("Stand") + 0.08 * np.sin(5.0 * t + np.arange(pepper.n))


def test_each_of_a_batch_is_the_single_twin(pepper):
    count, steps = 5, 300
    base, vary = drives(pepper, count)
    wanted = moves(pepper, steps)
    batch = TwinBatch(pepper, count, H, actuators=base, vary=vary, substeps=2)
    first = batch.follow(wanted, every=1, threads=2)
    batch.reset(rows=[1, 3])
    assert not batch.temperature[[1, 3]].any()
    second = batch.follow(wanted, every=1)
    for robot in range(count):
        params = base.changed(**{name: values[robot] for name, values in vary.items()})
        single = Twin(pepper, H, actuators=params, substeps=2)
        for run in (first, second):
            own = single.follow(wanted)
            np.testing.assert_allclose(run.position[robot], own.position, atol=1e-8)
            np.testing.assert_allclose(run.torque[robot], own.torque, atol=1e-5)
            if run is first and robot in (1, 3):
                single.reset()
        np.testing.assert_allclose(batch.temperature[robot], single.temperature, rtol=1e-6)
    assert batch.temperature.max() > 0.8
    assert np.ptp(second.final_position - first.final_position) > 1e-4  # derated and held on another side


def test_pieces_and_resumed_recordings_repeat_to_the_bit(pepper, tmp_path):
    base, vary = drives(pepper, 1)
    params = base.changed(**{name: values[0] for name, values in vary.items()})
    wanted = moves(pepper, 600)
    whole, pieces = (Twin(pepper, H, actuators=params) for _ in range(2))
    run = whole.follow(wanted)
    for start in range(0, 600, 150):
        part = pieces.follow(wanted[start : start + 150])
        np.testing.assert_array_equal(part.torque[1:], run.torque[start + 1 : start + 151])
    np.testing.assert_array_equal(pieces.temperature, whole.temperature)
    whole.reset()
    recorder = Recorder(whole, tmp_path / "heat", chunk=0.2)
    recorder.follow(wanted[:300])
    other = Twin(pepper, H, actuators=params)
    other.follow(wanted[:77])  # forgotten
    resumed = Recorder.resume(other, tmp_path / "heat").follow(wanted[300:])
    onward = whole.follow(wanted[300:])
    for name in ("position", "velocity", "torque"):
        np.testing.assert_array_equal(getattr(resumed, name), getattr(onward, name))
    np.testing.assert_array_equal(other.temperature, whole.temperature)


def test_a_world_out_of_reach_and_a_push_without_force_change_nothing(pepper):
    base, vary = drives(pepper, 1)
    params = base.changed(**{name: values[0] for name, values in vary.items()})
    far = pk.Scene().add_box("far", (1, 1, 1), (9, 9, 9))
    machines = [
        Twin(pepper, H, actuators=params, world=w, substeps=2) for w in (None, World(pepper, far), None)
    ]
    machines[2].push("LArm_effector", [0, 0, 0], start=0.1, duration=0.2)
    runs = [machine.follow(moves(pepper, 250)) for machine in machines]
    for machine, run in zip(machines[1:], runs[1:], strict=True):
        np.testing.assert_allclose(run.torque, runs[0].torque, atol=1e-9)
        np.testing.assert_allclose(machine.temperature, machines[0].temperature, atol=1e-12)


def test_rows_and_places_are_those_of_the_tables():
    assert len(ActuatorTable._fields) == HELD
    for name, row in {"limit": LIMIT, "play": PLAY_ROW, "continuous_torque": CONTINUOUS_ROW}.items():
        assert ActuatorTable._fields[row] == name
    for motor in (False, True):
        assert parameters(Variant(motor))[CONSTANT_LIMIT - CONSTANT] == "limit"


def test_without_them_not_a_bit_changes(pepper):
    base, wanted = actuator_parameters(pepper, "motor"), moves(pepper, 200)
    never = {"continuous_torque": 1e9, "thermal_time": 1.0}
    runs = []
    for more in ({}, {"backlash": 0.0, "continuous_torque": np.inf}, never):
        machine = Twin(pepper, H, actuators=base.changed(**more))
        runs.append(machine.follow(wanted))
        assert machine.temperature.any() == (more is never)
    for run in runs[1:]:
        np.testing.assert_array_equal(run.position, runs[0].position)
        np.testing.assert_array_equal(run.torque, runs[0].torque)


def test_backlash_has_no_part_in_other_modes(rotor):
    runs = [
        twin(rotor, mode="velocity", backlash=b).follow(np.zeros((50, 1)), np.ones((50, 1)))
        for b in (0.0, 0.1)
    ]
    np.testing.assert_array_equal(runs[0].position, runs[1].position)
    assert runs[0].velocity[-1, 0] == pytest.approx(1.0)


def test_linear_equation_of_a_step_is_that_of_the_step(rotor):
    machine = twin(rotor, backlash=PLAY, **HEAT)
    zero = np.zeros(1)
    for wanted in (0.2, 0.15, 0.1):
        mass, force = machine._integrator.linearized(
            machine.state.position, machine.state.velocity, np.array([wanted]), zero, zero
        )
        before = machine.state.velocity[0]
        after = machine.step([wanted]).velocity[0]
        assert after == pytest.approx(before + H * force[0] / mass[0, 0], abs=1e-12)


def test_wrong_values_are_refused_by_name(rotor):
    params = actuator_parameters(rotor)
    with pytest.raises(InvalidValueError, match=r"backlash of J.*-0\.1.*at least 0"):
        params.changed(backlash=-0.1)
    with pytest.raises(InvalidValueError, match=r"thermal_time of J.*inf.*continuous_torque"):
        params.changed(continuous_torque=2.0)
    with pytest.raises(InvalidValueError, match=r"continuous_torque of J.*0.*above 0"):
        params.changed(continuous_torque=0.0, thermal_time=1.0)
