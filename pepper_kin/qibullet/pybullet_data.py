"""The module `pybullet_data` without its files: shapes of the same sizes as the files' objects."""

from __future__ import annotations

from pepper_kin.model import Box, Sphere

FLOORS = ("plane.urdf", "plane100.urdf", "plane_transparent.urdf", "plane_implicit.urdf")
"""Files of floors, which every simulation has."""

OBJECTS: dict[str, tuple[Box | Sphere, tuple[float, float, float]]] = {
    "duck_vhacd.urdf": (Box((0.09, 0.085, 0.066)), (-0.007, 0.0435, 0.002)),
    "teddy_vhacd.urdf": (Box((0.084, 0.101, 0.071)), (0.068, 0.0665, 0.0325)),
    "table.urdf": (Box((1.502, 1.002, 0.626)), (0.0, 0.0, 0.313)),
    "traybox.urdf": (Box((0.602, 0.602, 0.138)), (0.0, 0.0, 0.059)),
    "mug.urdf": (Box((0.088, 0.128, 0.106)), (0.0, 0.02, 0.05)),
    "cube_small.urdf": (Box((0.05, 0.05, 0.05)), (0.0, 0.0, 0.0)),
    "cube.urdf": (Box((1.0, 1.0, 1.0)), (0.0, 0.0, 0.0)),
    "block.urdf": (Box((0.1, 0.018, 0.018)), (0.0, 0.0, 0.0)),
    "lego.urdf": (Box((0.034, 0.034, 0.026)), (0.0, 0.0, 0.0)),
    "jenga.urdf": (Box((0.15, 0.05, 0.03)), (0.0, 0.0, 0.0)),
    "domino.urdf": (Box((0.006, 0.026, 0.05)), (0.0, 0.0, 0.0)),
    "r2d2.urdf": (Box((0.344, 0.344, 0.604)), (0.0, 0.0, 0.0)),
    "sphere_small.urdf": (Sphere(0.03), (0.0, 0.0, 0.0)),
    "sphere2.urdf": (Sphere(0.5), (0.0, 0.0, 0.0)),
    "soccerball.urdf": (Sphere(0.5), (0.0, 0.0, 0.0)),
}
"""Name of a file -> box or sphere around its object, and the center of that shape [m]."""


def getDataPath() -> str:
    """Return a name in place of the folder: files are known by their names."""
    return "pybullet_data"
