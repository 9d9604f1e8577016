"""Dynamics of one state of any tree of joints, from tables, without compiling anything for a robot.

Vectors are in world axes; wrenches and inertias are about the origin of their body, so that the contribution
of a body to its parent is only shifted by r, the vector from the parent's origin to the body's.  Torques are
computed by recursive Newton-Euler (Luh, Walker and Paul, 1980), the mass matrix by composite bodies (Walker
and Orin, 1982); accelerations follow from M = L^T D L with the zeros of the tree (Featherstone, 2008, section
6.5).

Derivatives of the torques (Carpentier and Mansard, 2018) need, for each composite body, the mass m,
h = sum(m x), Sigma = sum(m x x^T), p = sum(m x') and Pi = sum(m x' x^T), where x is a position and x' its
velocity.  A change (a, alpha) of its acceleration and a change d of its angular velocity change its wrench by

    f = m a + alpha x h + 2 d x p,    n = h x a + (tr Sigma - Sigma) alpha + 2 (tr Pi - Pi) d

Let S be the motion that joint j permits, V and A velocity and spatial acceleration of its parent, U = V x S
and W = A x S + V x U, each with a linear and an angular part.  A change of q_j rotates the composite body of
j, with its wrench, by S, and changes its acceleration by W and its angular velocity by the angular part of U;
a change of v_j changes them by 2 U and by the angular part of S.  Propagated towards the root, such a wrench
is the change of the torques of j and of the joints before it.  For the torque of a joint i behind j, the
wrench of the acceleration S_i and g = 2 (p x linear + (tr Pi - Pi^T) angular) of S_i are propagated instead:
the former is the linear form of W_j or 2 U_j, g the linear form of the angular velocity.
"""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np

from pepper_kin.core.plain_vectors import in_range
from pepper_kin.core.sines import sines_and_cosines
from pepper_kin.kernels import compiled
from pepper_kin.kernels.intrinsics import floats_at
from pepper_kin.kernels.lanes import double_at, store_double, word_at
from pepper_kin.kernels.records import RecordView, double, word
from pepper_kin.kernels.signatures import Floats1, Floats2, Floats3, Ints1, Ints2

Vector: TypeAlias = tuple[float, float, float]
Symmetric: TypeAlias = tuple[float, float, float, float, float, float]

LINK = RecordView("LINK", parent=word, leader=word, slides=word)
"""A joint's links: index of its parent among the bodies (0: the world; joint i moves body i + 1), index of
its coordinate of the robot, and whether it is prismatic."""

JOINT = RecordView(
    "JOINT",
    gain=double,
    offset=double,
    rotor=double,
    **dict.fromkeys(("axis_x", "axis_y", "axis_z", "origin"), 3 * double),
    mass=double,
    first=3 * double,
    second=6 * double,
)
"""A joint and the body that it moves.

Its coordinate is gain q_leader + offset [rad or m] and acts along z; rotor [kg m^2 or kg]; axes and origin at
coordinate zero in the parent's frame [m]; m [kg], h [kg m] and xx, xy, xz, yy, yz, zz of Sigma [kg m^2] in
the body's frame."""

_OF_BODIES = ("x", "y", "z", "r", "first", "omega", "alpha", "a", "force", "moment", "v", "p")
_OF_DERIVATIVES = (
    *("pi_x", "pi_y", "pi_z"),
    *("s_linear", "s_angular", "u_linear", "u_angular", "w_linear", "w_angular"),
)
BODY = RecordView(
    "BODY", mass=double, second=6 * double, **dict.fromkeys(_OF_BODIES + _OF_DERIVATIVES, 3 * double)
)
"""A body at a state: its axes, r, inertia, motion (`a`: acceleration of its origin less gravity), wrench, p,
columns of Pi, and S, U and W of its joint.  Row 0 is the world."""

SINGULAR = 1e-14
"""Ratio of D to a diagonal entry of M below which D is only rounding error: M has no inverse."""


DEEP = 32
"""Mean number of entries of the rows of L above which M = L^T D L takes longer than recursions along the
tree: its operations grow with the cube of the depth.  A chain of 64 joints reaches it; for M^-1, one of half
that."""


