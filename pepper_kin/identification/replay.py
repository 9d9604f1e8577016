"""Replay of a log's commands on the twin, and comparison of the twin with the robot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pepper_kin import dynamics
from pepper_kin.arrays import Array, FrozenArrays
from pepper_kin.core.simulation.target_following import follow_targets, read_path, respond
from pepper_kin.exceptions import UnknownNameError
from pepper_kin.identification.robot_log import RobotLog
from pepper_kin.identification.stretches import Stretch, Tolerance, find_stretches
from pepper_kin.model import PepperModel
from pepper_kin.twin.arm_protection import arm_protection
from pepper_kin.twin.joint_response import JointResponse, joint_response

CYCLE = 0.02
"""Period of NAOqi's motion process [s]."""

SETTLE = 4.0
"""Initial time of a log that is not judged: the robot's initial posture was not commanded [s]."""

ROUND_TRIPS = np.arange(0.0, 0.0201, 0.0005)
"""Candidates for the time of a call to the robot and back [s]."""

LATE = 0.04
"""Ratio of a row's delay beyond the median by which each of its calls to the robot is longer."""

FAST = 0.2
"""Minimum ratio of the commanded speed at which a joint's motion counts as fast."""

FEW = 5
"""Minimum number of readings in fast motion for the estimate of a delay."""

SHIFTS = np.arange(-0.3, 0.3001, 0.005)
"""Candidates for the delay [s]."""

SPREAD = 0.02
"""Scale of the robust cost log(1 + (e / SPREAD)^2): far larger errors have other causes [rad]."""


@dataclass(frozen=True, eq=False)
class JointComparison:
    """Comparison of one joint of the twin with the robot's; angles in rad.

    Attributes:
        joint: Name of the joint.
        median: Median of |twin - robot| outside stretches.
        p95: 95th percentile of |twin - robot| outside stretches.
        rms: Root mean square of twin - robot outside stretches.
        delay: Remaining delay of the robot after the twin in fast motion [s]; NaN without fast motion.
        ratio: rms(twin - robot) / rms(command - robot) over all readings.
        median_of_all: Median of |twin - robot| over all readings.
        p95_of_all: 95th percentile of |twin - robot| over all readings.
        rms_of_all: Root mean square of twin - robot over all readings.
        named: Fraction of the readings in a stretch.
        named_squares: Fraction of the squared error in a stretch; NaN without any error.
        readings: Number of readings that were judged.
    """

    joint: str
    median: float
    p95: float
    rms: float
    delay: float
    ratio: float
    median_of_all: float
    p95_of_all: float
    rms_of_all: float
    named: float
    named_squares: float
    readings: int

    def as_dict(self) -> dict[str, float | int | None]:
        """Return the numbers by name, None for NaN."""
        values = {name: value for name, value in vars(self).items() if name != "joint"}
        return {name: None if np.isnan(value) else value for name, value in values.items()}


@dataclass(frozen=True, eq=False)
class Replay(FrozenArrays):
    """Comparison of the twin with the robot at the times of the readings.

    Attributes:
        log: The replayed log.
        twin: Angles of the twin [rad], shape (T, n).
        unexplained: Differences that no timing explains: 0 within the range of the twin around the time
            of a reading, else the distance from that range, positive above [rad], shape (T, n).
        judged: Which readings count, shape (T, n).
        named: Which readings are in a stretch, shape (T, n).
        round_trip: Time of a call to the robot and back, the time between readings of a row [s].
        stretches: Stretches that no actuator explains, in order of time.
        shifted: Sum of |twin - robot| in fast motion with the twin later by each of `SHIFTS`, by joint [rad],
            shape (n, shifts).
        moving: Number of readings in fast motion in `shifted`, shape (n,).
    """

    log: RobotLog
    twin: Array
    unexplained: Array
    judged: NDArray[np.bool_]
    named: NDArray[np.bool_]
    round_trip: float
    stretches: tuple[Stretch, ...]
    shifted: Array
    moving: NDArray[np.int64]

    @property
    def delays(self) -> Array:
        """Delays of the robot after the twin in fast motion [s], NaN if unknown, shape (n,)."""
        return np.array([_delay(*one) for one in zip(self.shifted, self.moving, strict=True)])

    @property
    def error(self) -> Array:
        """Twin minus robot [rad], shape (T, n)."""
        return np.asarray(self.twin - self.log.measured)

    def joint(self, name: str) -> JointComparison:
        """Return the numbers of one joint.

        Raises:
            UnknownNameError: for a joint that the log lacks.
        """
        if name not in self.log.joint_names:
            raise UnknownNameError("joint", name, self.log.joint_names)
        return compared([self])[name]

    def report(self) -> str:
        """Return a table of the joints, and the longest stretches."""
        return report_of([self])

    def as_dict(self) -> dict[str, Any]:
        """Return joints and stretches, for JSON."""
        return {
            "log": self.log.name,
            "person": self.log.person,
            "duration": self.log.duration,
            "round_trip": self.round_trip,
            "joints": {name: found.as_dict() for name, found in compared([self]).items()},
            "stretches": [stretch.as_dict() for stretch in self.stretches],
        }


