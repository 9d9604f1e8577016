"""A real Pepper beside the twin, the monitor of runs, and estimates beside the truth."""

from __future__ import annotations

import csv
import json
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from xml.etree.ElementTree import fromstring

import numpy as np
from harness import LOGS, figures, timed
from scipy import stats

import pepper_kin as pk
from pepper_kin import identification
from pepper_kin.identification import run_monitor as monitor
from pepper_kin.twin import Run, Twin, actuator_parameters
from pepper_kin.twin.base import BaseController, Odometry, OmniBase, arc_between, world_velocity
from pepper_kin.twin.sensors import SensorSuite, sensor_specifications

ASKED = {"median": 0.004, "p95": 0.025, "rms": 0.020, "delay": 0.02}
DIGITS = {"speed_share": 3, "latency": 3, "lag": 3, "backlash": 4, "compliance": 4}


def of_others(pepper, logs, fit):
    """Return the replays of all logs, each with actuators fitted without its person."""
    return [
        identification.replay(pepper, log, identification.without_person(pepper, fit, log.person))
        for log in logs
    ]


def summary(replays, ideal):
    """Return the numbers over all joints."""
    joints, plain = identification.compared(replays), identification.compared(ideal)
    error = np.concatenate([one.error[one.judged] for one in replays])
    named = np.concatenate([one.named[one.judged] for one in replays])
    return {
        "worst": {q: float(np.nanmax([abs(getattr(one, q)) for one in joints.values()])) for q in ASKED},
        "joints_within": {q: sum(abs(getattr(one, q)) <= ASKED[q] for one in joints.values()) for q in ASKED},
        "mean_ratio": float(np.mean([one.ratio for one in joints.values()])),
        "mean_ratio_ideal": float(np.mean([one.ratio for one in plain.values()])),
        "median_above_ideal": [
            name for name in joints if joints[name].median_of_all >= plain[name].median_of_all
        ],
        "named_squares": float((error[named] ** 2).sum() / (error**2).sum()),
        "named_readings": float(named.mean()),
    }


def changes(fit):
    """Return by quantity the largest change of a joint's value over its interval without a person."""
    found = {}
    for quantity in DIGITS:
        low, high = fit.response.intervals[quantity].T
        values = [getattr(one, quantity) - getattr(fit.response, quantity) for one in fit.without.values()]
        found[quantity] = float(np.nanmax(np.abs(values).max(axis=0) / (high - low)))
    return found


def data(fit):
    """Return the joints of `joint_responses.json`: quantity -> value, low, high."""
    rows = {}
    for j, joint in enumerate(fit.response.joint_names):
        rows[joint] = {}
        for quantity, digits in DIGITS.items():
            low, high = fit.response.intervals[quantity][j]
            if np.isfinite(low):
                values = (getattr(fit.response, quantity)[j], low, high)
                rows[joint][quantity] = [round(float(value), digits) for value in values]
    return rows


def read_logs(folder):
    """Return the logs of a folder."""
    files = sorted(folder.glob("*.csv*"))
    if not files:
        raise SystemExit(f"no logs in {folder}")
    return [identification.read_log(file) for file in files]


