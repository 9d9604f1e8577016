"""Limits of the wheels: balance over their triangle, their speeds and accelerations, the base's own speed."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from pepper_kin.arrays import Array, read_only
from pepper_kin.collision.loads import carrying, load_wrench
from pepper_kin.dynamics import base_wrench
from pepper_kin.dynamics.load import Loads
from pepper_kin.dynamics.support_polygon import inward_normals
from pepper_kin.dynamics.support_polygon import support_polygon as support_polygon
from pepper_kin.kinematics.base_geometry import pepper_base
from pepper_kin.model import PepperModel, kept_for_robot
from pepper_kin.model.wheels import BASE_JOINTS

_DIRECTIONS = 8  # number of directions in half a turn along which accelerations of unknown wheels are limited


def edge_moments(
    pepper: PepperModel,
    polygon: Array,
    q: Array,
    v: Array,
    a: Array,
    margin: float = 0.0,
    loads: Loads = (),
) -> Array:
    """Return the edge moments, which tell how firmly the robot stands on each edge of its support polygon.

    With (f, n) the wrench of the floor, p a vertex of the edge and i the unit vector that points inward,
        h = i . (-n_y, n_x) - (i . p + margin) f_z = (distance of the zero-moment point - margin) f_z:
    zero where the zero-moment point is `margin` inside the edge, and linear in the accelerations.

    Args:
        pepper: The robot.
        polygon: Vertices of the support polygon in base coordinates, counter-clockwise [m], shape (k, 2).
        q: Joint positions [rad or m], shape (..., n).
        v: Joint velocities [rad/s or m/s], shape (..., n).
        a: Joint accelerations [rad/s^2 or m/s^2], shape (..., n).
        margin: Distance to be kept from the edge [m].
        loads: Carried loads.

    Returns:
        Moment h of every edge [N m], positive where the robot stands firmly, shape (..., k).
    """
    return _moments(pepper, polygon, q, floor_wrench(pepper, q, v, a, loads), margin)


def moment_matrix(polygon: Array, margin: float) -> Array:
    """Return G such that edge moments are wrench @ G, shape (6, k), with the wrench in base coordinates."""
    inward = inward_normals(polygon)
    gain = np.zeros((6, len(polygon)))
    gain[4], gain[3] = -inward[:, 0], inward[:, 1]
    gain[2] = -(np.sum(inward * polygon, axis=1) + margin)
    return gain


def moves_base(pepper: PepperModel) -> bool:
    """Return whether the support polygon moves with the base's joints."""
    return set(BASE_JOINTS) <= set(pepper.joint_names)


def balance_margin(
    pepper: PepperModel, polygon: Array, q: Array, v: Array, a: Array, loads: Loads = ()
) -> Array:
    """Return the distance of the zero-moment point from the nearest edge of the support polygon.

    Args:
        pepper: The robot.
        polygon: Vertices in base coordinates, counter-clockwise [m], shape (k, 2).
        q: Joint positions [rad or m], shape (T, n).
        v: Joint velocities [rad/s or m/s], shape (T, n).
        a: Joint accelerations [rad/s^2 or m/s^2], shape (T, n).
        loads: Carried loads.

    Returns:
        Signed distance [m], positive inside, -inf where the floor would have to pull the robot down, shape
        (T,).
    """
    return margin_of_wrench(pepper, polygon, q, floor_wrench(pepper, q, v, a, loads))


def margin_of_wrench(pepper: PepperModel, polygon: Array, q: Array, wrench: Array) -> Array:
    """Return the distance that `balance_margin` returns [m], from the floor's wrench, shape (T, 6)."""
    moments, lift = _moments(pepper, polygon, q, wrench, 0.0).min(axis=1), wrench[:, 2]
    return np.where(lift > 0, moments / np.where(lift > 0, lift, 1.0), -np.inf)


def floor_wrench(pepper: PepperModel, q: Array, v: Array, a: Array, loads: Loads = ()) -> Array:
    """Return the wrench of the floor on a robot and its loads, about the world's origin.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).
        v: Joint velocities [rad/s or m/s], shape (..., n).
        a: Joint accelerations [rad/s^2 or m/s^2], shape (..., n).
        loads: Carried loads.

    Returns:
        Force [N], then moment [N m], shape (..., 6).
    """
    if pepper.solvers != "fast":
        return base_wrench(carrying(pepper, loads), q, v, a)
    wrench = base_wrench(pepper, q, v, a)
    return wrench + load_wrench(pepper, loads, q, v, a) if loads else wrench


def _moments(pepper: PepperModel, polygon: Array, q: Array, wrench: Array, margin: float) -> Array:
    """Return the edge moments [N m], shape (..., k), from the floor's wrench, shape (..., 6)."""
    if moves_base(pepper):  # the wrench about the base's origin, in the base's axes
        x, y, yaw = (q[..., pepper.joint_index(joint)] for joint in BASE_JOINTS)
        lift, cosine, sine = wrench[..., 2], np.cos(yaw), np.sin(yaw)
        n_x, n_y = wrench[..., 3] - y * lift, wrench[..., 4] + x * lift
        wrench = wrench.copy()
        wrench[..., 3], wrench[..., 4] = cosine * n_x + sine * n_y, cosine * n_y - sine * n_x
    return np.einsum("...i,ik->...k", wrench, moment_matrix(polygon, margin))


