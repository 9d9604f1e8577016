"""Task that brings joints to given positions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, read_only
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik.tasks.structure import TaskStructure, TaskVariables
from pepper_kin.ik.tasks.task import ANGLE_TOLERANCE, TargetTask, as_targets
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_joint_vectors


@dataclass(frozen=True, eq=False, init=False, repr=False)
class JointPosture(TargetTask):
    """Joints are at given positions: r(q) = S q - target, dr/dq = S, where S selects the joints.

    The error is the largest deviation of one joint [rad, or m for a prismatic joint]. With an infinite
    tolerance and a small weight the task is a preference, which other tasks override.

    Attributes:
        target: Positions [rad or m], shape (n,), or shape (m,) for the m joints that `joints` names,
            read-only.
        joints: Names of joints and groups, such as `("right_arm", "HeadYaw")`; a group
            stands for its joints in the robot's order. None for all, in the robot's order.
    """

    target: Array
    joints: tuple[str, ...] | None
    unit: ClassVar[str] = "rad"
    largest: ClassVar[bool] = True

    def __init__(
        self,
        q: ArrayLike,
        joints: Sequence[str] | None = None,
        weight: float = 1.0,
        tolerance: float = ANGLE_TOLERANCE,
        *,
        hard: bool = False,
    ) -> None:
        names = None if joints is None else (joints,) if isinstance(joints, str) else tuple(joints)
        if names is not None and (not names or len(set(names)) < len(names)):
            raise InvalidValueError("joints of posture", list(names), "at least one joint, each once")
        target = read_only(as_targets(q, "posture", (None,)))
        super().__init__(
            "posture" if names is None else f"posture of {', '.join(names)}",
            weight=weight, tolerance=tolerance, hard=hard, subject="posture", target=target, joints=names,
        )  # fmt: skip

    def indices(self, pepper: PepperModel) -> list[int]:
        """Return the indices of the joints in the robot's joint vector."""
        return [pepper.joint_index(name) for name in pepper.resolve_joints(self.joints)]

    def on(self, pepper: PepperModel) -> JointPosture:
        """Return the task with joint names in place of groups."""
        if self.joints is None:
            return self
        names = pepper.resolve_joints(self.joints)
        return self if names == self.joints else self.altered(joints=names)

    def check(self, pepper: PepperModel) -> None:
        """Refuse a robot that lacks a joint, or a wrong number of positions.

        Raises:
            UnknownNameError: for a name that is neither a joint nor a group.
            InvalidValueError: for a number of positions that differs from the number of joints.
        """
        if self.joints is None:
            as_joint_vectors(pepper, self.target, "posture")
            return
        names = pepper.resolve_joints(self.joints)
        if self.target.shape[-1] != len(names):
            raise InvalidValueError(
                "posture", f"shape {self.target.shape}", f"shape ({len(names)},), for {', '.join(names)}"
            )

    def residual(self, pepper: PepperModel, q: Array) -> Array:
        """Return S q - target [rad or m], shape (m,) for m joints, at q, shape (n,) [rad or m]."""
        return q[self.indices(pepper)] - self.target

    def jacobian(self, pepper: PepperModel, q: Array) -> Array:
        """Return S, shape (m, n) for m joints; q, shape (n,), is not used."""
        return np.eye(pepper.n)[self.indices(pepper)]

    def shortfall(self, pepper: PepperModel, q: Array) -> str:
        """Return the joint that is farthest from its target in words, at q, shape (n,) [rad or m]."""
        worst = int(np.argmax(np.abs(self.residual(pepper, q))))
        index = self.indices(pepper)[worst]
        name, unit = pepper.joint_names[index], pepper.joint_units[index]
        return f"{name} stops at {q[index]:.4f} {unit}, short of {self.target[worst]:.4f} {unit}"

    def attained(self, pepper: PepperModel, q: Array) -> str:
        """Return the largest deviation in words, at joint positions q, shape (n,) [rad or m]."""
        units = {pepper.joint_units[i] for i in self.indices(pepper)}
        unit = self.unit_on(pepper) if len(units) == 1 else "rad (or m)"
        return f"posture {self.error(pepper, q):.4f} {unit} away"

    def unit_on(self, pepper: PepperModel) -> str:
        """Return "m" if all joints of the task are prismatic, else "rad"."""
        return "m" if all(pepper.joint_units[i] == "m" for i in self.indices(pepper)) else "rad"

    def _structure(self) -> TaskStructure:
        joints, size = self.joints or (), self.target.shape[-1]
        return TaskStructure(JointPosture, joints=joints, target_size=size, hard=self.hard)

    @staticmethod
    def expression(task: TaskStructure, motion: TaskVariables, target: Any) -> tuple[Any, Any]:
        """Return S q - target and S."""
        positions, selection = motion.joints(task.joints)
        return positions - target, selection