@figures("validation.md", "robots' logs")
def reality(folder: Path = LOGS, packaged: bool = False, as_data: bool = False) -> Iterator[str]:
    """The twin beside a real Pepper, from its logs: each person's with actuators fitted to others'.

    For each joint |twin - robot| without the stretches that no actuator explains, the delay that is left, and
    of all readings rms(twin - robot) / rms(command - robot), beside the kinematic model (no latency, lag or
    backlash, the full speed; its arms are kept off the body, too).  Logs are tables as `pepper-kin check log`
    takes them, of a folder or $PEPPER_KIN_ROBOT_LOGS; docs/validation.md names the source of ours.
    `--packaged` replays with the values of the package instead: for logs of other persons.  `--as-data`
    prints the fit to all persons as the package keeps it, twin/data/joint_responses.json.
    """
    pepper, logs, fit, fitting = pk.load_pepper(), read_logs(folder), None, 0.0
    if not packaged:
        fit, fitting = timed(identification.fit_actuators, pepper, logs)
    if as_data:
        yield json.dumps(data(fit), indent=1)
        return
    replay = identification.replay
    replays, spent = timed(
        lambda: [replay(pepper, log) for log in logs] if packaged else of_others(pepper, logs, fit)
    )
    plain = pk.twin.joint_response(pepper, "ideal")
    ideal = [replay(pepper, log, plain, round_trip=0.0) for log in logs]
    minutes, found = sum(log.duration for log in logs) / 60.0, {"all": summary(replays, ideal)}
    for person in sorted({log.person for log in logs}):
        own = ([one for one in every if one.log.person == person] for every in (replays, ideal))
        found[person] = summary(*own)
    yield f"{len(logs)} logs, {minutes:.0f} minutes; replay of ten minutes {600 * spent / 60 / minutes:.2f} s"
    if fit is not None:
        yield f"fit with each person left out: {fitting:.0f} s of processor time\n{fit.report()}\n"
        yield f"largest change / interval when a person is left out: {changes(fit)}\n"
    yield identification.report_of(replays)
    for person, numbers in found.items():
        worst = ", ".join(f"{q} {1e3 * value:.1f}" for q, value in numbers["worst"].items())
        within = ", ".join(f"{count}" for count in numbers["joints_within"].values())
        yield (
            f"{person:>4}: worst joint [mrad, ms] {worst} (joints within {within}); "
            f"ratio {numbers['mean_ratio']:.2f}, kinematic {numbers['mean_ratio_ideal']:.2f}; "
            f"named {100 * numbers['named_readings']:.0f} % of readings, "
            f"{100 * numbers['named_squares']:.0f} % of the squared error; "
            f"median not below the kinematic one: {', '.join(numbers['median_above_ideal']) or 'none'}"
        )


MARGINS = (1.25, 2.0)
"""Thresholds over the largest sums; those of the package have the second."""
WINDOW = 120.0
LOG_SIZES = {monitor.STUCK: (0.1, 0.2, 0.5, 1.0, 2.0), monitor.BIAS: (0.03, 0.05, 0.1, 0.2)}
"""Way that a joint that is held does not follow, and bias [rad]."""
RUN_SIZES = {
    monitor.STUCK: (1.0, 2.0, 5.0, 10.0),
    monitor.BIAS: (0.002, 0.005, 0.01, 0.02),
    monitor.WEAK: (0.9, 0.8, 0.7, 0.6, 0.4),
    monitor.PAYLOAD: (0.02, 0.05, 0.1, 0.2),
}
"""Held for a time [s], bias [rad], strength that is left, and mass [kg]."""
SLIPS = (0.01, 0.02, 0.03, 0.05, 0.1)
ARM = ("ShoulderPitch", "ShoulderRoll", "ElbowYaw", "ElbowRoll", "WristYaw")
MOVING = "HeadYaw", "HeadPitch", "HipPitch", "HipRoll", "KneePitch"
MOVING += tuple(side + name for side in "LR" for name in ARM)
LOADED = ("LShoulderPitch", "RShoulderPitch", "LElbowRoll", "RElbowRoll", "HipPitch", "KneePitch")
UNSURE = {"stiffness": 0.1, "damping": 0.1, "coulomb_friction": 0.3, "viscous_friction": 0.3}
"""By which shares a robot differs from the monitor's twin, besides 3 % of its masses."""
STEP, EVERY, DURATION = 0.004, 5, 60.0


def area(negative, positive):
    """Return the area under the curve: how often a fault scores higher than none, ties counting half."""
    a, b = np.asarray(positive)[:, None], np.asarray(negative)[None]
    return float(np.mean((a > b) + 0.5 * (a == b)))


def part_of(log, begin, end):
    """Return a log from one time to another [s]."""
    given = (log.command_time >= begin) & (log.command_time < end)
    read = (log.time >= begin) & (log.time < end)
    return identification.RobotLog(
        f"{log.name}_{begin:.0f}", log.joint_names, log.command_time[given], log.command[given],
        log.time[read], log.measured[read], log.share, log.reading_order, log.person,
    )  # fmt: skip


