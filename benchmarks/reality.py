"""The twin beside a real Pepper, from its logs: each person's with actuators fitted to the other persons'.

For each joint |twin - robot| without the stretches that no actuator explains, the delay that is left, and of
all readings rms(twin - robot) / rms(command - robot), beside the kinematic model (no latency, lag or
backlash, the full speed; its arms are kept off the body, too).  Logs are tables as `pepper-kin check log`
takes them; docs/validation.md names the source of ours.

python benchmarks/reality.py [FOLDER] [--packaged] [--json] [--data]

    FOLDER       ../shared/robot_logs, or $PEPPER_KIN_ROBOT_LOGS, by default
    --packaged   replay with the values of the package instead: for logs of other persons
    --data       print the fit to all persons as the package keeps it, twin/data/joint_responses.json
"""

from __future__ import annotations

import argparse
import json
import os
import time
from pathlib import Path

import numpy as np

import pepper_kin as pk
from pepper_kin import identification

USUAL = Path(__file__).parents[2] / "shared" / "robot_logs"
ASKED = {"median": 0.004, "p95": 0.025, "rms": 0.020, "delay": 0.02}
DIGITS = {"speed_share": 3, "latency": 3, "lag": 3, "backlash": 4, "compliance": 4}


def held_out(pepper, logs, fit):
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


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "folder", nargs="?", type=Path, default=os.environ.get("PEPPER_KIN_ROBOT_LOGS", USUAL)
    )
    parser.add_argument("--packaged", action="store_true")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--data", action="store_true")
    options = parser.parse_args()
    files = sorted(Path(options.folder).glob("*.csv*"))
    if not files:
        parser.error(f"no logs in {options.folder}")
    pepper = pk.load_pepper()
    logs = [identification.read_log(file) for file in files]
    began = time.process_time()
    fit = None if options.packaged else identification.fit_actuators(pepper, logs)
    fitting = time.process_time() - began
    if options.data:
        print(json.dumps(data(fit), indent=1))
        return
    began = time.process_time()
    replays = (
        [identification.replay(pepper, log) for log in logs] if fit is None else held_out(pepper, logs, fit)
    )
    spent = time.process_time() - began
    plain = pk.twin.joint_response(pepper, "ideal")
    ideal = [identification.replay(pepper, log, plain, round_trip=0.0) for log in logs]
    minutes = sum(log.duration for log in logs) / 60.0
    found = summary(replays, ideal)
    persons = {
        person: summary(
            [one for one in replays if one.log.person == person],
            [one for one in ideal if one.log.person == person],
        )
        for person in sorted({log.person for log in logs})
    }
    if options.json:
        joints = {name: one.as_dict() for name, one in identification.compared(replays).items()}
        print(json.dumps({"all": found, "persons": persons, "joints": joints, "minutes": minutes}, indent=1))
        return
    print(
        f"{len(logs)} logs, {minutes:.0f} minutes; replay of ten minutes {600 * spent / 60 / minutes:.2f} s"
    )
    if fit is not None:
        print(f"fit with each person left out: {fitting:.0f} s of processor time\n{fit.report()}\n")
        print("largest change / interval when a person is left out:", changes(fit), "\n")
    print(identification.report_of(replays))
    for person, numbers in {"all": found, **persons}.items():
        worst = ", ".join(f"{q} {1e3 * value:.1f}" for q, value in numbers["worst"].items())
        within = ", ".join(f"{count}" for count in numbers["joints_within"].values())
        print(
            f"{person:>4}: worst joint [mrad, ms] {worst} (joints within {within}); "
            f"ratio {numbers['mean_ratio']:.2f}, kinematic {numbers['mean_ratio_ideal']:.2f}; "
            f"named {100 * numbers['named_readings']:.0f} % of readings, "
            f"{100 * numbers['named_squares']:.0f} % of the squared error; "
            f"median not below the kinematic one: {', '.join(numbers['median_above_ideal']) or 'none'}"
        )


if __name__ == "__main__":
    main()
