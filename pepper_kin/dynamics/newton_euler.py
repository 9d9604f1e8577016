"""Independent Newton-Euler dynamics, as a reference for the other implementations.

It is written directly from F = m a and tau = I alpha + omega x I omega, link by link, each in its own frame,
without spatial algebra or Pinocchio, and reads the URDF itself.  It is simple on purpose.  For a robot whose
`pinocchio_model` was changed by hand, which no URDF describes, numbers are read from that model.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array
from pepper_kin.dynamics.load import Loads
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.kernels import Kernel, compile_function, source_digest
from pepper_kin.model import PepperModel, kept_for_robot, robot_digest
from pepper_kin.model.joint_vectors import as_joint_vectors

GRAVITY = np.array([0.0, 0.0, -9.81])
_CHUNK = 1000  # states at a time, which fit in the processor's caches
_VECTOR_BYTES = 32  # as in the kernels that come with the package


_AXIS = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class _Body:
    """A link with the joint that carries it; vectors in its own frame, whose z is the axis of its joint.

    `origin` and `rotation` are its pose in its parent's frame, with the joint at zero.
    """

    parent: int
    joint: int  # index among the moving joints, -1 if fixed
    kind: str  # "revolute" (continuous too), "prismatic" or "fixed"
    origin: Array
    rotation: Array
    mass: Any
    center: Array
    inertia: Array

    @cached_property
    def cross_origin(self) -> Array:
        """Cross-product matrix of the origin, shape (3, 3)."""
        return _skew(self.origin)

    @cached_property
    def cross_center(self) -> Array:
        """Cross-product matrix of the center, shape (3, 3)."""
        return _skew(self.center)


def newton_euler(pepper: PepperModel, q: ArrayLike, v: ArrayLike, a: ArrayLike, loads: Loads = ()) -> Array:
    """Return the joint torques of a motion, tau = M(q) a + C(q, v) v + g(q).

    Forward pass: each link's angular velocity omega and acceleration alpha, and the acceleration of its
    origin, are computed from its parent's (Craig, Introduction to Robotics, section 6.5).  On each link,
    F = m (a_c - g) and N = I alpha + omega x I omega.  Backward pass: forces and moments are summed from the
    tips to the floor and projected on the joint axes.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).
        v: Joint velocities [rad/s or m/s], shape (..., n).
        a: Joint accelerations [rad/s^2 or m/s^2], shape (..., n).
        loads: Rigid objects fixed to frames; they are treated like links.

    Returns:
        Joint torques or forces [N m or N], shape (..., n).

    Raises:
        InvalidValueError: for a wrong length, NaN, infinity, or batch axes that do not broadcast.
        UnknownNameError: for a load at a frame that is not a link.
    """
    arrays = [as_joint_vectors(pepper, x, name) for x, name in ((q, "q"), (v, "v"), (a, "a"))]
    try:
        q_all, v_all, a_all = np.broadcast_arrays(*arrays)
    except ValueError:
        raise InvalidValueError("q, v and a", [x.shape for x in arrays], "broadcastable shapes") from None
    bodies = _bodies(pepper, tuple(loads))
    flat = [x.reshape(-1, pepper.n) for x in (q_all, v_all, a_all)]
    tau = np.zeros_like(flat[0])
    for start in range(0, len(tau), _CHUNK):
        part = slice(start, start + _CHUNK)
        tau[part] = _of_states(pepper, bodies, (flat[0][part], flat[1][part], flat[2][part]))
    return tau.reshape(q_all.shape)


def newton_euler_of_motion(pepper: PepperModel, q: Array, v: Array, a: Array, loads: Loads = ()) -> Array:
    """Return the torques of `newton_euler` for the states of a motion, by machine code of the same recursion.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (T, n).
        v: Joint velocities [rad/s or m/s], shape (T, n).
        a: Joint accelerations [rad/s^2 or m/s^2], shape (T, n).
        loads: Rigid objects fixed to frames.

    Returns:
        Joint torques or forces [N m or N], shape (T, n).
    """
    carried = [(load.mass, *load.center, *load.inertia) for load in loads]
    kernel = _kernel(pepper, tuple(load.frame for load in loads))
    return np.asarray(kernel(q, v, a, *([np.ravel(carried)] if loads else [])))


@kept_for_robot(most=8)
def _kernel(pepper: PepperModel, frames: tuple[str, ...]) -> Kernel:
    """Return the machine code for a robot with loads at given frames."""
    sources = source_digest("pepper_kin.model", __name__)
    return compile_function(
        lambda: _expression(pepper, frames),
        key=f"newton_euler{frames!r} of {robot_digest(pepper)} by {sources}",
        vector_bytes=_VECTOR_BYTES,
    )


def _expression(pepper: PepperModel, frames: tuple[str, ...]) -> Any:
    """Return tau(q, v, a, loads) as a `casadi.Function`; a load is mass, center and inertia, 10 numbers."""
    import casadi

    symbols = [casadi.SX.sym(name, pepper.n) for name in "qva"]
    carried = casadi.SX.sym("loads", 10 * len(frames))
    q, v, a = (np.array(casadi.vertsplit(x), dtype=object).reshape(-1, 1) for x in symbols)
    numbers = np.array(casadi.vertsplit(carried), dtype=object).reshape(-1, 10)
    places = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])  # indices of the tensor in xx, xy, xz, yy, yz, zz
    loads = [
        _Carried(frame, own[:1], own[1:4], own[4:][places])
        for frame, own in zip(frames, numbers, strict=True)
    ]
    tau = _of_states(pepper, _bodies_with(pepper, loads), (q.T, v.T, a.T))
    inputs = [*symbols, carried] if frames else symbols
    return casadi.Function("newton_euler", inputs, [casadi.vertcat(*tau[0])])


def _of_states(pepper: PepperModel, bodies: tuple[_Body, ...], state: tuple[Array, Array, Array]) -> Array:
    """Return torques, shape (T, n), for positions, velocities and accelerations of shape (T, n) each."""
    gain, offset = _coupling(pepper)
    changed = pepper.dynamics_model.changed()
    gravity = GRAVITY if changed is None else np.array(changed.gravity.linear)
    armature = np.zeros(len(gain)) if changed is None else _armature(pepper, changed)
    x, speed, change = (gain @ value.T for value in state)
    torques = _torques(bodies, x + offset[:, None], speed, change, gravity)
    return np.asarray((torques + armature[:, None] * change).T @ gain)


@kept_for_robot(most=8)
def _coupling(pepper: PepperModel) -> tuple[Array, Array]:
    """Return gain and offset of q_joint = gain q + offset for all moving joints, from URDF mimic elements."""
    mimics = {}
    moving = []
    for joint in pepper.document.tree.findall("joint"):
        if joint.get("type") == "fixed":
            continue
        name = str(joint.get("name"))
        moving.append(name)
        element = joint.find("mimic")
        if element is not None:
            multiplier, addend = float(element.get("multiplier", 1.0)), float(element.get("offset", 0.0))
            mimics[name] = (str(element.get("joint")), multiplier, addend)
    gains, offsets = [], []
    for name in moving:
        leader, gain, offset = name, 1.0, 0.0
        while leader in mimics:
            leader, multiplier, addend = mimics[leader]
            offset, gain = offset + gain * addend, gain * multiplier
        gains.append(gain * np.eye(pepper.n)[pepper.joint_index(leader)])
        offsets.append(offset)
    return np.array(gains), np.array(offsets)


def _rotation(rpy: Array) -> Array:
    """Return the rotation, shape (3, 3), of roll, pitch and yaw [rad], shape (3,)."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    roll = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    pitch = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    yaw = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return np.asarray(yaw @ pitch @ roll)