def windows(logs):
    """Return all windows of logs."""
    return [
        part_of(log, begin, begin + WINDOW)
        for log in logs
        for begin in np.arange(monitor.BLOCK + log.command_time[0], log.time[-1] - WINDOW, WINDOW)
    ]


def spoiled(log, ways, fault, rng):
    """Return a log with a fault of a kind and size that begins in the second quarter, and the joint.

    A joint is held until it did not follow a way of the size in readings that are judged; one that is not
    sent so far is not taken, and None is returned where no joint is; `ways` are those of `ways_of`.
    """
    kind, size = fault
    for _ in range(1000):
        measured, joint = np.array(log.measured), str(rng.choice(log.joint_names))
        begin, j = log.time[0] + WINDOW * rng.uniform(0.25, 0.5), log.index(joint)
        after = log.time >= begin
        if kind == monitor.BIAS:
            measured[after, j] += size * rng.choice([-1.0, 1.0])
            return replace(log, measured=measured), joint
        time, change = ways.get(joint, (np.zeros(1), np.zeros(1)))
        way = np.cumsum(np.abs(change) * (time > begin))
        if way[-1] > size:
            held = after & (log.time <= time[int(np.argmax(way > size))])
            measured[held, j] = measured[int(np.argmax(after)), j]
            return replace(log, measured=measured), joint
    return None


def ways_of(pepper, log, response):
    """Return joint -> times of its judged readings [s], and the twin's changes between them [rad]."""
    evidence = [one for one in monitor.evidence_of_log(pepper, log, response) if one.kind == monitor.STUCK]
    return {one.part: (one.time, one.signature[:, 0]) for one in evidence}


def false_alarms(pepper, logs, responses):
    """Yield false alarms of persons with what was fitted to the others, and fill in responses by person."""
    hours = sum(log.duration for log in logs) / 3600.0
    counted = dict.fromkeys(MARGINS, 0)
    for fitted in ("abc", "de"):
        train = [log for log in logs if log.person in fitted]
        others = [log for log in logs if log.person not in fitted]
        response = identification.fit_actuators(pepper, train).response
        responses.update(dict.fromkeys([log.person for log in others], response))
        known = [identification.diagnose(pepper, log, response) for log in train]
        for margin in MARGINS:
            limits = {
                k: margin * max(one.score(k) * monitor.THRESHOLDS[k] for one in known) for k in LOG_SIZES
            }
            alarms = [
                f"{log.name}: {fault}"
                for log in others
                for fault in identification.diagnose(pepper, log, response, thresholds=limits).faults
            ]
            counted[margin] += len(alarms)
            words = ", ".join(f"{kind} {limit:.0f}" for kind, limit in limits.items())
            yield f"thresholds {margin} x the largest sums of {fitted}: {words}"
            length = sum(log.duration for log in others) / 3600.0
            yield "\n    ".join([f"  {len(alarms)} false alarms in {length:.2f} h of the others", *alarms])
    for margin, count in counted.items():
        low, high = np.nan_to_num(stats.chi2.ppf([0.025, 0.975], [2 * count, 2 * count + 2])) / 2.0 / hours
        rate = f"{count / hours:.2f} an hour (95 % interval {low:.2f} to {high:.1f})"
        yield f"held out, {margin}: {count} in {hours:.2f} h, {rate}"


def curves(title, kinds, clean, seeds, make):
    """Yield curves over sizes: AUC, and how often kind and part were named.

    `make` returns a diagnosis and the part of a fault of a kind and size, by its number; or None.
    """
    for kind, sizes in kinds.items():
        negative = [one.score(kind) for one in clean]
        for size in sizes:
            made = [found for k in range(seeds) if (found := make(kind, size, k)) is not None]
            scores = [found.score(kind) for found, _ in made]
            named = np.mean(
                [any(f.kind == kind and f.part == part for f in found.faults) for found, part in made]
            )
            yield (
                f"{title}, {kind}, {len(clean)} windows without | AUC {{:.3f}} | named {{:.0%}} | of",
                f"{size:g}",
                area(negative, scores),
                named,
                len(scores),
            )