def replay(
    pepper: PepperModel,
    log: RobotLog,
    actuators: JointResponse | None = None,
    *,
    round_trip: float | None = None,
    tolerance: Tolerance | None = None,
) -> Replay:
    """Replay a log's commands on the twin and compare it with the robot.

    The twin processes commands like NAOqi's `setAngles` in cycles of 20 ms: targets within the limits, the
    interpolation with limited speed, the protection of the arms, and the response of the joints.

    Args:
        pepper: The robot.
        log: Log of the robot.
        actuators: Response of the joints; the measured one (`joint_response`) if omitted.
        round_trip: Time of a call to the robot and back [s]; if omitted, the one with which the twin is
            nearest to the robot, one number for the log.  It only determines when joints of a row were read.
        tolerance: Definition of a stretch.

    Returns:
        The comparison; its first 4 s are not judged.

    Raises:
        UnknownNameError: for a joint of the log that the robot or the actuators lack.
    """
    response = joint_response(pepper) if actuators is None else actuators
    allowed = Tolerance() if tolerance is None else tolerance
    for joint in log.joint_names:
        if joint not in pepper.joint_names:
            raise UnknownNameError(f"joint of {log.name}", joint, pepper.joint_names)
    commands = np.array([command_path(pepper, log, response, joint) for joint in log.joint_names])
    paths = [
        joint_path(pepper, log, response, joint, path)
        for joint, path in zip(log.joint_names, kept_off(pepper, log, commands), strict=True)
    ]
    judged = log.arrived() & (log.time >= log.time[0] + SETTLE)[:, None]
    droop = gravity_droop(pepper, log, response, paths)
    rigid = log.measured - droop  # positions of the joints without gravity
    if round_trip is None:
        round_trip = best_round_trip(log, paths, rigid, judged)
    readings = np.empty((len(paths), 3, log.time.size))
    shifted = np.zeros((len(paths), SHIFTS.size))
    moving = np.zeros(len(paths), dtype=np.int64)
    for j, path in enumerate(paths):
        times = times_of(log, j, round_trip)
        read_path(path, log.begin, CYCLE, times, allowed.timing, readings[j])
    twin, low, high = readings.transpose(1, 2, 0)
    unexplained = np.where(rigid > high, rigid - high, np.minimum(rigid - low, 0.0))
    unexplained = np.where(judged, unexplained, 0.0)
    twin = twin + droop
    stretches, named = find_stretches(pepper, log, twin, unexplained, allowed)
    for j, joint in enumerate(log.joint_names):
        k = pepper.joint_index(joint)
        fast = FAST * log.share * float(pepper.velocity_limits[k])
        use = judged[:, j] & ~named[:, j]
        times = times_of(log, j, round_trip)
        shifted[j], moving[j] = _shifted(paths[j], log, times, rigid[:, j], (fast, use))
    return Replay(log, twin, unexplained, judged, named, round_trip, stretches, shifted, moving)


def command_path(pepper: PepperModel, log: RobotLog, response: JointResponse, joint: str) -> Array:
    """Return the commands of the twin's joint at the ends of the cycles of a log [rad], shape (cycles,).

    The first cycle begins at `log.begin`, with the joint at its first reading.
    """
    j, k = log.index(joint), pepper.joint_index(joint)
    lower, upper = float(pepper.lower_limits[k]), float(pepper.upper_limits[k])
    last = log.time[-1] + ROUND_TRIPS[-1] * log.reading_order.max() + 1.0
    path = np.empty(max(int(np.ceil((last - log.begin) / CYCLE)), 1))
    times = log.command_time + response.latency[response.index(joint)]
    targets = np.clip(log.command[:, j], lower, upper)
    following = response.following(pepper, joint, log.share, CYCLE)
    start = float(np.clip(log.measured[0, j], lower, upper))
    follow_targets(times, targets, following, log.begin, start, path)
    return np.clip(path, lower, upper)