class TreeTables(NamedTuple):
    """A tree of joints, parents before children.

    Attributes:
        links: Rows of LINK, shape (N, LINK.width).
        joints: Rows of JOINT, shape (N, JOINT.width).
        gravity: Gravity vector [m/s^2], shape (3,).
        starts: Offsets of the packed rows of M, and their total size, shape (n + 1,).  Row a has the diagonal
            entry, then one for each coordinate above a in the elimination tree, the nearest first: these
            may be coupled to a, and L has no other entries.
        above: Nearest coordinate above each coordinate, -1 for none, shape (n,).
        work: Memory for rows of BODY and for angles, their sines and cosines, shape (work_size(N),); one for
            each thread.
    """

    links: Ints2
    joints: Floats2
    gravity: Floats1
    starts: Ints1
    above: Ints1
    work: Floats1


def work_size(count: int) -> int:
    """Return the size of the memory `TreeTables.work` for a number of joints."""
    return (count + 1) * BODY.width + 3 * (count + 3)


# Vector operations whose products and sums may be contracted, unlike those of `ray_casting`.


@compiled(inline=True, vector=True)
def _cross(a: Vector, b: Vector) -> Vector:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@compiled(inline=True, vector=True)
def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled(inline=True, vector=True)
def _plus(a: Vector, b: Vector) -> Vector:
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@compiled(inline=True, vector=True)
def _add(a: Vector, factor: float, b: Vector) -> Vector:
    """Return a + factor b."""
    return (a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2])


@compiled(inline=True, vector=True)
def _combined(x: Vector, y: Vector, z: Vector, u: Vector) -> Vector:
    """Return u_x x + u_y y + u_z z, the product of a matrix with these columns and u."""
    return (
        x[0] * u[0] + y[0] * u[1] + z[0] * u[2],
        x[1] * u[0] + y[1] * u[1] + z[1] * u[2],
        x[2] * u[0] + y[2] * u[1] + z[2] * u[2],
    )


@compiled(inline=True, vector=True)
def _inertia_times(s: Symmetric, u: Vector) -> Vector:
    """Return (tr Sigma - Sigma) u, the moment of inertia times u."""
    return (
        (s[3] + s[5]) * u[0] - s[1] * u[1] - s[2] * u[2],
        (s[0] + s[5]) * u[1] - s[1] * u[0] - s[4] * u[2],
        (s[0] + s[3]) * u[2] - s[2] * u[0] - s[4] * u[1],
    )


@compiled(inline=True, vector=True)
def _wrench(bodies: int, k: int, a: Vector, alpha: Vector) -> tuple[Vector, Vector]:
    """Return the wrench for the accelerations a and alpha of body k."""
    h = BODY.first(bodies, k)
    moment = _plus(_cross(h, a), _inertia_times(BODY.second(bodies, k), alpha))
    return _add(_cross(alpha, h), BODY.mass(bodies, k), a), moment


@compiled(lean=True, vector=True)
def _place(tree: TreeTables, q: Floats1) -> None:
    """Write the axes, origins and inertias of all bodies at q, shape (n,)."""
    links, joints, bodies = tree.links.ctypes.data, tree.joints.ctypes.data, tree.work.ctypes.data
    count = tree.links.shape[0]
    behind, padded = BODY.at(bodies, count + 1), (count + 3) // 4 * 4
    angles = floats_at(behind, padded)
    sines, cosines = floats_at(behind + 8 * padded, padded), floats_at(behind + 16 * padded, padded)
    angles[padded - 1] = angles[padded - 2] = angles[padded - 3] = 0.0
    for i in range(count):
        angles[i] = JOINT.gain(joints, i) * q[LINK.leader(links, i)] + JOINT.offset(joints, i)
    sines_and_cosines(angles, sines, cosines)
    BODY.set_x(bodies, (1.0, 0.0, 0.0))
    BODY.set_y(bodies, (0.0, 1.0, 0.0))
    BODY.set_z(bodies, (0.0, 0.0, 1.0))
    for i in range(count):
        parent, k = LINK.parent(links, i), i + 1
        px, py, pz = BODY.x(bodies, parent), BODY.y(bodies, parent), BODY.z(bodies, parent)
        r = _combined(px, py, pz, JOINT.origin(joints, i))
        x = _combined(px, py, pz, JOINT.axis_x(joints, i))
        y = _combined(px, py, pz, JOINT.axis_y(joints, i))
        z = _combined(px, py, pz, JOINT.axis_z(joints, i))
        if LINK.slides(links, i):
            r = _add(r, angles[i], z)
        else:
            c, s = cosines[i], sines[i]
            x, y = (
                (c * x[0] + s * y[0], c * x[1] + s * y[1], c * x[2] + s * y[2]),
                (c * y[0] - s * x[0], c * y[1] - s * x[1], c * y[2] - s * x[2]),
            )
        BODY.set_x(bodies, x, k)
        BODY.set_y(bodies, y, k)
        BODY.set_z(bodies, z, k)
        BODY.set_r(bodies, r, k)
        BODY.set_mass(bodies, JOINT.mass(joints, i), k)
        BODY.set_first(bodies, _combined(x, y, z, JOINT.first(joints, i)), k)
        xx, xy, xz, yy, yz, zz = JOINT.second(joints, i)
        # Columns of Q Sigma, then its rows times Q^T.
        a, b, c = (
            _combined(x, y, z, (xx, xy, xz)),
            _combined(x, y, z, (xy, yy, yz)),
            _combined(x, y, z, (xz, yz, zz)),
        )
        BODY.set_second(
            bodies,
            (
                a[0] * x[0] + b[0] * y[0] + c[0] * z[0],
                a[0] * x[1] + b[0] * y[1] + c[0] * z[1],
                a[0] * x[2] + b[0] * y[2] + c[0] * z[2],
                a[1] * x[1] + b[1] * y[1] + c[1] * z[1],
                a[1] * x[2] + b[1] * y[2] + c[1] * z[2],
                a[2] * x[2] + b[2] * y[2] + c[2] * z[2],
            ),
            k,
        )