def alarms_of(clean):
    """Return in words how many faults were named in runs without one, and the largest sums of each kind."""
    count = sum(len(one.faults) for one in clean)
    sums = {k: max(one.score(k) * limit for one in clean) for k, limit in monitor.THRESHOLDS.items()}
    largest = ", ".join(f"{kind} {value:.1f}" for kind, value in sums.items() if value)
    return f"{count} false alarms in {len(clean) * DURATION / 3600:.2f} h of runs; largest sums: {largest}"


def curves_of_logs(pepper, logs, responses, seeds):
    """Yield the curves of faults in real logs."""
    parts = windows(logs)
    clean = [identification.diagnose(pepper, one, responses[one.person]) for one in parts]
    ways = [ways_of(pepper, one, responses[one.person]) for one in parts]
    rng = np.random.default_rng(0)

    def make(kind, size, k):
        part, way = parts[k % len(parts)], ways[k % len(parts)]
        made = spoiled(part, way, (kind, size), rng)
        if made is None:
            return None
        log, joint = made
        return identification.diagnose(pepper, log, responses[part.person]), joint

    yield from curves("real logs", LOG_SIZES, clean, seeds, make)


def reference(pepper, rng):
    """Return a motion about the middle of the ranges, sums of three waves, and its speed; shapes (T, n)."""
    t = STEP * np.arange(round(DURATION / STEP) + 1)[:, None]
    places = [pepper.joint_index(name) for name in MOVING]
    lower, upper = pepper.lower_limits[places], pepper.upper_limits[places]
    reach = 0.3 * np.minimum(upper - lower, 1.6)
    q = np.tile(pepper.posture("Stand"), (t.size, 1))
    v = np.zeros_like(q)
    q[:, places] = np.clip(q[0, places], lower + 1.1 * reach, upper - 1.1 * reach)
    for _ in range(3):
        w, phase = rng.uniform(0.3, 1.5, len(places)), rng.uniform(0.0, 2.0 * np.pi, len(places))
        q[:, places] += reach / 3.0 * np.sin(w * t + phase)
        v[:, places] += reach / 3.0 * w * np.cos(w * t + phase)
    return q, v


def robot(pepper, rng):
    """Return a robot that differs from the monitor's twin, and its actuators."""
    links = {
        link.get("name"): link.find("inertial/mass")
        for link in fromstring(pepper.export("urdf")).iter("link")
    }
    masses = {name: float(mass.get("value")) for name, mass in links.items() if mass is not None}
    other = pepper.with_masses(
        {name: mass * rng.uniform(0.97, 1.03) for name, mass in masses.items() if mass > 0}
    )
    nominal = actuator_parameters(pepper, "measured")
    scales = {quantity: rng.uniform(1.0 - by, 1.0 + by, pepper.n) for quantity, by in UNSURE.items()}
    return other, nominal.changed(**{name: scale * getattr(nominal, name) for name, scale in scales.items()})


def recorded(pepper, kind, size, rng):
    """Return a run of a robot with a fault that begins in the second quarter, and where."""
    (body, actuators), (q, v) = robot(pepper, rng), reference(pepper, rng)
    onset, rows = int(rng.uniform(0.25, 0.5) * len(q)), len(q)
    joint = str(rng.choice(LOADED if kind == monitor.WEAK else MOVING))
    part, options, changed = joint, {}, actuators
    if kind == monitor.WEAK:
        changed = actuators.changed(strength={joint: size})
    elif kind == monitor.STUCK:
        changed, rows = actuators.changed(coulomb_friction={joint: 1e3}), onset + round(size / STEP)
    elif kind == monitor.PAYLOAD:
        part = str(rng.choice(["left", "right"]))
        options = {"payload": {part: size}}
    pieces, last = [], None
    for bodily, first, beyond in ((actuators, 0, onset), (changed, onset, rows), (actuators, rows, len(q))):
        twin = Twin(body, STEP, actuators=bodily, **(options if bodily is changed and first == onset else {}))
        start = (q[0], v[0]) if last is None else (last.position[-1], last.velocity[-1])
        twin.reset(np.clip(start[0], pepper.lower_limits, pepper.upper_limits), start[1])
        if beyond > first:
            last = twin.follow(q[first:beyond], v[first:beyond])
            pieces.append(last)
    return sensed(pepper, pieces, (q, v), rng, (kind, joint, size, onset)), part


