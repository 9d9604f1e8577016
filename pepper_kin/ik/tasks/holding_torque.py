"""Task that keeps the torques of holding still within a fraction of the effort limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, read_only
from pepper_kin.collision.loads import carrying
from pepper_kin.dynamics import gravity_torque
from pepper_kin.dynamics.load import Loads
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik.tasks.structure import TaskStructure, TaskVariables, joints_that_change
from pepper_kin.ik.tasks.task import TargetTask, as_targets
from pepper_kin.lazy_names import lazy_module
from pepper_kin.model import PepperModel
from pepper_kin.model.requirements import checked_share, limited_efforts

pinocchio = lazy_module("pinocchio")

LABEL = "holding torque"


@dataclass(frozen=True, eq=False, init=False, repr=False)
class HoldingTorque(TargetTask):
    """Every motor holds the posture with at most a fraction s of its effort limit.

    With g(q) the torques that hold the robot still and t_i the effort limit of joint i,

        r_i(q) = sign(g_i) max(0, |g_i(q)| / t_i - s),    dr_i/dq = dg_i/dq / t_i where r_i is not 0, else 0:

    an inequality, zero and without influence where the motors are strong enough. The error is the largest
    |r_i|, a fraction of an effort limit.

    Attributes:
        target: Fraction s, shape (), read-only.
        joints: Names of the joints that count; empty for all joints with an effort limit.
        loads: Carried objects; a search sets them from its scene.
    """

    target: Array
    joints: tuple[str, ...]
    loads: Loads
    unit: ClassVar[str] = "of the effort limit"
    target_axes: ClassVar[int] = 0
    largest: ClassVar[bool] = True

    def __init__(
        self,
        share: ArrayLike,
        weight: float = 1.0,
        tolerance: float = 1e-3,
        *,
        joints: Sequence[str] | None = None,
        hard: bool = False,
    ) -> None:
        target = read_only(as_targets(share, f"share of {LABEL}", ()))
        for value in target.ravel():
            checked_share(f"share of {LABEL}", value)
        super().__init__(
            LABEL,
            weight=weight,
            tolerance=tolerance,
            hard=hard,
            target=target,
            joints=tuple(joints or ()),
            loads=(),
        )

    def check(self, pepper: PepperModel) -> None:
        """Refuse a robot that lacks a joint of the task or the effort limit of one.

        Raises:
            UnknownNameError: listing the joints.
            InvalidValueError: for a joint without an effort limit.
        """
        limited = limited_efforts(pepper)
        for joint in self.joints:
            if pepper.joint_index(joint) not in limited:
                raise InvalidValueError(f"joint of {LABEL}", joint, "a joint with an effort limit")
        if not limited.size:
            raise InvalidValueError(LABEL, "a robot without effort limits", "one that has some")

    def use(self, pepper: PepperModel, q: Array) -> Array:
        """Return the signed ratios g_i / t_i of the joints that count, shape (k,), at q, shape (n,)."""
        index = _places(pepper, self.joints)
        return gravity_torque(carrying(pepper, self.loads), q)[index] / pepper.effort_limits[index]

    def residual(self, pepper: PepperModel, q: Array) -> Array:
        """Return the signed excess of the ratios over the fraction s, shape (k,)."""
        use = self.use(pepper, q)
        return np.asarray(np.sign(use) * np.maximum(0.0, np.abs(use) - self.target))

    def jacobian(self, pepper: PepperModel, q: Array) -> Array:
        """Return dg_i/dq / t_i of joints that exceed the fraction, zero for others, shape (k, n)."""
        excess = np.abs(self.use(pepper, q)) > self.target
        return np.where(excess[:, None], self.dependence(pepper, q), 0.0)

    def dependence(self, pepper: PepperModel, q: Array) -> Array:
        """Return dg_i/dq / t_i of the joints that count, by Pinocchio, shape (k, n)."""
        return _slopes(carrying(pepper, self.loads), q, self.joints)

    def shortfall(self, pepper: PepperModel, q: Array) -> str:
        """Return the joint with the largest ratio and the fraction, in words, at q, shape (n,) [rad or m]."""
        return f"{self.attained(pepper, q)}, beyond {100 * float(self.target):.3g} %"

    def attained(self, pepper: PepperModel, q: Array) -> str:
        """Return the joint with the largest ratio, and the ratio, in words, at q, shape (n,) [rad or m]."""
        use = np.abs(self.use(pepper, q))
        joint = pepper.joint_names[_places(pepper, self.joints)[int(np.argmax(use))]]
        return f"{joint} holds with {100 * float(use.max()):.3g} % of its effort limit"

    def _structure(self) -> TaskStructure | None:
        if self.loads:
            return None
        return TaskStructure(HoldingTorque, joints=self.joints, target_size=1, hard=self.hard)

    @staticmethod
    def moved_by(pepper: PepperModel, task: TaskStructure) -> np.ndarray:
        """Return whether the holding torques depend on each joint, shape (n,)."""
        return joints_that_change(pepper, lambda q: _slopes(pepper, q, task.joints))

    @staticmethod
    def expression(task: TaskStructure, motion: TaskVariables, target: Any) -> tuple[Any, Any]:
        """Return r_i and dr_i/dq."""
        import casadi

        index = _places(motion.pepper, task.joints)
        use = motion.gravity_torque[index] / casadi.DM(motion.pepper.effort_limits[index])
        excess = casadi.fabs(use) - target
        slopes = motion.without(casadi.jacobian(use, motion.q), HoldingTorque.moved_by(motion.pepper, task))
        rows = [casadi.if_else(excess[k] > 0, 1.0, 0.0) * slopes[k, :] for k in range(len(index))]
        return casadi.sign(use) * casadi.fmax(excess, 0.0), casadi.vertcat(*rows)


def _places(pepper: PepperModel, joints: tuple[str, ...]) -> np.ndarray:
    """Return the indices of joints, shape (k,); without names, of all joints with an effort limit."""
    return np.array([pepper.joint_index(name) for name in joints]) if joints else limited_efforts(pepper)


def _slopes(pepper: PepperModel, q: Array, joints: tuple[str, ...]) -> Array:
    """Return dg_i/dq / t_i of named joints, by Pinocchio, shape (k, n)."""
    model, data, index = pepper.inner_model, pepper.pinocchio_data, _places(pepper, joints)
    change = np.asarray(pinocchio.computeGeneralizedGravityDerivatives(model, data, pepper.to_full(q)))
    if pepper.is_coupled:
        change = pepper.full_map.T @ change @ pepper.full_map
    return change[index] / pepper.effort_limits[index, None]
