"""The twin beside logs: made ones, whose truth is known, NAOqi's modules, and a real robot's."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from pepper_kin.cli import app
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.identification import RobotLog, Tolerance, compared, fit_actuators, replay, without_person
from pepper_kin.identification.replay import CYCLE, joint_path
from pepper_kin.naoqi import Broker
from pepper_kin.twin import joint_response

JOINTS = ("LShoulderPitch", "LElbowRoll", "RShoulderPitch", "RElbowRoll", "HipPitch")


def test_a_robot_that_is_as_the_twin_has_no_error(pepper, made_log):
    log = made_log(pepper, joint_response(pepper))
    found = replay(pepper, log)
    assert found.round_trip == pytest.approx(0.006)
    assert np.abs(found.error[found.judged]).max() < 1e-9
    assert found.stretches == ()
    for joint, numbers in compared([found]).items():
        assert numbers.ratio < 1e-6
        assert numbers.delay == pytest.approx(0.0, abs=0.005), joint


def test_a_robot_that_is_late_is_seen_to_be_late(pepper, made_log):
    late = joint_response(pepper).changed(latency=joint_response(pepper).latency + 0.1)
    found = replay(pepper, made_log(pepper, late), round_trip=0.006, tolerance=Tolerance(timing=0.3))
    assert found.delays == pytest.approx(0.1, abs=0.011)


def test_the_way_is_that_of_the_modules(pepper):
    """The commands of NAOqi's simulated body, cycle by cycle, are those of the replay."""
    broker = Broker(real_time=False)
    motion, body = broker.motion, broker.body
    start = body.commanded("LElbowRoll")
    given, seen = [], []
    for k in range(200):
        if k % 20 == 0:
            given.append((k * CYCLE, -0.8 + 0.6 * np.cos(2.1 * k)))
            motion.setAngles("LElbowRoll", given[-1][1], 0.15)
        body.time.spend(CYCLE)
        seen.append(body.commanded("LElbowRoll"))
    times, targets = np.array(given).T
    rows = np.arange(200) * CYCLE
    log = RobotLog("n", ("LElbowRoll",), times, targets[:, None], rows, np.full((200, 1), start), 0.15)
    path = joint_path(pepper, log, joint_response(pepper, "ideal"), "LElbowRoll")
    np.testing.assert_allclose(path[: len(seen)], seen, atol=1e-9)


@pytest.mark.parametrize(
    ("hold", "kind"), [(lambda q: np.full(q.shape, q[0]), "blocked"), (lambda q: q + 0.3, "unknown")]
)
def test_a_joint_that_does_not_follow_is_named_with_its_time(pepper, hold, kind, made_log):
    log = made_log(pepper, joint_response(pepper))
    measured = np.array(log.measured)
    during = (log.time > 20) & (log.time < 30)
    measured[during, 4] = hold(measured[during, 4])
    held = RobotLog("h", JOINTS, log.time, log.command, log.time, measured, 0.15, log.reading_order)
    found = replay(pepper, held)
    assert {stretch.joint for stretch in found.stretches} == {"HipPitch"}
    assert all(s.begin > 19.5 and s.end < 30.5 for s in found.stretches)
    assert kind in {stretch.kind for stretch in found.stretches}
    numbers = found.joint("HipPitch")
    assert numbers.named_squares > 0.9
    assert numbers.p95 < 0.02 < numbers.rms_of_all


def test_a_command_beyond_a_limit_is_named(pepper, made_log):
    log = made_log(pepper, joint_response(pepper))
    command, measured = np.array(log.command), np.array(log.measured)
    during = (log.time > 20) & (log.time < 30)
    command[during, 1], measured[during, 1] = -1.6, -1.45
    short = RobotLog("s", JOINTS, log.time, command, log.time, measured, 0.15, log.reading_order)
    found = replay(pepper, short).stretches
    kinds = {s.kind for s in found if s.duration > 5 and s.joint == "LElbowRoll"}
    assert kinds == {"beyond a limit"}


def test_wrong_arguments_are_refused(pepper, made_log):
    log = made_log(pepper, joint_response(pepper), seconds=10)
    other = RobotLog("o", ("Elbow",), log.time, log.command[:, :1], log.time, log.measured[:, :1])
    with pytest.raises(UnknownNameError, match="Elbow"):
        replay(pepper, other)
    with pytest.raises(UnknownNameError, match="Elbow"):
        replay(pepper, log).joint("Elbow")
    with pytest.raises(InvalidValueError, match="within"):
        Tolerance(within=0.0)
    with pytest.raises(InvalidValueError, match="at least one"):
        fit_actuators(pepper, [])
    with pytest.raises(UnknownNameError, match="mass"):
        fit_actuators(pepper, [log], ("mass",))


