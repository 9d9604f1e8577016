"""Task that brings one joint to a value."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik.tasks.joint_posture import JointPosture
from pepper_kin.ik.tasks.task import (
    ANGLE_TOLERANCE,
    as_targets,
    checked_hard,
    checked_tolerance,
    checked_weight,
)
from pepper_kin.model import PepperModel


class JointValue(JointPosture):
    """One joint is at a value: `JointPosture` of one joint; the error is |q_i - value| [rad or m].

    Args:
        joint: Name of a joint, see `pepper.joint_names`.
        value: Target position [rad or m], a number, or N numbers, shape (N,), for `solve_batch`.

    Raises:
        InvalidValueError: for a value that is not a number, NaN or infinite.
    """

    def __init__(
        self,
        joint: str,
        value: ArrayLike,
        weight: float = 1.0,
        tolerance: float = ANGLE_TOLERANCE,
        *,
        hard: bool = False,
    ) -> None:
        if not isinstance(joint, str):
            raise InvalidValueError("joint", repr(joint), "the name of one joint")
        values = as_targets(value, f"value of {joint}", ())
        super().__init__(
            values[..., None],
            (joint,),
            checked_weight(weight, joint),
            checked_tolerance(tolerance, joint, "rad or m"),
            hard=checked_hard(hard, joint),
        )
        object.__setattr__(self, "label", joint)

    def check(self, pepper: PepperModel) -> None:
        """Refuse a robot that lacks the joint.

        Raises:
            UnknownNameError: listing the joints.
        """
        pepper.joint_index(self.label)

    def attained(self, pepper: PepperModel, q: Array) -> str:
        """Return the joint's position in words, at joint positions q, shape (n,) [rad or m]."""
        index = self.indices(pepper)[0]
        return f"{q[index]:.4f} {pepper.joint_units[index]}"

    def shortfall(self, pepper: PepperModel, q: Array) -> str:
        """Return the joint's distance from the value in words, at q, shape (n,) [rad or m]."""
        unit, target = self.unit_on(pepper), float(np.ravel(self.target)[0])
        return f"{self.label} stops {self.error(pepper, q):.4f} {unit} short of {target:.4f} {unit}"
