"""Tipping with moving joints against the dynamics of a robot that really hangs on a hinge."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.twin.base import BalanceMonitor, BatchTipping, simulate_tipping


def on_a_hinge(pepper, start, along):
    """The same robot with one more joint: a hinge on the floor along an edge of the wheels."""
    root = ET.fromstring(pepper.urdf)
    for link in root.findall("link"):
        for kind in ("visual", "collision"):
            for shape in link.findall(kind):
                link.remove(shape)
    first = pepper.link_names[0]
    for name in ("floor", "tilting"):
        ET.SubElement(root, "link", {"name": name})
    for name, kind, parent, child, sign in (
        ("Tilt", "continuous", "floor", "tilting", 1),
        ("Mount", "fixed", "tilting", first, -1),
    ):
        joint = ET.SubElement(root, "joint", {"name": name, "type": kind})
        place = " ".join(repr(float(sign * x)) for x in (*start, 0.0))
        ET.SubElement(joint, "origin", {"xyz": place, "rpy": "0 0 0"})
        ET.SubElement(joint, "parent", {"link": parent})
        ET.SubElement(joint, "child", {"link": child})
        if kind == "continuous":
            ET.SubElement(joint, "axis", {"xyz": " ".join(repr(float(x)) for x in along)})
            ET.SubElement(joint, "limit", {"effort": "1e6", "velocity": "1e3"})
    return pk.load_robot(ET.tostring(root, encoding="unicode"))


def motion(pepper, t):
    """Positions, velocities and accelerations of a brisk motion, shape (..., n)."""
    t = np.asarray(t)[..., None]
    size, w = np.zeros(pepper.n), 2.0 + np.arange(pepper.n) % 5
    for name, value in {"HipPitch": 0.25, "KneePitch": -0.1, "HipRoll": 0.2, "LShoulderRoll": 0.3}.items():
        size[pepper.joint_index(name)] = value
    rest = pepper.joint_vector({"LShoulderRoll": 0.5})
    return rest + size * np.sin(w * t), size * w * np.cos(w * t), -size * w**2 * np.sin(w * t)


@pytest.mark.parametrize("edge", [0, 1, 2])
def test_the_tilt_is_that_of_the_hinged_robot(edge):
    pepper = pk.load_pepper()
    monitor = BalanceMonitor(pepper)
    start, end = monitor.contacts[edge], monitor.contacts[(edge + 1) % 3]
    along = np.array([*(end - start), 0.0]) / np.linalg.norm(end - start)
    hinged = on_a_hinge(pepper, start, along)
    order = [hinged.joint_index(name) for name in pepper.joint_names]
    tilt = hinged.joint_index("Tilt")

    def rates(t, state):
        q, v, a = (np.zeros(hinged.n) for _ in range(3))
        q[order], v[order], a[order] = motion(pepper, t)
        q[tilt], v[tilt] = state
        # No torque at the hinge: what is missing at no acceleration, over the inertia there.
        missing = pk.dynamics.inverse_dynamics(hinged, q, v, a)[tilt]
        return [state[1], -missing / pk.dynamics.mass_matrix(hinged, q)[tilt, tilt]]

    time = np.linspace(0.0, 0.5, 501)
    expected = solve_ivp(rates, (0, 0.5), [0.05, 0.9], t_eval=time, rtol=1e-9, atol=1e-11).y
    series = motion(pepper, time)
    found = simulate_tipping(monitor, monitor.assess(time, *series), series[0], start=(edge, 0.05, 0.9))
    count = len(found.time)
    assert found.angle.max() > 0.3
    np.testing.assert_allclose(found.angle, expected[0, :count], atol=2e-6)
    np.testing.assert_allclose(found.rate, expected[1, :count], atol=2e-5)


def test_rows_of_a_batch_tilt_as_single_robots():
    """Each with a motion of its own, and some reset halfway."""
    pepper, count, h = pk.load_pepper(), 5, 0.01
    monitor, time = BalanceMonitor(pepper), h * np.arange(120)
    series = [motion(pepper, 1.5 * time + 0.4 * row) for row in range(count)]
    q, v, a = (np.stack(parts) for parts in zip(*series, strict=True))
    a = 4.0 * a  # more than the floor can hold
    batch, found = BatchTipping(monitor, count, restitution=0.2), []
    for k in range(len(time)):
        if k == 60:
            batch.reset([1, 3])
        batch.step(q[:, k], v[:, k], a[:, k], h)
        found.append(np.stack([batch.angle, batch.rate, batch.edge.astype(float)], axis=1))
    with pytest.raises(InvalidValueError, match="rows"):
        batch.reset([count])
    rows = np.array(found)
    assert rows[:, :, 0].max() > 0.01
    assert not batch.fallen.all()
    for row in range(count):
        for part in (slice(0, 60), slice(60, 120)) if row in (1, 3) else (slice(0, 120),):
            own = [np.concatenate([x[row, part][:1], x[row, part]]) for x in (q, v, a)]
            report = monitor.assess(h * np.arange(len(own[0])), *own)
            wanted = simulate_tipping(monitor, report, own[0], restitution=0.2)
            end = len(wanted.angle) - 1
            np.testing.assert_allclose(rows[part, row, 0][:end], wanted.angle[1:], atol=1e-9)
            np.testing.assert_allclose(rows[part, row, 1][:end], wanted.rate[1:], atol=1e-9)
            tilted = wanted.angle[1:] > 0.0
            assert (rows[part, row, 2][:end][tilted] == wanted.edge[1:][tilted]).all()
