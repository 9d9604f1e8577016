"""Files that `save` wrote, against their own numbers interpolated here, and examined by NumPy and coal.

Points by ros2_control's polynomials of degree 3 and 5, keys of NAOqi by de Casteljau's construction,
polynomials by their powers: dense states of them keep the limits of position, velocity, acceleration, jerk,
torques by Newton and Euler, the zero-moment point in the triangle of the wheels, speeds of hands by
differences, and distances by coal.
"""

import csv
import json
import runpy
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest
import yaml

import pepper_kin as pk
from pepper_kin.collision.loads import loads_of
from pepper_kin.exceptions import InfeasibleError, InvalidValueError
from pepper_kin.files import load, naoqi_arguments, ros_points, save
from pepper_kin.trajectory.limits import jerk_limits

SAMPLED = ("torque", "balance", "hand_speed")
KINDS = ("csv", "npz", "json", "yaml", "py", "mcap", "naoqi_arguments", "ros_points")
TRIANGLE = np.array([[0.09, 0.155], [-0.17, 0.0], [0.09, -0.155]])  # of the wheels, by the URDF [m]
EVERY = 2e-3
"""Time between the states looked at, at most; seven in each piece at least [s]."""


class States(NamedTuple):
    """Time, position and its derivatives, shape (T,) and (T, n); times between keys, shape (T,)."""

    time: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    jerk: np.ndarray | None
    width: np.ndarray


def shares(width):
    """Yield each piece and places in it, 0 to 1."""
    for i, h in enumerate(width):
        yield i, h, np.linspace(0.0, 1.0, max(7, int(h / EVERY) + 2))[:, None]


def of_powers(breaks, coefficients):
    """Return states of polynomials, constant term first, shape (m, k, n)."""
    rows = []
    for i, h, u in shares(np.diff(breaks)):
        c, t = coefficients[i], u * h
        values = []
        for _ in range(4):
            values.append(sum(c[k] * t**k for k in range(len(c))) + 0.0 * t)
            c = np.array([k * c[k] for k in range(1, len(c))]) if len(c) > 1 else np.zeros((1, c.shape[1]))
        rows.append((breaks[i] + t[:, 0], *values, np.full(len(t), h)))
    return States(*(np.concatenate(column) for column in zip(*rows, strict=True)))


def of_points(time, q, v, a=None):
    """Return states by the formulas of ros2_control's JointTrajectoryController (trajectory.cpp)."""
    polynomials = []
    for i, h in enumerate(np.diff(time)):
        p0, p1, v0, v1 = q[i], q[i + 1], v[i], v[i + 1]
        if a is None:
            c = [p0, v0, (-3 * p0 + 3 * p1 - 2 * v0 * h - v1 * h) / h**2]
            c += [(2 * p0 - 2 * p1 + v0 * h + v1 * h) / h**3]
        else:
            a0, a1 = a[i], a[i + 1]
            c = [p0, v0, 0.5 * a0]
            c += [(-20 * p0 + 20 * p1 - 3 * a0 * h**2 + a1 * h**2 - 12 * v0 * h - 8 * v1 * h) / (2 * h**3)]
            c += [
                (30 * p0 - 30 * p1 + 3 * a0 * h**2 - 2 * a1 * h**2 + 16 * v0 * h + 14 * v1 * h) / (2 * h**4)
            ]
            c += [(-12 * p0 + 12 * p1 - a0 * h**2 + a1 * h**2 - 6 * v0 * h - 6 * v1 * h) / (2 * h**5)]
        polynomials.append(c)
    return of_powers(time, np.array(polynomials))


def casteljau(points, u):
    """Return a Bezier curve at u, of control points in a list."""
    while len(points) > 1:
        points = [(1 - u) * p + u * r for p, r in pairwise(points)]
    return points[0]