@compiled(lean=True, vector=True)
def _move(tree: TreeTables, v: Floats1, a: Floats1) -> None:
    """Write the motion of all bodies at v and a, shape (n,), and the wrench that each body needs."""
    links, joints, bodies = tree.links.ctypes.data, tree.joints.ctypes.data, tree.work.ctypes.data
    still = (0.0, 0.0, 0.0)
    BODY.set_omega(bodies, still)
    BODY.set_alpha(bodies, still)
    BODY.set_a(bodies, (-tree.gravity[0], -tree.gravity[1], -tree.gravity[2]))
    for i in range(tree.links.shape[0]):
        parent, leader, k = LINK.parent(links, i), LINK.leader(links, i), i + 1
        gain = JOINT.gain(joints, i)
        speed, rate = gain * v[leader], gain * a[leader]
        z, r = BODY.z(bodies, k), BODY.r(bodies, k)
        omega, alpha = BODY.omega(bodies, parent), BODY.alpha(bodies, parent)
        linear = _plus(BODY.a(bodies, parent), _plus(_cross(alpha, r), _cross(omega, _cross(omega, r))))
        across = _cross(omega, z)
        if LINK.slides(links, i):
            linear = _add(_add(linear, rate, z), 2.0 * speed, across)
        else:
            alpha = _add(_add(alpha, rate, z), speed, across)
            omega = _add(omega, speed, z)
        BODY.set_omega(bodies, omega, k)
        BODY.set_alpha(bodies, alpha, k)
        BODY.set_a(bodies, linear, k)
        force, moment = _wrench(bodies, k, linear, alpha)
        force = _plus(force, _cross(omega, _cross(omega, BODY.first(bodies, k))))
        moment = _plus(moment, _cross(omega, _inertia_times(BODY.second(bodies, k), omega)))
        BODY.set_force(bodies, force, k)
        BODY.set_moment(bodies, moment, k)


@compiled(lean=True, vector=True)
def _gather_torques(tree: TreeTables, a: Floats1, tau: Floats1) -> None:
    """Add the wrench of each body to its parent's, and write the torques, shape (n,)."""
    links, joints, bodies = tree.links.ctypes.data, tree.joints.ctypes.data, tree.work.ctypes.data
    for j in range(tau.shape[0]):
        tau[j] = 0.0
    for i in range(tree.links.shape[0] - 1, -1, -1):
        parent, leader, k = LINK.parent(links, i), LINK.leader(links, i), i + 1
        force, moment, z = BODY.force(bodies, k), BODY.moment(bodies, k), BODY.z(bodies, k)
        gain = JOINT.gain(joints, i)
        own = _dot(z, force) if LINK.slides(links, i) else _dot(z, moment)
        tau[leader] += gain * (own + JOINT.rotor(joints, i) * gain * a[leader])
        if parent > 0:
            moment = _plus(moment, _cross(BODY.r(bodies, k), force))
            BODY.set_force(bodies, _plus(BODY.force(bodies, parent), force), parent)
            BODY.set_moment(bodies, _plus(BODY.moment(bodies, parent), moment), parent)


