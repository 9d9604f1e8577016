"""Whole jobs, from a user's words to numbers and files."""

from pepper_kin.jobs.check_dynamics import check_dynamics
from pepper_kin.jobs.demo import demo_scene, run_demo
from pepper_kin.jobs.dynamics_check import DynamicsCheck, DynamicsCheckRow
from pepper_kin.jobs.export_files import write_export
from pepper_kin.jobs.gesture_job import MadeGesture, make_gesture, write_library_gesture
from pepper_kin.jobs.reach import ReachOutcome, reach
from pepper_kin.jobs.result_files import write_gesture, write_outcome

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