def of_keys(times, keys, start):
    """Return states of NAOqi's Bezier curves; all joints have their keys at the same times here."""
    assert all(at == times[0] for at in times)
    ends = np.array([0.0, *times[0]])
    value = np.column_stack([start, np.array([[key[0] for key in joint] for joint in keys])])
    before = np.array([[key[1][1:] for key in joint] for joint in keys])
    behind = np.array([[key[2][1:] for key in joint] for joint in keys])
    rows = []
    for i, h, u in shares(np.diff(ends)):
        leave = behind[:, i - 1] if i else np.tile([h / 3, 0.0], (len(keys), 1))  # at rest before the first
        x = [ends[i] + 0 * leave[:, 0], ends[i] + leave[:, 0], ends[i + 1] + before[:, i, 0]]
        x += [ends[i + 1] + 0 * leave[:, 0]]
        y = [value[:, i], value[:, i] + leave[:, 1], value[:, i + 1] + before[:, i, 1], value[:, i + 1]]
        time, q = casteljau(x, u), casteljau(y, u)
        assert np.ptp(time, axis=1).max() < 1e-12
        dx, dy = (casteljau([3 * (r - p) for p, r in pairwise(c)], u) for c in (x, y))
        ddx, ddy = (casteljau([6 * (c[k + 2] - 2 * c[k + 1] + c[k]) for k in (0, 1)], u) for c in (x, y))
        rows.append((time[:, 0], q, dy / dx, (ddy * dx - dy * ddx) / dx**3, np.full(len(u), h)))
    time, q, v, a, width = (np.concatenate(column) for column in zip(*rows, strict=True))
    return States(time, q, v, a, None, width)


FIELDS = ("positions", "velocities", "accelerations")


def numbers_of(kind, path):
    """Return the states of the curve that a file holds."""
    if kind == "csv":
        with path.open(newline="") as file:
            head, *rows = csv.reader(file)
        table = np.array(rows, dtype=float)
        found = [
            table[:, [i for i, name in enumerate(head) if name.endswith(f".{quantity}")]]
            for quantity in ("position", "velocity", "acceleration")
        ]
        return of_points(table[:, 0], *(f if f.size else None for f in found))
    if kind in ("npz", "json"):
        held = np.load(path) if kind == "npz" else json.loads(path.read_text())
        return of_powers(np.array(held["breaks"]), np.array(held["coefficients"]))
    if kind == "yaml":
        points = yaml.load(path.read_text(), getattr(yaml, "CSafeLoader", yaml.SafeLoader))["points"]
        time = [p["time_from_start"]["sec"] + 1e-9 * p["time_from_start"]["nanosec"] for p in points]
        fields = [np.array([p[name] for p in points]) for name in FIELDS]
        return of_points(np.array(time), *(f if f.size else None for f in fields))
    if kind == "mcap":
        from mcap.reader import make_reader
        from mcap_ros2.decoder import DecoderFactory

        with path.open("rb") as file:
            reader = make_reader(file, decoder_factories=[DecoderFactory()])
            message = next(iter(reader.iter_decoded_messages(topics="/joint_trajectory"))).decoded_message
        stamps = [p.time_from_start for p in message.points]
        fields = [np.array([getattr(p, name) for p in message.points], dtype=float) for name in FIELDS]
        time = np.array([t.sec + 1e-9 * t.nanosec for t in stamps])
        return of_points(time, *(f if f.size else None for f in fields))
    assert kind == "py"
    calls = {}

    class Motion:
        def __getattr__(self, name):
            return lambda *arguments: calls.setdefault(name, arguments)

    runpy.run_path(str(path))["run"](Motion())
    _, times, keys = calls["angleInterpolationBezier"]
    return of_keys(times, keys, np.array(calls["angleInterpolationWithSpeed"][1]))


