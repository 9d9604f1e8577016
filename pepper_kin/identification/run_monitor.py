"""Faults in a robot's log or a run: residuals against the twin, tested for the signature of each fault.

A residual r, the measurement minus the twin's expectation, is theta phi + noise under a fault of the size
theta:

    fault            residual r                                          signature phi        theta
    stuck joint      change of the angle - change of the twin's          -change of twin's    1
    biased sensor    angle - twin's (+ (torque - twin's) / Kp)           1                    bias [rad]
    weak motor       angle - twin's + (torque - twin's) / Kp             -torque / Kp         1 / strength - 1
    wrong payload    torques of an arm - twin's                          -J^T g of the hand   mass [kg]
    slipped wheel    rotation of a wheel - rotation for the base's path  wheel's rotation     ratio
    slipping gear    residual of a stuck joint                           -change of twin's,   ratio of motion
                                                                         in both or one direction

The residual with torque / Kp is insensitive to a payload, and torques are insensitive to a weak motor, whose
servo deviates further until it gives the same torque: structured residuals like these isolate faults
(Gertler, Fault Detection and Diagnosis in Engineering Systems, 1998).  Residuals of a weak motor are
differences over 2 s.  Torques are corrected for gravity at the difference between the postures of robot and
twin.  Each hypothesis has Page's cumulative sum (Biometrika 41, 1954) of log-likelihood ratios under the
Cauchy distribution, which is robust against a joint that is held briefly:

    s_k = log(1 + (r / sigma)^2) - log(1 + ((r - theta phi) / sigma)^2) - d log(1 + (theta phi / sigma)^2),
    S_k = max(0, S_{k-1} + s_k).

A fault is reported where S of some theta reaches a threshold; it began where S was last 0.  A gear that loses
a fraction of every motion also has an offset: a bias of that joint at that time is not reported.  A gear
that slips once, by a tooth, gives the same readings as an encoder whose bias begins then: the line of a bias
names both.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pepper_kin import dynamics, kinematics
from pepper_kin.arrays import Array
from pepper_kin.dynamics.newton_euler import GRAVITY
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.identification.fit import used_readings
from pepper_kin.identification.replay import CYCLE, replay
from pepper_kin.identification.robot_log import RobotLog
from pepper_kin.identification.stretches import NEAR_LIMIT, Tolerance
from pepper_kin.model import PepperModel
from pepper_kin.model.at_frames import HANDS
from pepper_kin.model.joint_vectors import check_positive
from pepper_kin.twin.base import OmniBase, arc_between
from pepper_kin.twin.joint_response import JointResponse, joint_response
from pepper_kin.twin.run import Run
from pepper_kin.twin.run_status import RunStatus
from pepper_kin.twin.twin import Twin

FAULTS = ("stuck joint", "weak motor", "wrong payload", "slipped wheel", "biased sensor", "slipping gear")
"""Kinds of faults that `diagnose` reports."""
STUCK, WEAK, PAYLOAD, SLIP, BIAS, GEAR = FAULTS
UNITS = dict(
    zip(
        FAULTS,
        ("rad not followed", "of its strength", "kg", "of its turns", "rad", "of its way lost"),
        strict=True,
    )
)

THRESHOLDS = {STUCK: 25.0, WEAK: 30.0, PAYLOAD: 20.0, SLIP: 10.0, BIAS: 90.0, GEAR: 25.0}
"""Thresholds of the cumulative sums: for stuck joints, gears and biases twice the maximum in an hour of a
real Pepper's logs, for others twice the maximum of healthy twins (`benchmarks/run_all.py run_monitor`)."""

SPREADS = {STUCK: 0.006, WEAK: 0.002, PAYLOAD: 0.1, SLIP: 0.01, BIAS: 0.02, GEAR: 0.006}
"""sigma of the residuals: [rad], [N m] for the payload, [rad] for a wheel; in runs, a bias has the sigma of a
weak motor."""

DRIFT = 0.2
"""d, the ratio of the maximum evidence of a reading that is subtracted."""

BLOCK = 0.1
"""Minimum time between readings; readings of a run are means over this time [s]."""

LAG = 2.0
"""Time over which differences show a weak motor: an offset does not indicate one [s]."""

GAP = 1.0
"""Maximum time between readings whose changes are compared [s]."""

SPEED_OVER = 0.2
"""Time over which mean speeds are compared with the speed that `share` allows [s]."""
COMMANDED, READ, FASTER = 0.2, 0.02, 1.2
"""Criteria by which a log's `share` is too low for a joint: fraction of commanded speeds above the allowed
speed, or of measured speeds above it by a factor; a real Pepper's logs have at most 0.08 and 0.005."""

