"""Certified motions against code that shares nothing with what times and certifies them.

Extremes by the roots of polynomials (NumPy), torques by Pinocchio between milliseconds, wheels by finite
differences of where the model has them, durations beside toppra.
"""

import numpy as np
import pinocchio
import pytest
from numpy.polynomial import polynomial

import pepper_kin as pk
from pepper_kin.exceptions import InfeasibleError, PepperKinError
from pepper_kin.model.at_frames import HANDS
from pepper_kin.model.wheels import BASE_JOINTS
from pepper_kin.trajectory import Trajectory
from pepper_kin.trajectory.limits import NAMED, jerk_limits

EXTREME = ("velocity_scale", "acceleration_scale", "torque_scale", "payload", "jerk", "path")
RADIUS, FASTEST = 0.07, 6.28319  # Pepper's wheels, by its URDF


@pytest.fixture(scope="module")
def robots():
    return {base: pk.load_pepper(base=base) for base in ("fixed", "planar")}


def random_path(pepper, rng):
    """Waypoints of all joints or a few, near or far, some of which rest; the base drives within 1 m."""
    count = int(rng.integers(2, 7))
    lower, upper = np.maximum(pepper.lower_limits, -3.0), np.minimum(pepper.upper_limits, 3.0)
    legs = [pepper.joint_index(name) for name in ("KneePitch", "HipPitch", "HipRoll")]
    lower[legs], upper[legs] = 0.08 * lower[legs], 0.08 * upper[legs]
    for name in set(BASE_JOINTS) & set(pepper.joint_names):
        lower[pepper.joint_index(name)], upper[pepper.joint_index(name)] = -0.5, 0.5
    middle = (lower + upper) / 2
    points = middle + 0.9 * (rng.uniform(lower, upper, (count, pepper.n)) - middle)
    points = points[0] + rng.choice([1.0, 0.3, 0.01]) * (points - points[0])
    rests = rng.random(pepper.n) < rng.choice([0.0, 0.5, 0.9])
    rests[rng.integers(pepper.n)] = False
    points[:, rests] = points[0, rests]
    return points


def random_options(pepper, rng):
    options = {
        "velocity_scale": float(rng.choice([1.0, rng.uniform(0.05, 1.0)])),
        "acceleration_scale": float(rng.choice([1.0, rng.uniform(0.05, 1.0)])),
        "torque_scale": float(rng.choice([1.0, rng.uniform(0.6, 1.0)])),
        "gridpoints": int(rng.choice([20, 100, 200])),
    }
    if rng.random() < 0.4:
        options["jerk"] = str(rng.choice(list(NAMED)))
    if rng.random() < 0.25:
        options["payload"] = {str(rng.choice(["left", "right"])): float(rng.uniform(0.01, 0.4))}
    if rng.random() < 0.2:
        options["balance"] = float(rng.uniform(0.0, 0.02))
    if rng.random() < 0.2:
        options["hand_speed"] = float(rng.uniform(0.1, 1.0))
    return options


def extremes(trajectory, order, rng):
    """Greatest and least values of a derivative of each joint, shape (n,), by the roots of the next one.

    Roots are looked for where samples are greatest and least, and on a few segments at random.
    """
    step = np.diff(trajectory.breaks)
    powers = np.arange(trajectory.coefficients.shape[1])
    unit = trajectory.coefficients * step[:, None, None] ** powers[:, None]  # over [0, 1]
    curves = np.moveaxis(unit, 1, 0)
    curves = polynomial.polyder(curves, order) if order else curves
    size = step[:, None, None] ** order
    sampled = polynomial.polyval(np.linspace(0.0, 1.0, 9), curves) / size
    high, low = sampled.max(axis=(0, 2)), sampled.min(axis=(0, 2))
    for j in range(trajectory.n):
        near = np.argsort(sampled[:, j].max(axis=1))[-3:], np.argsort(sampled[:, j].min(axis=1))[:3]
        for i in {*near[0].tolist(), *near[1].tolist(), *rng.integers(step.size, size=2).tolist()}:
            slope = np.trim_zeros(polynomial.polyder(curves[:, i, j]), "b")
            turns = polynomial.polyroots(slope) if slope.size > 1 else np.zeros(0)
            turns = turns[np.abs(turns.imag) < 1e-5].real
            value = polynomial.polyval(turns[(turns > 0) & (turns < 1)], curves[:, i, j]) / size[i, 0, 0]
            high[j], low[j] = max(high[j], *value, -np.inf), min(low[j], *value, np.inf)
    return high, low