def kept_off(pepper: PepperModel, log: RobotLog, commands: Array) -> Array:
    """Return commands with the arms kept off the body [rad], shape (n, cycles); see `ArmProtection`.

    Args:
        pepper: The robot; joints that the log lacks are in the posture Stand.
        log: Log of the robot.
        commands: Commands of the log's joints at the ends of the cycles [rad], shape (n, cycles).
    """
    protection = arm_protection(pepper, CYCLE)
    places = [pepper.joint_index(joint) for joint in log.joint_names]
    stand = _stand(pepper)
    allowed, kept = stand.copy(), commands.copy()
    allowed[places] = commands[:, 0]
    for k, command in enumerate(commands.T):
        wanted = stand.copy()
        wanted[places] = command
        allowed = protection.allowed(allowed, wanted)
        kept[:, k] = allowed[places]
    return kept


def joint_path(
    pepper: PepperModel, log: RobotLog, response: JointResponse, joint: str, commands: Array | None = None
) -> Array:
    """Return the angles of the twin's joint at the ends of the cycles of a log [rad], shape (cycles,).

    Args:
        pepper: The robot.
        log: Log of the robot.
        response: Response of the joints.
        joint: Name of the joint.
        commands: Commands at the ends of the cycles [rad], shape (cycles,); from `command_path` if omitted.
    """
    path = command_path(pepper, log, response, joint) if commands is None else commands.copy()
    k = pepper.joint_index(joint)
    start = float(np.clip(log.measured[0, log.index(joint)], pepper.lower_limits[k], pepper.upper_limits[k]))
    respond(response.following(pepper, joint, log.share, CYCLE), start, path)
    return path


def read_at(path: Array, log: RobotLog, times: Array) -> Array:
    """Return a path of `joint_path` at times [rad], shape (T,)."""
    return np.interp(times, log.begin + CYCLE * (1 + np.arange(path.size)), path)


def times_of(log: RobotLog, j: int, round_trip: float) -> Array:
    """Return the times at which the joint in column j was read [s], shape (T,); long rows have long calls."""
    took = np.diff(log.time, append=log.time[-1] + np.median(np.diff(log.time)))
    longer = np.clip(took - np.median(took), -0.1, 0.4)
    return np.asarray(log.time + (round_trip + LATE * longer) * log.reading_order[j])


def gravity_droop(pepper: PepperModel, log: RobotLog, response: JointResponse, paths: list[Array]) -> Array:
    """Return the displacements by gravity, -compliance x holding torque [rad], shape (T, n).

    Joints that the log lacks are assumed in the posture Stand.
    """
    compliance = np.array([response.compliance[response.index(joint)] for joint in log.joint_names])
    if not compliance.any():
        return np.zeros(log.measured.shape)
    return np.asarray(-compliance * holding_torque(pepper, log, paths))


def holding_torque(pepper: PepperModel, log: RobotLog, paths: list[Array]) -> Array:
    """Return the torques that hold the twin against gravity at the times of a log [N m], shape (T, n)."""
    twin = np.column_stack([read_at(path, log, log.time) for path in paths])
    places = [pepper.joint_index(joint) for joint in log.joint_names]
    return np.asarray(dynamics.gravity_torque(pepper, whole_body(pepper, log, twin))[:, places])


def whole_body(pepper: PepperModel, log: RobotLog, angles: Array) -> Array:
    """Return angles of all joints [rad], shape (T, n): the log's joints, and the posture Stand for others."""
    q = np.tile(_stand(pepper), (len(angles), 1))
    q[:, [pepper.joint_index(joint) for joint in log.joint_names]] = angles
    return q


def _stand(pepper: PepperModel) -> Array:
    stand = pepper.posture("Stand") if "Stand" in pepper.posture_names else pepper.neutral()
    return np.array(stand, dtype=float)


def best_round_trip(log: RobotLog, paths: list[Array], rigid: Array, judged: NDArray[np.bool_]) -> float:
    """Return the round trip that minimizes the sum of log(1 + (e / 20 mrad)^2) [s].

    Args:
        log: The log.
        paths: Angles of the twin's joints at the ends of the cycles [rad], shape (cycles,) each.
        rigid: Readings without the displacement by gravity [rad], shape (T, n).
        judged: Which readings count, shape (T, n).
    """
    if not log.reading_order.any():
        return 0.0
    cost = np.zeros(ROUND_TRIPS.size)
    for j, path in enumerate(paths):
        use = judged[:, j]
        for k, trip in enumerate(ROUND_TRIPS):
            error = read_at(path, log, times_of(log, j, float(trip))[use]) - rigid[use, j]
            cost[k] += np.log1p((error / SPREAD) ** 2).sum()
    return float(ROUND_TRIPS[int(np.argmin(cost))])