_COMPLIANCES = np.array([0.4, 0.8, 1.6, 3.2, 6.4])
_MASSES = np.array([0.05, 0.1, 0.2, 0.4, 0.8, 1.6, -0.05, -0.1, -0.2, -0.4])
_SLIPS = np.array([0.04, 0.08, 0.16, 0.32, 0.64])
_LOSSES = np.array([0.2, 0.35, 0.5, 0.65])
_SCALE = np.array([2.5, 5.0, 10.0, 20.0, 40.0, 80.0])


@dataclass(frozen=True)
class RunFault:
    """A fault in a run, by comparison with the twin.

    Attributes:
        kind: One of `FAULTS`.
        part: The joint, the hand ("left", "right") or the wheel.
        begin: Start of the fault according to the residuals [s].
        end: Time of the last reading that supports the fault [s].
        size: Motion that a stuck joint did not follow [rad]; ratio of its torque that a weak motor gives;
            mass in the hand beyond the twin's [kg]; ratio of its rotation by which a wheel slips; bias of an
            encoder [rad]; ratio of its motion that a gear loses.
        score: Ratio of the maximum cumulative sum to its threshold, at least 1.
    """

    kind: str
    part: str
    begin: float
    end: float
    size: float
    score: float

    def meets(self, other: RunFault) -> bool:
        """Return whether another fault concerns the same part at the same time."""
        return self.part == other.part and self.begin <= other.end and other.begin <= self.end

    def __str__(self) -> str:
        """Return one line."""
        where = f"{self.kind}, {self.part}, {self.begin:.1f} to {self.end:.1f} s"
        or_slip = f", or a gear that slipped once, at {self.begin:.1f} s" if self.kind == BIAS else ""
        return f"{where}: {self.size:.3g} {UNITS[self.kind]} (score {self.score:.1f}){or_slip}"


@dataclass(frozen=True)
class Diagnosis:
    """Faults and scores of a run.

    Attributes:
        faults: Faults in order of time; of two that share a joint at a time, the one with the higher score.
        scores: (kind, part) -> ratio of the maximum cumulative sum to its threshold, for all judged.
        judged: Joint or wheel -> time for which it was judged [s].
        not_judged: Kind -> why this run cannot show it.
        beyond_share: Joint -> by how much its commanded or measured speed exceeds the log's `share`: the twin
            is slower, which hides faults.
    """

    faults: tuple[RunFault, ...]
    scores: Mapping[tuple[str, str], float]
    judged: Mapping[str, float]
    not_judged: Mapping[str, str]
    beyond_share: Mapping[str, str]

    def score(self, kind: str) -> float:
        """Return the maximum score of a kind over all parts, 0 if it was not judged.

        Raises:
            UnknownNameError: for another kind.
        """
        if kind not in FAULTS:
            raise UnknownNameError("fault", kind, FAULTS)
        return max((score for (one, _), score in self.scores.items() if one == kind), default=0.0)

    def report(self) -> str:
        """Return the faults, a line each, and the kinds that were not judged."""
        lines = [*map(str, self.faults), *(f"{joint}: {why}" for joint, why in self.beyond_share.items())]
        if self.beyond_share:
            lines.append(
                "faults hide where joints outrun the twin: give the speed of setAngles, read_log(share=)"
            )
        lines = lines or ["no fault"]
        return "\n".join([*lines, *(f"not judged: {kind}: {why}" for kind, why in self.not_judged.items())])


class _Evidence(NamedTuple):
    """A residual and a fault's signature in it.

    Attributes:
        kind: Kind of the fault.
        part: Part of the fault.
        joints: Names of the joints that it concerns.
        time: Times of the residuals [s], shape (T,).
        residual: Residuals r, shape (T, k).
        signature: Signature phi, shape (T, k).
        spread: Standard deviation sigma of the residuals.
        sizes: Tested sizes theta, shape (m,).
    """

    kind: str
    part: str
    joints: frozenset[str]
    time: Array
    residual: Array
    signature: Array
    spread: float
    sizes: Array


