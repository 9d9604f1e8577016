"""The monitor of runs: false alarms an hour on a real Pepper's logs, and curves on injected faults.

False alarms: how joints follow, and thresholds (a margin x the largest sum), are fitted to the logs of some
persons and counted on those of the others, and the other way about.  Nobody knows of a fault in these logs:
each alarm counts as false.

Curves: area under the receiver operating characteristic (AUC) of the largest score of a kind, runs with an
injected fault against runs of the same source without one.  Stuck joints and biased readings are injected
into windows of 120 s of the logs, and like weak motors and payloads into runs of a twin of 60 s.  Its
stiffness, friction and masses differ from those of the monitor's twin (`UNSURE`), and its encoders and
torque sensors err as the package's sensors do, at 50 Hz.  Wheels that slip turn farther than the base moves;
their odometry errs as the package's.

python benchmarks/run_monitor.py [FOLDER] [--seeds N] [--part logs|twin|wheels]

    FOLDER   of logs as benchmarks/reality.py takes them; ../shared/robot_logs, or $PEPPER_KIN_ROBOT_LOGS
    --seeds  windows or runs of each size; 40 if omitted
"""

from __future__ import annotations

import argparse
import os
from dataclasses import replace
from pathlib import Path
from xml.etree.ElementTree import fromstring

import numpy as np
from scipy import stats

import pepper_kin as pk
from pepper_kin import identification
from pepper_kin.identification import run_monitor as monitor
from pepper_kin.twin import Run, Twin, actuator_parameters
from pepper_kin.twin.base import BaseController, Odometry, OmniBase, arc_between, world_velocity
from pepper_kin.twin.sensors import SensorSuite, sensor_specifications

USUAL = Path(__file__).parents[2] / "shared" / "robot_logs"
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
MOVING = (
    "HeadYaw",
    "HeadPitch",
    "HipPitch",
    "HipRoll",
    "KneePitch",
    *(s + name for s in "LR" for name in ARM),
)
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
    given, read = (
        (log.command_time >= begin) & (log.command_time < end),
        (log.time >= begin) & (log.time < end),
    )
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
    sent so far is not taken, and None is returned where no joint is.

    Args:
        log: A window of a log.
        ways: Joint -> times of its judged readings [s], and the twin's changes between them [rad].
        fault: Its kind and size.
        rng: Generator.
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


def held_out(pepper, logs):
    """Print false alarms of each part of the persons with what was fitted to the other; return responses."""
    responses, hours = {}, sum(log.duration for log in logs) / 3600.0
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
            print(f"thresholds {margin} x the largest sums of {fitted}: {words}")
            length = sum(log.duration for log in others) / 3600.0
            print(f"  {len(alarms)} false alarms in {length:.2f} h of the others", *alarms, sep="\n    ")
    for margin, count in counted.items():
        low, high = np.nan_to_num(stats.chi2.ppf([0.025, 0.975], [2 * count, 2 * count + 2])) / 2.0 / hours
        rate = f"{count / hours:.2f} an hour (95 % interval {low:.2f} to {high:.1f})"
        print(f"held out, {margin}: {count} in {hours:.2f} h, {rate}")
    return responses


def table(title, negative, found):
    """Print a curve over sizes: AUC, and how often kind and part were named."""
    print(f"{title}: {len(negative)} windows without a fault")
    for size, scores, named in found:
        print(f"  {size:>7g}  AUC {area(negative, scores):.3f}  named {np.mean(named):4.0%} of {len(scores)}")


def alarms_of(clean):
    """Return in words how many faults were named in runs without one, and the largest sums of each kind."""
    count = sum(len(one.faults) for one in clean)
    sums = {k: max(one.score(k) * limit for one in clean) for k, limit in monitor.THRESHOLDS.items()}
    largest = ", ".join(f"{kind} {value:.1f}" for kind, value in sums.items() if value)
    return f"{count} false alarms in {len(clean) * DURATION / 3600:.2f} h of runs; largest sums: {largest}"


def named_right(found, kind, part):
    """Return whether a diagnosis names the fault at its part."""
    return any(fault.kind == kind and fault.part == part for fault in found.faults)


def curves_of_logs(pepper, logs, responses, seeds):
    """Print the curves of faults in real logs."""
    parts = windows(logs)
    clean = [identification.diagnose(pepper, one, responses[one.person]) for one in parts]
    ways = [ways_of(pepper, one, responses[one.person]) for one in parts]
    rng = np.random.default_rng(0)
    for kind, sizes in LOG_SIZES.items():
        rows = []
        for size in sizes:
            scores, named = [], []
            for k in range(seeds):
                part, way = parts[k % len(parts)], ways[k % len(parts)]
                made = spoiled(part, way, (kind, size), rng)
                if made is None:
                    continue
                log, joint = made
                found = identification.diagnose(pepper, log, responses[part.person])
                scores.append(found.score(kind))
                named.append(named_right(found, kind, joint))
            rows.append((size, scores, named))
        table(f"real logs, {kind}", [one.score(kind) for one in clean], rows)


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
    """Print the curves of faults in runs of the twin."""
    twin = Twin(pepper, STEP * EVERY, actuators=actuator_parameters(pepper, "measured"))
    rng = np.random.default_rng(1)
    clean = [
        identification.diagnose(pepper, recorded(pepper, "", 0.0, rng)[0], twin) for _ in range(2 * seeds)
    ]
    print(alarms_of(clean))
    for kind, sizes in RUN_SIZES.items():
        rows = []
        for size in sizes:
            scores, named = [], []
            for _ in range(seeds):
                run, part = recorded(pepper, kind, size, rng)
                found = identification.diagnose(pepper, run, twin)
                scores.append(found.score(kind))
                named.append(named_right(found, kind, part))
            rows.append((size, scores, named))
        table(f"runs of a twin, {kind}", [one.score(kind) for one in clean], rows)


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
    """Print the curve of wheels that slip."""
    pepper, rng, kind = pk.load_pepper(base="planar"), np.random.default_rng(2), monitor.SLIP
    clean = [identification.diagnose(pepper, driven(pepper, 0.0, rng)[0]) for _ in range(2 * seeds)]
    print(alarms_of(clean))
    rows = []
    for size in SLIPS:
        scores, named = [], []
        for _ in range(seeds):
            run, wheel = driven(pepper, size, rng)
            found = identification.diagnose(pepper, run)
            scores.append(found.score(kind))
            named.append(named_right(found, kind, wheel))
        rows.append((size, scores, named))
    table(f"runs of a twin, {kind}", [one.score(kind) for one in clean], rows)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "folder", nargs="?", type=Path, default=os.environ.get("PEPPER_KIN_ROBOT_LOGS", USUAL)
    )
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--part", choices=("logs", "twin", "wheels"))
    options = parser.parse_args()
    pepper = pk.load_pepper()
    if options.part in (None, "logs"):
        files = sorted(Path(options.folder).glob("*.csv*"))
        if not files:
            parser.error(f"no logs in {options.folder}")
        logs = [identification.read_log(file) for file in files]
        curves_of_logs(pepper, logs, held_out(pepper, logs), options.seeds)
    if options.part in (None, "twin"):
        curves_of_runs(pepper, options.seeds)
    if options.part in (None, "wheels"):
        curve_of_wheels(options.seeds)


if __name__ == "__main__":
    main()
