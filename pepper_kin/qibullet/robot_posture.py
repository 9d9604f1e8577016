"""Postures of Pepper by name."""

from __future__ import annotations

from pepper_kin.model import load_pepper
from pepper_kin.naoqi.joint_names import ACTUATED

NAMES = ("Stand", "StandInit", "StandZero", "Crouch")
"""Postures of qiBullet's Pepper."""


class PepperPosture:
    """A posture: joints and their angles in the library's model.

    Args:
        posture_name: Name: "Stand", "StandInit", "StandZero" or "Crouch", in any case.
    """

    def __init__(self, posture_name: str) -> None:
        self.posture_name = posture_name

    def getPostureName(self) -> str:
        """Return the name of the posture."""
        return self.posture_name

    def getPostureJointNames(self) -> list[str]:
        """Return the names of the joints."""
        return list(ACTUATED)

    def getPostureJointValues(self) -> list[float]:
        """Return the joints' angles [rad, for hands fractions], in the order of the names."""
        pepper = load_pepper(base="planar", hands="mimic")
        known = {name.lower(): name for name in NAMES}
        q = pepper.posture(known.get(self.posture_name.lower(), self.posture_name))
        return [float(q[pepper.joint_index(name)]) for name in ACTUATED]

    def isPostureName(self, posture_name: str) -> bool:
        """Return whether a name is this posture's, in any case."""
        return str(posture_name).lower() == self.posture_name.lower()
