"""pepper_kin: kinematics, dynamics, whole-body IK, motion planning, timing and a twin for Pepper.

    import pepper_kin as pk

    pepper = pk.load_pepper()
    q = pepper.posture("Ready")
    pk.kinematics.frame_pose(pepper, q, "LArm_effector")

Packages, imported at their first use; `help(pk.ik)` lists the contents of one:

    model            the robot: loading, groups, postures, limits, shapes, exports
    kinematics       poses, velocities and Jacobians of frames, reach maps
    dynamics         torques, accelerations, mass, energy, balance
    symbolic         the same quantities as CasADi expressions
    collision        scenes, contacts, distances
    ik               inverse kinematics: the best configuration, and the reason where none fits
    servo            inverse kinematics tick by tick, for moving targets
    base_placement   search for the pose of the base
    motion           paths, Cartesian motions, optimization, gestures
    trajectory       timing within limits, an independent check
    files            trajectories in seven formats
    twin             simulation; within it `twin.world`, `twin.sensors`, `twin.base`
    identification   robots' logs: the twin held beside them, and fitted to them
    viewer           pages, pictures and films; within it `viewer.server`
    planners         motion planners for any space
    jobs             the work of the commands
    naoqi, qibullet, ros, ros_messages   NAOqi, qiBullet's classes and ROS 2, all on the twin
    kernels, batch   machine code and batches
    exceptions, status   errors on misuse; outcomes of calls

Common names are available here, too: load_pepper, load_robot, PepperModel, pose, Scene,
plan, plan_batch, PlanProblem, retime, Trajectory, Twin, TwinBatch, Viewer, PepperKinError.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from pepper_kin import forked_children  # noqa: F401
from pepper_kin.lazy_names import lazily

if TYPE_CHECKING:
    from pepper_kin import (
        base_placement,
        batch,
        collision,
        dynamics,
        exceptions,
        files,
        identification,
        ik,
        jobs,
        kernels,
        kinematics,
        model,
        motion,
        planners,
        servo,
        status,
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

__version__ = "0.2.0"

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
    "exceptions",
    "files",
    "identification",
    "ik",
    "jobs",
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
    "status",
    "symbolic",
    "trajectory",
    "twin",
    "viewer",
]

__getattr__, __dir__ = lazily(__name__)
