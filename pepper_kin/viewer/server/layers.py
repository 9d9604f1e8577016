"""Layers of the robot that can be shown or hidden separately."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pepper_kin.collision import ConvexMesh
from pepper_kin.dynamics.support_polygon import support_polygon
from pepper_kin.lazy_names import lazy_module
from pepper_kin.model import Box, Cylinder, PepperModel, Sphere
from pepper_kin.viewer.drawable import Color, Drawable
from pepper_kin.viewer.server.merging import merged
from pepper_kin.viewer.server.targets import COLORS, RADIUS, SharedTargets

pinocchio = lazy_module("pinocchio")

VISUAL, CAPSULES, SPHERES, FRAMES = "visual", "capsules", "spheres", "frames"
INERTIA, MASS, ZMP = "inertia", "center_of_mass", "zero_moment_point"
LAYERS = {
    VISUAL: "Visual geometry",
    CAPSULES: "Capsules",
    SPHERES: "Spheres",
    FRAMES: "Frames",
    INERTIA: "Inertia ellipsoids",
    MASS: "Center of mass",
    ZMP: "Zero-moment point",
}
"""Name of a layer -> title."""
TARGETS = "targets"

MASS_BODY, ZMP_BODY = "@center of mass", "@zero-moment point"
"""Names of the balance points, which have poses like links."""

CAPSULE_COLOR: Color = (0.20, 0.45, 0.90, 0.30)
SPHERE_COLOR: Color = (0.16, 0.62, 0.42, 0.40)
_INERTIA_COLOR: Color = (0.86, 0.55, 0.10, 0.45)
_MASS_COLOR: Color = (0.95, 0.72, 0.10, 1.0)
_ZMP_COLOR: Color = (0.10, 0.60, 0.30, 1.0)
_WHEEL_COLOR: Color = (0.10, 0.60, 0.30, 0.75)
_AXES: tuple[Color, ...] = ((0.85, 0.15, 0.15, 1.0), (0.15, 0.65, 0.2, 1.0), (0.15, 0.35, 0.9, 1.0))
_AXIS_LENGTH, _AXIS_WIDTH = 0.09, 0.005
_SENSIBLE_FRAMES = ("base_footprint", "LArm_effector", "RArm_effector", "CameraTop_frame")


def target_body(name: str) -> str:
    """Return the name of a target's body in the poses."""
    return f"@{name}"


def layers_of(pepper: PepperModel, targets: SharedTargets) -> dict[str, tuple[Drawable, ...]]:
    """Return the drawables of each layer, on links or on the bodies with names in @."""
    return {
        VISUAL: merged(pepper, pepper.visual_shapes),
        CAPSULES: merged(pepper, pepper.collision_shapes, CAPSULE_COLOR),
        SPHERES: merged(pepper, pepper.collision_spheres, SPHERE_COLOR),
        FRAMES: tuple(axis for frame in _frames(pepper) for axis in _triad(frame)),
        INERTIA: _ellipsoids(pepper),
        MASS: (Drawable("ball", MASS_BODY, Sphere(0.03), np.eye(4), _MASS_COLOR),),
        ZMP: _zero_moment_point(pepper),
        TARGETS: tuple(
            Drawable("ball", target_body(name), Sphere(RADIUS), np.eye(4), COLORS[name])
            for name in targets.names
        ),
    }


def _frames(pepper: PepperModel) -> tuple[str, ...]:
    """Return the frames to show: moved links, hands, camera and base."""
    moved = [joint.child for joint in pepper.document.joints if joint.type != "fixed" and not joint.mimic]
    names = (*(name for name in _SENSIBLE_FRAMES if name in pepper.frame_names), *moved)
    return tuple(dict.fromkeys(names))


def _triad(frame: str) -> list[Drawable]:
    axes = []
    for k, color in enumerate(_AXES):
        size, pose = np.full(3, _AXIS_WIDTH), np.eye(4)
        size[k], pose[k, 3] = _AXIS_LENGTH, _AXIS_LENGTH / 2
        axes.append(Drawable(f"axis {'xyz'[k]}", frame, Box((size[0], size[1], size[2])), pose, color))
    return axes


def _ellipsoids(pepper: PepperModel) -> tuple[Drawable, ...]:
    """Return, for every moving body, the solid ellipsoid of the same mass and inertia.

    With mass m and principal moments I_1, I_2, I_3 its semi-axes are
    a_i = sqrt(5 (I_j + I_k - I_i) / (2 m)).
    """
    model = pepper.inner_model
    drawables = []
    for joint, inertia in enumerate(model.inertias):
        if inertia.mass < 1e-6:
            continue
        moments, axes = np.linalg.eigh(inertia.inertia)
        semi = np.sqrt(np.maximum(5 * (moments.sum() - 2 * moments) / (2 * inertia.mass), 1e-6))
        pose = np.eye(4)
        pose[:3, :3] = axes * np.sign(np.linalg.det(axes))
        pose[:3, 3] = inertia.lever
        link, to_link = _link_of(model, joint, pepper)
        if link is not None:
            name = f"ellipsoid {model.names[joint]}"
            drawables.append(Drawable(name, link, _ellipsoid(semi), to_link @ pose, _INERTIA_COLOR))
    return tuple(drawables)


def _link_of(model: Any, joint: int, pepper: PepperModel) -> tuple[str | None, NDArray[np.float64]]:
    """Return a link that moves with a Pinocchio joint, and the joint's pose in the link, shape (4, 4)."""
    for name in pepper.frame_names:
        frame = model.frames[pepper.frame_id(name)]
        if frame.parentJoint == joint:
            return name, np.asarray(frame.placement.inverse().homogeneous)
    return None, np.eye(4)


def _ellipsoid(semi: NDArray[np.float64]) -> ConvexMesh:
    """Return an ellipsoid with the given semi-axes [m], shape (3,), along the coordinate axes."""
    polar = np.linspace(0.0, np.pi, 9)[1:-1]
    around = np.linspace(0.0, 2 * np.pi, 13)[:-1]
    ring = np.stack([np.cos(around), np.sin(around)], axis=-1)
    points = [np.column_stack([np.sin(p) * ring, np.full(len(ring), np.cos(p))]) for p in polar]
    unit = np.concatenate([[[0.0, 0.0, 1.0]], *points, [[0.0, 0.0, -1.0]]])
    return ConvexMesh(unit * semi)


def _zero_moment_point(pepper: PepperModel) -> tuple[Drawable, ...]:
    """Return the disc of the zero-moment point, and the sides of the support polygon."""
    disc = Drawable("disc", ZMP_BODY, Cylinder(0.022, 0.006), np.eye(4), _ZMP_COLOR)
    polygon = support_polygon(pepper)
    if polygon is None:
        return (disc,)
    sides = []
    for k, (corner, after) in enumerate(zip(polygon, np.roll(polygon, -1, axis=0), strict=True)):
        along = after - corner
        length, pose = float(np.hypot(*along)), np.eye(4)
        pose[:2, 0], pose[:2, 1] = along / length, np.array([-along[1], along[0]]) / length
        pose[:3, 3] = [*(corner + after) / 2, 0.003]
        sides.append(Drawable(f"side {k}", "base_footprint", Box((length, 0.008, 0.004)), pose, _WHEEL_COLOR))
    return (disc, *sides)
