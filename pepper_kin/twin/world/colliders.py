"""All shapes of a world as one table, and which pairs of them may meet."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pepper_kin.collision import HalfSpace, Scene
from pepper_kin.collision.bodies import WORLD, Body, bodies
from pepper_kin.collision.coal_shapes import coal_geometry
from pepper_kin.collision.fast.options import OPTIONS
from pepper_kin.collision.solids import SceneGeometry, padding
from pepper_kin.model import Box, Capsule, Cylinder, PepperModel, Sphere
from pepper_kin.twin.world.kinds import BALL, BOX, CAPSULE, CYLINDER, HALF_SPACE, OTHER

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

STANDS, ON_ROBOT, FREE = 0, 1, 2
"""Who moves a shape: nobody, a joint of the robot, or itself."""

ROUNDED = 2e-4
"""Corners that coal sees are rounded by this at most, so that shapes that touch are apart to it [m]."""


@dataclass(frozen=True, eq=False)
class Colliders:
    """One row for each shape.

    Attributes:
        names: Link or object that each belongs to.
        kind: See `kinds`, shape (k,).
        size: Lengths as `kinds.reach` wants them, shape (k, 3) [m].
        mover: STANDS, ON_ROBOT or FREE, shape (k,).
        index: Joint or free body that moves it, shape (k,).
        own_rotation: In the frame of that joint or body, shape (k, 3, 3).
        own_position: [m], shape (k, 3).
        ball: Centre, in the shape's frame, and radius of its bounding ball [m], shape (k, 4).
        rotation: In the world, overwritten by `place_shapes`, shape (k, 3, 3).
        position: [m], shape (k, 3).
        middle: Centre of the bounding ball in the world [m], shape (k, 3).
        speed: Bound on the speed of any point of it [m/s], shape (k,).
        pairs: Rows of shapes that may meet, that which moves first, shape (p, 2).
        geometries: The shapes.
        pads: How far each reaches beyond what coal is given [m].
        coal: Coal's shape of each, made when first needed.
    """

    names: tuple[str, ...]
    kind: Indices
    size: Array
    mover: Indices
    index: Indices
    own_rotation: Array
    own_position: Array
    ball: Array
    rotation: Array
    position: Array
    middle: Array
    speed: Array
    pairs: Indices
    geometries: tuple[Any, ...]
    pads: list[float]
    coal: dict[int, Any] = field(default_factory=dict)

    def coal_shape(self, row: int) -> Any:
        """Return coal's shape of a row, smaller by `pads`."""
        shape = self.coal.get(row)
        if shape is None:
            geometry = self.geometries[row]
            match geometry:
                case Box() | Cylinder():
                    lengths = geometry.size if isinstance(geometry, Box) else (geometry.radius,)
                    lengths = (*lengths, geometry.length) if isinstance(geometry, Cylinder) else lengths
                    self.pads[row] = pad = min(ROUNDED, 0.05 * min(lengths))
                    shape = coal_geometry(_smaller(geometry, pad))
                case Sphere() | Capsule() | HalfSpace():
                    shape = coal_geometry(geometry)
                case _:  # Pinocchio's geometry object
                    shape = geometry
            self.coal[row] = shape
        return shape


@dataclass(frozen=True, eq=False)
class _Row:
    name: str
    geometry: SceneGeometry | Any
    mover: int
    index: int
    pose: Array
    pad: float = 0.0
    of_robot: bool = False


def colliders(
    pepper: PepperModel | None, scene: Scene, free: tuple[tuple[str, SceneGeometry], ...]
) -> Colliders:
    """Return the table of a robot, a scene and free bodies."""
    rows = [*_fixed_rows(pepper, scene)]
    rows += [_Row(name, shape, FREE, place, np.eye(4)) for place, (name, shape) in enumerate(free)]
    count = len(rows)
    poses = np.array([row.pose for row in rows]).reshape(-1, 4, 4)
    measured = [_measure(row.geometry) for row in rows]
    pads = np.array([row.pad for row in rows])
    return Colliders(
        names=tuple(row.name for row in rows),
        kind=np.array([kind for kind, _, _ in measured], dtype=np.int64),
        size=np.array([size for _, size, _ in measured]).reshape(-1, 3),
        mover=np.array([row.mover for row in rows], dtype=np.int64),
        index=np.array([row.index for row in rows], dtype=np.int64),
        own_rotation=np.ascontiguousarray(poses[:, :3, :3]),
        own_position=np.ascontiguousarray(poses[:, :3, 3]),
        ball=np.array([ball for _, _, ball in measured]).reshape(-1, 4) + pads[:, None] * [0, 0, 0, 1],
        rotation=np.ascontiguousarray(poses[:, :3, :3]),
        position=np.ascontiguousarray(poses[:, :3, 3]),
        middle=np.zeros((count, 3)),
        speed=np.zeros(count),
        pairs=np.array(list(_pairs(rows, scene)), dtype=np.int64).reshape(-1, 2),
        geometries=tuple(row.geometry for row in rows),
        pads=pads.tolist(),
    )


