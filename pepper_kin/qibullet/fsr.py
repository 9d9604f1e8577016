"""Sensors of the weight under NAO's feet, which are not simulated."""

from __future__ import annotations

from typing import Any

from pepper_kin.qibullet.errors import UnsimulatedError
from pepper_kin.qibullet.other_robots import ONLY_PEPPER


class Fsr:
    """A sensor of the weight under a foot of NAO."""

    def __init__(self, *_: Any, **__: Any) -> None:
        raise UnsimulatedError("the weight under a foot (FSR)", ONLY_PEPPER)


class FsrHandler(Fsr):
    """The weight sensors of a robot with feet."""


class NaoFsr(FsrHandler):
    """The weight sensors of NAO."""
