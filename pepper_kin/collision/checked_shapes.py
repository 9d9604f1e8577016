"""Shapes and pairs that coal checks, made at their first use."""

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
"""Pairs that count: of the robot with attached objects, to "self", to "obstacles" of the world, or "all"."""


class CheckedShapes:
    """Shapes and pairs shared by checkers of one robot in one scene with different margins.

    Args:
        pepper: The robot.
        scene: The scene, whose names fit the robot.
        geometry_type: Type of the robot's shapes.
    """

    def __init__(self, pepper: PepperModel, scene: Scene, geometry_type: GeometryType) -> None:
        self._pepper, self._scene, self._geometry_type = pepper, scene, geometry_type

    @cached_property
    def bodies(self) -> tuple[CollisionBody, ...]:
        """The bodies, the world's last."""
        return bodies(self._pepper, self._scene, self._geometry_type)

    @cached_property
    def pairs(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Indices of the bodies of each pair, the world's second, sorted."""
        first, second = checked_pairs(self._pepper, self._scene, self.bodies, self._geometry_type).T
        return np.ascontiguousarray(first), np.ascontiguousarray(second)

    @cached_property
    def model(self) -> Any:
        """Pinocchio's geometry model of shapes and pairs."""
        import pinocchio

        model = pinocchio.GeometryModel()
        for body in self.bodies:
            model.addGeometryObject(body.geometry_object)
        for i, j in zip(*(places.tolist() for places in self.pairs), strict=True):
            model.addCollisionPair(pinocchio.CollisionPair(i, j))
        return model

    @cached_property
    def paddings(self) -> Array:
        """Distance by which the shapes of each pair extend beyond coal's [m], shape (pairs,)."""
        pads = np.array([body.padding for body in self.bodies])
        return np.asarray(pads[self.pairs[0]] + pads[self.pairs[1]])

    @cached_property
    def to_world(self) -> NDArray[np.bool_]:
        """Whether each pair is with the world, shape (pairs,)."""
        world = np.array([body.kind == WORLD for body in self.bodies], dtype=bool)
        return np.asarray(world[self.pairs[1]])

    def counted(self, to: PairsTo) -> NDArray[np.bool_]:
        """Return whether each pair counts, shape (pairs,).

        Raises:
            InvalidValueError: for a word other than "all", "self" or "obstacles".
        """
        check_choice("to", to, ("all", "self", "obstacles"))
        return (
            self.to_world == (to == "obstacles") if to != "all" else np.ones(len(self.to_world), dtype=bool)
        )

    @cached_property
    def _balls(self) -> list[tuple[Array, float]]:
        """Center and radius of a bounding sphere of each body [m]."""
        return [_bounding_ball(body) for body in self.bodies]

    @property
    def bounding_centers(self) -> list[Array]:
        """Centers of bounding spheres of the bodies, in the frames of coal's shapes [m]."""
        return [center for center, _ in self._balls]

    @cached_property
    def bounding_reach(self) -> Array:
        """Sums of the radii of the bounding spheres of each pair [m], shape (pairs,)."""
        radii = np.array([radius for _, radius in self._balls])
        return np.asarray(radii[self.pairs[0]] + radii[self.pairs[1]])

    @cached_property
    def planes(self) -> tuple[NDArray[np.intp], Array]:
        """Indices of the pairs with half-spaces, and the half-spaces' outward normals, shape (k, 3)."""
        flat = {j: _plane_normal(body) for j, body in enumerate(self.bodies) if body.is_half_space}
        listed = np.flatnonzero(np.isin(self.pairs[1], list(flat)))
        return listed, np.array([flat[j] for j in self.pairs[1][listed].tolist()]).reshape(-1, 3)

    @cached_property
    def without_box(self) -> NDArray[np.intp]:
        """Indices of the pairs that the broad phase misses: a bounding box is flat or missing."""
        boxed = np.array([_has_box(body) for body in self.bodies], dtype=bool)
        return np.flatnonzero(~(boxed[self.pairs[0]] & boxed[self.pairs[1]]))


def _bounding_ball(body: CollisionBody) -> tuple[Array, float]:
    """Return center, in the frame of coal's shape, and radius of a bounding sphere [m]; 0 for half-spaces."""
    shape = body.geometry_object.geometry
    if body.is_half_space:
        return np.array(shape.n) * shape.d, 0.0
    return np.array(shape.aabb_center), float(shape.aabb_radius)


def _has_box(body: CollisionBody) -> bool:
    """Return whether a body has a bounding box with a volume."""
    return not body.is_half_space and body.geometry_object.geometry.aabb_local.volume() > 0


def _plane_normal(body: CollisionBody) -> Array:
    """Return the outward normal of a half-space in the world, shape (3,)."""
    return np.array(body.geometry_object.placement.rotation @ body.geometry_object.geometry.n)
