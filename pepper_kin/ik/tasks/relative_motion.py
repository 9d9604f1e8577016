"""Pose and Jacobian of one frame relative to another."""

from __future__ import annotations

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik.tasks.direction import cross_matrix
from pepper_kin.ik.tasks.structure import TaskStructure, joints_that_change
from pepper_kin.ik.tasks.task import TargetTask
from pepper_kin.kinematics import frame_jacobian, frame_pose
from pepper_kin.model import PepperModel


class RelativeTask(TargetTask):
    """A task on one frame relative to another."""

    frame: str
    reference: str

    def check(self, pepper: PepperModel) -> None:
        """Refuse a robot without one of the frames."""
        pepper.frame_id(self.frame)
        pepper.frame_id(self.reference)

    @staticmethod
    def moved_by(pepper: PepperModel, task: TaskStructure) -> np.ndarray:
        """Return whether each joint moves one frame relative to the other, shape (n,)."""
        return joints_that_change(pepper, lambda q: relative_jacobian(pepper, q, task.frame, task.reference))


def words_for_pair(frame: str, reference: str) -> str:
    """Return "a seen from b".

    Raises:
        InvalidValueError: if both names are the same.
    """
    if frame == reference:
        raise InvalidValueError("frame and reference", f"{frame!r} twice", "two different frames")
    return f"{frame} seen from {reference}"


def relative_pose(pepper: PepperModel, q: Array, frame: str, reference: str) -> tuple[Array, Array]:
    """Return the pose of frame a in b: R_b^T R_a, shape (3, 3), and R_b^T (o_a - o_b), shape (3,) [m].

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (n,).
        frame: Name of frame a, see `pepper.frame_names`.
        reference: Name of another frame b.
    """
    moved, relative_to = frame_pose(pepper, q, frame), frame_pose(pepper, q, reference)
    turn = relative_to[:3, :3].T
    return turn @ moved[:3, :3], turn @ (moved[:3, 3] - relative_to[:3, 3])


def relative_jacobian(pepper: PepperModel, q: Array, frame: str, reference: str) -> Array:
    """Return the Jacobian of frame a relative to reference b, in b's axes, linear rows first, shape (6, n).

    With d = o_a - o_b and R_b' = [w_b]x R_b,

        d/dt R_b^T d = R_b^T (v_a - v_b + [d]x w_b),   angular velocity of a relative to b: R_b^T (w_a - w_b).

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (n,).
        frame: Name of frame a, see `pepper.frame_names`.
        reference: Name of another frame b.
    """
    moved, relative_to = frame_pose(pepper, q, frame), frame_pose(pepper, q, reference)
    jacobian, other = frame_jacobian(pepper, q, frame), frame_jacobian(pepper, q, reference)
    turn, line = relative_to[:3, :3].T, moved[:3, 3] - relative_to[:3, 3]
    linear = jacobian[:3] - other[:3] + cross_matrix(line) @ other[3:]
    return np.vstack([turn @ linear, turn @ (jacobian[3:] - other[3:])])
