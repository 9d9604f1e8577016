"""Excitation motions, and what recordings of them tell: planted values are found."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

import pepper_kin as pk
from pepper_kin.exceptions import InfeasibleError, InvalidValueError, LimitError, UnknownNameError
from pepper_kin.identification import (
    estimate_inertia,
    estimate_payload,
    estimate_stiffness,
    excitation_motion,
)
from pepper_kin.identification.recorded_motion import RecordedMotion, solve
from pepper_kin.twin import actuator_parameters

JOINTS = ("LShoulderPitch", "LShoulderRoll", "LElbowYaw", "LElbowRoll", "LWristYaw")


@pytest.fixture(scope="module")
def excitation(pepper):
    return excitation_motion(pepper, "left_arm", draws=40, seed=3)


@pytest.fixture(scope="module")
def actuators(pepper):
    """Return motors with friction, rotors and other stiffness than Pepper's."""
    stiffness = {"LShoulderPitch": 310.0, "LElbowYaw": 150.0, "LWristYaw": 25.0}
    return actuator_parameters(pepper, "motor").changed(latency=0.0, stiffness=stiffness)


def recorded(robot, excitation, actuators, seed=0, payload=None):
    """Return a run as encoders and torque sensors with noise tell it."""
    twin = pk.Twin(robot, 0.002, feedforward="none", actuators=actuators, payload=payload)
    return noisy(robot, twin.execute(excitation.trajectory), seed)


def noisy(robot, run, seed):
    """Return a run as encoders and torque sensors with noise tell it."""
    random = np.random.default_rng(seed)
    q = run.position + 1e-4 * random.normal(size=run.position.shape)
    torque = run.torque + 0.005 * robot.effort_limits * random.normal(size=run.torque.shape)
    return replace(run, position=q, torque=torque)


def coarse(fine):
    """Return a run of steps of 0.2 ms as one of 2 ms: the mean torque of each step, states at its end."""
    torque = fine.torque[1:].reshape(-1, 10, fine.torque.shape[1]).mean(axis=1)
    every = {name: getattr(fine, name)[::10] for name in ("time", "position", "velocity")}
    every |= {
        f"reference_{name}": getattr(fine, f"reference_{name}")[::10] for name in ("position", "velocity")
    }
    torque = np.concatenate([fine.torque[:1], torque])
    return replace(fine, torque=torque, external_wrench=None, **every)


def misses(estimate, planted):
    """Return by how many half-widths of their intervals planted values are off, shape (k,)."""
    at = [estimate.index(name) for name in planted]
    low, high = estimate.intervals[at].T
    return np.abs(np.array(list(planted.values())) - 0.5 * (low + high)) / (0.5 * (high - low))


@pytest.mark.thorough
def test_the_motion_is_certified_and_begins_and_ends_at_rest(pepper, excitation):
    assert excitation.certificate.success
    assert excitation.trajectory.check(pepper).success
    assert excitation.joints == JOINTS
    ends = excitation.trajectory([0.0, excitation.trajectory.duration])
    np.testing.assert_allclose(ends.position[0], ends.position[1], atol=1e-12)
    np.testing.assert_allclose([ends.velocity, ends.acceleration], 0.0, atol=1e-12)
    still = [j for j, name in enumerate(pepper.joint_names) if name not in JOINTS]
    moves = np.ptp(excitation.trajectory.sample(0.02).position, axis=0)
    assert np.all(moves[still] == 0.0)
    assert np.all(np.delete(moves, still) > 0.1)


def test_the_motion_keeps_shares_of_limits_and_clearance(pepper, excitation):
    samples = excitation.trajectory.sample(0.005)
    q, v, a = samples.position, samples.velocity, samples.acceleration
    assert np.all(np.abs(v) <= 0.8001 * pepper.velocity_limits)
    assert np.all(np.abs(a) <= 0.8001 * pepper.acceleration_limits)
    assert np.all(np.abs(pk.dynamics.newton_euler(pepper, q, v, a)) <= 0.801 * pepper.effort_limits)
    assert pk.collision.clearance(pepper, q).min() > 0.008