def sensed(pepper, pieces, wanted, rng, fault):
    """Return pieces of a run as encoders and torque sensors at 50 Hz tell them."""
    kind, joint, size, onset = fault
    rows = slice(EVERY - 1, None, EVERY)
    position = np.concatenate([piece.position[1:] for piece in pieces])
    velocity = np.concatenate([piece.velocity[1:] for piece in pieces])[rows]
    torque = np.concatenate([piece.torque[1:] for piece in pieces])
    count = len(velocity)
    torque = torque[: count * EVERY].reshape(count, EVERY, -1).mean(axis=1)
    encoders, gauges = (sensor_specifications()[name] for name in ("joint_encoders", "joint_torques"))
    if kind == monitor.BIAS:
        position[onset:, pepper.joint_index(joint)] += size * rng.choice([-1.0, 1.0])
    read = position[rows] + encoders.noise * rng.normal(size=velocity.shape)
    read = np.round(read / encoders.resolution) * encoders.resolution + encoders.bias * rng.normal(
        size=pepper.n
    )
    torque += gauges.noise * rng.normal(size=torque.shape) + gauges.bias * rng.normal(size=pepper.n)
    q, v = (values[: count * EVERY][rows] for values in wanted)
    time = STEP * EVERY * np.arange(count)
    return Run(
        pepper.joint_names, pepper.joint_units, time, read, velocity, torque, q, v, pepper.effort_limits
    )  # fmt: skip


def curves_of_runs(pepper, seeds):
    """Yield the curves of faults in runs of the twin."""
    twin = Twin(pepper, STEP * EVERY, actuators=actuator_parameters(pepper, "measured"))
    rng = np.random.default_rng(1)
    clean = [
        identification.diagnose(pepper, recorded(pepper, "", 0.0, rng)[0], twin) for _ in range(2 * seeds)
    ]
    yield alarms_of(clean)

    def make(kind, size, _):
        run, part = recorded(pepper, kind, size, rng)
        return identification.diagnose(pepper, run, twin), part

    yield from curves("runs of a twin", RUN_SIZES, clean, seeds, make)


def driven(pepper, size, rng):
    """Return a run of the base whose one wheel slips from the second quarter on, and the wheel."""
    controller, position, velocity = BaseController(OmniBase(pepper)), [], []
    for k in range(round(DURATION / 0.02)):
        if k % 100 == 0:
            wanted = rng.uniform(-1.0, 1.0, 3) * (0.3, 0.3, 0.8)
        controller.command(wanted)
        velocity.append(world_velocity(controller.step(0.02), controller.pose[2]))
        position.append(controller.pose)
    q, v = np.tile(pepper.posture("Stand"), (len(position), 1)), np.zeros((len(position), pepper.n))
    q[:, :3], v[:, :3] = position, velocity
    suite = SensorSuite(pepper, sensors=["wheel_odometry"], seed=int(rng.integers(1 << 30)))
    run = Twin(pepper, 0.02, sensors=suite).follow(q, v)
    seen = run.readings["wheel_odometry"]
    base, wheel = OmniBase(pepper), int(rng.integers(3))
    turns = arc_between(seen.value[:-1, :3], seen.value[1:, :3]) @ base.wheel_map.T
    turns[int(rng.uniform(0.25, 0.5) * len(turns)) :, wheel] /= 1.0 - size
    odometry = Odometry(base, seen.value[0, :3])
    value = np.array(seen.value)
    value[1:, :3] = [odometry.add(turn) for turn in turns]
    return replace(run, readings={"wheel_odometry": replace(seen, value=value)}), base.geometry.wheel_names[
        wheel
    ]


def curve_of_wheels(seeds):
    """Yield the curve of wheels that slip."""
    pepper, rng = pk.load_pepper(base="planar"), np.random.default_rng(2)
    clean = [identification.diagnose(pepper, driven(pepper, 0.0, rng)[0]) for _ in range(2 * seeds)]
    yield alarms_of(clean)

    def make(_, size, k):
        run, wheel = driven(pepper, size, rng)
        return identification.diagnose(pepper, run), wheel

    yield from curves("runs of a twin", {monitor.SLIP: SLIPS}, clean, seeds, make)