@compiled(lean=True, vector=True)
def _gather_inertias(tree: TreeTables) -> None:
    """Add the inertia of each body to its parent's, from the tips to the root."""
    links, bodies = tree.links.ctypes.data, tree.work.ctypes.data
    for i in range(tree.links.shape[0] - 1, -1, -1):
        parent, k = LINK.parent(links, i), i + 1
        if parent == 0:
            continue
        mass, h, r = BODY.mass(bodies, k), BODY.first(bodies, k), BODY.r(bodies, k)
        own, s, moved = BODY.second(bodies, k), BODY.second(bodies, parent), _add(h, mass, r)
        BODY.set_mass(bodies, BODY.mass(bodies, parent) + mass, parent)
        BODY.set_first(bodies, _plus(BODY.first(bodies, parent), moved), parent)
        # (r + x) (r + x)^T = x x^T + x r^T + r (x + r)^T
        BODY.set_second(
            bodies,
            (
                s[0] + own[0] + h[0] * r[0] + r[0] * moved[0],
                s[1] + own[1] + h[0] * r[1] + r[0] * moved[1],
                s[2] + own[2] + h[0] * r[2] + r[0] * moved[2],
                s[3] + own[3] + h[1] * r[1] + r[1] * moved[1],
                s[4] + own[4] + h[1] * r[2] + r[1] * moved[2],
                s[5] + own[5] + h[2] * r[2] + r[2] * moved[2],
            ),
            parent,
        )


@compiled(lean=True, inline=True)
def _place_in_rows(starts: int, a: int, b: int) -> int:
    """Return the offset of the entry (a, b) of M in its packed rows."""
    low, high = max(a, b), min(a, b)
    return word_at(starts, low + 1) - word_at(starts, high + 1) + word_at(starts, high)


@compiled(lean=True, vector=True)
def _write_masses(tree: TreeTables, rows: Floats1) -> None:
    """Write the packed rows of the mass matrix, shape (starts[-1],), from composite bodies."""
    links, joints, bodies = tree.links.ctypes.data, tree.joints.ctypes.data, tree.work.ctypes.data
    starts, packed = tree.starts.ctypes.data, rows.ctypes.data
    for at in range(rows.shape[0]):
        rows[at] = 0.0
    for i in range(tree.links.shape[0]):
        parent, leader, k = LINK.parent(links, i), LINK.leader(links, i), i + 1
        gain, z, still = JOINT.gain(joints, i), BODY.z(bodies, k), (0.0, 0.0, 0.0)
        if LINK.slides(links, i):
            force, moment = _wrench(bodies, k, z, still)
            own = _dot(z, force)
        else:
            force, moment = _wrench(bodies, k, still, z)
            own = _dot(z, moment)
        at, own = word_at(starts, leader), gain * gain * (own + JOINT.rotor(joints, i))
        store_double(packed, double_at(packed, at) + own, at)
        while parent > 0:
            moment = _plus(moment, _cross(BODY.r(bodies, k), force))
            k, j = parent, parent - 1
            z = BODY.z(bodies, k)
            own = _dot(z, force) if LINK.slides(links, j) else _dot(z, moment)
            own *= gain * JOINT.gain(joints, j)
            other = LINK.leader(links, j)
            own += own if leader == other else 0.0
            at = _place_in_rows(starts, leader, other)
            store_double(packed, double_at(packed, at) + own, at)
            parent = LINK.parent(links, j)


@compiled(lean=True)
def _unpack(tree: TreeTables, rows: Floats1, masses: Floats2) -> None:
    """Write M, shape (n, n), from its packed rows."""
    starts, above = tree.starts.ctypes.data, tree.above.ctypes.data
    packed, target, n = rows.ctypes.data, masses.ctypes.data, masses.shape[0]
    for at in range(n * n):
        store_double(target, 0.0, at)
    for a in range(n):
        b = a
        for at in range(word_at(starts, a), word_at(starts, a + 1)):
            value = double_at(packed, at)
            store_double(target, value, n * a + b)
            store_double(target, value, n * b + a)
            b = word_at(above, b)


