"""The monitor of runs: planted faults are named by kind, part, time and size, and nothing else is."""

from dataclasses import replace

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.identification import FAULTS, RobotLog, diagnose
from pepper_kin.twin import Twin, actuator_parameters, joint_response
from pepper_kin.twin.base import Odometry, OmniBase, arc_between
from pepper_kin.twin.sensors import SensorSuite

STEP, ONSET = 0.02, 15.0


def planted(pepper, *, strength=None, payload=None, stuck=None, bias=None, seconds=45.0):
    """Return what encoders and torque sensors tell of a robot with a fault from `ONSET` on.

    It differs from what a monitor takes it for: stiffness by 5 %, friction by 20 %, a forearm by 3 %.
    """
    t = STEP * np.arange(round(seconds / STEP))[:, None]
    moving = [j for j, name in enumerate(pepper.joint_names) if name[1:] in ("ShoulderPitch", "ElbowRoll")]
    q, v = np.tile(pepper.posture("Stand"), (t.size, 1)), np.zeros((t.size, pepper.n))
    wave = np.array([0.3 + 0.1 * k for k in range(len(moving))])
    middle = np.clip(q[0, moving], pepper.lower_limits[moving] + 0.6, pepper.upper_limits[moving] - 0.6)
    q[:, moving], v[:, moving] = middle + 0.5 * np.sin(2 * wave * t), wave * np.cos(2 * wave * t)
    nominal = actuator_parameters(pepper, "measured")
    own = nominal.changed(stiffness=1.05 * nominal.stiffness, coulomb_friction=1.2 * nominal.coulomb_friction)
    faulty = own.changed(strength=strength or {}, coulomb_friction=dict.fromkeys(stuck or (), 1e3))
    body, split = pepper.with_masses({"LForeArm": 0.1708}), round(ONSET / STEP)
    before = Twin(body, STEP, actuators=own)
    before.reset(q[0], v[0])
    first = before.follow(q[1:split], v[1:split])
    after = Twin(body, STEP, actuators=faulty, payload=payload)
    after.reset(first.position[-1], first.velocity[-1])
    second = after.follow(q[split:], v[split:])
    rng, rows = np.random.default_rng(0), {}
    for name, noise in (("position", 3e-4), ("velocity", 0.0), ("torque", 0.05)):
        series = np.concatenate([getattr(first, name), getattr(second, name)[1:]])
        rows[name] = series + noise * rng.normal(size=series.shape)
    for joint, size in (bias or {}).items():
        rows["position"][split:, pepper.joint_index(joint)] += size
    wrench = np.zeros((t.size, 6))
    wanted = {"reference_position": q, "reference_velocity": v}
    return replace(first, time=t[:, 0], **rows, **wanted, external_wrench=wrench)


@pytest.fixture(scope="module")
def model(pepper):
    return Twin(pepper, STEP, actuators=actuator_parameters(pepper, "measured"))


def only(found, kind, part):
    """Return the one fault of a kind at a part, after checking that all faults are that."""
    assert {(fault.kind, fault.part) for fault in found.faults} == {(kind, part)}, found.report()
    return found.faults[0]


@pytest.mark.thorough
def test_a_robot_within_its_tolerances_has_no_fault(pepper, model, made_log):
    found = diagnose(pepper, planted(pepper), model)
    assert found.faults == ()
    assert set(found.not_judged) == {"slipped wheel"}
    assert found.judged["LElbowRoll"] == pytest.approx(45.0, abs=0.5)
    log = diagnose(pepper, made_log(pepper, joint_response(pepper), noise=2e-3))
    assert log.faults == ()
    assert set(log.not_judged) == {"weak motor", "wrong payload", "slipped wheel"}
    assert log.report().startswith("no fault\nnot judged: weak motor")


