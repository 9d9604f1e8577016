"""All shapes of a world as one table, and the pairs of shapes that may touch."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.collision import HalfSpace, Scene
from pepper_kin.collision.bodies import WORLD, CollisionBody, bodies
from pepper_kin.collision.coal_shapes import coal_geometry
from pepper_kin.collision.solids import SceneGeometry, padding
from pepper_kin.core.simulation.narrow_phase import (
    BALL,
    BOX,
    CAPSULE,
    CYLINDER,
    FREE,
    HALF_SPACE,
    ON_ROBOT,
    OTHER,
    STANDS,
    ShapeTable,
)
from pepper_kin.model import Box, Capsule, Cylinder, PepperModel, Sphere
from pepper_kin.twin.world.free_body import FreeBody

ROUNDED = 2e-4
"""Maximum rounding radius of corners in coal's shapes, so that touching shapes are still separate [m]."""


@dataclass(frozen=True, eq=False)
class Colliders:
    """Shapes of a world, one row for each.

    Attributes:
        names: Name of the link or object that each shape belongs to.
        table: Table of the shapes.
        geometries: Geometry of each shape.
        pads: Distance by which each shape extends beyond its shape in coal [m].
        coal: Row -> coal's shape, created at its first use.
    """

    names: tuple[str, ...]
    table: ShapeTable
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
    driven: bool = False


def colliders(
    pepper: PepperModel | None, scene: Scene, bodies: Sequence[FreeBody], friction: float
) -> Colliders:
    """Return the shapes of a robot, a scene and bodies; `friction` is the coefficient of all but the bodies.

    Bodies that are movers of the scene are not stopped by contacts, and do not collide with static obstacles.
    """
    rows = [*_fixed_rows(pepper, scene.standing)]
    for place, body in enumerate(bodies):
        shape, pad = _shape(body.geometry)
        rows.append(_Row(body.name, shape, FREE, place, np.eye(4), pad, driven=body.name in scene.objects))
    count = len(rows)
    poses = np.array([row.pose for row in rows]).reshape(-1, 4, 4)
    measured = [_measure(row.geometry) for row in rows]
    pads = np.array([row.pad for row in rows])
    coefficients = np.full(count, friction)
    coefficients[count - len(bodies) :] = [body.friction for body in bodies]
    pairs = sorted(_pairs(rows, scene), key=lambda pair: any(rows[k].mover == ON_ROBOT for k in pair))
    alone = sum(all(rows[k].mover != ON_ROBOT for k in pair) for pair in pairs)
    balls = np.array([ball for _, _, ball in measured]).reshape(-1, 4)
    middles = np.einsum("kij,kj->ki", poses[:, :3, :3], balls[:, :3]) + poses[:, :3, 3]
    table = ShapeTable(
        kind=np.array([kind for kind, _, _ in measured], dtype=np.int64),
        size=np.array([size for _, size, _ in measured]).reshape(-1, 3),
        mover=np.array([row.mover for row in rows], dtype=np.int64),
        owner=np.array([row.index for row in rows], dtype=np.int64),
        of_robot=np.array([row.of_robot for row in rows], dtype=np.int64),
        own_rotation=np.ascontiguousarray(poses[:, :3, :3]),
        own_position=np.ascontiguousarray(poses[:, :3, 3]),
        own_middle=middles,
        ball=balls + pads[:, None] * [0, 0, 0, 1],
        placed=np.ones(count, dtype=np.int64),
        rotation=np.array(poses[:, :3, :3], order="C"),
        position=np.array(poses[:, :3, 3], order="C"),
        middle=middles.copy(),
        speed=np.zeros(count),
        pairs=np.array(pairs, dtype=np.int64).reshape(-1, 2),
        alone=np.array([alone]),
        friction=coefficients,
    )
    names, geometries = tuple(row.name for row in rows), tuple(row.geometry for row in rows)
    return Colliders(names, table, geometries, pads.tolist())


def _fixed_rows(pepper: PepperModel | None, scene: Scene) -> Iterator[_Row]:
    if pepper is None:
        for item in scene.objects.values():
            shape, pad = _shape(item.geometry)
            yield _Row(item.name, shape, STANDS, 0, np.array(item.transform_object_to_world), pad)
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


def _shape(geometry: SceneGeometry) -> tuple[Any, float]:
    """Return the geometry of a row, and the distance by which the shape extends beyond it [m]."""
    if isinstance(geometry, Box | Sphere | Capsule | Cylinder | HalfSpace):
        return geometry, 0.0
    return coal_geometry(geometry), padding(geometry)


def _geometry_of(body: CollisionBody, shapes: Iterator[Any], scene: Scene) -> Any:
    if body.kind == "robot":
        return next(shapes).geometry
    held = scene.objects if body.kind == WORLD else scene.attached
    return held[body.owner].geometry


def _pairs(rows: list[_Row], scene: Scene) -> Iterator[tuple[int, int]]:
    """Yield pairs in which a shape moves, except pairs of the robot's own shapes and allowed pairs."""
    for i, first in enumerate(rows):
        for j in range(i + 1, len(rows)):
            second = rows[j]
            alike = first.mover == second.mover and first.mover != FREE
            alike = alike or (first.of_robot and second.of_robot)
            alike = alike or ((first.driven or second.driven) and _none_yields(first, second))
            if alike or (min(first.name, second.name), max(first.name, second.name)) in scene.allowed:
                continue
            yield (i, j) if first.mover > second.mover else (j, i)


def _none_yields(first: _Row, second: _Row) -> bool:
    """Whether neither body yields: each is static or a mover of the scene."""
    return all(row.driven or row.mover == STANDS for row in (first, second))


def _measure(geometry: Any) -> tuple[int, tuple[float, float, float], Array]:
    """Return kind, lengths and bounding sphere of a geometry."""
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