def torque_of(pepper, trajectory, payload, rng):
    """Greatest torques at random instants, loads as bodies of another model, by Pinocchio, shape (n,)."""
    model = pepper.pinocchio_model.copy()
    for hand, mass in payload.items():
        frame = model.frames[model.getFrameId(HANDS[hand])]
        load = pinocchio.Inertia(mass, frame.placement.translation, np.zeros((3, 3)))
        model.inertias[frame.parentJoint] = model.inertias[frame.parentJoint] + load
    data = model.createData()
    state = trajectory(np.sort(rng.uniform(0.0, trajectory.duration, 400)))
    return np.abs([pinocchio.rnea(model, data, *row) for row in zip(*state, strict=True)]).max(axis=0)


def outside(value, lower, upper):
    """What is beyond limits, as a share of their range, where they are finite."""
    with np.errstate(invalid="ignore"):
        return np.nan_to_num(np.maximum(value - upper, lower - value) / (upper - lower), nan=0.0).max()


def faults(pepper, trajectory, options, rng):
    """Sentences on limits that a motion which its certificate passed is found to exceed."""
    shown = {name: options[name] for name in ("jerk", "payload", "hand_speed") if name in options}
    found = trajectory.check(pepper, collisions=False, balance=options.get("balance"), **shown)
    wrong = [] if found.success else [found.report()]
    v = pepper.velocity_limits * options.get("velocity_scale", 1.0)
    a = pepper.acceleration_limits * options.get("acceleration_scale", 1.0)
    bounds = [(pepper.lower_limits, pepper.upper_limits), (-v, v), (-a, a)]
    if "jerk" in options:
        rate = jerk_limits(pepper, options["jerk"])
        bounds.append((-rate, rate))
    for order, (lower, upper) in enumerate(bounds):
        over = max(outside(value, lower, upper) for value in extremes(trajectory, order, rng))
        if over > 1e-9:
            wrong.append(f"derivative {order} is {over:.3g} of its range beyond its limits")
    torque = torque_of(pepper, trajectory, options.get("payload", {}), rng)
    effort = pepper.effort_limits * options.get("torque_scale", 1.0)
    if np.any(torque > effort + found.torque.resolution + 1e-7 * effort):
        wrong.append(f"torque {torque / effort} with a resolution of {found.torque.resolution / effort}")
    if found.wheel_speed is not None:
        share = options.get("velocity_scale", 1.0)
        speed, base = wheel_speeds(pepper, trajectory)
        if speed > share * FASTEST + found.wheel_speed.resolution + 1e-4:
            wrong.append(f"wheels turn at {speed:.5g} rad/s")
        if base > share * FASTEST * RADIUS + found.base_speed.resolution + 1e-9:
            wrong.append(f"the base goes at {base:.5g} m/s")
    return wrong


def wheel_speeds(pepper, trajectory, h=1e-5):
    """Greatest speed of a wheel [rad/s], by its places a little earlier and later, and of the base [m/s]."""
    time = np.linspace(h, trajectory.duration - h, 300)
    found = 0.0
    before, now, after = (trajectory(time + shift).position for shift in (-h, 0.0, h))
    for name in ("WheelFL_link", "WheelFR_link", "WheelB_link"):
        ends = [pk.kinematics.frame_pose(pepper, q, name)[:, :2, 3] for q in (before, after)]
        axle = pk.kinematics.frame_pose(pepper, now, name)[:, :2, 0]
        along = np.stack([axle[:, 1], -axle[:, 0]], axis=1)
        rolled = np.einsum("ti,ti->t", (ends[1] - ends[0]) / (2 * h), along)
        found = max(found, float(np.abs(rolled).max()) / RADIUS)
    return found, float(np.linalg.norm(trajectory(time).velocity[:, :2], axis=1).max())