def diagnose(
    pepper: PepperModel,
    run: RobotLog | Run,
    model: JointResponse | Twin | None = None,
    *,
    thresholds: Mapping[str, float] | None = None,
) -> Diagnosis:
    """Compare a robot's log, or a run with torques, with the twin, and report faults; see the module's text.

    A log shows stuck joints, slipping gears and biased sensors; it is not judged where an arm is kept off
    the body, or a joint's command is at its limit.  A bias affects only the readings: if the servo itself
    reads the biased encoder, the joint is wrong and the reading is not.  A weak motor shows when a joint
    moves under a load.  In a run, `position` of the base's joints is its externally observed pose, and the
    sensor "wheel_odometry" has the rotations of its wheels.  A joint without commands shows nothing.

    Args:
        pepper: The robot.
        run: Log of the robot, or a run of all its joints in equal steps.
        model: Expected behavior: the response of the joints for a log (`joint_response(pepper)` if omitted),
            or a twin with the steps of the run, which is reset (`Twin(pepper, step)` if omitted).
        thresholds: Kind -> threshold, in place of the one of `THRESHOLDS`.

    Raises:
        InvalidValueError: for anything but a log or a run, a model of the wrong type, a run of other
            joints or with uneven times, or a threshold that is not above 0.
        UnknownNameError: for an unknown kind of fault, or an unknown joint.
    """
    limits = dict(THRESHOLDS)
    for kind, value in (thresholds or {}).items():
        if kind not in FAULTS:
            raise UnknownNameError("fault", kind, FAULTS)
        limits[kind] = check_positive(f"threshold of {kind}", value, "log-likelihood ratio")
    if isinstance(run, RobotLog) and (model is None or isinstance(model, JointResponse)):
        response = joint_response(pepper) if model is None else model
        evidence, beyond = list(evidence_of_log(pepper, run, response)), _beyond_share(pepper, run, response)
    elif isinstance(run, Run) and (model is None or isinstance(model, Twin)):
        evidence, beyond = [*_of_run(pepper, run, model), *_of_wheels(pepper, run)], {}
    else:
        given = f"{type(run).__name__} with {type(model).__name__}"
        raise InvalidValueError("run", given, "a RobotLog with a JointResponse, or a Run with a Twin")
    found: list[tuple[RunFault, frozenset[str]]] = []
    scores: dict[tuple[str, str], float] = {}
    for one in evidence:
        score, faults = _tested(one, limits[one.kind])
        scores[one.kind, one.part] = max(score, scores.get((one.kind, one.part), 0.0))
        found += [(fault, one.joints) for fault in faults]
    gears = [fault for fault, _ in found if fault.kind == GEAR]
    found = [(f, joints) for f, joints in found if f.kind != BIAS or not any(map(f.meets, gears))]
    chosen: list[tuple[RunFault, frozenset[str]]] = []
    for fault, joints in sorted(found, key=lambda item: -item[0].score):
        if not any(joints & j and fault.begin <= f.end and f.begin <= fault.end for f, j in chosen):
            chosen.append((fault, joints))
    judged: dict[str, float] = {}
    for one in evidence:
        length = one.time.size * float(np.median(np.diff(one.time)))
        judged[one.part] = max(length, judged.get(one.part, 0.0))
    kinds = {one.kind for one in evidence}
    return Diagnosis(
        tuple(sorted((fault for fault, _ in chosen), key=lambda fault: (fault.begin, fault.part))),
        scores,
        judged,
        {kind: why for kind, why in _reasons(run).items() if kind not in kinds},
        beyond,
    )


def _reasons(run: RobotLog | Run) -> dict[str, str]:
    """Return why a run may not show a kind of fault."""
    if isinstance(run, RobotLog):
        lacks = dict.fromkeys((WEAK, PAYLOAD), "a log has no torques")
        return {**dict.fromkeys(FAULTS, "too few readings were judged"), **lacks, SLIP: "a log has no wheels"}
    return {
        **dict.fromkeys(FAULTS, "too short"),
        PAYLOAD: "the robot lacks the hands, or the run is too short",
        SLIP: "the run lacks the joints of the base or readings of 'wheel_odometry'",
    }


def _tested(one: _Evidence, threshold: float) -> tuple[float, list[RunFault]]:
    """Return the maximum score of a hypothesis, and the faults whose score reaches 1."""
    top, faults = 0.0, []
    unlikely = np.log1p((one.residual / one.spread) ** 2)
    for size in one.sizes:
        shift = size * one.signature
        gain = unlikely - np.log1p(((one.residual - shift) / one.spread) ** 2)
        gain -= DRIFT * np.log1p((shift / one.spread) ** 2)
        total = np.concatenate([[0.0], np.cumsum(gain.sum(axis=1))])
        sums = (total - np.minimum.accumulate(total)) / threshold
        begins = np.flatnonzero(sums == 0.0)
        top = max(top, float(sums.max()))
        for k in np.flatnonzero(np.maximum.reduceat(sums, begins) >= 1.0):
            stop = begins[k + 1] if k + 1 < begins.size else sums.size
            last = int(begins[k] + np.argmax(sums[begins[k] : stop]))
            rows = slice(int(begins[k]), last)
            begin, end = one.time[rows][0], one.time[last - 1]
            faults.append(
                RunFault(
                    one.kind, one.part, float(begin), float(end), _size(one, rows, size), float(sums[last])
                )
            )
    return top, faults