@pytest.mark.parametrize(
    ("fault", "kind", "part", "size"),
    [
        ({"strength": {"LShoulderPitch": 0.5}}, "weak motor", "LShoulderPitch", 0.5),
        ({"strength": {"RElbowRoll": 0.4}}, "weak motor", "RElbowRoll", 0.4),
        ({"payload": {"right": 0.2}}, "wrong payload", "right", 0.2),
        ({"bias": {"LElbowRoll": -0.02}}, "biased sensor", "LElbowRoll", -0.02),
    ],
)
def test_a_planted_fault_of_a_run_is_named_with_its_size(pepper, model, fault, kind, part, size):
    found = only(diagnose(pepper, planted(pepper, **fault), model), kind, part)
    assert found.begin == pytest.approx(ONSET, abs=2.0)
    assert found.size == pytest.approx(size, rel=0.2)
    assert found.score >= 1.0


def test_a_joint_that_sticks_is_named_with_the_way_that_it_missed(pepper, model):
    run = planted(pepper, stuck=["RShoulderPitch"])
    found = only(diagnose(pepper, run, model), "stuck joint", "RShoulderPitch")
    assert found.begin == pytest.approx(ONSET, abs=0.5)
    way = np.abs(
        np.diff(run.reference_position[run.time > ONSET, pepper.joint_index("RShoulderPitch")])
    ).sum()
    assert found.size == pytest.approx(way, rel=0.1)


@pytest.mark.thorough
@pytest.mark.parametrize("bias", [0.08, -0.3])
def test_a_biased_reading_of_a_log_is_named(pepper, made_log, bias):
    log = made_log(pepper, joint_response(pepper), noise=2e-3, seconds=90.0)
    measured = np.array(log.measured)
    measured[log.time > 40.0, 3] += bias
    found = only(diagnose(pepper, replace(log, measured=measured)), "biased sensor", "RElbowRoll")
    assert found.begin == pytest.approx(40.0, abs=4.0)  # while the arm is near the body it is not judged
    assert found.size == pytest.approx(bias, rel=0.1)


def test_a_gear_that_slips_once_is_said_and_one_wrong_reading_is_no_fault(pepper):
    """A joint follows by the response of the twin, and from 60 s on it is one tooth off."""
    time, slip = np.arange(0.0, 120.0, 0.1), 0.15
    command = (-0.8 + 0.4 * np.sin(0.5 * time))[:, None]
    noise = np.random.default_rng(1).normal(0.0, 0.004, (time.size, 1))
    for end, named in ((601, False), (None, True)):
        measured = command + noise
        measured[600:end] += slip
        log = RobotLog("slips", ("LElbowRoll",), time, command, time, measured, share=0.15)
        found = diagnose(pepper, log)
        assert bool(found.faults) == named, found.report()
    fault = only(found, "biased sensor", "LElbowRoll")
    assert fault.size == pytest.approx(slip, rel=0.1)
    assert fault.begin == pytest.approx(60.0, abs=1.0)
    assert found.report().splitlines()[0].endswith(f"or a gear that slipped once, at {fault.begin:.1f} s")


@pytest.mark.thorough
def test_a_joint_that_is_held_in_a_log_is_named(pepper, made_log):
    log = made_log(pepper, joint_response(pepper), noise=5e-4, seconds=90.0)
    measured = np.array(log.measured)
    during = (log.time > 40.0) & (log.time < 60.0)
    measured[during, 4] = measured[np.argmax(during), 4]
    found = diagnose(pepper, replace(log, measured=measured))
    fault = only(found, "stuck joint", "HipPitch")
    assert fault.begin < 41.0 < 55.0 < fault.end < 61.0
    still = measured[(log.time > fault.begin) & (log.time < 60.0), 4]
    assert np.ptp(still) < 0.02  # where a joint stands before it sticks, nothing tells the two apart
    assert found.score("stuck joint") == found.scores["stuck joint", "HipPitch"] == fault.score


