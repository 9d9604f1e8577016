"""Newton-Euler dynamics written independently, to check the others against.

Straight from F = m a and tau = I alpha + omega x I omega, link by link in the world frame: no spatial
algebra, no Pinocchio, and its own reading of the URDF.  Slow and plain on purpose.
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
    motion = {
        name: (q_all @ gain[name] + offset[name], v_all @ gain[name], a_all @ gain[name]) for name in gain
    }
    tau = np.zeros_like(q_all)
    for name, torque in _torques(bodies, motion, q_all.shape[:-1]).items():
        tau += torque[..., None] * gain[name]
    return tau


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


def _rotation(axis: Array, angle: Array) -> Array:
    """Rodrigues' formula: rotation about a unit axis, shape (..., 3, 3)."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = np.asarray(angle)[..., None, None]
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * (cross @ cross)


def _fixed_rotation(rpy: Array) -> Array:
    x, y, z = np.eye(3)
    return np.asarray(_rotation(z, rpy[2]) @ _rotation(y, rpy[1]) @ _rotation(x, rpy[0]))


def _vector(element: ET.Element | None, attribute: str, default: str = "0 0 0") -> Array:
    text = default if element is None else element.get(attribute, default)
    return np.array([float(value) for value in text.split()])


@lru_cache(maxsize=8)
def _read_bodies(urdf: str) -> tuple[_Body, ...]:
    """Return the links that count, parents first: those that move, have mass, or carry one that does."""
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
    """Leave out links without mass that are fixed and carry nothing, such as the frames of sensors."""
    keep = [body.mass > 0 or body.kind != "fixed" or body.parent < 0 for body in bodies]
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


def _apply(matrix: Array, vector: Array) -> Array:
    return np.einsum("...ij,...j->...i", matrix, vector)


def _torques(
    bodies: Sequence[_Body], motion: dict[str, tuple[Array, Array, Array]], batch: tuple[int, ...]
) -> dict[str, Array]:
    """Return the torque of every moving joint, each of shape `batch`."""
    zero = np.zeros((*batch, 3))
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
            r, p, w, dw, acc = np.broadcast_to(np.eye(3), (*batch, 3, 3)), zero, zero, zero, zero
            axis = zero
        else:
            k = body.parent
            r = turn[k] @ body.rotation
            axis = _apply(r, body.axis)
            arm = _apply(turn[k], body.origin)
            w, dw = omega[k], alpha[k]
            slide = zero
            if body.kind != "fixed":
                x, speed, rate = (s[..., None] for s in motion[body.joint])
                if body.kind == "prismatic":
                    arm = arm + axis * x
                    slide = 2 * np.cross(w, axis * speed) + axis * rate
                else:
                    r = r @ _rotation(body.axis, x[..., 0])
                    dw = dw + np.cross(w, axis * speed) + axis * rate
                    w = w + axis * speed
            p = position[k] + arm
            acc = (
                acceleration[k]
                + np.cross(alpha[k], arm)
                + np.cross(omega[k], np.cross(omega[k], arm))
                + slide
            )
        for values, value in (
            (turn, r), (position, p), (omega, w), (alpha, dw), (acceleration, acc), (axes, axis),
        ):  # fmt: skip
            values.append(value)
        lever = _apply(r, body.center)
        inertia = r @ body.inertia @ np.swapaxes(r, -1, -2)
        a_center = acc + np.cross(dw, lever) + np.cross(w, np.cross(w, lever))
        f = body.mass * (a_center - GRAVITY)
        n = _apply(inertia, dw) + np.cross(w, _apply(inertia, w))
        force.append(f)
        moment.append(n + np.cross(lever, f))
    torques = {}
    for i in reversed(range(len(bodies))):
        body = bodies[i]
        if body.kind != "fixed":
            load = force[i] if body.kind == "prismatic" else moment[i]
            torques[body.joint] = np.sum(axes[i] * load, axis=-1)
        if body.parent >= 0:
            k = body.parent
            force[k] = force[k] + force[i]
            moment[k] = moment[k] + moment[i] + np.cross(position[i] - position[k], force[i])
    return torques
