"""Do 95 % intervals of estimates hold the truth?  `python benchmarks/estimates.py FIRST LAST ROWS.csv`.

Scenarios FIRST to LAST - 1 are recorded with the twin: a hand or wrist that carries a load of 50 to 400 g,
whose actuators have friction, rotors and stiffness of 0.7 to 1.4 of the usual, on a motion of its arm or of
all joints.  Each recording gets the noise of encoders and torque sensors `DRAWS` times, and each of these is
one run: payload and friction are estimated, and stiffness from a recording without load.  What was found is
appended to ROWS.csv; `python benchmarks/estimates.py ROWS.csv` prints its table.  A fourth argument,
`payload` or `stiffness`, leaves the other out; `exact` has stiffness of servos whose encoders have no steps,
`zeros` stiffness from recordings of their own, in each of which the encoders' zeros lie elsewhere.

The width of an interval is compared with that of 95 % of the estimates from the noise drawn again on the same
recording (a bootstrap with the true errors), 3.92 standard deviations of them; of stiffness, those of 1 / Kp.
"Error" is the root mean square of estimate - truth over the standard deviation that its interval stands for.
"""

import csv
import sys
from collections import defaultdict
from dataclasses import replace

import numpy as np

import pepper_kin as pk
from pepper_kin import identification
from pepper_kin.twin import actuator_parameters

DRAWS = 25
ENCODER, SENSOR = 1e-4, 0.005  # [rad], and share of the effort limit
STEP, FINER = 0.002, 10  # [s]; the twin's own steps are finer, and their error is not what is examined
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
        twin = pk.Twin(pepper, STEP / FINER, feedforward="none", actuators=actuators, payload=load)
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
    """Return a run as it is sampled in steps of `STEP`: the mean torque of each, and states at its end."""
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


def record(first, last, path, only=""):
    """Append a row for each parameter of each run: scenario, draw, name, true value, value and interval."""
    pepper, motions = pk.load_pepper(), {}
    with open(path, "a", newline="") as file:
        writer = csv.writer(file)
        for number in range(first, last):
            recording, load, joints, true = scenario(pepper, number, motions, only == "exact")
            heavy = recording(load) if only in ("", "payload") else None
            light = recording(None) if only not in ("payload", "zeros") else None
            for draw in range(DRAWS):
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


def table(path):
    """Print, for each kind of parameter, coverage, widths and the shift of the mean."""
    known = defaultdict(lambda: defaultdict(list))
    with open(path, newline="") as file:
        for number, _, name, *numbers in csv.reader(file):
            row, kind = [float(one) for one in numbers], name.rpartition(".")[2]
            if kind == "stiffness":  # estimated as compliance, in which intervals are symmetric
                row = [1 / row[0], 1 / row[1], 1 / row[3], 1 / row[2]]
            known[kind][number, name].append(row)
    print(
        "| parameter | runs | inside | least of a scenario | width over the spread | worst | shift | error |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for kind, scenarios in known.items():
        inside, width, shift, error, count = [], [], [], [], 0
        for rows in scenarios.values():
            true, value, low, high = np.array(rows).T
            spread = value.std(ddof=1)
            inside.append(np.mean((low <= true) & (true <= high)))
            width.append(np.median(high - low) / (3.92 * spread))
            shift.append((value - true).mean() / spread)
            error.append(np.mean((3.92 * (value - true) / (high - low)) ** 2))
            count += len(rows)
        print(
            f"| {kind} | {count:,} | {100 * np.mean(inside):.1f} % | {100 * min(inside):.0f} % | "
            f"{np.median(width):.2f} | {max(width):.2f} | {np.sqrt(np.mean(np.square(shift))):.2f} | "
            f"{np.sqrt(np.mean(error)):.2f} |"
        )


if __name__ == "__main__":
    record(int(sys.argv[1]), int(sys.argv[2]), *sys.argv[3:]) if len(sys.argv) > 2 else table(sys.argv[1])
