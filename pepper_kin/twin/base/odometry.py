"""Poses of the base along arcs: x, y [m] and yaw [rad]."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, read_only
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model.joint_vectors import as_batch, as_finite, as_real, check_seed
from pepper_kin.twin.base.omni_base import OmniBase

_STRAIGHT = 1e-4  # angle below which the series is exact to the last bit [rad]


def arc_moved(pose: ArrayLike, arc: ArrayLike) -> Array:
    """Return the pose at the end of an arc: a constant twist for the unit of time.

    With w the rotation angle, the displacement in the axes of the start is
        (sin(w)/w  -(1 - cos w)/w;  (1 - cos w)/w  sin(w)/w) (x, y),
    the exponential of the twist in the plane (Lynch and Park, Modern Robotics, 2017, 3.3.3).

    Args:
        pose: Initial pose x, y [m], yaw [rad], shape (..., 3).
        arc: Twist times duration: x, y [m], angle [rad], in the axes of the base, shape (..., 3).

    Returns:
        x, y, yaw, shape (..., 3); the yaw counts full turns.

    Raises:
        InvalidValueError: for a wrong shape, NaN or infinity.
    """
    start, step = as_batch(pose, "pose", (3,)), as_batch(arc, "arc", (3,))
    ratio, bend = _coefficients(step[..., 2])
    x = ratio * step[..., 0] - bend * step[..., 1]
    y = bend * step[..., 0] + ratio * step[..., 1]
    cos, sin = np.cos(start[..., 2]), np.sin(start[..., 2])
    return np.stack(
        [
            start[..., 0] + cos * x - sin * y,
            start[..., 1] + sin * x + cos * y,
            start[..., 2] + step[..., 2],
        ],
        axis=-1,
    )


def arc_between(start: ArrayLike, end: ArrayLike) -> Array:
    """Return the arc that leads from one pose to another, the inverse of `arc_moved`.

    Args:
        start: Initial pose x, y [m], yaw [rad], shape (..., 3).
        end: Final pose x, y [m], yaw [rad], shape (..., 3); its yaw is less than a full turn from the
            start's.

    Returns:
        x, y [m], angle [rad] in the axes of the start, shape (..., 3).

    Raises:
        InvalidValueError: for a wrong shape, NaN, infinity, or a full turn or more.
    """
    first, last = as_batch(start, "start", (3,)), as_batch(end, "end", (3,))
    step = last - first
    angle = step[..., 2]
    if np.abs(angle).max(initial=0.0) > 2 * np.pi - 1e-6:
        raise InvalidValueError("end", f"{np.abs(angle).max():.6g} rad further", "less than a full turn")
    cos, sin = np.cos(first[..., 2]), np.sin(first[..., 2])
    x = cos * step[..., 0] + sin * step[..., 1]
    y = -sin * step[..., 0] + cos * step[..., 1]
    ratio, bend = _coefficients(angle)
    size = ratio**2 + bend**2
    return np.stack([(ratio * x + bend * y) / size, (ratio * y - bend * x) / size, angle], axis=-1)


class Odometry:
    """Pose estimated from the wheels' rotation, exact along arcs except for modeled wheel slip.

    Args:
        base: The wheels.
        pose: Initial pose x, y [m], yaw [rad], shape (3,), or (N, 3) for many bases.
        radius_error: Relative error of each wheel's assumed radius, one number or shape (k,), or (N, k) for
            many bases.
        wheel_slip: Standard deviation of each wheel's slip for a rotation of one radian [rad]; it grows with
            the square root of the rotation.
        seed: Seed of the slip, or a generator.

    Raises:
        InvalidValueError: for a wrong shape, NaN, infinity, or a slip below 0.
    """

    def __init__(
        self,
        base: OmniBase,
        pose: ArrayLike = (0.0, 0.0, 0.0),
        *,
        radius_error: ArrayLike = 0.0,
        wheel_slip: float = 0.0,
        seed: int | np.random.Generator = 0,
    ) -> None:
        count, error = len(base.wheel_map), as_batch(radius_error, "radius_error", ())
        start = as_batch(pose, "pose", (3,))
        turns = (*start.shape[:-1], count)
        if error.shape not in ((), (count,), turns):
            raise InvalidValueError("radius_error", f"shape {error.shape}", f"shape () or ({count},)")
        if not 0 <= as_real(wheel_slip) < np.inf:
            raise InvalidValueError("wheel_slip", wheel_slip, "a finite number of at least 0 [rad]")
        self.base = base
        self._pose = read_only(start)
        self._scale, self._wheel_slip = 1.0 + np.broadcast_to(error, turns), float(wheel_slip)
        self._random = (
            seed if isinstance(seed, np.random.Generator) else np.random.default_rng(check_seed(seed))
        )

    @property
    def pose(self) -> Array:
        """The estimated pose: x, y [m], yaw [rad], shape (..., 3)."""
        return self._pose

    def add(self, turns: ArrayLike) -> Array:
        """Add the wheels' rotation since the last call; return the new pose.

        Args:
            turns: Rotation angles of the wheels [rad], shape (..., k).

        Raises:
            InvalidValueError: for a wrong shape, NaN or infinity.
        """
        angles = as_finite(turns, "turns", self._scale.shape)
        believed = self._scale * angles
        if self._wheel_slip:
            spread = self._wheel_slip * np.sqrt(np.abs(angles))
            believed = believed + spread * self._random.standard_normal(angles.shape)
        self._pose = read_only(arc_moved(self._pose, self.base.body_twist(believed)))
        return self._pose


def _coefficients(angle: Array) -> tuple[Array, Array]:
    """Return sin(w)/w and (1 - cos w)/w of angles w [rad], shape (...), by their series near 0."""
    small = np.abs(angle) < _STRAIGHT
    safe = np.where(small, 1.0, angle)
    ratio = np.where(small, 1.0 - angle**2 / 6.0, np.sin(safe) / safe)
    # 1 - cos w = 2 sin^2(w/2) keeps its digits
    bend = np.where(small, angle / 2.0, 2.0 * np.sin(safe / 2.0) ** 2 / safe)
    return ratio, bend