def _frame_about(axis: Array) -> Array:
    """Return a rotation, shape (3, 3), whose third column is a unit axis, shape (3,)."""
    across = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    across /= np.linalg.norm(across)
    return np.stack([across, np.cross(axis, across), axis], axis=1)


def _vector(element: ET.Element | None, attribute: str, default: str = "0 0 0") -> Array:
    """Return the numbers of an attribute, or of the default if the element or attribute is missing."""
    text = default if element is None else element.get(attribute, default)
    return np.array([float(value) for value in text.split()])


@kept_for_robot(most=8)
def _bodies(pepper: PepperModel, loads: Loads) -> tuple[_Body, ...]:
    """Return the bodies of `_bodies_with`, cached."""
    carried = [_Carried(load.frame, load.mass, np.array(load.center), load.tensor) for load in loads]
    return _bodies_with(pepper, carried)


class _Carried(NamedTuple):
    """A load: its frame, mass, center, shape (3,), and inertia about it, shape (3, 3); or expressions."""

    frame: str
    mass: Any
    center: Array
    tensor: Array


def _bodies_with(pepper: PepperModel, loads: Sequence[_Carried]) -> tuple[_Body, ...]:
    """Return the relevant links and loads, parents first: those that move, have inertia, or carry such."""
    changed = pepper.dynamics_model.changed()
    bodies, place, turns = _read_bodies(pepper) if changed is None else _changed_bodies(pepper, changed)
    for load in loads:
        if load.frame not in place:
            raise UnknownNameError("link that carries a load", load.frame, place)
        own = turns[load.frame]
        center, inertia = own.T @ load.center, own.T @ load.tensor @ own
        link = place[load.frame]
        bodies.append(_Body(link, -1, "fixed", np.zeros(3), np.eye(3), load.mass, center, inertia))
    return _that_count(bodies)