@compiled(lean=True)
def _factorize(tree: TreeTables, rows: Floats1) -> bool:
    """Overwrite the packed rows of M with 1 / D and L of M = L^T D L; False if M has no inverse."""
    starts, above, packed = tree.starts.ctypes.data, tree.above.ctypes.data, rows.ctypes.data
    for a in range(tree.above.shape[0] - 1, -1, -1):
        begin, end, b = word_at(starts, a), word_at(starts, a + 1), word_at(above, a)
        pivot = double_at(packed, begin)
        if not pivot > 0.0:
            return False
        store_double(packed, 1.0 / pivot, begin)
        for at in range(begin + 1, end):
            entry, other = double_at(packed, at), word_at(starts, b)
            factor, before = entry / pivot, double_at(packed, other)
            rest = before - factor * entry
            if rest < SINGULAR * before:
                return False
            store_double(packed, rest, other)
            for k in range(1, end - at):
                changed = double_at(packed, other + k) - factor * double_at(packed, at + k)
                store_double(packed, changed, other + k)
            store_double(packed, factor, at)
            b = word_at(above, b)
    return True


@compiled(lean=True, vector=True)
def _solve(tree: TreeTables, factors: Floats1, x: Floats1, end: int) -> None:
    """Overwrite the first `end` elements of x, shape (n,), zero after them, with those of M^-1 x."""
    starts, above = tree.starts.ctypes.data, tree.above.ctypes.data
    packed, target = factors.ctypes.data, x.ctypes.data
    for a in range(end - 1, -1, -1):
        b, value = word_at(above, a), double_at(target, a)
        for at in range(word_at(starts, a) + 1, word_at(starts, a + 1)):
            store_double(target, double_at(target, b) - double_at(packed, at) * value, b)
            b = word_at(above, b)
    for a in range(end):
        begin, b = word_at(starts, a), word_at(above, a)
        total = double_at(packed, begin) * double_at(target, a)
        for at in range(begin + 1, word_at(starts, a + 1)):
            total -= double_at(packed, at) * double_at(target, b)
            b = word_at(above, b)
        store_double(target, total, a)


@compiled(lean=True, vector=True)
def _solve_columns(tree: TreeTables, factors: Floats1, x: Floats2) -> None:
    """Overwrite x, shape (n, m), with M^-1 x."""
    for a in range(x.shape[0] - 1, -1, -1):
        b = tree.above[a]
        for at in range(tree.starts[a] + 1, tree.starts[a + 1]):
            for k in range(x.shape[1]):
                x[b, k] -= factors[at] * x[a, k]
            b = tree.above[b]
    for a in range(x.shape[0]):
        b = tree.above[a]
        for k in range(x.shape[1]):
            x[a, k] *= factors[tree.starts[a]]
        for at in range(tree.starts[a] + 1, tree.starts[a + 1]):
            for k in range(x.shape[1]):
                x[a, k] -= factors[at] * x[b, k]
            b = tree.above[b]


@compiled(lean=True)
def _invert(tree: TreeTables, factors: Floats1, inverse: Floats2) -> None:
    """Write M^-1, symmetric, shape (n, n), from the factors of M."""
    for a in range(inverse.shape[0]):
        for b in range(a):
            inverse[a, b] = 0.0
        inverse[a, a] = 1.0
        _solve(tree, factors, inverse[a], a + 1)
        for b in range(a):
            inverse[b, a] = inverse[a, b]