def losing(angles, onset, joint, loss):
    """Return angles, shape (T, n), of a joint that follows only a part of each way from a row on."""
    spoiled = np.array(angles)
    spoiled[onset:, joint] = angles[onset, joint] + (1 - loss) * (
        angles[onset:, joint] - angles[onset, joint]
    )
    return spoiled


@pytest.mark.parametrize("loss", [0.2, 0.4, 0.6])
def test_a_gear_that_loses_a_part_of_each_way_is_named_as_that(pepper, model, made_log, loss):
    run, joint = planted(pepper), pepper.joint_index("RShoulderPitch")
    slipping = replace(run, position=losing(run.position, round(ONSET / STEP), joint, loss))
    fault = only(diagnose(pepper, slipping, model), "slipping gear", "RShoulderPitch")
    assert fault.begin == pytest.approx(ONSET, abs=1.0)
    assert fault.size == pytest.approx(loss, rel=0.05)
    log = made_log(pepper, joint_response(pepper), noise=2e-3, seconds=90.0)
    measured = losing(log.measured, int(np.argmax(log.time > 40.0)), 3, loss)
    fault = only(diagnose(pepper, replace(log, measured=measured)), "slipping gear", "RElbowRoll")
    assert fault.begin == pytest.approx(40.0, abs=5.0)
    assert fault.size == pytest.approx(loss, rel=0.05)


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_a_gear_that_slips_in_one_direction_is_named_with_the_share_of_that(pepper, made_log, direction):
    log = made_log(pepper, joint_response(pepper), seed=1, noise=2e-3, seconds=120.0)
    steps, measured = np.diff(log.measured[:, 3]), np.array(log.measured)
    slips = (direction * steps > 0.0) & (log.time[1:] > 40.0)
    measured[1:, 3] = measured[0, 3] + np.cumsum(np.where(slips, 0.6 * steps, steps))
    fault = only(diagnose(pepper, replace(log, measured=measured)), "slipping gear", "RElbowRoll")
    assert fault.begin == pytest.approx(40.0, abs=5.0)
    assert fault.size == pytest.approx(0.4, rel=0.05)


@pytest.mark.parametrize("share", [0.15, 0.5])
def test_commands_faster_than_the_share_are_told_with_joint_speed_and_limit(pepper, share):
    t, joints = np.arange(0.0, 60.0, 0.02), ("LShoulderPitch", "LElbowRoll")
    command = np.stack([0.8 + 0.3 * np.sin(t), -0.8 + 0.5 * np.sin(5.0 * t)], axis=1)
    log = RobotLog("fast", joints, t, command, t, losing(command, 1500, 1, 0.4), share)
    found = diagnose(pepper, log)
    limit = share * joint_response(pepper).speed_share[pepper.joint_index("LElbowRoll")]
    limit *= pepper.velocity_limits[pepper.joint_index("LElbowRoll")]
    if limit < 2.5:  # the peak of 0.5 sin(5 t); 0.3 sin(t) goes at 0.3 rad/s
        assert set(found.beyond_share) == {"LElbowRoll"}
        fastest = 0.5 * 2.0 * np.sin(5.0 * 0.1) / 0.2  # the greatest mean over 0.2 s
        assert f"LElbowRoll: commanded at up to {fastest:.2f} rad/s" in found.report()
        assert f"share=0.15 allows {limit:.2f} rad/s" in found.report()
        assert found.report().splitlines()[1].endswith("give the speed of setAngles, read_log(share=)")
    else:
        assert not found.beyond_share


def test_a_gear_of_a_real_session_is_named_and_not_as_a_bias(pepper, real_logs):
    log = real_logs[-1]
    measured = losing(log.measured, int(np.argmax(log.time > 60.0)), log.index("RElbowYaw"), 0.4)
    found = diagnose(pepper, replace(log, measured=measured))
    assert found.score("biased sensor") > found.score("slipping gear"), "what it has lost looks like a bias"
    assert only(found, "slipping gear", "RElbowYaw").size == pytest.approx(0.4, abs=0.05)