@dataclass(frozen=True, eq=False)
class WheelLimits:
    """Limits of a planar base with twist (v_x, v_y, omega) in its own axes [m/s, m/s, rad/s].

    With a wheel's row w of `rows`, |w . twist| <= speed and |w . d(twist)/dt| <= acceleration, and
    |v| + lever |omega| <= base_speed.  The base's joints are its pose in the world, so that the twist is
    their velocity rotated by -yaw: v = R(-yaw) (dx/dt, dy/dt), dv/dt = R(-yaw) (d2x/dt2, d2y/dt2) - omega x
    v.

    Attributes:
        places: Indices of the joints x, y and yaw, shape (3,).
        names: Names of the wheels, one for each row.
        rows: Map from the twist to the wheels' speeds, shape (k, 3) [rad/m and 1, or 1 and m].
        speed: Maximum speed of a wheel [rad/s; m/s of the rim for wheels whose radius is unknown].
        acceleration: Maximum acceleration of a wheel [rad/s^2 or m/s^2].
        base_speed: Maximum speed of the base [m/s].
        lever: Radius by which rotation adds to the base's speed [m].
        unit: Unit of the wheels' positions, "rad" or "m".
    """

    places: tuple[int, int, int]
    names: tuple[str, ...]
    rows: Array
    speed: float
    acceleration: float
    base_speed: float
    lever: float
    unit: str

    def scaled(self, speed: float, acceleration: float) -> WheelLimits:
        """Return the limits multiplied by scales of speed and acceleration."""
        return replace(
            self,
            speed=self.speed * speed,
            acceleration=self.acceleration * acceleration,
            base_speed=self.base_speed * speed,
        )

    @property
    def speed_count(self) -> int:
        """Number of limited speeds: one for each wheel, and the base's."""
        return len(self.rows) + 1

    def speeds(self, q: Array, v: Array) -> Array:
        """Return the speeds of the wheels, shape (T, k), of states of shape (T, n)."""
        return np.asarray(self._twist(q, v) @ self.rows.T)

    def base_speeds(self, q: Array, v: Array) -> Array:
        """Return |v| + lever |omega| [m/s], shape (T,)."""
        twist = self._twist(q, v)
        return np.asarray(np.hypot(twist[:, 0], twist[:, 1]) + self.lever * np.abs(twist[:, 2]))

    def shares(self, q: Array, v: Array) -> Array:
        """Return the fractions of their limits that the speeds of wheels and base use, shape (T, k + 1)."""
        wheels = np.abs(self.speeds(q, v)) / self.speed
        return np.column_stack([wheels, self.base_speeds(q, v) / self.base_speed])

    def accelerations(self, q: Array, v: Array, a: Array) -> Array:
        """Return the accelerations of the wheels, shape (T, k), of states of shape (T, n)."""
        twist, change = self._twist(q, v), self._twist(q, a)
        omega = twist[:, 2]
        change[:, 0] += omega * twist[:, 1]
        change[:, 1] -= omega * twist[:, 0]
        return np.asarray(change @ self.rows.T)

    def _twist(self, q: Array, v: Array) -> Array:
        """Return velocities in the base's own axes, shape (T, 3)."""
        x, y, yaw = self.places
        cosine, sine = np.cos(q[:, yaw]), np.sin(q[:, yaw])
        return np.stack(
            [cosine * v[:, x] + sine * v[:, y], cosine * v[:, y] - sine * v[:, x], v[:, yaw]], axis=1
        )


@kept_for_robot(most=1)
def wheel_limits(pepper: PepperModel) -> WheelLimits | None:
    """Return the limits of the wheels of a planar base; None for other robots, and where none are known.

    Pepper's wheels are taken from `pepper_base(fastest=True)`: 6.28 rad/s, which is 0.44 m/s at the rim, and
    at the rim the maker's maximum acceleration of the base.  A base with `Wheels(speed, acceleration, track)`
    has its rims at half the track from its center, in unknown directions: |v| + track / 2 |omega| <= speed;
    accelerations are limited along eight directions, within a polygon that lies inside the corresponding
    bound.
    """
    if not set(BASE_JOINTS) <= set(pepper.joint_names):
        return None
    x, y, yaw = (pepper.joint_index(joint) for joint in BASE_JOINTS)
    known = pepper.wheels
    if known is not None:
        if known.differential:
            return None
        half = known.track / 2
        angle = np.pi / _DIRECTIONS * np.arange(_DIRECTIONS)
        along = np.repeat(np.stack([np.cos(angle), np.sin(angle)], axis=1), 2, axis=0)
        rows = np.column_stack([along, np.tile([half, -half], _DIRECTIONS)])
        names = tuple(f"a wheel that rolls at {math.degrees(part):.3g} degrees" for part in angle)
        inside = math.cos(np.pi / (2 * _DIRECTIONS))
        return WheelLimits(
            (x, y, yaw), tuple(name for name in names for _ in range(2)), read_only(rows), known.speed,
            known.acceleration * inside, known.speed, half, "m",
        )  # fmt: skip
    base = pepper_base(fastest=True)
    if not {f"{name}_link" for name in base.wheel_names} <= set(pepper.frame_names):
        return None
    return WheelLimits(
        (x, y, yaw), base.wheel_names, read_only(base.wheel_map), base.wheel_speed_limit,
        base.linear_acceleration / base.wheel_radius, base.wheel_speed_limit * base.wheel_radius, 0.0, "rad",
    )  # fmt: skip
