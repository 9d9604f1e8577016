"""Table of the robot's methods and which of them are simulated."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

from pepper_kin.naoqi.memory import ALMemory
from pepper_kin.naoqi.module import Module, robot_signatures
from pepper_kin.naoqi.motion import ALMotion
from pepper_kin.naoqi.posture import ALRobotPosture
from pepper_kin.naoqi.speech import ALAnimatedSpeech

LISTED = (ALMotion, ALRobotPosture, ALMemory, ALAnimatedSpeech)
"""Modules of which there is a list of a robot's methods."""


class Covered(NamedTuple):
    """A method of the robot's list.

    Attributes:
        module: "ALMotion".
        method: "setAngles".
        answer: "simulated", or "refused by name: " and why.
    """

    module: str
    method: str
    answer: str


@cache
def coverage() -> tuple[Covered, ...]:
    """Return each method of the robot's ALMotion, ALRobotPosture, ALMemory and ALAnimatedSpeech, once."""
    kinds = {kind.name: kind for kind in LISTED}
    names = dict.fromkeys((s.module, s.name) for s in robot_signatures())
    return tuple(Covered(module, name, _answer(kinds[module], name)) for module, name in names)


def _answer(kind: type[Module], name: str) -> str:
    if name in kind.not_simulated:
        return f"refused by name: {kind.not_simulated[name]}"
    if callable(getattr(kind, name, None)):
        return "simulated"
    return "refused by name: the twin has nothing that it could act on"


__all__ = ["Covered", "coverage"]