def random_motion(pepper, rng):
    """Return a motion near Stand and the conditions that it was timed with; None where there is none."""
    start = pepper.posture("Stand")
    size = rng.choice([0.05, 0.3, 0.8]) * np.where(np.arange(pepper.n) < 3, 0.15, 1.0)
    count = int(rng.integers(2, 6))
    points = start + size * rng.normal(size=(count, pepper.n)) * (
        rng.random(pepper.n) < rng.choice([0.2, 1.0])
    )
    points[0] = start
    points = np.clip(points, pepper.lower_limits + 1e-3, pepper.upper_limits - 1e-3)
    if rng.random() < 0.25:
        time = np.cumsum(rng.uniform(0.3, 2.0, count))
        with np.testing.suppress_warnings() as hidden:
            hidden.filter(pk.exceptions.OvershootWarning)
            return pk.Trajectory.from_positions(pepper, time, points), {}
    given = {}
    if rng.random() < 0.3:
        given["balance"] = float(rng.uniform(0.0, 0.02))
    if rng.random() < 0.25:
        given["payload"] = {str(rng.choice(["left", "right"])): float(rng.uniform(0.05, 0.3))}
    if rng.random() < 0.25:
        given["hand_speed"] = float(rng.uniform(0.2, 1.0))
    if rng.random() < 0.25:
        given["jerk"] = str(rng.choice(["gentle", "moderate", "brisk"]))
    scales = {
        name: float(rng.choice([1.0, rng.uniform(0.3, 1.0)]))
        for name in ("velocity_scale", "acceleration_scale")
    }
    try:
        motion = pk.retime(
            pepper, points, gridpoints=int(rng.choice([20, 100, 200])), **scales, **{"balance": 0.0, **given}
        )
    except (InfeasibleError, InvalidValueError):
        return None
    return (motion if rng.random() < 0.9 else motion.scaled(0.9)), given


def random_scene(rng):
    scene = pk.Scene()
    for k in range(int(rng.integers(0, 4))):
        place = rng.uniform([0.25, -0.6, 0.4], [0.7, 0.6, 1.2])
        scene = scene.add_box(f"box {k}", size=rng.uniform(0.03, 0.3, 3), position=place)
    return scene


def broken(pepper, states, scene, given, certificate=None):
    """Return the first limit that states break, and by how much; "" for none.

    Torque, balance and speeds of hands are examined every millisecond; a certificate states what
    they may be worse by between, its `resolution`, which counts as kept.
    """
    between = {name: getattr(getattr(certificate, name, None), "resolution", 0.0) for name in SAMPLED}
    # Numbers of a file are rounded to 1e-16, which short pieces amplify in derivatives.
    noise = 1e-14 / states.width[:, None]
    sides = np.maximum(pepper.lower_limits - states.q, states.q - pepper.upper_limits).max()
    if sides > 2e-6:
        return f"position {sides}"
    for name, value, limit, order in (
        ("velocity", states.v, pepper.velocity_limits, 0),
        ("acceleration", states.a, pepper.acceleration_limits, 1),
        ("jerk", states.jerk, jerk_limits(pepper, given["jerk"]) if "jerk" in given else np.inf, 2),
    ):
        if value is not None:
            over = np.abs(value) - limit * (1 + 1e-7) - noise / states.width[:, None] ** order
            if over.max() > 0:
                return f"{name} {over.max()}"
    held = loads_of(pepper, scene, given.get("payload"))
    torque = np.abs(pk.dynamics.newton_euler(pepper, states.q, states.v, states.a, held))
    if (torque > pepper.effort_limits * (1 + 1e-5) + between["torque"]).any():
        return f"torque {(torque / pepper.effort_limits).max()}"
    wrench = pk.dynamics.base_wrench(pepper, states.q, states.v, states.a)
    if held:
        from pepper_kin.collision.loads import load_wrench

        wrench = wrench + load_wrench(pepper, held, states.q, states.v, states.a)
    point = np.column_stack([-wrench[:, 4], wrench[:, 3]]) / wrench[:, 2:3]
    edges = np.roll(TRIANGLE, -1, axis=0) - TRIANGLE
    inward = np.column_stack([-edges[:, 1], edges[:, 0]]) / np.linalg.norm(edges, axis=1)[:, None]
    inside = np.einsum("ki,tki->tk", inward, point[:, None] - TRIANGLE).min()
    if inside < given.get("balance", 0.0) - 2e-6 - min(between["balance"], 1e-3) or wrench[:, 2].min() <= 0:
        return f"balance {inside}"
    if "hand_speed" in given:
        for frame in ("LArm_effector", "RArm_effector"):
            at = pk.kinematics.frame_pose(pepper, states.q, frame)[:, :3, 3]
            step = np.diff(states.time)
            far = np.linalg.norm(np.diff(at, axis=0), axis=1)
            if (far > (given["hand_speed"] * (1 + 1e-6) + between["hand_speed"]) * step + 1e-11).any():
                return f"hand speed of {frame}"
    chosen = np.unique(np.searchsorted(states.time, np.arange(0.0, states.time[-1], 5e-3)))
    nearest = pk.collision.clearance(pepper, states.q[chosen], scene).min()
    return f"clearance {nearest}" if nearest < -2e-5 else ""