@figures("monitor.md", "robots' logs, but for the parts twin and wheels", seeds=1, part="wheels")
def run_monitor(folder: Path = LOGS, seeds: int = 40, part: str = "") -> Iterator[tuple | str]:
    """The monitor of runs: false alarms an hour on a real Pepper's logs, and curves on injected faults.

    False alarms: how joints follow, and thresholds (a margin x the largest sum), are fitted to the logs of
    some persons and counted on those of the others, and the other way about.  Nobody knows of a fault in
    these logs: each alarm counts as false.

    Curves: area under the receiver operating characteristic (AUC) of the largest score of a kind, `seeds`
    runs of each size with an injected fault against runs of the same source without one.  Stuck joints and
    biased readings are injected into windows of 120 s of the logs, and like weak motors and payloads into
    runs of a twin of 60 s.  Its stiffness, friction and masses differ from those of the monitor's twin
    (`UNSURE`), and its encoders and torque sensors err as the package's sensors do, at 50 Hz.  Wheels that
    slip turn farther than the base moves; their odometry errs as the package's.  A part, logs, twin or
    wheels, runs alone.
    """
    pepper, responses = pk.load_pepper(), {}
    if part in ("", "logs"):
        logs = read_logs(folder)
        yield from false_alarms(pepper, logs, responses)
        yield from curves_of_logs(pepper, logs, responses, seeds)
    if part in ("", "twin"):
        yield from curves_of_runs(pepper, seeds)
    if part in ("", "wheels"):
        yield from curve_of_wheels(seeds)


ENCODER, SENSOR = 1e-4, 0.005  # [rad], and share of the effort limit
SAMPLE, FINER = 0.002, 10  # [s]; the twin's own steps are finer, and their error is not what is examined
MOTIONS = 3  # for each set of joints


def scenario(pepper, number, motions, exact=False):
    """Return what makes a recording without noise, the load, the joints and what is true."""
    rng = np.random.default_rng(number)
    side, whole, wrist = ("left", "right")[number % 2], number % 5 == 4, number % 4 > 1
    moved = None if whole else f"{side}_arm"
    key = moved, number % MOTIONS
    if key not in motions:
        motions[key] = identification.excitation_motion(pepper, moved, draws=20, seed=key[1]).trajectory
    joints = None if whole and number % 3 else f"{side}_arm"
    frame = f"{side[0]}_wrist" if wrist else side
    usual, names = actuator_parameters(pepper, "motor").changed(latency=0.0), pepper.resolve_joints(joints)
    changed = {
        name: getattr(usual, name) * rng.uniform(0.7, 1.4, pepper.n)
        for name in ("viscous_friction", "coulomb_friction", "rotor_inertia", "stiffness")
    }
    if exact:
        changed["encoder_resolution"] = np.zeros(pepper.n)
    actuators, mass = replace(usual, **changed), float(rng.uniform(0.05, 0.4))

    def recording(load, zeros=0.0):
        """Return a run with a load; the encoders' zeros lie elsewhere, by shares of their steps."""
        moved = motions[key].coefficients.copy()
        moved[:, 0] += zeros * actuators.encoder_resolution
        twin = pk.Twin(pepper, SAMPLE / FINER, feedforward="none", actuators=actuators, payload=load)
        return coarse(twin.execute(replace(motions[key], coefficients=moved)))

    true = {"mass": mass, "x": 0.0, "y": 0.0, "z": 0.0}
    for name in names:
        j = pepper.joint_index(name)
        true |= {
            f"{name}.viscous": actuators.viscous_friction[j],
            f"{name}.coulomb": actuators.coulomb_friction[j],
            f"{name}.stiffness": actuators.stiffness[j],
        }
    return recording, {frame: mass}, joints, true


def coarse(run):
    """Return a run as it is sampled in steps of `SAMPLE`: the mean torque of each, and states at its end."""
    torque = run.torque[1:].reshape(-1, FINER, run.torque.shape[1]).mean(axis=1)
    every = {
        name: getattr(run, name)[::FINER]
        for name in ("time", "position", "velocity", "reference_position", "reference_velocity")
    }
    return replace(run, torque=np.concatenate([run.torque[:1], torque]), external_wrench=None, **every)


