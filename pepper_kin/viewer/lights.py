"""Drawables of Pepper's lights: segments of the rings at eyes and ears, chest and shoulders.

A ring is divided into as many equal sectors as it has lights.  The first sector starts at the top, and they
proceed clockwise for a viewer who faces the ring; the direction is an assumption.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pepper_kin.model import PepperModel, Shape
from pepper_kin.model.shapes import Mesh, Sphere
from pepper_kin.viewer.drawable import Color, Drawable
from pepper_kin.viewer.surface import DrawnSurface, read_surface

OFF: Color = (0.12, 0.12, 0.13, 1.0)
"""Color of a light that is off."""

ABOVE = 0.0008
"""Distance of the drawn lights from the shell [m]."""

CHEST_RADIUS = 0.012


@dataclass(frozen=True)
class Ring:
    """A ring of lights on each side of the robot.

    Attributes:
        shape: Name of the visual shape with both rings.
        names: Names of the lights of one side, with {} for "Left" or "Right".
        facing: Axis that the rings face: 0 for x, 1 for y.
    """

    shape: str
    names: tuple[str, ...]
    facing: int


RINGS = (
    Ring("head_eye_rings", tuple(f"{{}}FaceLed{k}" for k in range(8)), 0),
    Ring("head_ear_rings", tuple(f"{{}}EarLed{k}" for k in range(1, 11)), 1),
    Ring("torso_shoulder_rings", ("{}ShoulderLed",), 1),
)


def pepper_lights(pepper: PepperModel) -> dict[str, Drawable]:
    """Return name of a light -> drawable, for the lights in the robot's visual shapes."""
    shapes = {shape.name: shape for shape in pepper.visual_shapes}
    lights = {}
    for ring in RINGS:
        shape = shapes.get(ring.shape)
        if shape is not None and isinstance(shape.geometry, Mesh):
            for name, surface in _segments(ring, shape, shape.geometry):
                pose = shape.transform_shape_to_link
                lights[name] = Drawable(name, shape.link, surface, pose, OFF)
    if "ChestButton_frame" in pepper.frame_names:
        entry = next(j for j in pepper.document.joints if j.child == "ChestButton_frame")
        place = pepper.inner_model.frames[pepper.frame_id("ChestButton_frame")].placement
        parent = pepper.inner_model.frames[pepper.frame_id(entry.parent)].placement
        pose = np.asarray((parent.inverse() * place).homogeneous)
        lights["ChestLeds"] = Drawable("ChestLeds", entry.parent, Sphere(CHEST_RADIUS), pose, OFF)
    return lights


def _segments(ring: Ring, shape: Shape, mesh: Mesh) -> Iterator[tuple[str, DrawnSurface]]:
    """Yield name and surface, a little in front of the shell, of each light on both sides."""
    surface = read_surface(mesh.path)
    vertices = surface.vertices * np.broadcast_to(np.asarray(mesh.scale, dtype=float), 3)
    faces = np.asarray(surface.faces)
    middles = vertices[faces].mean(axis=1)
    for side, sign in (("Left", 1.0), ("Right", -1.0)):
        own = sign * middles[:, 1] > 0.0
        outward = np.zeros(3)
        outward[ring.facing] = 1.0 if ring.facing == 0 else sign
        sector = _sectors(middles[own], outward, len(ring.names))
        for k, name in enumerate(ring.names):
            yield name.format(side), _part(vertices + ABOVE * outward, faces[own][sector == k])


def _sectors(middles: NDArray[np.float64], outward: NDArray[np.float64], count: int) -> NDArray[np.intp]:
    """Return the sector of each triangle of a ring, clockwise from the top.

    Args:
        middles: Centroids of the triangles [m], shape (F, 3).
        outward: Unit vector that the ring faces, shape (3,).
        count: Number of sectors.
    """
    center = (middles.min(axis=0) + middles.max(axis=0)) / 2.0
    right = np.cross([0.0, 0.0, 1.0], outward)  # right of a viewer who faces the ring
    offset = middles - center
    angle = np.arctan2(offset @ right, offset[:, 2]) % (2.0 * np.pi)
    return np.minimum((angle * count / (2.0 * np.pi)).astype(np.intp), count - 1)


def _part(vertices: NDArray[np.float64], faces: NDArray[np.intp]) -> DrawnSurface:
    """Return the surface of faces, shape (F, 3), with only the used vertices [m], shape (V, 3)."""
    used, numbered = np.unique(faces, return_inverse=True)
    return DrawnSurface(vertices[used].astype(np.float32), numbered.reshape(-1, 3).astype(np.uint32))