@pytest.mark.thorough
def test_the_search_finds_a_better_condition_and_a_seed_gives_one_motion(pepper, excitation):
    again = excitation_motion(pepper, "left_arm", draws=40, seed=3)
    assert again.trajectory == excitation.trajectory
    assert again.condition == excitation.condition
    single = [excitation_motion(pepper, "left_arm", draws=1, seed=seed).condition for seed in range(5)]
    assert excitation.condition < 0.7 * np.median(single)


@pytest.mark.thorough
def test_the_motion_avoids_what_is_around(pepper):
    free = excitation_motion(pepper, "left_arm", draws=20)
    reached = pk.kinematics.frame_pose(pepper, free.trajectory.sample(0.05).position, "LArm_effector")
    start = reached[0, :3, 3]
    farthest = reached[np.argmax(np.linalg.norm(reached[:, :3, 3] - start, axis=1)), :3, 3]
    scene = pk.Scene().add_sphere("ball", radius=0.03, position=farthest)
    assert not free.trajectory.check(pepper, scene).success
    assert (
        excitation_motion(pepper, "left_arm", draws=20, scene=scene).trajectory.check(pepper, scene).success
    )


@pytest.mark.thorough
def test_planted_stiffness_is_found(pepper, excitation, actuators):
    twin = pk.Twin(pepper, 0.0002, feedforward="none", actuators=actuators)
    run = coarse(twin.execute(excitation.trajectory))  # at 2 ms the twin's own error is 2 % of an elbow's
    found = [estimate_stiffness(pepper, noisy(pepper, run, seed), "left_arm") for seed in range(4)]
    planted = {f"{j}.stiffness": actuators.stiffness[pepper.joint_index(j)] for j in JOINTS}
    off = np.concatenate([misses(one, planted) for one in found])
    assert np.mean(off < 1) >= 0.9  # what the resolution of encoders does is the same for all four
    assert off.max() < 2
    width = np.ptp(found[0].intervals, axis=1) / found[0].values
    assert width.max() < 0.1


@pytest.mark.thorough
def test_planted_masses_rotors_and_friction_are_found(pepper, excitation, actuators):
    link = pepper.with_masses({"LForeArm": 0.35})
    found = estimate_inertia(pepper, recorded(link, excitation, actuators), "left_arm")
    truth = estimate_inertia(link, recorded(link, excitation, actuators), "left_arm")
    assert found.names == truth.names
    first_moments = [name for name in found.names if ".mc_" in name]
    planted = {name: truth.described[truth.index(name)] for name in first_moments}
    for quantity, of in (
        ("rotor", "rotor_inertia"),
        ("viscous", "viscous_friction"),
        ("coulomb", "coulomb_friction"),
    ):
        values = getattr(actuators, of)
        named = {f"{joint}.{quantity}": values[pepper.joint_index(joint)] for joint in JOINTS}
        planted |= {name: value for name, value in named.items() if name in found.names}
    assert len(planted) >= 20
    off = misses(found, planted)
    assert np.mean(off < 1) >= 0.85
    assert off.max() < 2
    changed = found.index("LElbowRoll.mc_x")
    low, high = found.intervals[changed]
    assert not low <= found.described[changed] <= high


def test_a_planted_payload_is_found(pepper, excitation, actuators):
    run = recorded(pepper, excitation, actuators, payload={"left": 0.15})
    found = estimate_payload(pepper, run, "left", "left_arm")
    assert misses(found, {"mass": 0.15, "x": 0.0, "y": 0.0, "z": 0.0}).max() < 1.5
    low, high = found.intervals[found.index("mass")]
    assert high - low < 0.01
    assert "mass" in found.report()
    assert set(found.residual) == set(JOINTS)


