"""Speeds and accelerations of the wheels of a planar base, relative to their limits."""

from __future__ import annotations

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.motion.optimization.moving import Moving
from pepper_kin.planners.optimization import BarrierBound, Rows
from pepper_kin.trajectory.balance import WheelLimits

_SMOOTH = 1e-3  # smoothing of |v| at rest, relative to the base's maximum speed


class WheelTerm:
    """Term of each wheel's speed and acceleration and of the base's speed, relative to their limits.

    The base's speed has two rows, (|v| +- lever omega) / base_speed: both are between -1 and 1 if |v| + lever
    |omega| is within its limit.

    Args:
        moving: The joints that move.
        wheels: The limits of the wheels.
        share: Fraction of the limits that is used.
        per_interval: Samples in each interval of the spline.
    """

    barrier_bound = BarrierBound.WITHIN_ONE

    def __init__(self, moving: Moving, wheels: WheelLimits, share: float, per_interval: int) -> None:
        self._wheels, self.per_interval = wheels.scaled(share, share), per_interval
        self._places = np.array(wheels.places)
        # Index of each base joint among the moving joints; -1 if it rests.
        self._columns = np.array(
            [int(np.argmax(moving.joints == j)) if j in moving.joints else -1 for j in wheels.places]
        )
        self._rest = moving.rest[self._places]

    def values(self, q: Array, v: Array, a: Array) -> Array:
        """Return the values, shape (K, 2 k + 2) for k wheels, at states of shape (K, n)."""
        return self.rows(q, v, a).value

    def rows(self, q: Array, v: Array, a: Array) -> Rows:
        """Return the values and their derivatives, shape (K, 2 k + 2, n)."""
        wheels, count = self._wheels, len(q)
        yaw = self._of_base(q, self._rest)[:, 2]
        v_x, v_y, omega = self._of_base(v, np.zeros(3)).T
        a_x, a_y, alpha = self._of_base(a, np.zeros(3)).T
        cosine, sine, none, one = np.cos(yaw), np.sin(yaw), np.zeros(count), np.ones(count)
        along, across = cosine * v_x + sine * v_y, cosine * v_y - sine * v_x
        ahead, aside = cosine * a_x + sine * a_y, cosine * a_y - sine * a_x
        turned = ((cosine, sine, none), (-sine, cosine, none), (none, none, one))
        twist = np.stack([along, across, omega], axis=1)
        change = np.stack([ahead + omega * across, aside - omega * along, alpha], axis=1)
        twist_by = {"q": _matrix((none, none, across), (none, none, -along)), "v": _matrix(*turned)}
        change_by = {
            "q": _matrix((none, none, aside - omega * along), (none, none, -ahead - omega * across)),
            "v": _matrix((-omega * sine, omega * cosine, across), (-omega * cosine, -omega * sine, -along)),
            "a": _matrix(*turned),
        }
        speed_map, change_map = wheels.rows / wheels.speed, wheels.rows / wheels.acceleration
        size = np.sqrt(along**2 + across**2 + (_SMOOTH * wheels.base_speed) ** 2)
        lever = wheels.lever * one
        base_map = np.stack(
            [np.stack([along / size, across / size, side * lever], axis=1) for side in (1.0, -1.0)], axis=1
        )  # (K, 2, 3), the derivatives of the base's speeds by the twist
        base = np.stack([size + side * wheels.lever * omega for side in (1.0, -1.0)], axis=1)
        value = np.concatenate([twist @ speed_map.T, change @ change_map.T, base / wheels.base_speed], axis=1)

        def slopes(part: str) -> Array:
            by_twist = twist_by.get(part, np.zeros((count, 3, 3)))
            return self._spread(
                np.concatenate(
                    [
                        speed_map @ by_twist,
                        change_map @ change_by[part],
                        base_map @ by_twist / wheels.base_speed,
                    ],
                    axis=1,
                ),
                q.shape[1],
            )

        return Rows(value, slopes("q"), slopes("v"), slopes("a"))

    def _of_base(self, states: Array, rest: Array) -> Array:
        """Return the base's part of states, shape (K, 3); resting joints are at `rest`, shape (3,)."""
        return np.where(self._columns >= 0, states[:, self._columns], rest)

    def _spread(self, slopes: Array, n: int) -> Array:
        """Expand derivatives by x, y and yaw, shape (K, R, 3), to all moving joints, shape (K, R, n)."""
        whole = np.zeros((*slopes.shape[:2], n))
        present = self._columns >= 0
        whole[:, :, self._columns[present]] = slopes[:, :, present]
        return whole


def _matrix(*rows: tuple[Array, Array, Array]) -> Array:
    """Return matrices, shape (K, 3, 3), from up to three rows of arrays, shape (K,); others are zero."""
    found = np.zeros((rows[0][0].size, 3, 3))
    for k, row in enumerate(rows):
        found[:, k] = np.stack(row, axis=1)
    return found