def noisy(pepper, run, rng):
    """Return a run as encoders and torque sensors tell it."""
    q = run.position + ENCODER * rng.normal(size=run.position.shape)
    torque = run.torque + SENSOR * pepper.effort_limits * rng.normal(size=run.torque.shape)
    return replace(run, position=q, torque=torque)


def record(first, last, path, only, draws):
    """Append a row for each parameter of each run: scenario, draw, name, true value, value and interval."""
    pepper, motions = pk.load_pepper(), {}
    with open(path, "a", newline="") as file:
        writer = csv.writer(file)
        for number in range(first, last):
            recording, load, joints, true = scenario(pepper, number, motions, only == "exact")
            heavy = recording(load) if only in ("", "payload") else None
            light = recording(None) if only not in ("payload", "zeros") else None
            for draw in range(draws):
                rng, estimates = np.random.default_rng((number, draw)), []
                if only == "zeros":
                    light = recording(None, rng.uniform(-0.5, 0.5, pepper.n))
                if heavy:
                    read, (frame,) = noisy(pepper, heavy, rng), load
                    estimates.append(identification.estimate_payload(pepper, read, frame, joints))
                if light:
                    estimates.append(
                        identification.estimate_stiffness(pepper, noisy(pepper, light, rng), joints)
                    )
                for found in estimates:
                    for name, value, ends in zip(found.names, found.values, found.intervals, strict=True):
                        writer.writerow([number, draw, name, true[name], value, *ends])
            file.flush()


@figures("recipes/twin.md", last=1, draws=2)
def estimates(first=0, last=40, rows=Path("rows.csv"), only="", draws=25) -> Iterator[tuple]:
    """Do 95 % intervals of estimates hold the truth?

    Scenarios from the first to the last are recorded with the twin: a hand or wrist that carries a load of 50
    to 400 g, whose actuators have friction, rotors and stiffness of 0.7 to 1.4 of the usual, on a motion of
    its arm or of all joints.  Each recording gets the noise of encoders and torque sensors `draws` times, and
    each of these is one run: payload and friction are estimated, and stiffness from a recording without load.
    What was found is appended to the file `rows`, whose table is printed; a last scenario of 0 only prints
    it.  `only` is `payload` or `stiffness`, which leaves the other out; `exact`, stiffness of servos whose
    encoders have no steps; or `zeros`, stiffness from recordings of their own, in each of which the encoders'
    zeros lie elsewhere.

    The width of an interval is compared with that of 95 % of the estimates from the noise drawn again on the
    same recording (a bootstrap with the true errors), 3.92 standard deviations of them; of stiffness, those
    of 1 / Kp.  "Error" is the root mean square of estimate - truth over the standard deviation that its
    interval stands for.
    """
    record(first, last, rows, only, draws)
    known = defaultdict(lambda: defaultdict(list))
    with open(rows, newline="") as file:
        for number, _, name, *numbers in csv.reader(file):
            row, kind = [float(one) for one in numbers], name.rpartition(".")[2]
            if kind == "stiffness":  # estimated as compliance, in which intervals are symmetric
                row = [1 / row[0], 1 / row[1], 1 / row[3], 1 / row[2]]
            known[kind][number, name].append(row)
    for kind, scenarios in known.items():
        inside, width, shift, error, count = [], [], [], [], 0
        for runs in scenarios.values():
            true, value, low, high = np.array(runs).T
            spread = value.std(ddof=1)
            inside.append(np.mean((low <= true) & (true <= high)))
            width.append(np.median(high - low) / (3.92 * spread))
            shift.append((value - true).mean() / spread)
            error.append(np.mean((3.92 * (value - true) / (high - low)) ** 2))
            count += len(runs)
        shifts = np.sqrt([np.mean(np.square(shift)), np.mean(error)])
        yield (
            "parameter | runs {:,} | inside {:.1f} % | least of a scenario {:.0f} % | width over the "
            "spread {:.2f} | worst {:.2f} | shift {:.2f} | error {:.2f}",
            kind, count, 100 * np.mean(inside), 100 * min(inside), np.median(width), max(width), *shifts,
        )  # fmt: skip