@pytest.mark.thorough
def test_intervals_hold_the_truth_as_often_as_they_say(pepper, excitation, actuators):
    """Noise drawn again on one recording whose own steps are fine: spread and share inside are counted."""
    twin = pk.Twin(pepper, 0.0002, feedforward="none", actuators=actuators, payload={"left": 0.25})
    run = coarse(twin.execute(excitation.trajectory))
    found = [estimate_payload(pepper, noisy(pepper, run, seed), "left", "left_arm") for seed in range(20)]
    places = [pepper.joint_index(name) for name in JOINTS]
    friction = [*actuators.viscous_friction[places], *actuators.coulomb_friction[places]]
    true, ends = np.array([0.25, 0.0, 0.0, 0.0, *friction]), np.array([one.intervals for one in found])
    inside = (ends[..., 0] <= true) & (true <= ends[..., 1])
    assert inside.mean() > 0.9
    assert inside.mean(axis=0).min() >= 0.6  # of 20 at 95 % fewer have a chance of 1e-7
    spread = np.std([one.values for one in found], axis=0, ddof=1)
    width = np.mean(ends[..., 1] - ends[..., 0], axis=0) / (3.92 * spread)
    assert np.median(width) < 1.5


@pytest.mark.thorough
def test_steps_of_encoders_shift_no_stiffness(pepper):
    """A wrist whose torque bends its servo by a fiftieth of an encoder's step: planted values to 15 %."""
    motion = excitation_motion(pepper, "left_arm", draws=20, seed=1).trajectory
    planted, found = (40.0, 52.0, 65.0), []
    for stiffness in planted:
        usual = actuator_parameters(pepper, "motor").changed(latency=0.0, stiffness={"LWristYaw": stiffness})
        run = coarse(pk.Twin(pepper, 0.0002, feedforward="none", actuators=usual).execute(motion))
        found.append(estimate_stiffness(pepper, noisy(pepper, run, 0), ["LWristYaw"]).values[0])
    np.testing.assert_allclose(found, planted, rtol=0.15)


def test_long_blocks_hold_the_truth_where_errors_last_and_blocks_are_few():
    """Planted parameters, and errors that change over a quarter of a second: 95 % intervals of 140 draws."""
    rng, step, count = np.random.default_rng(4), 0.002, 5000
    data = RecordedMotion(None, (), [], step, 8.0, *[np.empty(0)] * 4)
    slow = signal.butter(2, 2.5, fs=1 / step, output="sos")
    fast = signal.butter(4, 8.0, fs=1 / step, output="sos")
    true, inside = np.array([1.0, -0.5, 0.2, 2.0]), {False: 0, True: 0}
    for _ in range(140):
        columns = signal.sosfiltfilt(slow, rng.normal(size=(count, 4)), axis=0)
        errors = [signal.sosfiltfilt(one, rng.normal(size=count)) for one in (slow, fast)]
        target = columns @ true + errors[0] + 0.3 * errors[1]
        for long in inside:
            found = solve(
                data, columns[:, None], target[:, None], np.ones((count, 1), dtype=bool), long_blocks=long
            )
            inside[long] += np.sum(np.abs(found.values - true) <= np.ptp(found.intervals, axis=1) / 2)
    assert 0.9 <= inside[True] / 560 <= 0.98
    assert inside[False] / 560 < 0.88  # the usual blocks are too short for such errors


def test_joints_that_turn_around_all_the_time_are_refused_by_name(pepper, excitation, actuators):
    run = pk.Twin(pepper, 0.002, feedforward="none", actuators=actuators).execute(excitation.trajectory)
    j, position = pepper.joint_index("LElbowRoll"), run.position.copy()
    position[:, j] += 0.05 * np.sin(2 * np.pi * 6.0 * run.time) - position[:, j] + position[0, j]
    with pytest.raises(InvalidValueError, match="LElbowRoll turns around all the time"):
        estimate_payload(pepper, replace(run, position=position), "left", "left_arm")