def _read_bodies(pepper: PepperModel) -> tuple[list[_Body], dict[str, int], dict[str, Array]]:
    """Return the URDF's links, parents first, their indices, and the rotations of their frames."""
    root = pepper.document.tree
    links = {str(link.get("name")): link for link in root.findall("link")}
    joints = root.findall("joint")
    moving = [j for j in joints if j.get("type") != "fixed"]
    children = {str(j.find("child").get("link")) for j in joints}  # type: ignore[union-attr]
    order = [name for name in links if name not in children]
    place, turns = {order[0]: 0}, {order[0]: np.eye(3)}
    bodies = [_body((-1, -1), None, links[order[0]], np.eye(3), np.eye(3))]
    waiting = list(joints)
    while waiting:
        for joint in list(waiting):
            parent = str(joint.find("parent").get("link"))  # type: ignore[union-attr]
            child = str(joint.find("child").get("link"))  # type: ignore[union-attr]
            if parent in place:
                place[child] = len(bodies)
                turns[child] = _turn(joint)
                ranks = place[parent], moving.index(joint) if joint in moving else -1
                bodies.append(_body(ranks, joint, links[child], turns[parent], turns[child]))
                waiting.remove(joint)
    return bodies, place, turns


def _changed_bodies(pepper: PepperModel, model: Any) -> tuple[list[_Body], dict[str, int], dict[str, Array]]:
    """Return bodies, indices and rotations of a `pinocchio.Model` changed by hand, with all its frames."""
    joints = {str(j.get("name")): j for j in pepper.document.tree.findall("joint")}
    moving = [name for name, joint in joints.items() if joint.get("type") != "fixed"]
    own, bodies = [np.eye(3)], []
    for i, name in enumerate(model.names):
        kind, parent, place, inertia = "fixed", -1, model.jointPlacements[i], model.inertias[i]
        if i > 0:
            kind = "prismatic" if joints[name].get("type") == "prismatic" else "revolute"
            parent = model.parents[i]
            own.append(_turn(joints[name]))
        above, turn = own[parent] if i > 0 else np.eye(3), own[i]
        bodies.append(
            _Body(
                parent,
                moving.index(name) if i > 0 else -1,
                kind,
                above.T @ place.translation,
                above.T @ place.rotation @ turn,
                float(inertia.mass),
                turn.T @ inertia.lever,
                turn.T @ inertia.inertia @ turn,
            )
        )
    place_of, turns = {}, {}
    for name in pepper.frame_names:
        frame = model.frames[pepper.frame_id(name)]
        above = own[frame.parentJoint]
        place_of[name], turns[name] = len(bodies), np.eye(3)
        origin, turn = above.T @ frame.placement.translation, above.T @ frame.placement.rotation
        bodies.append(_Body(frame.parentJoint, -1, "fixed", origin, turn, 0.0, np.zeros(3), np.zeros((3, 3))))
    return bodies, place_of, turns


def _armature(pepper: PepperModel, model: Any) -> Array:
    """Return the armature of each moving joint in the URDF's order [kg m^2 or kg], shape (k,)."""
    joints = pepper.document.tree.findall("joint")
    moving = [str(joint.get("name")) for joint in joints if joint.get("type") != "fixed"]
    places = [model.joints[model.getJointId(name)].idx_v for name in moving]
    return np.array(model.armature)[places]


def _that_count(bodies: list[_Body]) -> tuple[_Body, ...]:
    """Remove fixed links without inertia and without children, such as sensor frames."""
    keep = [
        body.inertia.dtype == object  # a load whose numbers are symbolic
        or body.mass > 0
        or body.inertia.any()
        or body.kind != "fixed"
        or body.parent < 0
        for body in bodies
    ]
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


def _turn(joint: ET.Element) -> Array:
    """Return the rotation, shape (3, 3), from the frame used here for a link to the URDF's frame."""
    if joint.get("type") == "fixed":
        return np.eye(3)
    axis = _vector(joint.find("axis"), "xyz", "1 0 0")
    return _frame_about(axis / np.linalg.norm(axis))