@pytest.mark.thorough
def test_a_fit_finds_what_a_log_was_made_with(pepper, made_log):
    """Known values come back within their intervals' order, though each robot differs and some are held."""
    truth = joint_response(pepper, "ideal").changed(
        speed_share=0.8, latency=0.03, lag=0.09, backlash=0.003, compliance={"HipPitch": 0.002}
    )
    logs = []
    for seed in range(4):
        lag = 0.09 + 0.004 * (seed - 1.5)
        own = truth.changed(lag=lag)
        logs.append(made_log(pepper, own, seed=seed, seconds=90, trip=0.004 + 0.002 * seed, noise=5e-4))
    fit = fit_actuators(pepper, logs)
    assert fit.persons == ("p0", "p1", "p2", "p3")
    np.testing.assert_allclose(fit.response.speed_share, 0.8, atol=0.015)
    np.testing.assert_allclose(fit.response.lag + fit.response.latency, 0.12, atol=0.015)
    np.testing.assert_allclose(fit.response.backlash, 0.003, atol=0.0007)
    assert fit.response.compliance[4] == pytest.approx(0.002, rel=0.15)
    for seed in range(4):
        assert fit.round_trips[f"made_{seed}"] == pytest.approx(0.004 + 0.002 * seed, abs=0.0025)
    low, high = fit.response.intervals["lag"].T
    assert (low < fit.response.lag).all()
    assert (fit.response.lag < high).all()
    for person in fit.persons:
        for quantity in ("speed_share", "lag", "backlash"):
            change = getattr(fit.without[person], quantity) - getattr(fit.response, quantity)
            low, high = fit.response.intervals[quantity].T
            assert (np.abs(change) < high - low).all()
    assert "HipPitch" in fit.report()
    assert without_person(pepper, fit, "p0").compliance[pepper.joint_index("HipPitch")] > 0


def test_the_command_prints_joints_and_stretches(pepper, tmp_path, made_log, written):
    path = written(made_log(pepper, joint_response(pepper), seconds=20), tmp_path / "person_q_1_x.csv")
    shown = CliRunner().invoke(app, ["check", "log", str(path), "--json", "--plot", str(tmp_path / "a.png")])
    assert shown.exit_code == 0, shown.output
    found = json.loads(shown.stdout)
    assert set(found["joints"]) == set(JOINTS)
    assert {"median", "p95", "rms", "delay", "ratio"} <= set(found["joints"]["HipPitch"])
    assert isinstance(found["stretches"], list)
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    words = CliRunner().invoke(app, ["check", "log", str(path)])
    assert "LElbowRoll" in words.stdout


def test_a_real_robot(pepper, real_logs):
    """The recordings of five persons, to which the packaged values were fitted."""
    found = [replay(pepper, log) for log in real_logs]
    ideal = compared([replay(pepper, log, joint_response(pepper, "ideal")) for log in real_logs])
    numbers = compared(found)
    for joint, one in numbers.items():
        assert one.median_of_all <= ideal[joint].median_of_all, joint
        assert one.rms < 0.020, joint
        assert one.p95 < 0.032, joint
        assert abs(one.delay) <= 0.02, joint
    assert np.mean([one.ratio for one in numbers.values()]) < 0.62
    error = np.concatenate([one.error[one.judged] for one in found])
    named = np.concatenate([one.named[one.judged] for one in found])
    assert (error[named] ** 2).sum() > 0.8 * (error**2).sum()


def test_the_modules_follow_as_the_replay_says(pepper):
    """What encoders of the simulated body read with the measured response is what the replay expects."""
    broker = Broker(real_time=False, response="measured")
    motion, body = broker.motion, broker.body
    joints = ["RShoulderPitch", "LElbowRoll", "HipPitch"]
    times, targets, rows, seen = [], [], [], []
    for k in range(500):
        if k % 10 == 0:
            times.append(k * CYCLE)
            targets.append(
                [1.2 + 0.5 * np.cos(0.13 * k), -0.8 + 0.4 * np.sin(0.09 * k), 0.1 * np.sin(0.02 * k)]
            )
            motion.setAngles(joints, targets[-1], 0.15)
        rows.append(k * CYCLE)
        seen.append(motion.getAngles(joints, True))
        body.time.spend(CYCLE)
    log = RobotLog(
        "n", tuple(joints), np.array(times), np.array(targets), np.array(rows), np.array(seen), 0.15
    )
    found = replay(pepper, log)
    error = np.abs(found.error[found.judged[:, 0]])
    # A call in between two cycles waits for the next in both; here all are made as a cycle begins.
    assert np.median(error) < 0.008
    assert error.max() < 0.025
    assert np.abs(found.delays).max() <= 0.016
