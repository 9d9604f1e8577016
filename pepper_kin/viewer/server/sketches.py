"""Simplified drawables with fewer triangles, for software rendering of moving bodies."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from pepper_kin.collision import ConvexMesh
from pepper_kin.model import PepperModel, Sphere
from pepper_kin.viewer.drawable import Drawable
from pepper_kin.viewer.server.coarsening import coarsened
from pepper_kin.viewer.server.layers import (
    CAPSULE_COLOR,
    CAPSULES,
    INERTIA,
    MASS,
    SPHERE_COLOR,
    SPHERES,
    TARGETS,
    VISUAL,
)
from pepper_kin.viewer.server.merging import merged
from pepper_kin.viewer.surface import DrawnSurface, capsule_surface

SKETCHES = "sketches"
"""Name of the group of the simplified drawables."""
TRIANGLES = 4500
"""Triangles of the robot's visual geometry: each takes about 1 us of processor time a frame."""
_SEGMENTS, _RINGS = 8, 2
_BALL_SEGMENTS, _BALL_RINGS = 12, 3


def sketches_of(
    pepper: PepperModel, layers: Mapping[str, tuple[Drawable, ...]]
) -> dict[str, tuple[Drawable, ...]]:
    """Return simplified drawables of layers from `layers_of`; other layers need none."""
    unit = capsule_surface(1.0, 0.0, _SEGMENTS, _RINGS)
    ball = capsule_surface(1.0, 0.0, _BALL_SEGMENTS, _BALL_RINGS)
    return {
        VISUAL: coarsened(layers[VISUAL], TRIANGLES),
        CAPSULES: merged(pepper, pepper.collision_shapes, CAPSULE_COLOR, _SEGMENTS, _RINGS),
        SPHERES: merged(pepper, pepper.collision_spheres, SPHERE_COLOR, _SEGMENTS, _RINGS),
        INERTIA: tuple(_rounded(drawable, unit) for drawable in layers[INERTIA]),
        MASS: tuple(_rounded(drawable, ball) for drawable in layers[MASS]),
        TARGETS: tuple(_rounded(drawable, ball) for drawable in layers[TARGETS]),
    }


def _rounded(drawable: Drawable, unit: DrawnSurface) -> Drawable:
    """Return a sphere or an ellipsoid along its own axes as a surface."""
    geometry = drawable.geometry
    if isinstance(geometry, Sphere):
        semi = np.full(3, geometry.radius)
    elif isinstance(geometry, ConvexMesh):
        semi = np.abs(geometry.vertices).max(axis=0)
    else:
        return drawable
    return replace(drawable, geometry=DrawnSurface(unit.vertices * semi, unit.faces))