@compiled(lean=True, vector=True)
def _write_rates(tree: TreeTables, v: Floats1) -> None:
    """Write S, U and W of all joints, and p and Pi of composite bodies, before inertias are gathered."""
    links, joints, bodies = tree.links.ctypes.data, tree.joints.ctypes.data, tree.work.ctypes.data
    none = (0.0, 0.0, 0.0)
    BODY.set_v(bodies, none)
    for i in range(tree.links.shape[0]):
        parent, k = LINK.parent(links, i), i + 1
        z, omega = BODY.z(bodies, k), BODY.omega(bodies, parent)
        velocity = _plus(BODY.v(bodies, parent), _cross(omega, BODY.r(bodies, k)))
        first = _cross(omega, z)
        second = _plus(_cross(BODY.alpha(bodies, parent), z), _cross(omega, first))
        s, u, w = z, first, second
        t, u_angular, w_angular = none, none, none
        if LINK.slides(links, i):
            velocity = _add(velocity, JOINT.gain(joints, i) * v[LINK.leader(links, i)], z)
        else:
            s, u, w = none, _cross(velocity, z), _cross(BODY.a(bodies, k), z)
            t, u_angular, w_angular = z, first, second
            # (A - omega x V) x z + omega x (V x z) + V x (omega x z), by Jacobi's identity
            w = _add(w, 2.0, _cross(velocity, first))
        BODY.set_s_linear(bodies, s, k)
        BODY.set_s_angular(bodies, t, k)
        BODY.set_u_linear(bodies, u, k)
        BODY.set_u_angular(bodies, u_angular, k)
        BODY.set_w_linear(bodies, w, k)
        BODY.set_w_angular(bodies, w_angular, k)
        BODY.set_v(bodies, velocity, k)
        omega, h = BODY.omega(bodies, k), BODY.first(bodies, k)
        xx, xy, xz, yy, yz, zz = BODY.second(bodies, k)
        BODY.set_p(bodies, _add(_cross(omega, h), BODY.mass(bodies, k), velocity), k)
        BODY.set_pi_x(bodies, _add(_cross(omega, (xx, xy, xz)), h[0], velocity), k)
        BODY.set_pi_y(bodies, _add(_cross(omega, (xy, yy, yz)), h[1], velocity), k)
        BODY.set_pi_z(bodies, _add(_cross(omega, (xz, yz, zz)), h[2], velocity), k)
    for i in range(tree.links.shape[0] - 1, -1, -1):
        parent, k = LINK.parent(links, i), i + 1
        if parent > 0:
            p, r = BODY.p(bodies, k), BODY.r(bodies, k)
            BODY.set_p(bodies, _plus(BODY.p(bodies, parent), p), parent)
            x, y, z = BODY.pi_x(bodies, k), BODY.pi_y(bodies, k), BODY.pi_z(bodies, k)
            BODY.set_pi_x(bodies, _plus(BODY.pi_x(bodies, parent), _add(x, r[0], p)), parent)
            BODY.set_pi_y(bodies, _plus(BODY.pi_y(bodies, parent), _add(y, r[1], p)), parent)
            BODY.set_pi_z(bodies, _plus(BODY.pi_z(bodies, parent), _add(z, r[2], p)), parent)


@compiled(inline=True, vector=True)
def _gyroscopic(bodies: int, k: int, wrench: tuple[Vector, Vector], d: Vector) -> tuple[Vector, Vector]:
    """Add to a wrench the effect of a change d of the angular velocity of composite body k."""
    x, y, z = BODY.pi_x(bodies, k), BODY.pi_y(bodies, k), BODY.pi_z(bodies, k)
    turned = _add(_add(wrench[1], -2.0, _combined(x, y, z, d)), 2.0 * (x[0] + y[1] + z[2]), d)
    return _add(wrench[0], 2.0, _cross(d, BODY.p(bodies, k))), turned