def _shifted(
    path: Array, log: RobotLog, times: Array, rigid: Array, which: tuple[float, NDArray[np.bool_]]
) -> tuple[Array, int]:
    """Return the sum of |twin(t - s) - robot(t)| for each shift s [rad], and the number of readings.

    Args:
        path: Angles of the twin's joint at the ends of the cycles [rad], shape (cycles,).
        log: The log.
        times: Times at which the joint was read [s], shape (T,).
        rigid: Readings without the displacement by gravity [rad], shape (T,).
        which: Minimum speed of fast motion [rad/s], and mask of the readings that count, shape (T,).
    """
    fast, use = which
    speed = (read_at(path, log, times + 0.05) - read_at(path, log, times - 0.05)) / 0.1
    moving = use & (np.abs(speed) > fast)
    sums = [np.abs(read_at(path, log, times[moving] - s) - rigid[moving]).sum() for s in SHIFTS]
    return np.array(sums), int(moving.sum())


def _delay(shifted: Array, moving: int) -> float:
    """Return the shift with the minimum sum [s], NaN for too few readings."""
    return float(SHIFTS[int(np.argmin(shifted))]) if moving >= FEW else float("nan")


def compared(replays: list[Replay]) -> dict[str, JointComparison]:
    """Return the numbers of each joint over the readings of several logs with the same joints."""
    found = {}
    for joint in replays[0].log.joint_names:
        errors, commands, named = [], [], []
        for one in replays:
            j = one.log.index(joint)
            use = one.judged[:, j]
            errors.append(one.error[use, j])
            commands.append((one.log.commands_at(one.log.time)[:, j] - one.log.measured[:, j])[use])
            named.append(one.named[use, j])
        error, inside = np.concatenate(errors), np.concatenate(named)
        places = [one.log.index(joint) for one in replays]
        shifted = sum(one.shifted[j] for one, j in zip(replays, places, strict=True))
        moving = sum(int(one.moving[j]) for one, j in zip(replays, places, strict=True))
        found[joint] = _numbers(
            joint, error, np.concatenate(commands), inside, _delay(np.asarray(shifted), moving)
        )
    return found


def _numbers(
    joint: str, error: Array, command: Array, named: NDArray[np.bool_], delay: float
) -> JointComparison:
    """Return the comparison of a joint from the errors of twin and command, shape (T,) [rad]."""
    return JointComparison(
        joint,
        *_spread(error[~named]),
        delay,
        _rms(error) / _rms(command) if np.any(command) else float("nan"),
        *_spread(error),
        float(named.mean()) if named.size else 0.0,
        float((error[named] ** 2).sum() / (error**2).sum()) if np.any(error) else float("nan"),
        error.size,
    )


def _spread(error: Array) -> tuple[float, float, float]:
    """Return median and 95th percentile of |error|, and its rms; NaN without readings."""
    if not error.size:
        return (float("nan"),) * 3
    return float(np.median(np.abs(error))), float(np.percentile(np.abs(error), 95)), _rms(error)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")


def report_of(replays: list[Replay], longest: int = 8) -> str:
    """Return a table of the joints over several logs, and the longest stretches."""
    lines = [
        "|twin - robot| [mrad]: median, 95th percentile, rms; delay [s]; ratio to rms(command - robot)",
        f"{'':<15}{'without stretches':>28} |{'all readings':>28} |{'in stretches':>16}",
        f"{'joint':<15}{'median':>7}{'p95':>7}{'rms':>7}{'delay':>7} |{'median':>7}{'p95':>7}{'rms':>7}"
        f"{'ratio':>7} |{'readings':>9}{'e^2':>7}",
    ]
    for name, c in compared(replays).items():
        lines.append(
            f"{name:<15}{1e3 * c.median:7.1f}{1e3 * c.p95:7.1f}{1e3 * c.rms:7.1f}{c.delay:7.3f} |"
            f"{1e3 * c.median_of_all:7.1f}{1e3 * c.p95_of_all:7.1f}{1e3 * c.rms_of_all:7.1f}{c.ratio:7.2f} |"
            f"{100 * c.named:8.1f}%{100 * c.named_squares:6.1f}%"
        )
    every = [(one.log.name, stretch) for one in replays for stretch in one.stretches]
    kinds: Mapping[str, int] = {}
    for _, stretch in every:
        kinds = {**kinds, stretch.kind: kinds.get(stretch.kind, 0) + 1}
    counted = ", ".join(f"{count} {kind}" for kind, count in sorted(kinds.items()))
    largest = "; the largest:" if every and longest else ""
    lines.append(f"{len(every)} stretches that no actuator explains: {counted or 'none'}{largest}")
    every.sort(key=lambda item: -item[1].size * item[1].duration)
    lines += [f"  {name}: {stretch}" for name, stretch in every[:longest]]
    return "\n".join(lines)
