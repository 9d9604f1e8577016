"""Logs: made ones, whose truth is known, and those of a real robot where they are at hand."""

import os
from pathlib import Path

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.identification import RobotLog, read_log
from pepper_kin.identification.replay import (
    command_path,
    holding_torque,
    joint_path,
    kept_off,
    read_at,
    times_of,
)

JOINTS = ("LShoulderPitch", "LElbowRoll", "RShoulderPitch", "RElbowRoll", "HipPitch")
REAL = Path(
    os.environ.get("PEPPER_KIN_ROBOT_LOGS", Path(__file__).parents[2].parent / "shared" / "robot_logs")
)


@pytest.fixture(scope="session")
def pepper():
    return pk.load_pepper()


@pytest.fixture(scope="session")
def real_logs():
    """Return two sessions of each of three persons, the shortest ones."""
    files = sorted(REAL.glob("person_[abd]_session_[13].csv.xz"))
    if not files:
        pytest.skip("no logs of a real robot beside the checkout")
    return [read_log(file) for file in files]


def _made_log(pepper, response, *, seed=0, seconds=60.0, trip=0.006, person="", noise=0.0):
    """Return a log of a robot with a known response: steps between postures, read one after the other."""
    rng = np.random.default_rng(seed)
    count = int(5 * seconds)
    time = np.cumsum(rng.uniform(0.15, 0.25, count))
    middle = np.array([1.4, -0.8, 1.3, 0.8, -0.05])
    span = np.array([0.5, 0.5, 0.5, 0.5, 0.15])
    held = np.repeat(rng.uniform(-1.0, 1.0, (count // 12 + 1, len(JOINTS))), 12, axis=0)[:count]
    command = middle + span * held
    order = 2.5 + np.arange(len(JOINTS))
    log = RobotLog(f"made_{seed}", JOINTS, time, command, time, command, 0.15, order, person or f"p{seed}")
    first = np.vstack([middle, command[1:]])  # the path begins at the first reading
    log = RobotLog(log.name, JOINTS, time, command, time, first, 0.15, order, log.person)
    commands = np.array([command_path(pepper, log, response, joint) for joint in JOINTS])
    kept = zip(JOINTS, kept_off(pepper, log, commands), strict=True)
    paths = [joint_path(pepper, log, response, joint, path) for joint, path in kept]
    torque = holding_torque(pepper, log, paths)
    measured = np.column_stack(
        [
            read_at(path, log, times_of(log, j, trip))
            - response.compliance[response.index(joint)] * torque[:, j]
            for j, (joint, path) in enumerate(zip(JOINTS, paths, strict=True))
        ]
    )
    measured[0] = middle
    measured[1:] += noise * rng.normal(size=measured[1:].shape)
    return RobotLog(log.name, JOINTS, time, command, time, measured, 0.15, order, log.person)


def _written(log, path):
    """Write a log as a table; return the path."""
    names = ["time", *(f"{joint}{end}" for joint in log.joint_names for end in ("_command", "_measured"))]
    rows = np.empty((log.time.size, len(names)))
    rows[:, 0], rows[:, 1::2], rows[:, 2::2] = log.time, log.command, log.measured
    path.write_text(
        ",".join(names) + "\n" + "\n".join(",".join(map(repr, row)) for row in rows.tolist()) + "\n"
    )
    return path


@pytest.fixture(scope="session")
def made_log():
    """Return what makes a log: (pepper, response, seed, seconds, trip, person, noise) -> RobotLog."""
    return _made_log


@pytest.fixture(scope="session")
def written():
    """Return what writes a log as a table: (log, path) -> path."""
    return _written