@compiled(lean=True, vector=True)
def _write_derivatives(tree: TreeTables, by_q: Floats2, by_v: Floats2, masses: Floats2) -> None:
    """Write the derivatives of the torques, shape (n, n) each, from composite bodies, wrenches and rates."""
    links, joints, bodies = tree.links.ctypes.data, tree.joints.ctypes.data, tree.work.ctypes.data
    for a in range(by_q.shape[0]):
        for b in range(by_q.shape[0]):
            by_q[a, b] = by_v[a, b] = masses[a, b] = 0.0
    for i in range(tree.links.shape[0]):
        k, leader, gain = i + 1, LINK.leader(links, i), JOINT.gain(joints, i)
        s, t = BODY.s_linear(bodies, k), BODY.s_angular(bodies, k)
        u, upsilon = BODY.u_linear(bodies, k), BODY.u_angular(bodies, k)
        x, y, z = BODY.pi_x(bodies, k), BODY.pi_y(bodies, k), BODY.pi_z(bodies, k)
        f, n = _wrench(bodies, k, s, t)
        g = _add(_cross(BODY.p(bodies, k), s), x[0] + y[1] + z[2], t)
        g = _add(g, -1.0, (_dot(x, t), _dot(y, t), _dot(z, t)))
        q_wrench = _wrench(bodies, k, BODY.w_linear(bodies, k), BODY.w_angular(bodies, k))
        qf, qn = _gyroscopic(bodies, k, q_wrench, upsilon)
        force, moment = BODY.force(bodies, k), BODY.moment(bodies, k)
        qf, qn = _plus(qf, _cross(t, force)), _plus(qn, _plus(_cross(t, moment), _cross(s, force)))
        vf, vn = _wrench(bodies, k, u, upsilon)
        vf, vn = _gyroscopic(bodies, k, (_plus(vf, vf), _plus(vn, vn)), t)
        masses[leader, leader] += gain * gain * (_dot(s, f) + _dot(t, n) + JOINT.rotor(joints, i))
        by_q[leader, leader] += gain * gain * (_dot(s, qf) + _dot(t, qn))
        by_v[leader, leader] += gain * gain * (_dot(s, vf) + _dot(t, vn))
        parent = LINK.parent(links, i)
        while parent > 0:
            r = BODY.r(bodies, k)
            n, qn, vn = _plus(n, _cross(r, f)), _plus(qn, _cross(r, qf)), _plus(vn, _cross(r, vf))
            k, j = parent, parent - 1
            s, t, upsilon = BODY.s_linear(bodies, k), BODY.s_angular(bodies, k), BODY.u_angular(bodies, k)
            w, w_angular = BODY.w_linear(bodies, k), BODY.w_angular(bodies, k)
            other, both = LINK.leader(links, j), gain * JOINT.gain(joints, j)
            own = both * (_dot(s, f) + _dot(t, n))
            masses[leader, other] += own
            masses[other, leader] += own
            by_q[leader, other] += both * (_dot(f, w) + _dot(n, w_angular) + 2.0 * _dot(g, upsilon))
            by_q[other, leader] += both * (_dot(s, qf) + _dot(t, qn))
            changed = _dot(f, BODY.u_linear(bodies, k)) + _dot(n, upsilon) + _dot(g, t)
            by_v[leader, other] += 2.0 * both * changed
            by_v[other, leader] += both * (_dot(s, vf) + _dot(t, vn))
            parent = LINK.parent(links, j)


@compiled(lean=True)
def _differentiate(tree: TreeTables, v: Floats1, a: Floats1, tau: Floats1, derivatives: Floats3) -> None:
    """Write torques and their derivatives, shape (3, n, n), for bodies that have been placed."""
    _move(tree, v, a)
    _gather_torques(tree, a, tau)
    _write_rates(tree, v)
    _gather_inertias(tree)
    _write_derivatives(tree, derivatives[0], derivatives[1], derivatives[2])


@compiled(lean=True)
def _factorize_masses(tree: TreeTables, rows: Floats1) -> bool:
    """Write the factors of M for bodies that have been placed, which become composite; False without M^-1."""
    _gather_inertias(tree)
    _write_masses(tree, rows)
    return bool(_factorize(tree, rows))


@compiled("boolean(TreeTables, float64[::1], float64[::1], float64[::1], float64[::1])")
def inverse_dynamics(tree: TreeTables, q: Floats1, v: Floats1, a: Floats1, tau: Floats1) -> bool:
    """Write the torques of a motion.

    Args:
        tree: The robot.
        q: Positions [rad or m], shape (n,).
        v: Velocities [rad/s or m/s], shape (n,).
        a: Accelerations [rad/s^2 or m/s^2], shape (n,).
        tau: Output: M(q) a + C(q, v) v + g(q), shape (n,) [N m or N].

    Returns:
        Whether the vectors have shape (n,) and are within range; else nothing is written.
    """
    n = tree.above.shape[0]
    if not (in_range(n, q) and in_range(n, v) and in_range(n, a)):
        return False
    _place(tree, q)
    _move(tree, v, a)
    _gather_torques(tree, a, tau)
    return True


@compiled("boolean(TreeTables, float64[::1], float64[::1])")
def gravity_torque(tree: TreeTables, q: Floats1, tau: Floats1) -> bool:
    """Write g(q), the torques at rest, shape (n,) [N m or N]; see `inverse_dynamics`."""
    still = np.zeros(tree.above.shape[0])
    return bool(inverse_dynamics(tree, q, still, still, tau))


@compiled("boolean(TreeTables, float64[::1], float64[:, ::1])")
def mass_matrix(tree: TreeTables, q: Floats1, masses: Floats2) -> bool:
    """Write M(q), shape (n, n) [kg m^2, kg m or kg]; see `inverse_dynamics`."""
    if not in_range(tree.above.shape[0], q):
        return False
    rows = np.empty(tree.starts[-1])
    _place(tree, q)
    _gather_inertias(tree)
    _write_masses(tree, rows)
    _unpack(tree, rows, masses)
    return True


