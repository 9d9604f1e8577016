"""Rows that keep the robot on its wheels: zero-moment point and capture point inside their triangle."""

from __future__ import annotations

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.collision.loads import (
    center_of_mass_jacobian_with,
    center_of_mass_with,
    load_wrench,
    load_wrench_rate,
)
from pepper_kin.dynamics import center_of_mass, total_mass
from pepper_kin.dynamics.center_of_mass import share_of_moving
from pepper_kin.dynamics.load import Loads
from pepper_kin.dynamics.support_polygon import inward_normals, wheel_contacts
from pepper_kin.kinematics import frame_jacobian, frame_pose
from pepper_kin.model import PepperModel
from pepper_kin.servo.half_spaces import VelocityRows

BASE = "base_footprint"


class BalanceRows:
    """Two rows for each edge of the wheels' triangle.

    With p a point of the edge, i its inward normal, m the margin, omega^2 = g / c_z:

        zero-moment point z of the acceleration (v' - v) / dt:   i . (z - p) >= m,
        capture point x = c + J_c v' (dt + 1 / omega):           i . (x - p) >= m.

    The first keeps this tick from tipping, the second keeps a motion of the center of mass c that can be
    stopped before the edge (Pratt et al., Capture point: a step toward humanoid push recovery, 2006).  Both
    are linear in the next velocity v': the first times the floor's vertical force.

    Args:
        pepper: The robot, with the frame `base_footprint`.
        margin: m [m].
        loads: What it carries, which is part of c and of the floor's wrench.

    Attributes:
        loads: The same; may be replaced between ticks.

    Raises:
        UnknownNameError: for a robot without that frame.
        InvalidValueError: for one whose wheels are not known.
    """

    def __init__(self, pepper: PepperModel, margin: float, loads: Loads = ()) -> None:
        pepper.frame_id(BASE)
        self.loads = loads
        self._pepper, self._margin, self._corners = pepper, margin, wheel_contacts(pepper, "balance")
        self._inward = inward_normals(self._corners)

    def rows(self, q: Array, v: Array, dt: float) -> VelocityRows:
        """Return the six rows at q, shape (n,) [rad or m], after velocity v, shape (n,) [rad/s or m/s]."""
        pose = frame_pose(self._pepper, q, BASE)
        points = self._corners @ pose[:2, :2].T + pose[:2, 3]
        inward = self._inward @ pose[:2, :2].T
        reach = np.einsum("ij,ij->i", inward, points) + self._margin
        center = center_of_mass_with(self._pepper, self.loads, q)
        tilt, tilt_rate, lift, lift_rate = self._floor(q, v)
        # h = i . tilt - reach f_z, linear in the acceleration.
        slope = (inward @ tilt_rate - np.outer(reach, lift_rate)) / dt
        now = inward @ tilt - reach * lift
        fall = np.sqrt(float(np.linalg.norm(self._pepper.inner_model.gravity.linear)) / center[2])
        drift = inward @ self._center_rate(q, pose, center)[:2] * (dt + 1.0 / fall)
        matrix = np.concatenate([slope / lift, drift])
        least = np.concatenate([(slope @ v - now) / lift, reach - inward @ center[:2]])
        # A robot that stands outside may only come back: it is not thrown.
        least[len(reach) :] = np.minimum(least[len(reach) :], 0.0)
        return VelocityRows(matrix, least, ("balance",) * len(least))

    def _center_rate(self, q: Array, pose: Array, center: Array) -> Array:
        """Return the Jacobian of the center of mass as seen from the base, shape (3, n).

        Args:
            q: Joint positions [rad or m], shape (n,).
            pose: Of the base in the world, shape (4, 4).
            center: Center of mass in the world [m], shape (3,).
        """
        base = frame_jacobian(self._pepper, q, BASE)
        carried = base[:3] + np.cross(base[3:], center - pose[:3, 3], axisa=0, axisc=0)
        return center_of_mass_jacobian_with(self._pepper, self.loads, q) - carried

    def _floor(self, q: Array, v: Array) -> tuple[Array, Array, float, Array]:
        """Return (-n_y, n_x) and f_z of the floor without acceleration, and their derivatives by it.

        Args:
            q: Joint positions [rad or m], shape (n,).
            v: Joint velocities [rad/s or m/s], shape (n,).

        Returns:
            Moments [N m], shape (2,), their derivatives, shape (2, n), force [N] and its derivatives, shape
            (n,).
        """
        import pinocchio

        pepper, model, data = self._pepper, self._pepper.inner_model, self._pepper.pinocchio_data
        share, still = share_of_moving(pepper)
        v_full = pepper.rate_to_full(v)
        pinocchio.dccrba(model, data, pepper.to_full(q), v_full)
        momentum = pepper.columns_from_full(np.array(data.Ag))
        bias = np.array(data.dAg).reshape(6, -1) @ v_full
        center = center_of_mass(pepper, q)
        lever = pinocchio.skew((center - still) / share if share > 0 else center)
        weight = total_mass(pepper) * np.asarray(model.gravity.linear)
        moment = bias[3:] + lever @ bias[:3] - np.cross(center, weight)
        moment_rate = momentum[3:] + lever @ momentum[:3]
        lift, lift_rate = float(bias[2] - weight[2]), momentum[2]
        if self.loads:
            carried = load_wrench(pepper, self.loads, q, v, np.zeros_like(q))
            carried_rate = load_wrench_rate(pepper, self.loads, q)
            moment, moment_rate = moment + carried[3:], moment_rate + carried_rate[3:]
            lift, lift_rate = lift + float(carried[2]), lift_rate + carried_rate[2]
        tilt = np.array([-moment[1], moment[0]])
        tilt_rate = np.array([-moment_rate[1], moment_rate[0]])
        return tilt, tilt_rate, lift, lift_rate