def _size(one: _Evidence, rows: slice, start: float) -> float:
    """Return the size of a fault over some rows, by least squares with Cauchy weights."""
    r, phi, size = one.residual[rows], one.signature[rows], start
    if one.kind == STUCK:
        return float(np.abs(phi).sum())
    for _ in range(10):
        weight = 1.0 / (1.0 + ((r - size * phi) / one.spread) ** 2)
        size = float((weight * r * phi).sum() / (weight * phi**2).sum())
    return 1.0 / (1.0 + size) if one.kind == WEAK else size


def evidence_of_log(pepper: PepperModel, log: RobotLog, response: JointResponse) -> Iterator[_Evidence]:
    """Yield the evidence of a log on its joints."""
    found = replay(pepper, log, response, tolerance=Tolerance(within=100.0))  # which finds no stretch
    command, places = log.commands_at(log.time), [pepper.joint_index(joint) for joint in log.joint_names]
    inside = command > pepper.lower_limits[places] + NEAR_LIMIT
    inside &= command < pepper.upper_limits[places] - NEAR_LIMIT
    use = found.judged & used_readings(pepper, (log,), response)[id(log)] & inside
    first = np.unique(np.floor(log.time / BLOCK), return_index=True)[1]
    for j, joint in enumerate(log.joint_names):
        rows = first[use[first, j]]
        if rows.size > 2:
            angles = log.measured[rows, j], found.twin[rows, j]
            yield from _of_motion(joint, log.time[rows], *angles)
            yield _of_bias(joint, log.time[rows], angles[0] - angles[1], SPREADS[BIAS])


def _beyond_share(pepper: PepperModel, log: RobotLog, response: JointResponse) -> dict[str, str]:
    """Return texts, by joint, on commanded or measured speeds above the log's `share`."""
    found, arrived = {}, log.arrived()
    for j, joint in enumerate(log.joint_names):
        k, rows = pepper.joint_index(joint), arrived[:, j]
        command = np.clip(log.command[:, j], pepper.lower_limits[k], pepper.upper_limits[k])
        commanded = _speeds(log.command_time, command)
        read = _speeds(log.time[rows], log.measured[rows, j])
        limit = response.following(pepper, joint, log.share, CYCLE).fastest
        if (commanded > limit).mean() > COMMANDED or (read > FASTER * limit).mean() > READ:
            found[joint] = (
                f"commanded at up to {commanded.max():.2f} rad/s and read at up to {read.max():.2f} rad/s, "
                f"share={log.share:g} allows {limit:.2f} rad/s"
            )
    return found


def _speeds(time: Array, angle: Array) -> Array:
    """Return mean speeds over `SPEED_OVER` from each time on [rad/s]; one 0 if all times are too short."""
    end = np.searchsorted(time, time + SPEED_OVER)
    begin = np.flatnonzero(end < time.size)
    end = end[begin]
    speeds = np.abs(angle[end] - angle[begin]) / (time[end] - time[begin])
    return speeds if speeds.size else np.zeros(1)


def _of_motion(joint: str, time: Array, angle: Array, expected: Array) -> Iterator[_Evidence]:
    """Yield the evidence for a stuck joint and a slipping gear, from measured and expected angles."""
    near = np.diff(time) < GAP
    moved = np.where(near, np.diff(expected), 0.0)[:, None]
    residual = np.where(near, np.diff(angle), 0.0)[:, None] - moved
    ways = ((STUCK, moved), (GEAR, moved), (GEAR, np.maximum(moved, 0.0)), (GEAR, np.minimum(moved, 0.0)))
    for kind, way in ways:
        where = kind, joint, frozenset([joint]), time[1:]
        yield _Evidence(*where, residual, -way, SPREADS[kind], np.ones(1) if kind == STUCK else _LOSSES)


def _of_bias(joint: str, time: Array, residual: Array, spread: float) -> _Evidence:
    sizes, joints = spread * np.concatenate([_SCALE, -_SCALE]), frozenset([joint])
    return _Evidence(BIAS, joint, joints, time, residual[:, None], np.ones((time.size, 1)), spread, sizes)


