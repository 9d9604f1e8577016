"""Spheres that contain Pepper's links, for quick collision checks by batches and planners."""

from __future__ import annotations

import numpy as np

from pepper_kin.model.expanded_urdf import urdf_folder
from pepper_kin.model.shapes import Shape, Sphere
from pepper_kin.model.urdf_document import UrdfDocument

_COLOR = (0.95, 0.55, 0.15, 0.45)
_MOVING_FINGERS = (0.0913, -0.00706, -0.02048, 0.0637)
"""Center x, y, z and radius of a sphere that contains the fingers at every opening, left wrist frame [m]."""


def pepper_spheres(document: UrdfDocument) -> tuple[Shape, ...]:
    """Return Pepper's sphere set: 57 spheres, fitted to contain the links' surfaces with the hands open.

    For moving fingers, one more sphere per hand contains them at every opening.

    Args:
        document: Pepper's URDF.

    Returns:
        The spheres, each fixed to its link.
    """
    import json

    table = json.loads((urdf_folder() / "data" / "spheres.json").read_text(encoding="utf-8"))
    if any(joint.name == "LFinger11" and joint.type != "fixed" for joint in document.joints):
        x, y, z, radius = _MOVING_FINGERS
        table["l_wrist"].append([x, y, z, radius])
        table["r_wrist"].append([x, -y, z, radius])
    spheres = []
    for link, rows in table.items():
        for index, (x, y, z, radius) in enumerate(rows):
            pose = np.eye(4)
            pose[:3, 3] = x, y, z
            spheres.append(Shape(f"{link}_sphere_{index}", link, Sphere(radius), pose, _COLOR))
    return tuple(spheres)