@compiled(lean=True)
def _is_deep(tree: TreeTables, limit: int) -> bool:
    """Return whether the rows of L have more entries than a limit on average."""
    return bool(tree.starts[-1] > limit * tree.above.shape[0])


@compiled(lean=True)
def _accelerate(
    tree: TreeTables,
    q: Floats1,
    v: Floats1,
    tau: Floats1,
    still: Floats1,
    rows: Floats1,
    a: Floats1,
) -> bool:
    """Write accelerations and the factors of M; `still` has n zeros. False if M has no inverse."""
    _place(tree, q)
    _move(tree, v, still)
    _gather_torques(tree, still, a)
    for j in range(a.shape[0]):
        a[j] = tau[j] - a[j]
    if not _factorize_masses(tree, rows):
        return False
    _solve(tree, rows, a, a.shape[0])
    return True


@compiled("boolean(TreeTables, float64[::1], float64[::1], float64[::1], float64[::1])")
def forward_dynamics(tree: TreeTables, q: Floats1, v: Floats1, tau: Floats1, a: Floats1) -> bool:
    """Write the accelerations caused by torques.

    Args:
        tree: The robot.
        q: Positions [rad or m], shape (n,).
        v: Velocities [rad/s or m/s], shape (n,).
        tau: Torques or forces [N m or N], shape (n,).
        a: Output: M(q)^-1 (tau - C(q, v) v - g(q)), shape (n,) [rad/s^2 or m/s^2].

    Returns:
        Whether the vectors have shape (n,) and are within range, M has an inverse, and the tree is not DEEP.
    """
    n = tree.above.shape[0]
    if _is_deep(tree, DEEP) or not (in_range(n, q) and in_range(n, v) and in_range(n, tau)):
        return False
    still, rows = np.zeros(n), np.empty(tree.starts[-1])
    return bool(_accelerate(tree, q, v, tau, still, rows, a))


@compiled("boolean(TreeTables, float64[::1], float64[:, ::1])")
def inverse_mass_matrix(tree: TreeTables, q: Floats1, inverse: Floats2) -> bool:
    """Write M(q)^-1, shape (n, n); see `forward_dynamics`."""
    n = tree.above.shape[0]
    if _is_deep(tree, DEEP // 2) or not in_range(n, q):
        return False
    rows = np.empty(tree.starts[-1])
    _place(tree, q)
    if not _factorize_masses(tree, rows):
        return False
    _invert(tree, rows, inverse)
    return True


@compiled("boolean(TreeTables, float64[::1], float64[::1], float64[::1], float64[:, :, ::1])")
def inverse_dynamics_derivatives(
    tree: TreeTables, q: Floats1, v: Floats1, a: Floats1, derivatives: Floats3
) -> bool:
    """Write the derivatives of the torques by q, v and a, shape (3, n, n); see `inverse_dynamics`."""
    n = tree.above.shape[0]
    if not (in_range(n, q) and in_range(n, v) and in_range(n, a)):
        return False
    tau = np.empty(n)
    _place(tree, q)
    _differentiate(tree, v, a, tau, derivatives)
    return True


@compiled("boolean(TreeTables, float64[::1], float64[::1], float64[::1], float64[:, :, ::1])")
def forward_dynamics_derivatives(
    tree: TreeTables, q: Floats1, v: Floats1, tau: Floats1, derivatives: Floats3
) -> bool:
    """Write the derivatives of the accelerations by q, v and tau, shape (3, n, n); see `forward_dynamics`.

    They are -M^-1 dtau/dq and -M^-1 dtau/dv at the acceleration caused by tau, and M^-1.
    """
    n = tree.above.shape[0]
    if _is_deep(tree, DEEP // 2) or not (in_range(n, q) and in_range(n, v) and in_range(n, tau)):
        return False
    rows, still, a = np.empty(tree.starts[-1]), np.zeros(n), np.empty(n)
    if not _accelerate(tree, q, v, tau, still, rows, a):
        return False
    _place(tree, q)  # single bodies instead of composite ones
    _differentiate(tree, v, a, still, derivatives)
    for which in range(2):
        for i in range(n):
            for j in range(n):
                derivatives[which, i, j] = -derivatives[which, i, j]
        _solve_columns(tree, rows, derivatives[which])
    _invert(tree, rows, derivatives[2])
    return True