def test_a_load_beside_the_origin_of_a_frame_is_found_where_it_is(pepper, excitation, actuators):
    run = recorded(pepper, excitation, actuators, payload={"l_wrist": 0.2})
    place = pk.kinematics.frame_poses(pepper, pepper.neutral(), ["LArm_effector", "l_wrist"])
    expected = (np.linalg.inv(place[0]) @ place[1])[:3, 3]
    found = estimate_payload(pepper, run, "LArm_effector", "left_arm")
    np.testing.assert_allclose(found.values[1:4], expected, atol=0.005)


@pytest.mark.thorough
def test_what_leaves_no_motion_is_refused_by_name(pepper):
    with pytest.raises(UnknownNameError, match="LElbow"):
        excitation_motion(pepper, ["LElbow"])
    urdf = pepper.export("urdf")
    limit = re.search(r'<joint name="LElbowRoll".*?velocity="([^"]+)"', urdf, re.DOTALL)
    stopped = pk.load_robot(urdf[: limit.start(1)] + "0" + urdf[limit.end(1) :])
    with pytest.raises(InfeasibleError, match="velocity limit of LElbowRoll is 0"):
        excitation_motion(stopped, ["LElbowRoll"])
    with pytest.raises(InfeasibleError, match="KneePitch needs more"):
        excitation_motion(pepper, ["KneePitch"], limit_share=0.01)
    end = pepper.joint_vector({"HeadYaw": pepper.upper_limits[pepper.joint_index("HeadYaw")]})
    with pytest.raises(InfeasibleError, match="HeadYaw stands at an end"):
        excitation_motion(pepper, ["HeadYaw"], posture=end)
    with pytest.raises(LimitError, match="HeadYaw"):
        excitation_motion(pepper, ["HeadYaw"], posture=2 * end)
    with pytest.raises(InfeasibleError, match="come too near"):
        excitation_motion(pepper, ["HeadYaw"], posture="Stand", clearance=0.05)
    with pytest.raises(InvalidValueError, match="limit_share"):
        excitation_motion(pepper, limit_share=1.5)
    with pytest.raises(InvalidValueError, match="harmonics"):
        excitation_motion(pepper, harmonics=2)


def test_recordings_that_tell_nothing_are_refused(pepper, excitation, actuators):
    run = pk.Twin(pepper, 0.002, feedforward="none", actuators=actuators).execute(excitation.trajectory)
    with pytest.raises(InvalidValueError, match="cutoff"):
        estimate_stiffness(pepper, run, "left_arm", cutoff=250.0)
    with pytest.raises(InvalidValueError, match="duration"):
        estimate_inertia(pepper, run, "left_arm", cutoff=1.0)
    with pytest.raises(InvalidValueError, match="a frame that a joint moves"):
        estimate_payload(pepper, run, "base_link", "left_arm")
    with pytest.raises(UnknownNameError, match="nose"):
        estimate_payload(pepper, run, "nose", "left_arm")
    uneven = replace(run, time=run.time**1.1)
    with pytest.raises(InvalidValueError, match="uneven"):
        estimate_stiffness(pepper, uneven, "left_arm")
    still = replace(run, position=np.tile(run.position[0], (len(run), 1)))
    with pytest.raises(InvalidValueError, match="LShoulderPitch does not move"):
        estimate_stiffness(pepper, still, "left_arm")


@pytest.mark.thorough
@pytest.mark.parametrize(
    "joints", [None, "left_arm", ("HipRoll", "KneePitch", "LShoulderPitch", "LElbowRoll")]
)
def test_a_payload_is_found_whichever_joints_are_used(pepper, whole_excitation, joints):
    actuators = actuator_parameters(pepper, "motor").changed(latency=0.0)
    run = recorded(pepper, whole_excitation, actuators, payload={"left": 0.3})
    found = estimate_payload(pepper, run, "left", joints)
    assert found.values[0] == pytest.approx(0.3, abs=0.02)
    low, high = found.intervals[0]
    assert abs(0.3 - (low + high) / 2) < 1.5 * (high - low) / 2


@pytest.fixture(scope="module")
def whole_excitation(pepper):
    return excitation_motion(pepper, draws=40, seed=5)
