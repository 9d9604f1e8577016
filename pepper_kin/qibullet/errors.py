"""Errors of the adapter, caught by `except pybullet.error` if pybullet is installed."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

from pepper_kin.exceptions import PepperKinError

__all__ = ["BulletError", "SimulationError", "UnsimulatedError"]


def _bullet_error() -> Any:
    """Return `pybullet.error`, which scripts for qiBullet catch; RuntimeError without pybullet."""
    if find_spec("pybullet") is None:
        return RuntimeError
    import pybullet

    return pybullet.error


BulletError: Any = _bullet_error()


class SimulationError(PepperKinError, BulletError):
    """A call with wrong arguments, or to an unknown simulation or robot."""


class UnsimulatedError(SimulationError):
    """A feature of qiBullet that the twin does not simulate.

    Attributes:
        what: Name of the feature.
        why: Reason, or what to use instead.
    """

    def __init__(self, what: str, why: str) -> None:
        self.what, self.why = what, why
        super().__init__(f"{what} is not simulated: {why}")
