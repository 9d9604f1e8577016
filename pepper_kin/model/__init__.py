"""The robot's description: loading, joint groups, postures, limits and shapes."""

from pepper_kin.model.load import load_pepper, load_robot, pepper_urdf
from pepper_kin.model.pepper_model import PepperModel
from pepper_kin.model.semantics import Semantics
from pepper_kin.model.shapes import Box, Capsule, Cylinder, Geometry, Mesh, Shape, Sphere

__all__ = [
    "Box",
    "Capsule",
    "Cylinder",
    "Geometry",
    "Mesh",
    "PepperModel",
    "Semantics",
    "Shape",
    "Sphere",
    "load_pepper",
    "load_robot",
    "pepper_urdf",
]