def _of_run(pepper: PepperModel, run: Run, model: Twin | None) -> Iterator[_Evidence]:
    """Yield the evidence of a run on its joints and on the loads of the hands."""
    if run.joint_names != pepper.joint_names:
        raise InvalidValueError(
            "joints of the run", ", ".join(run.joint_names), ", ".join(pepper.joint_names)
        )
    steps = np.diff(run.time)
    if not (steps.size and np.allclose(steps, steps[0], rtol=1e-3, atol=0.0)):
        raise InvalidValueError("time", "uneven steps", "times of the run in equal steps")
    step = float(steps.mean())
    twin = Twin(pepper, step) if model is None else model
    if abs(twin.timestep - step) > 1e-3 * step or twin.pepper.joint_names != run.joint_names:
        given = f"steps of {twin.timestep:g} s of {', '.join(twin.pepper.joint_names)}"
        raise InvalidValueError("model", given, f"a twin of the run's joints with its steps of {step:g} s")
    twin.reset(np.clip(run.position[0], pepper.lower_limits, pepper.upper_limits), run.velocity[0])
    expected = twin.follow(run.reference_position[1:], run.reference_velocity[1:])
    if expected.status is RunStatus.STOPPED:
        raise InvalidValueError("model", expected.message, "a twin that follows the run's references")
    length = max(round(BLOCK / step), 1)
    if len(run) <= 3 * length:
        return

    def means(values: Array) -> Array:
        count = (len(values) - 1) // length
        return np.asarray(values[1 : 1 + count * length].reshape(count, length, -1).mean(axis=1))

    time, q, torque = means(run.time)[:, 0], means(run.position), means(run.torque)
    away, more = q - means(expected.position), torque - means(expected.torque)
    held = more - dynamics.gravity_torque(pepper, q) + dynamics.gravity_torque(pepper, q - away)
    lag = round(LAG / (step * length))
    for j, joint in enumerate(run.joint_names):
        if joint.startswith("Base") or run.joint_units[j] != "rad":
            continue
        stiffness = max(float(twin.actuators.stiffness[j]), 1e-9)
        residual = away[:, j] + (held if twin.feedforward == "gravity" else more)[:, j] / stiffness
        yield from _of_motion(joint, time, q[:, j], q[:, j] - away[:, j])
        yield _of_bias(joint, time, residual, SPREADS[WEAK])
        if time.size > 2 * lag:
            lean = torque[:, [j]] / stiffness
            varied = (residual[lag:] - residual[:-lag])[:, None], lean[:-lag] - lean[lag:]
            where = WEAK, joint, frozenset([joint]), time[lag:]
            yield _Evidence(*where, *varied, SPREADS[WEAK], _COMPLIANCES)
    hands = {hand: frame for hand, frame in HANDS.items() if frame in pepper.frame_names}
    above = {hand: set(pepper.joints_above(frame)) for hand, frame in hands.items()}
    for hand, frame in hands.items():
        arm = sorted(above[hand].difference(*(above[other] for other in hands if other != hand)))
        weight = -(kinematics.frame_jacobian(pepper, q, frame)[:, :3].transpose(0, 2, 1) @ GRAVITY)[:, arm]
        joints = frozenset(pepper.joint_names[j] for j in arm)
        yield _Evidence(PAYLOAD, hand, joints, time, held[:, arm], weight, SPREADS[PAYLOAD], _MASSES)


def _of_wheels(pepper: PepperModel, run: Run) -> Iterator[_Evidence]:
    """Yield the evidence of a run on the wheels: their rotations against those that the base's path needs."""
    base = [j for j, name in enumerate(run.joint_names) if name in ("BaseX", "BaseY", "BaseYaw")]
    readings = run.readings.get("wheel_odometry")
    if len(base) < 3 or readings is None or np.ptp(readings.time) < 1.0:
        return
    wheels = OmniBase(pepper)
    time = np.arange(readings.time[0], readings.time[-1], 2.0 * BLOCK)
    turns = []
    for when, poses in ((readings.time, readings.value), (run.time, run.position[:, base])):
        pose = np.column_stack([np.interp(time, when, poses[:, k]) for k in range(3)])
        turns.append(arc_between(pose[:-1], pose[1:]) @ wheels.wheel_map.T)
    for k, wheel in enumerate(wheels.geometry.wheel_names):
        residual, turn = (turns[0] - turns[1])[:, [k]], turns[0][:, [k]]
        yield _Evidence(SLIP, wheel, frozenset([wheel]), time[1:], residual, turn, SPREADS[SLIP], _SLIPS)
