"""The shapes and pairs that coal checks, made when they are first asked for."""

from __future__ import annotations

from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array
from pepper_kin.collision.bodies import WORLD, CollisionBody, GeometryType, bodies, checked_pairs
from pepper_kin.collision.scene import Scene
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import check_choice

PairsTo = Literal["all", "self", "obstacles"]
"""Which pairs count: of the robot, with what it holds, to "self", to "obstacles" of the world, or "all"."""


class CheckedShapes:
    """What checkers of one robot in one scene share, whatever their margins.

    Args:
        pepper: The robot.
        scene: The scene, whose names fit the robot.
        geometry_type: Which shapes of the robot.
    """

    def __init__(self, pepper: PepperModel, scene: Scene, geometry_type: GeometryType) -> None:
        self._pepper, self._scene, self._geometry_type = pepper, scene, geometry_type

    @cached_property
    def bodies(self) -> tuple[CollisionBody, ...]:
        """The solids, the world's last."""
        return bodies(self._pepper, self._scene, self._geometry_type)

    @cached_property
    def pairs(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Places of the solids of each pair, the world's second, in order."""
        first, second = checked_pairs(self._pepper, self._scene, self.bodies, self._geometry_type).T
        return np.ascontiguousarray(first), np.ascontiguousarray(second)

    @cached_property
    def model(self) -> Any:
        """Pinocchio's model of shapes and pairs."""
        import pinocchio

        model = pinocchio.GeometryModel()
        for body in self.bodies:
            model.addGeometryObject(body.geometry_object)
        for i, j in zip(*(places.tolist() for places in self.pairs), strict=True):
            model.addCollisionPair(pinocchio.CollisionPair(i, j))
        return model

    @cached_property
    def paddings(self) -> Array:
        """How far the shapes of each pair reach beyond coal's [m]."""
        pads = np.array([body.padding for body in self.bodies])
        return np.asarray(pads[self.pairs[0]] + pads[self.pairs[1]])

    @cached_property
    def to_world(self) -> NDArray[np.bool_]:
        """Which pairs are with the world."""
        world = np.array([body.kind == WORLD for body in self.bodies], dtype=bool)
        return np.asarray(world[self.pairs[1]])

    def counted(self, to: PairsTo) -> NDArray[np.bool_]:
        """Return which pairs count, shape (pairs,).

        Raises:
            InvalidValueError: for another word than "all", "self" or "obstacles".
        """
        check_choice("to", to, ("all", "self", "obstacles"))
        return (
            self.to_world == (to == "obstacles") if to != "all" else np.ones(len(self.to_world), dtype=bool)
        )

    @cached_property
    def _balls(self) -> list[tuple[Array, float]]:
        return [_bounding_ball(body) for body in self.bodies]

    @property
    def bounding_centers(self) -> list[Array]:
        """Centers of balls around the solids, in the frames of coal's shapes [m]."""
        return [center for center, _ in self._balls]

    @cached_property
    def bounding_reach(self) -> Array:
        """Sums of the radii of the balls around the two solids of each pair [m]."""
        radii = np.array([radius for _, radius in self._balls])
        return np.asarray(radii[self.pairs[0]] + radii[self.pairs[1]])

    @cached_property
    def planes(self) -> tuple[NDArray[np.intp], Array]:
        """Places of the pairs with half-spaces, and the directions out of these, shape (k, 3)."""
        flat = {j: _plane_normal(body) for j, body in enumerate(self.bodies) if body.is_half_space}
        listed = np.flatnonzero(np.isin(self.pairs[1], list(flat)))
        return listed, np.array([flat[j] for j in self.pairs[1][listed].tolist()]).reshape(-1, 3)

    @cached_property
    def without_box(self) -> NDArray[np.intp]:
        """Places of the pairs that the broad phase misses: one's bounding box is flat or missing."""
        boxed = np.array([_has_box(body) for body in self.bodies], dtype=bool)
        return np.flatnonzero(~(boxed[self.pairs[0]] & boxed[self.pairs[1]]))


def _bounding_ball(body: CollisionBody) -> tuple[Array, float]:
    """Return center, in the frame of coal's shape, and radius [m]; for a half-space, a point on it."""
    shape = body.geometry_object.geometry
    if body.is_half_space:
        return np.array(shape.n) * shape.d, 0.0
    return np.array(shape.aabb_center), float(shape.aabb_radius)


def _has_box(body: CollisionBody) -> bool:
    return not body.is_half_space and body.geometry_object.geometry.aabb_local.volume() > 0


def _plane_normal(body: CollisionBody) -> Array:
    """Return the direction out of a half-space in the world, shape (3,)."""
    return np.array(body.geometry_object.placement.rotation @ body.geometry_object.geometry.n)
