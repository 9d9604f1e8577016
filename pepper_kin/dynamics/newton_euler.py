"""Newton-Euler dynamics written independently, to check the others against.

Straight from F = m a and tau = I alpha + omega x I omega, link by link in the world frame: no spatial
algebra, no Pinocchio, and its own reading of the URDF.  Plain on purpose.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_joint_vectors

GRAVITY = np.array([0.0, 0.0, -9.81])
_CHUNK = 2000  # states at once, which keeps its memory small

Array = NDArray[np.float64]


@dataclass(frozen=True)
class _Body:
    """A link with the joint that carries it; vectors in the frames that the URDF states them in."""

    parent: int
    joint: str
    kind: str
    origin: Array
    rotation: Array
    axis: Array
    mass: float
    center: Array
    inertia: Array


def newton_euler(pepper: PepperModel, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> Array:
    """Return the joint torques of a motion, tau = M(q) a + C(q, v) v + g(q).

    Outward: each link's orientation, position, angular velocity omega and acceleration alpha, and the
    acceleration of its origin, from those of its parent (Craig, Introduction to Robotics, section 6.5).
    On each link, F = m (a_c - g) and N = I alpha + omega x I omega.  Inward: forces and moments are summed
    from the tips to the floor and projected on the joint axes.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).
        v: Joint velocities [rad/s or m/s], shape (..., n).
        a: Joint accelerations [rad/s^2 or m/s^2], shape (..., n).

    Returns:
        Joint torques or forces [N m or N], shape (..., n).

    Raises:
        InvalidValueError: for a wrong length, NaN, infinity, or batch axes that do not broadcast.
    """
    arrays = [as_joint_vectors(pepper, x, name) for x, name in ((q, "q"), (v, "v"), (a, "a"))]
    try:
        q_all, v_all, a_all = np.broadcast_arrays(*arrays)
    except ValueError:
        raise InvalidValueError("q, v and a", [x.shape for x in arrays], "broadcastable shapes") from None
    bodies = _read_bodies(pepper.urdf)
    gain, offset = _coupling(pepper)
    flat = [x.reshape(-1, pepper.n) for x in (q_all, v_all, a_all)]
    tau = np.zeros_like(flat[0])
    for start in range(0, len(tau), _CHUNK):
        q_part, v_part, a_part = (x[start : start + _CHUNK] for x in flat)
        motion = {
            name: (q_part @ row + offset[name], v_part @ row, a_part @ row) for name, row in gain.items()
        }
        for name, torque in _torques(bodies, motion, len(q_part)).items():
            tau[start : start + _CHUNK] += torque[:, None] * gain[name]
    return tau.reshape(q_all.shape)


@lru_cache(maxsize=8)
def _coupling(pepper: PepperModel) -> tuple[dict[str, Array], dict[str, float]]:
    """Return each moving joint's row of q_joint = gain . q + offset, read from the URDF's mimic elements."""
    mimics = {}
    moving = []
    for joint in ET.fromstring(pepper.urdf).findall("joint"):
        if joint.get("type") == "fixed":
            continue
        name = str(joint.get("name"))
        moving.append(name)
        element = joint.find("mimic")
        if element is not None:
            multiplier, addend = float(element.get("multiplier", 1.0)), float(element.get("offset", 0.0))
            mimics[name] = (str(element.get("joint")), multiplier, addend)
    gains, offsets = {}, {}
    for name in moving:
        leader, gain, offset = name, 1.0, 0.0
        while leader in mimics:
            leader, multiplier, addend = mimics[leader]
            offset, gain = offset + gain * addend, gain * multiplier
        gains[name] = gain * np.eye(pepper.n)[pepper.joint_index(leader)]
        offsets[name] = offset
    return gains, offsets


def _fixed_rotation(rpy: Array) -> Array:
    r = np.eye(3)[:, :, None]
    for axis, angle in zip(np.eye(3)[::-1], rpy[::-1], strict=True):
        r = _turned(r, axis, np.array([angle]))
    return r[:, :, 0]


def _vector(element: ET.Element | None, attribute: str, default: str = "0 0 0") -> Array:
    text = default if element is None else element.get(attribute, default)
    return np.array([float(value) for value in text.split()])


@lru_cache(maxsize=8)
def _read_bodies(urdf: str) -> tuple[_Body, ...]:
    """Return the links that count, parents first: those that move, have inertia, or carry one that does."""
    root = ET.fromstring(urdf)
    links = {str(link.get("name")): link for link in root.findall("link")}
    joints = root.findall("joint")
    children = {str(j.find("child").get("link")) for j in joints}  # type: ignore[union-attr]
    order = [name for name in links if name not in children]
    bodies = [_body(-1, None, links[order[0]])]
    place = {order[0]: 0}
    waiting = list(joints)
    while waiting:
        for joint in list(waiting):
            parent = str(joint.find("parent").get("link"))  # type: ignore[union-attr]
            child = str(joint.find("child").get("link"))  # type: ignore[union-attr]
            if parent in place:
                place[child] = len(bodies)
                bodies.append(_body(place[parent], joint, links[child]))
                waiting.remove(joint)
    return _that_count(bodies)


def _that_count(bodies: list[_Body]) -> tuple[_Body, ...]:
    """Leave out links without inertia that are fixed and carry nothing, such as the frames of sensors."""
    keep = [body.mass > 0 or body.inertia.any() or body.kind != "fixed" or body.parent < 0 for body in bodies]
    for i in reversed(range(len(bodies))):
        if keep[i] and bodies[i].parent >= 0:
            keep[bodies[i].parent] = True
    place: dict[int, int] = {-1: -1}
    kept: list[_Body] = []
    for i, body in enumerate(bodies):
        if keep[i]:
            place[i] = len(kept)
            kept.append(replace(body, parent=place[body.parent]))
    return tuple(kept)


def _body(parent: int, joint: ET.Element | None, link: ET.Element) -> _Body:
    origin = None if joint is None else joint.find("origin")
    axis = _vector(None if joint is None else joint.find("axis"), "xyz", "1 0 0")
    inertial = link.find("inertial")
    mass, center, inertia = 0.0, np.zeros(3), np.zeros((3, 3))
    if inertial is not None:
        mass = float(inertial.find("mass").get("value", 0))  # type: ignore[union-attr]
        frame = inertial.find("origin")
        center, turn = _vector(frame, "xyz"), _fixed_rotation(_vector(frame, "rpy"))
        i = {k: float(x) for k, x in inertial.find("inertia").attrib.items()}  # type: ignore[union-attr]
        tensor = [
            [i["ixx"], i["ixy"], i["ixz"]],
            [i["ixy"], i["iyy"], i["iyz"]],
            [i["ixz"], i["iyz"], i["izz"]],
        ]
        inertia = turn @ np.array(tensor) @ turn.T
    return _Body(
        parent,
        "" if joint is None else str(joint.get("name")),
        "fixed" if joint is None else str(joint.get("type")),
        _vector(origin, "xyz"),
        _fixed_rotation(_vector(origin, "rpy")),
        axis / (np.linalg.norm(axis) or 1.0),
        mass,
        center,
        inertia,
    )


def _cross(a: Array, b: Array) -> Array:
    """Return a x b, component by component, shape (3, T)."""
    result = np.empty_like(b)
    result[0] = a[1] * b[2] - a[2] * b[1]
    result[1] = a[2] * b[0] - a[0] * b[2]
    result[2] = a[0] * b[1] - a[1] * b[0]
    return result


def _spin(omega: Array, alpha: Array, arm: Array) -> Array:
    """Return alpha x arm + omega x (omega x arm): what turning adds to the acceleration at an arm's end."""
    return _cross(alpha, arm) + _cross(omega, _cross(omega, arm))


