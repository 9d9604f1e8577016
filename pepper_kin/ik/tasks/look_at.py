"""Turn a camera towards a point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.frozen_arrays import read_only
from pepper_kin.ik.tasks.direction import cross_matrix, direction_residual, sideways_basis
from pepper_kin.ik.tasks.task import (
    ANGLE_TOLERANCE,
    Array,
    Task,
    as_targets,
    words_for_angle,
    words_for_vector,
)
from pepper_kin.kinematics import frame_jacobian, frame_pose
from pepper_kin.model import PepperModel

# A point nearer to the camera's origin than this has no defined direction [m].
NEAREST = 1e-6

_AHEAD, _AHEAD_OPTICAL = read_only((1.0, 0.0, 0.0)), read_only((0.0, 0.0, 1.0))


@dataclass(frozen=True, eq=False, init=False)
class LookAt(Task):
    """The axis of a camera passes through a point p that lies before it.

    r(q) = (theta / sin theta) B d with d = R^T u, u = (p - o) / |p - o|, see `direction_residual`;
    |r| = theta, the angle between the camera's axis and the point, up to pi for a point behind.  With
    rho = |p - o|,

        dd/dq = R^T ([u]x J_w - (I - u u^T) J_v / rho).

    Attributes:
        target: The point p in the world [m], shape (3,), read-only.
        frame: The camera's frame.  Its x axis is the view axis; of a frame whose name ends in
            `_optical_frame` it is z (ROS REP 103).
        weight: Weight in the sum of squares.
        tolerance: Largest angle of a task that is met [rad].
        hard: Whether it is met even where soft tasks suffer from it.
        axis: The view axis in the frame, shape (3,), read-only.
        basis: Two directions across the axis in the frame, shape (2, 3), read-only.
        label: Whose gaze, in words.
    """

    target: Array
    frame: str
    weight: float
    tolerance: float
    hard: bool
    axis: Array
    basis: Array
    label: str
    unit: ClassVar[str] = "rad"

    def __init__(
        self,
        point: ArrayLike,
        camera: str = "CameraTop_frame",
        weight: float = 1.0,
        tolerance: float = ANGLE_TOLERANCE,
        *,
        hard: bool = False,
    ) -> None:
        name = f"gaze of {camera}"
        optical = str(camera).endswith("_optical_frame")
        axis = _AHEAD_OPTICAL if optical else _AHEAD
        self._fill(
            name, weight, tolerance, hard,
            target=read_only(as_targets(point, f"point of {name}", (3,))),
            frame=camera, label=name,
            axis=axis, basis=sideways_basis(axis),
        )  # fmt: skip

    def residual(self, pepper: PepperModel, q: Array) -> Array:
        """Return the turn still to make [rad], shape (2,)."""
        pose = frame_pose(pepper, q, self.frame)
        direction, _ = self.sight(pose[:3, 3])
        return direction_residual(self.axis, self.basis, pose[:3, :3].T @ direction)[0]

    def jacobian(self, pepper: PepperModel, q: Array) -> Array:
        """Return dr/dd dd/dq, shape (2, n)."""
        pose, jacobian = frame_pose(pepper, q, self.frame), frame_jacobian(pepper, q, self.frame)
        rotation, (direction, distance) = pose[:3, :3], self.sight(pose[:3, 3])
        slope = direction_residual(self.axis, self.basis, rotation.T @ direction)[1]
        turning = cross_matrix(direction) @ jacobian[3:]
        moving = (jacobian[:3] - np.outer(direction, direction @ jacobian[:3])) / distance
        return slope @ rotation.T @ (turning - moving)

    def shortfall(self, pepper: PepperModel, q: Array) -> str:
        """Return by which angle the view axis misses the point, in words, at q, shape (n,) [rad or m]."""
        angle = words_for_angle(self.error(pepper, q))
        return f"{self.label} passes {angle} beside {words_for_vector(self.target)}"

    def attained(self, pepper: PepperModel, q: Array) -> str:
        """Return the direction of the view axis in the world in words, at q, shape (n,) [rad or m]."""
        axis = frame_pose(pepper, q, self.frame)[:3, :3] @ self.axis
        return f"direction {words_for_vector(axis)}"

    def sight(self, origin: Array) -> tuple[Array, float]:
        """Return the direction u from the camera's origin to the point, and its distance rho.

        Args:
            origin: Origin o of the camera in the world [m], shape (3,).

        Returns:
            u, a unit vector in the world, shape (3,), and rho [m]; x and NEAREST for a nearer point.
        """
        line = self.target - origin
        distance = float(np.linalg.norm(line))
        if distance < NEAREST:
            return np.array([1.0, 0.0, 0.0]), NEAREST
        return line / distance, distance
