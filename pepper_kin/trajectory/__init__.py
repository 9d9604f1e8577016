"""Trajectories: a value, timing within limits, an independent check, animations by keys, pictures."""

from typing import Any

from pepper_kin.lazy_names import lazy_module
from pepper_kin.trajectory.active_limits import ActiveLimits, active_limits
from pepper_kin.trajectory.certificate import Certificate, LimitCheck, ScalarCheck
from pepper_kin.trajectory.check import check
from pepper_kin.trajectory.enforce_limits import enforce_limits
from pepper_kin.trajectory.key_curve import Handle, Key
from pepper_kin.trajectory.limit_violations import LimitViolation, find_limit_violations
from pepper_kin.trajectory.online import OnlineMotion
from pepper_kin.trajectory.phase_plane import PhasePlane, phase_plane
from pepper_kin.trajectory.plot import plot
from pepper_kin.trajectory.retiming import retime
from pepper_kin.trajectory.samples import Samples
from pepper_kin.trajectory.timeline import Curve, ImportedMotion, Timeline, import_timeline
from pepper_kin.trajectory.trajectory import State, Trajectory

__all__ = [
    "ActiveLimits",
    "Certificate",
    "Curve",
    "Handle",
    "ImportedMotion",
    "Key",
    "LimitCheck",
    "LimitViolation",
    "OnlineMotion",
    "PhasePlane",
    "Samples",
    "ScalarCheck",
    "State",
    "Timeline",
    "Trajectory",
    "active_limits",
    "check",
    "enforce_limits",
    "find_limit_violations",
    "import_timeline",
    "phase_plane",
    "plot",
    "retime",
]

_files = lazy_module("pepper_kin.files")


def __getattr__(name: str) -> Any:
    """Return a name of `pepper_kin.files`, the room built on this one, for those who look for it here."""
    if name.startswith("_") or name not in _files.__all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(_files, name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_files.__all__})