def _torques(
    bodies: Sequence[_Body], motion: dict[str, tuple[Array, Array, Array]], count: int
) -> dict[str, Array]:
    """Return the torque of every moving joint in `count` states, shape (T,) each.

    Coordinates come first and states last, (3, T) for a vector: whole rows at a time are multiplied.  A
    matrix r turns a vector that is the same in all states by `vector @ r`, as r[i, j] stands for row i and
    column j of all states, and r @ m is `m.T @ r`.
    """
    zero = np.zeros((3, count))
    turn: list[Array] = []  # orientation of each link in the world
    position: list[Array] = []  # origin of each link
    omega: list[Array] = []  # angular velocity
    alpha: list[Array] = []  # angular acceleration
    acceleration: list[Array] = []  # of the link's origin
    axes: list[Array] = []
    force: list[Array] = []  # that the link needs from its joint, summed over all that it carries
    moment: list[Array] = []  # the same about the link's origin
    for body in bodies:
        if body.parent < 0:
            r, p, w, dw, acc, axis = np.repeat(np.eye(3)[:, :, None], count, axis=2), *[zero] * 5
        else:
            k = body.parent
            r = body.rotation.T @ turn[k]
            axis = body.axis @ r
            arm = body.origin @ turn[k]
            w, dw = omega[k], alpha[k]
            slide = zero
            if body.kind != "fixed":
                x, speed, rate = motion[body.joint]
                if body.kind == "prismatic":
                    arm = arm + axis * x
                    slide = 2 * _cross(w, axis * speed) + axis * rate
                else:
                    r = _turned(r, body.axis, x)
                    dw = dw + _cross(w, axis * speed) + axis * rate
                    w = w + axis * speed
            p = position[k] + arm
            acc = acceleration[k] + _spin(omega[k], alpha[k], arm) + slide
        for values, value in (
            (turn, r), (position, p), (omega, w), (alpha, dw), (acceleration, acc), (axes, axis),
        ):  # fmt: skip
            values.append(value)
        lever = body.center @ r
        f = body.mass * (acc + _spin(w, dw, lever) - GRAVITY[:, None])
        n = _times(r, body.inertia, dw) + _cross(w, _times(r, body.inertia, w))
        force.append(f)
        moment.append(n + _cross(lever, f))
    torques = {}
    for i in reversed(range(len(bodies))):
        body = bodies[i]
        if body.kind != "fixed":
            load = force[i] if body.kind == "prismatic" else moment[i]
            torques[body.joint] = np.sum(axes[i] * load, axis=0)
        if body.parent >= 0:
            k = body.parent
            force[k] = force[k] + force[i]
            moment[k] = moment[k] + moment[i] + _cross(position[i] - position[k], force[i])
    return torques


def _turned(r: Array, axis: Array, angle: Array) -> Array:
    """Return r times the rotation about a unit axis by each state's angle, by Rodrigues' formula."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    across = cross.T @ r
    return np.asarray(r + np.sin(angle) * across + (1 - np.cos(angle)) * (cross.T @ across))


def _times(r: Array, inertia: Array, vector: Array) -> Array:
    """Return r I r^T times a vector, where I is given in the link's frame, shape (3, T)."""
    inside = inertia @ np.sum(r * vector[:, None], axis=0)
    return np.asarray(np.sum(r * inside, axis=1))
