"""Whole jobs, from a user's words to numbers and files.

Each job's module is imported when the job is first used, so that a check of dynamics does not load planners.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pepper_kin.jobs.check_dynamics import check_dynamics
    from pepper_kin.jobs.demo import demo_scene, run_demo
    from pepper_kin.jobs.dynamics_check import DynamicsCheck, DynamicsCheckRow
    from pepper_kin.jobs.export_files import write_export
    from pepper_kin.jobs.gesture_job import MadeGesture, make_gesture, write_library_gesture
    from pepper_kin.jobs.reach import ReachOutcome, reach
    from pepper_kin.jobs.result_files import write_gesture, write_outcome

_MODULES = {
    "DynamicsCheck": "dynamics_check",
    "DynamicsCheckRow": "dynamics_check",
    "MadeGesture": "gesture_job",
    "ReachOutcome": "reach",
    "check_dynamics": "check_dynamics",
    "demo_scene": "demo",
    "make_gesture": "gesture_job",
    "reach": "reach",
    "run_demo": "demo",
    "write_export": "export_files",
    "write_gesture": "result_files",
    "write_library_gesture": "gesture_job",
    "write_outcome": "result_files",
}

__all__ = [
    "DynamicsCheck",
    "DynamicsCheckRow",
    "MadeGesture",
    "ReachOutcome",
    "check_dynamics",
    "demo_scene",
    "make_gesture",
    "reach",
    "run_demo",
    "write_export",
    "write_gesture",
    "write_library_gesture",
    "write_outcome",
]


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{_MODULES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
