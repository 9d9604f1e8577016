"""Trajectories: a value, timing within limits, an independent check, animations by keys, pictures."""

from typing import Any

from pepper_kin.lazy_names import lazy_module
from pepper_kin.trajectory.binding import Binding, binding_limits
from pepper_kin.trajectory.certificate import Certificate, LimitCheck, ScalarCheck
from pepper_kin.trajectory.check import check
from pepper_kin.trajectory.excess import Excess, find_excesses
from pepper_kin.trajectory.key_curve import Handle, Key
from pepper_kin.trajectory.make_safe import make_safe
from pepper_kin.trajectory.online import OnlineMotion
from pepper_kin.trajectory.phase_plane import PhasePlane, phase_plane
from pepper_kin.trajectory.plot import plot
from pepper_kin.trajectory.retiming import retime
from pepper_kin.trajectory.samples import Samples
from pepper_kin.trajectory.timeline import Curve, ImportedMotion, Timeline, import_timeline
from pepper_kin.trajectory.trajectory import State, Trajectory

__all__ = [
    "Binding",
    "Certificate",
    "Curve",
    "Excess",
    "Handle",
    "ImportedMotion",
    "Key",
    "LimitCheck",
    "OnlineMotion",
    "PhasePlane",
    "Samples",
    "ScalarCheck",
    "State",
    "Timeline",
    "Trajectory",
    "binding_limits",
    "check",
    "find_excesses",
    "import_timeline",
    "make_safe",
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
