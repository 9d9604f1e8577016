"""pepper_kin: kinematics, dynamics, whole-body IK, motion planning, timing and a twin for Pepper.

    import pepper_kin as pk

    pepper = pk.load_pepper()
    q = pepper.posture("Stand")
    pk.kinematics.frame_pose(pepper, q, "LArm_effector")

Packages are imported when first used, so that importing the package itself is quick.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from pepper_kin.lazy_names import lazily

if TYPE_CHECKING:
    from pepper_kin import (
        base_placement,
        batch,
        collision,
        dynamics,
        files,
        ik,
        kernels,
        kinematics,
        model,
        motion,
        planners,
        servo,
        symbolic,
        trajectory,
        twin,
        viewer,
    )
    from pepper_kin.collision import Scene
    from pepper_kin.exceptions import PepperKinError
    from pepper_kin.model import PepperModel, load_pepper, load_robot, pose
    from pepper_kin.motion import PlanProblem, plan, plan_batch
    from pepper_kin.trajectory import Trajectory, retime
    from pepper_kin.twin import Twin, TwinBatch
    from pepper_kin.viewer import Viewer

__version__ = "0.1.0"

_PACKAGES = (
    "base_placement",
    "batch",
    "collision",
    "dynamics",
    "exceptions",
    "files",
    "ik",
    "kernels",
    "kinematics",
    "model",
    "motion",
    "planners",
    "servo",
    "symbolic",
    "trajectory",
    "twin",
    "viewer",
)
_NAMES = {
    "PepperKinError": "exceptions",
    "PepperModel": "model",
    "Scene": "collision",
    "Trajectory": "trajectory",
    "Twin": "twin",
    "TwinBatch": "twin",
    "Viewer": "viewer",
    "load_pepper": "model",
    "load_robot": "model",
    "pose": "model",
    "PlanProblem": "motion",
    "plan": "motion",
    "plan_batch": "motion",
    "retime": "trajectory",
}

__all__ = [
    "PepperKinError",
    "PepperModel",
    "PlanProblem",
    "Scene",
    "Trajectory",
    "Twin",
    "TwinBatch",
    "Viewer",
    "base_placement",
    "batch",
    "collision",
    "dynamics",
    "files",
    "ik",
    "kernels",
    "kinematics",
    "load_pepper",
    "load_robot",
    "model",
    "motion",
    "plan",
    "plan_batch",
    "planners",
    "pose",
    "retime",
    "servo",
    "symbolic",
    "trajectory",
    "twin",
    "viewer",
]

__getattr__, __dir__ = lazily(__name__, {**_NAMES, **{name: name for name in _PACKAGES}})
