"""Complete jobs of the commands, from options to numbers and files.

    reach, ReachOutcome, save_outcome, run_demo, demo_scene
    make_gesture, MadeGesture, save_library_gesture, save_gesture
    load_motion, scene_beside, save_export
    check_dynamics, DynamicsCheck, DynamicsCheckRow
    check_physics, PhysicsCheck
    warm_up, WarmUp, check_installation, Installation, Package

A job's module is imported at the first use of the job, so that a check of dynamics does not load planners. No
module has the name of a job, since importing it would hide the job.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from pepper_kin.lazy_names import lazily

if TYPE_CHECKING:
    from pepper_kin.jobs.demo import demo_scene, run_demo
    from pepper_kin.jobs.dynamics_check import DynamicsCheck, DynamicsCheckRow
    from pepper_kin.jobs.dynamics_checking import check_dynamics
    from pepper_kin.jobs.export_files import save_export
    from pepper_kin.jobs.gesture_job import MadeGesture, make_gesture, save_library_gesture
    from pepper_kin.jobs.installation import Installation, Package, check_installation
    from pepper_kin.jobs.motion_file import load_motion, scene_beside
    from pepper_kin.jobs.physics_check import PhysicsCheck, check_physics
    from pepper_kin.jobs.reaching import ReachOutcome, reach
    from pepper_kin.jobs.result_files import save_gesture, save_outcome
    from pepper_kin.jobs.warming import WarmUp, warm_up

__all__ = [
    "DynamicsCheck",
    "DynamicsCheckRow",
    "Installation",
    "MadeGesture",
    "Package",
    "PhysicsCheck",
    "ReachOutcome",
    "WarmUp",
    "check_dynamics",
    "check_installation",
    "check_physics",
    "demo_scene",
    "load_motion",
    "make_gesture",
    "reach",
    "run_demo",
    "save_export",
    "save_gesture",
    "save_library_gesture",
    "save_outcome",
    "scene_beside",
    "warm_up",
]

__getattr__, __dir__ = lazily(__name__)