def test_no_curve_in_a_file_breaks_a_limit_of_its_certificate(amount, rng, tried, tmp_path):
    pepper = pk.load_pepper()
    counts, wrong = {"written": 0, "refused": 0}, []
    want = amount(4, 16, 1000)
    while sum(counts.values()) < want:
        found = random_motion(pepper, rng)
        if found is None:
            continue
        motion, given = found
        scene, kind = random_scene(rng), str(rng.choice(KINDS))
        certificate = motion.check(pepper, scene, **given)
        passes = certificate.success
        if not passes and rng.random() < 0.95:
            continue
        dt = None if rng.random() < 0.4 else float(np.exp(rng.uniform(np.log(2e-3), np.log(5.0))))
        path = tmp_path / f"a.{kind}"
        try:
            if kind == "naoqi_arguments":
                _, times, keys, start = naoqi_arguments(motion, dt, scene=scene, **given)
                states = of_keys(times, keys, np.array(start))
            elif kind == "ros_points":
                points = ros_points(motion, dt, scene=scene, **given)
                states = of_points(points.time, points.position, points.velocity, points.acceleration)
            else:
                states = numbers_of(kind, save(motion, path, dt=dt, scene=scene, **given))
        except InvalidValueError:
            counts["refused"] += 1
            cubic = kind in ("py", "naoqi_arguments") and "jerk" in given
            without_curve = passes and dt is None and not cubic
            wrong += [(kind, dt, given, "no curve was found")] if without_curve else []
            tried("certified motions without a curve, NAOqi with jerk left out", without_curve)
            tried(
                f"motions that {'pass' if passes else 'fail'} and were not written{' at a dt' if dt else ''}",
                1,
            )
            continue
        counts["written"] += 1
        strictly = broken(pepper, states, scene, given)
        reason = broken(pepper, states, scene, given, certificate) if strictly else ""
        tried("files with an excess between milliseconds, as stated", bool(strictly and not reason))
        if not reason and path.exists():
            again = load(path, pepper=pepper)
            at = np.minimum(states.time, again.duration)
            if np.abs(again(at).position - states.q).max() > 1e-9:
                reason = "read back as another curve"
            elif not again.check(pepper, scene, **given).success:
                reason = f"read back: {again.check(pepper, scene, **given).failures}"
        path.unlink(missing_ok=True)
        wrong += [(kind, dt, given, reason)] if reason else []
        tried("files of motions", 1, wrong=bool(reason))
    assert not wrong, wrong[:3]
    assert counts["written"] > 0.2 * want, counts


@pytest.mark.parametrize("fault", ["position", "velocity", "acceleration", "torque", "balance", "clearance"])
def test_the_examination_of_files_finds_a_planted_fault(fault):
    """The oracle itself, on a motion that keeps everything, and on one that does not."""
    pepper = pk.load_pepper()
    q = np.tile(pepper.posture("Stand"), (9, 1))
    time = np.linspace(0.0, 1.0, 9)
    still = States(time, q, 0 * q, 0 * q, None, np.full(9, 0.1))
    assert broken(pepper, still, pk.Scene(), {}) == ""
    bad = {
        "position": still._replace(q=q + 9.0),
        "velocity": still._replace(v=still.v + 9.0),
        "acceleration": still._replace(a=still.a + 1e3),
    }
    scene = pk.Scene()
    if fault == "clearance":
        scene = scene.add_box("box", size=(0.2, 0.2, 0.2), position=(0.0, 0.0, 0.8))
    given = {"torque": {"payload": {"left": 9.0}}, "balance": {"balance": 0.2}}.get(fault, {})
    assert broken(pepper, bad.get(fault, still), scene, given).startswith(fault)
