"""The robot's description: loading, joint groups, postures, limits, shapes, exports and checks."""

from pepper_kin.model.comparison import Comparison, Difference, compare
from pepper_kin.model.export_formats import FORMATS, export
from pepper_kin.model.fault import Fault
from pepper_kin.model.load import load_pepper, load_robot, pepper_urdf
from pepper_kin.model.mesh_names import mesh_files
from pepper_kin.model.model_audit import Audit, audit
from pepper_kin.model.paper_limits import LimitRow, LimitsTable, limits_table
from pepper_kin.model.pepper_model import PepperModel
from pepper_kin.model.semantics import Semantics
from pepper_kin.model.shapes import Box, Capsule, Cylinder, Geometry, Mesh, Shape, Sphere

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
    "LimitRow",
    "LimitsTable",
    "Mesh",
    "PepperModel",
    "Semantics",
    "Shape",
    "Sphere",
    "audit",
    "compare",
    "export",
    "limits_table",
    "load_pepper",
    "load_robot",
    "mesh_files",
    "pepper_urdf",
]