def _body(
    ranks: tuple[int, int],
    joint: ET.Element | None,
    link: ET.Element,
    above: Array,
    own: Array,
) -> _Body:
    """Read a link, whose own frame and parent frame are rotated by `own` and `above` from the URDF's.

    `ranks` are the indices of its parent among the links, and of its joint among the moving joints.  `above`
    and `own` are rotations, shape (3, 3).
    """
    origin = None if joint is None else joint.find("origin")
    kind = "fixed" if joint is None else str(joint.get("type"))
    inertial = link.find("inertial")
    mass, center, inertia = 0.0, np.zeros(3), np.zeros((3, 3))
    if inertial is not None:
        mass = float(inertial.find("mass").get("value", 0))  # type: ignore[union-attr]
        frame = inertial.find("origin")
        center, turn = own.T @ _vector(frame, "xyz"), own.T @ _rotation(_vector(frame, "rpy"))
        i = {k: float(x) for k, x in inertial.find("inertia").attrib.items()}  # type: ignore[union-attr]
        tensor = [
            [i["ixx"], i["ixy"], i["ixz"]],
            [i["ixy"], i["iyy"], i["iyz"]],
            [i["ixz"], i["iyz"], i["izz"]],
        ]
        inertia = turn @ np.array(tensor) @ turn.T
    return _Body(
        *ranks,
        kind if kind in ("fixed", "prismatic") else "revolute",
        above.T @ _vector(origin, "xyz"),
        above.T @ _rotation(_vector(origin, "rpy")) @ own,
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


def _skew(v: Array) -> Array:
    """Return the cross-product matrix of v, shape (3, 3), for v of shape (3,)."""
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _turn_back(vectors: Array, cosine: Array, sine: Array) -> None:
    """Express vectors, shape (..., 3, T), in axes rotated about z by an angle, in place."""
    x, y = vectors[..., 0, :], vectors[..., 1, :]
    turned = cosine * x + sine * y
    y *= cosine
    y -= sine * x
    x[...] = turned


def _torques(
    bodies: Sequence[_Body], position: Array, speed: Array, change: Array, gravity: Array = GRAVITY
) -> Array:
    """Return the torques of all moving joints from their positions, speeds and accelerations, (k, T) each.

    `gravity` is the acceleration of free fall [m/s^2], shape (3,).  Coordinates come first and states last,
    (3, T) for a vector, so that whole rows are multiplied at a time.  Numbers may be CasADi expressions.
    """
    cosine, sine = np.cos(position), np.sin(position)
    rates: list[Array] = []  # angular velocity and acceleration, and the origin's acceleration less gravity
    squares: list[Array] = []  # squared angular speed
    loads: list[Array] = []  # force that the link needs from its joint, and moment about the link's origin

    def turning(i: int, arm: Array, cross: Array) -> Array:
        """Return alpha x arm + omega x (omega x arm), the acceleration of an arm's end due to rotation."""
        w, dw, _ = rates[i]
        return w * (arm @ w) - cross @ dw - arm[:, None] * squares[i]

    for i, body in enumerate(bodies):
        k, j = body.parent, body.joint
        if k < 0:
            rate = np.zeros((3, 3, position.shape[1]), position.dtype)
            rate[2] -= gravity[:, None]
        else:
            rate = body.rotation.T @ rates[k]
            rate[2] += body.rotation.T @ turning(k, body.origin, body.cross_origin)
        rates.append(rate)
        w, dw, acc = rate
        if body.kind == "revolute":
            _turn_back(rate, cosine[j], sine[j])
            dw[0] += w[1] * speed[j]  # omega x axis speed
            dw[1] -= w[0] * speed[j]
            dw[2] += change[j]
            w[2] += speed[j]
        squares.append(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
        if body.kind == "prismatic":
            acc += position[j] * turning(i, _AXIS, _skew(_AXIS))
            acc[0] += 2 * w[1] * speed[j]  # 2 omega x axis speed
            acc[1] -= 2 * w[0] * speed[j]
            acc[2] += change[j]
        load = np.empty((2, 3, position.shape[1]), position.dtype)
        load[0] = body.mass * (acc + turning(i, body.center, body.cross_center))
        load[1] = body.inertia @ dw + _cross(w, body.inertia @ w) + body.cross_center @ load[0]
        loads.append(load)
    torques = np.empty_like(position)
    for i in reversed(range(len(bodies))):
        body, load, j = bodies[i], loads[i], bodies[i].joint
        if body.kind == "revolute":
            torques[j] = load[1, 2]
            _turn_back(load, cosine[j], -sine[j])
        elif body.kind == "prismatic":
            torques[j] = load[0, 2]
            load[1, 0] -= position[j] * load[0, 1]
            load[1, 1] += position[j] * load[0, 0]
        if body.parent >= 0:
            load = body.rotation @ load
            load[1] += body.cross_origin @ load[0]
            loads[body.parent] += load
    return torques
