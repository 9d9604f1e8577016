"""The robot's description: loading, joint groups, postures, limits, shapes, exports and checks.

    load_pepper, load_robot, PepperModel      a frozen robot; pepper_urdf is the text of Pepper's description
    Semantics, Wheels                         groups, postures and allowed contacts; a base that drives
    MotionRequirements                        reserves of motions: balance, torque for the servos
    pose, rotation_from_rpy, rpy_from_rotation, rotation_from_quaternion, quaternion_from_rotation
    Box, Sphere, Capsule, Cylinder, Mesh      geometries, together `Geometry`; Shape: one on a link
    export, FORMATS, mesh_files               URDF, SRDF, SDF and MJCF
    audit, Audit, Fault                       faults of any URDF
    compare, Comparison, Difference           differences of two URDFs
    robot_digest, RobotMemory, kept_for_robot, once_for_robot     caches per robot

A `PepperModel` is a value: methods that change it return a new model.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from pepper_kin.lazy_names import lazily

if TYPE_CHECKING:
    from pepper_kin.model.comparison import Comparison, Difference, compare
    from pepper_kin.model.digest import RobotMemory, kept_for_robot, once_for_robot, robot_digest
    from pepper_kin.model.export_formats import FORMATS, export
    from pepper_kin.model.load import load_pepper, pepper_urdf
    from pepper_kin.model.mesh_names import mesh_files
    from pepper_kin.model.model_audit import Audit, audit
    from pepper_kin.model.other_robots import load_robot
    from pepper_kin.model.pepper_model import PepperModel
    from pepper_kin.model.poses import (
        pose,
        quaternion_from_rotation,
        rotation_from_quaternion,
        rotation_from_rpy,
        rpy_from_rotation,
    )
    from pepper_kin.model.requirements import MotionRequirements
    from pepper_kin.model.semantics import Semantics
    from pepper_kin.model.shapes import Box, Capsule, Cylinder, Geometry, Mesh, Shape, Sphere
    from pepper_kin.model.tolerant_urdf import Fault
    from pepper_kin.model.wheels import Wheels

__all__ = [
    "FORMATS",
    "Audit",
    "Box",
    "Capsule",
    "Comparison",
    "Cylinder",
    "Difference",
    "Fault",
    "Geometry",
    "Mesh",
    "MotionRequirements",
    "PepperModel",
    "RobotMemory",
    "Semantics",
    "Shape",
    "Sphere",
    "Wheels",
    "audit",
    "compare",
    "export",
    "kept_for_robot",
    "load_pepper",
    "load_robot",
    "mesh_files",
    "once_for_robot",
    "pepper_urdf",
    "pose",
    "quaternion_from_rotation",
    "robot_digest",
    "rotation_from_quaternion",
    "rotation_from_rpy",
    "rpy_from_rotation",
]

__getattr__, __dir__ = lazily(
    __name__,
    {
        "comparison": "Comparison Difference compare",
        "digest": "RobotMemory kept_for_robot once_for_robot robot_digest",
        "export_formats": "FORMATS export",
        "tolerant_urdf": "Fault",
        "load": "load_pepper pepper_urdf",
        "other_robots": "load_robot",
        "mesh_names": "mesh_files",
        "model_audit": "Audit audit",
        "pepper_model": "PepperModel",
        "poses": "pose quaternion_from_rotation rotation_from_quaternion rotation_from_rpy rpy_from_rotation",
        "requirements": "MotionRequirements",
        "semantics": "Semantics",
        "shapes": "Box Capsule Cylinder Geometry Mesh Shape Sphere",
        "wheels": "Wheels",
    },
)
