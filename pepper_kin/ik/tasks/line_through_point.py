"""Task that makes the line through two frames pass through a point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, read_only
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik.tasks import symbolic_angles
from pepper_kin.ik.tasks.direction import NEAREST, turn_between, unit_and_length
from pepper_kin.ik.tasks.structure import TaskStructure, TaskVariables, frame_structure
from pepper_kin.ik.tasks.task import (
    ANGLE_TOLERANCE,
    TargetTask,
    as_targets,
    words_for_angle,
    words_for_vector,
)
from pepper_kin.kinematics import frame_jacobian, frame_pose
from pepper_kin.model import PepperModel, kept_for_robot


@dataclass(frozen=True, eq=False, init=False, repr=False)
class LineThroughPoint(TargetTask):
    """The line from one frame's origin through another's passes through a point p beyond the second.

    With a the origin of `start`, b the origin of `frame`, w = (b - a) / |b - a| and u = (p - b) / |p - b|,

        r(q) = (theta / sin theta) w x u,   |r| = theta,

    the angle at b between the line and the point, up to pi for a point on the other side: the point is
    |p - b| sin(theta) beside the line.  See `turn_between` for dr/dw and dr/du; with J_a and J_b the linear
    Jacobians of both origins,

        dw/dq = (I - w w^T) (J_b - J_a) / |b - a|,   du/dq = -(I - u u^T) J_b / |p - b|.

    `PointAt` is this task for Pepper's arms. With a camera as `start`, a hand covers the point in its image.

    Attributes:
        start: Name of the frame where the line begins, see `pepper.frame_names`.
        frame: Name of another frame, at another position, through which the line passes.
        target: Point p in the world [m], shape (3,), or (N, 3) for `solve_batch`, read-only.

    Raises:
        InvalidValueError: for one frame twice or a malformed point; in a search, for two frames at the same
            position.
    """

    start: str
    frame: str
    target: Array
    unit: ClassVar[str] = "rad"
    aspect: ClassVar[str] = "line"

    def __init__(
        self,
        start: str,
        frame: str,
        point: ArrayLike,
        weight: float = 1.0,
        tolerance: float = ANGLE_TOLERANCE,
        label: str = "",
        *,
        hard: bool = False,
    ) -> None:
        if start == frame:
            raise InvalidValueError("start and frame", f"{frame!r} twice", "two different frames")
        name = label or f"{start} to {frame}"
        target = read_only(as_targets(point, f"point of {name}", (3,)))
        super().__init__(
            name, weight=weight, tolerance=tolerance, hard=hard, frame=frame, start=start, target=target
        )

    def check(self, pepper: PepperModel) -> None:
        """Refuse a robot that lacks one of the frames, or has both at the same position."""
        if _distance(pepper, self.start, self.frame) < NEAREST:
            raise InvalidValueError(
                f"line of {self.label}",
                f"{self.start} and {self.frame} at the same place",
                "two frames that are apart",
            )

    def residual(self, pepper: PepperModel, q: Array) -> Array:
        """Return the remaining rotation about the world's axes [rad], shape (3,)."""
        (along, _), (sight, _) = self._lines(pepper, q)
        return turn_between(along, sight)[0]

    def jacobian(self, pepper: PepperModel, q: Array) -> Array:
        """Return dr/dw dw/dq + dr/du du/dq, shape (3, n)."""
        (along, length), (sight, distance) = self._lines(pepper, q)
        _, by_along, by_sight = turn_between(along, sight)
        moving = frame_jacobian(pepper, q, self.frame)[:3]
        swing = _across(along, moving - frame_jacobian(pepper, q, self.start)[:3]) / length
        return np.asarray(by_along @ swing - by_sight @ _across(sight, moving) / distance)

    def shortfall(self, pepper: PepperModel, q: Array) -> str:
        """Return the angle between line and point in words, at q, shape (n,) [rad or m]."""
        angle = words_for_angle(self.error(pepper, q))
        return f"the line of {self.label} passes {angle} beside {words_for_vector(self.target)}"

    def attained(self, pepper: PepperModel, q: Array) -> str:
        """Return the direction of the line in the world in words, at q, shape (n,) [rad or m]."""
        return f"direction {words_for_vector(self._lines(pepper, q)[0][0])}"

    def _lines(self, pepper: PepperModel, q: Array) -> tuple[tuple[Array, float], tuple[Array, float]]:
        """Return w, shape (3,), and |b - a| [m], u, shape (3,), and |p - b| [m], at q, shape (n,)."""
        first = frame_pose(pepper, q, self.start)[:3, 3]
        second = frame_pose(pepper, q, self.frame)[:3, 3]
        return unit_and_length(second - first), unit_and_length(self.target - second)

    def _structure(self) -> TaskStructure:
        return frame_structure(LineThroughPoint, self.frame, self.hard, reference=self.start)

    @staticmethod
    def moved_by(pepper: PepperModel, task: TaskStructure) -> np.ndarray:
        """Return whether each joint moves one of the frames, shape (n,)."""
        used = np.zeros(pepper.n, dtype=bool)
        used[pepper.joints_above(task.frame) + pepper.joints_above(task.reference)] = True
        return used

    @staticmethod
    def expression(task: TaskStructure, motion: TaskVariables, target: Any) -> tuple[Any, Any]:
        """Return the remaining rotation and dr/dw dw/dq + dr/du du/dq."""
        pose, jacobian = motion.frames[task.frame]
        start, other = motion.frames[task.reference]
        along, length = symbolic_angles.unit_and_length(pose[:, 3] - start[:, 3])
        sight, distance = symbolic_angles.unit_and_length(target - pose[:, 3])
        residual, by_along, by_sight = symbolic_angles.turn_between(along, sight)
        swing = (by_along - (by_along @ along) @ along.T) / length
        across = (by_sight - (by_sight @ sight) @ sight.T) / distance
        return residual, (swing - across) @ jacobian[:3, :] - swing @ other[:3, :]


def _across(direction: Array, jacobian: Array) -> Array:
    """Return (I - d d^T) J, shape (3, n), of a unit vector d, shape (3,), and a Jacobian J, shape (3, n)."""
    return np.asarray(jacobian - np.outer(direction, direction @ jacobian))


@kept_for_robot(most=64)
def _distance(pepper: PepperModel, start: str, frame: str) -> float:
    """Return the distance of two frames' origins in the neutral posture [m]."""
    q = pepper.neutral()
    apart = frame_pose(pepper, q, frame)[:3, 3] - frame_pose(pepper, q, start)[:3, 3]
    return float(np.linalg.norm(apart))