def test_a_real_session_raises_no_alarm_and_a_bias_in_another_is_all_that_is_named(pepper, real_logs):
    found = diagnose(pepper, real_logs[0])
    assert found.faults == ()
    assert found.beyond_share == {}
    log = real_logs[-1]
    measured = np.array(log.measured)
    measured[log.time > 60.0, log.index("RElbowYaw")] += 0.1
    found = only(diagnose(pepper, replace(log, measured=measured)), "biased sensor", "RElbowYaw")
    assert found.size == pytest.approx(0.1, abs=0.02)
    assert 55.0 < found.begin < 75.0


@pytest.mark.parametrize("slip", [0.0, 0.08])
def test_a_wheel_that_slips_is_named_with_its_share(slip):
    pepper = pk.load_pepper(base="planar")
    base, t = OmniBase(pepper), STEP * np.arange(1500)
    q, v = np.tile(pepper.posture("Stand"), (t.size, 1)), np.zeros((t.size, pepper.n))
    q[:, 0], q[:, 1], q[:, 2] = np.sin(0.3 * t), 0.5 * np.sin(0.4 * t), 0.8 * np.sin(0.2 * t)
    v[:, 0], v[:, 1], v[:, 2] = 0.3 * np.cos(0.3 * t), 0.2 * np.cos(0.4 * t), 0.16 * np.cos(0.2 * t)
    run = Twin(pepper, STEP, sensors=SensorSuite(pepper, sensors=["wheel_odometry"], seed=1)).follow(q, v)
    seen = run.readings["wheel_odometry"]
    turns = arc_between(seen.value[:-1, :3], seen.value[1:, :3]) @ base.wheel_map.T
    turns[seen.time[1:] > ONSET, 1] /= 1.0 - slip
    odometry, value = Odometry(base, seen.value[0, :3]), np.array(seen.value)
    value[1:, :3] = [odometry.add(turn) for turn in turns]
    found = diagnose(pepper, replace(run, readings={"wheel_odometry": replace(seen, value=value)}))
    if not slip:
        assert found.faults == ()
        return
    fault = only(found, "slipped wheel", base.geometry.wheel_names[1])
    assert fault.size == pytest.approx(slip, abs=0.02)
    assert fault.begin == pytest.approx(ONSET, abs=2.0)


def test_wrong_arguments_are_refused_by_name(pepper, model, made_log):
    log, run = made_log(pepper, joint_response(pepper), seconds=10.0), planted(pepper, seconds=16.0)
    with pytest.raises(InvalidValueError, match="RobotLog with Twin"):
        diagnose(pepper, log, model)
    with pytest.raises(InvalidValueError, match="str with NoneType"):
        diagnose(pepper, "run.csv")
    with pytest.raises(InvalidValueError, match=r"steps of 0.02 s"):
        diagnose(pepper, run, Twin(pepper, 0.01))
    with pytest.raises(InvalidValueError, match="joints of the run"):
        diagnose(pk.load_pepper(base="planar"), run)
    with pytest.raises(InvalidValueError, match="uneven"):
        diagnose(pepper, replace(run, time=run.time**1.1), model)
    with pytest.raises(UnknownNameError, match="loose screw"):
        diagnose(pepper, run, model, thresholds={"loose screw": 1.0})
    with pytest.raises(InvalidValueError, match="threshold of stuck joint"):
        diagnose(pepper, run, model, thresholds={"stuck joint": 0.0})
    with pytest.raises(UnknownNameError, match="available: " + ", ".join(FAULTS)):
        diagnose(pepper, run, model).score("loose screw")


def test_a_higher_threshold_names_less(pepper, model):
    run = planted(pepper, payload={"left": 0.2})
    assert only(diagnose(pepper, run, model), "wrong payload", "left").score < 1000.0
    found = diagnose(pepper, run, model, thresholds={"wrong payload": 2e4})
    assert found.faults == ()
    assert 0.0 < found.score("wrong payload") < 1.0