@pytest.mark.parametrize("base", ["fixed", "planar"])
def test_certified_motions_keep_their_limits_everywhere(robots, base, amount, rng, tried):
    pepper, count, refused, wrong = robots[base], amount(3, 40, 5_000), 0, []
    for case in range(count):
        path, options = random_path(pepper, rng), random_options(pepper, rng)
        try:
            trajectory = pk.retime(pepper, path, **options)
        except InfeasibleError:
            refused += 1
            continue
        wrong += [f"{case}: {options}: {fault}" for fault in faults(pepper, trajectory, options, rng)]
    tried("timings", count - refused, wrong=len(wrong))
    assert not wrong, "\n".join(wrong)
    assert refused < 0.9 * count


def test_durations_are_those_of_toppra(robots, amount, rng, tried):
    pepper, wrong, done = robots["fixed"], [], 0
    for _ in range(amount(2, 25, 2_000)):
        path, options = random_path(pepper, rng), random_options(pepper, rng)
        options = {name: options[name] for name in ("velocity_scale", "acceleration_scale")}
        try:
            ours = pk.retime(pepper, path, **options)
        except InfeasibleError:
            continue
        theirs = pk.retime(pepper, path, solver="toppra", **options)
        done += 1
        if not abs(ours.duration / theirs.duration - 1) < 0.02:
            wrong.append(f"{options}: {ours.duration} s, toppra {theirs.duration} s")
    tried("durations beside toppra", done, wrong=len(wrong))
    assert not wrong, "\n".join(wrong)


def test_whatever_is_asked_is_answered_or_refused_by_the_library(robots, amount, rng, tried):
    pepper, count, wrong = robots["fixed"], amount(6, 30, 5_000), []
    for _ in range(count):
        path, options = random_path(pepper, rng), random_options(pepper, rng)
        name = str(rng.choice(EXTREME))
        size = 10.0 ** rng.uniform(-15, 15)
        if name == "payload":
            options["payload"] = {"left": size}
        elif name == "jerk":
            options["jerk"] = size
        elif name == "path":
            path[int(rng.integers(len(path)))] = path[0] + rng.choice([0.0, 1e-12, 1e-9, 1e-6])
        else:
            options[name] = min(size, 1.0)
        try:
            trajectory = pk.retime(pepper, path, **options)
        except PepperKinError:
            continue
        except Exception as error:
            wrong.append(f"{name} {size:.3g}, {options}: {type(error).__name__}: {error}")
            continue
        if not (np.isfinite(trajectory.coefficients).all() and trajectory.duration > 0):
            wrong.append(f"{name} {size:.3g}, {options}: not finite")
    tried("extreme requests of timing", count, wrong=len(wrong))
    assert not wrong, "\n".join(wrong)


def test_bounds_between_states_hold_on_any_motion(robots, amount, rng, tried):
    """On polynomials that nobody timed, torques and speeds of hands at random instants."""
    pepper, count, wrong = robots["fixed"], amount(4, 40, 5_000), []
    for _ in range(count):
        order, segments = int(rng.integers(2, 8)), int(rng.integers(1, 6))
        breaks = np.concatenate([[0.0], np.cumsum(10.0 ** rng.uniform(-4, -0.5, segments))])
        scale = 10.0 ** rng.uniform(-1, 1) * np.array([1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1e3])[:order]
        coefficients = rng.normal(size=(segments, order, pepper.n)) * scale[:, None]
        trajectory = Trajectory(pepper.joint_names, breaks, coefficients, pepper.joint_units)
        found = trajectory.check(pepper, collisions=False, hand_speed={"left": 1.0})
        torque = torque_of(pepper, trajectory, {}, rng)
        if np.any(torque > np.abs(found.torque.value) + found.torque.resolution + 1e-9 * torque):
            wrong.append(f"torque of {order - 1}-th degree, breaks {breaks}")
        state = trajectory(rng.uniform(0.0, trajectory.duration, 300))
        speed = np.linalg.norm(
            pk.kinematics.frame_velocity(pepper, *state[:2], HANDS["left"])[:, :3], axis=1
        ).max()
        if speed > found.hand_speed.value + found.hand_speed.resolution + 1e-9:
            wrong.append(f"hand at {speed}, stated {found.hand_speed}")
    tried("motions with bounds between states", count, wrong=len(wrong))
    assert not wrong, "\n".join(wrong)