def _fixed_rows(pepper: PepperModel | None, scene: Scene) -> Iterator[_Row]:
    if pepper is None:
        for item in scene.objects.values():
            simple = isinstance(item.geometry, Box | Sphere | Capsule | Cylinder | HalfSpace)
            shape = item.geometry if simple else coal_geometry(item.geometry)
            pose = np.array(item.transform_object_to_world)
            yield _Row(item.name, shape, STANDS, 0, pose, 0.0 if simple else padding(item.geometry))
        return
    shapes = iter(pepper.collision_shapes)
    for body in bodies(pepper, scene):
        solid = body.geometry_object
        pose = np.array(solid.placement.homogeneous)
        geometry = _geometry_of(body, shapes, scene)
        mover = ON_ROBOT if body.kind != WORLD and body.joint else STANDS
        simple = isinstance(geometry, Box | Sphere | Capsule | Cylinder | HalfSpace)
        pad = 0.0 if simple else body.padding
        shape = geometry if simple else solid.geometry
        yield _Row(body.owner, shape, mover, body.joint, pose, pad, body.kind != WORLD)


def _geometry_of(body: Body, shapes: Iterator[Any], scene: Scene) -> Any:
    if body.kind == "robot":
        return next(shapes).geometry
    held = scene.objects if body.kind == WORLD else scene.attached
    return held[body.owner].geometry


def _pairs(rows: list[_Row], scene: Scene) -> Iterator[tuple[int, int]]:
    """Yield pairs of which one moves, but for the robot's own and those that the scene allows to touch."""
    for i, first in enumerate(rows):
        for j in range(i + 1, len(rows)):
            second = rows[j]
            alike = first.mover == second.mover and first.mover != FREE
            alike = alike or (first.of_robot and second.of_robot)
            if alike or (min(first.name, second.name), max(first.name, second.name)) in scene.allowed:
                continue
            yield (i, j) if first.mover > second.mover else (j, i)


def _measure(geometry: Any) -> tuple[int, tuple[float, float, float], Array]:
    """Return kind, lengths and bounding ball."""
    match geometry:
        case Sphere():
            return BALL, (geometry.radius, 0.0, 0.0), np.array([0, 0, 0, geometry.radius])
        case Capsule():
            half = geometry.length / 2
            return CAPSULE, (geometry.radius, half, 0.0), np.array([0, 0, 0, geometry.radius + half])
        case Box():
            x, y, z = (length / 2 for length in geometry.size)
            return BOX, (x, y, z), np.array([0, 0, 0, np.linalg.norm([x, y, z])])
        case Cylinder():
            half = geometry.length / 2
            far = np.hypot(geometry.radius, half)
            return CYLINDER, (geometry.radius, half, 0.0), np.array([0, 0, 0, far])
        case HalfSpace():
            return HALF_SPACE, (geometry.offset, 0.0, 0.0), np.zeros(4)
    geometry.computeLocalAABB()
    return OTHER, (0.0, 0.0, 0.0), np.array([*geometry.aabb_center, geometry.aabb_radius])


def _smaller(geometry: Box | Cylinder, pad: float) -> Box | Cylinder:
    if isinstance(geometry, Cylinder):
        return Cylinder(geometry.radius - pad, geometry.length - 2 * pad)
    x, y, z = (length - 2 * pad for length in geometry.size)
    return Box((x, y, z))


@njit(
    "void(int64[::1], int64[::1], float64[:, :, ::1], float64[:, ::1], float64[:, ::1], float64[:, :, ::1], "
    "float64[:, ::1], float64[:, ::1], float64[:, ::1], float64[:, :, ::1], float64[:, ::1], "
    "float64[:, ::1], float64[:, :, ::1], float64[:, ::1], float64[:, ::1], float64[::1])",
    **OPTIONS,
)
def place_shapes(
    mover: Indices,
    index: Indices,
    own_rotation: Array,
    own_position: Array,
    ball: Array,
    joint_rotation: Array,
    joint_position: Array,
    joint_linear: Array,
    joint_angular: Array,
    body_rotation: Array,
    body_position: Array,
    body_velocity: Array,
    rotation: Array,
    position: Array,
    middle: Array,
    speed: Array,
) -> None:
    """Write pose, bounding ball and a bound on the speed of every shape; see `Colliders`."""
    frame = np.empty((3, 3))
    origin, linear, angular = np.zeros(3), np.zeros(3), np.zeros(3)
    for s in range(len(mover)):
        if mover[s] == ON_ROBOT:
            for i in range(3):
                origin[i] = joint_position[index[s], i]
                linear[i], angular[i] = joint_linear[index[s], i], joint_angular[index[s], i]
                for k in range(3):
                    frame[i, k] = joint_rotation[index[s], i, k]
        elif mover[s] == FREE:
            for i in range(3):
                origin[i] = body_position[index[s], i]
                linear[i], angular[i] = body_velocity[index[s], i], body_velocity[index[s], 3 + i]
                for k in range(3):
                    frame[i, k] = body_rotation[index[s], i, k]
        if mover[s] != STANDS:
            for i in range(3):
                position[s, i] = origin[i]
                for k in range(3):
                    position[s, i] += frame[i, k] * own_position[s, k]
                    rotation[s, i, k] = (
                        frame[i, 0] * own_rotation[s, 0, k]
                        + frame[i, 1] * own_rotation[s, 1, k]
                        + frame[i, 2] * own_rotation[s, 2, k]
                    )
        away, turning, moving = 0.0, 0.0, 0.0
        for i in range(3):
            middle[s, i] = position[s, i]
            for k in range(3):
                middle[s, i] += rotation[s, i, k] * ball[s, k]
            away += (middle[s, i] - origin[i]) ** 2
            turning += angular[i] ** 2
            moving += linear[i] ** 2
        speed[s] = 0.0
        if mover[s] != STANDS:
            speed[s] = np.sqrt(moving) + np.sqrt(turning) * (np.sqrt(away) + ball[s, 3])
