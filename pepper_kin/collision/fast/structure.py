"""Pairs of solids to compare, in classes and groups that share a bound."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array
from pepper_kin.collision.bodies import (
    CollisionBody,
    may_touch_in_world,
    moving_bodies,
    moving_pairs,
    solid_objects,
)
from pepper_kin.collision.checker import CollisionChecker
from pepper_kin.collision.fast.ball_cover import ball_around, ball_cover
from pepper_kin.collision.fast.solids import Solid, simple_shape, solid_of
from pepper_kin.collision.kept_size import MOST_BYTES, bytes_of, kept_within
from pepper_kin.collision.scene import Scene
from pepper_kin.collision.scene_object import AttachedObject, SceneObject
from pepper_kin.core.collision.layout import HULL, OTHER
from pepper_kin.core.collision.scene_rows import ROW, write_simple_rows
from pepper_kin.core.collision.scene_trees import write_gaps
from pepper_kin.model import PepperModel, kept_for_robot
from pepper_kin.model.moving_tree import moving_tree


@dataclass(frozen=True, eq=False)
class MovingParts:
    """The robot with attached objects: common to all scenes.

    Attributes:
        bodies: The robot's bodies, then the attached ones.
        solids: The bodies as solids for compiled code.
        classes: Pairs (indices in `solids`) of the robot with itself, by limbs of the robot.
    """

    bodies: tuple[CollisionBody, ...]
    solids: tuple[Solid, ...]
    classes: tuple[tuple[tuple[int, int], ...], ...]

    @cached_property
    def by_joint(self) -> tuple[tuple[tuple[int, ...], ...], NDArray[np.int64]]:
        """Solids of each moving joint, and of no joint, if all are compared with the same objects."""
        found: dict[int, list[int]] = {}
        for i, solid in enumerate(self.solids):
            found.setdefault(solid.joint, []).append(i)
        resting = np.array(found.pop(0, []), np.int64)
        return tuple(tuple(found[joint]) for joint in sorted(found)), resting

    @cached_property
    def rows(self) -> Array:
        """Rows of the solids, see `core.collision.scene_rows`, shape (k, ROW)."""
        return np.array([solid.row for solid in self.solids]).reshape(-1, ROW)

    @cached_property
    def supported(self) -> bool:
        """Whether all solids of the robot have bounds."""
        return all(solid.kind != OTHER for solid in self.solids)

    @cached_property
    def decided(self) -> bool:
        """Whether all solids of the robot are convex."""
        return _are_decided(self.solids)


@dataclass(frozen=True, eq=False)
class ComparedParts:
    """Bodies and pairs that are compared.

    Attributes:
        moving: The robot with attached objects.
        groups: Indices in `moving.solids` of solids that move against the scene: each group has the solids of
            one joint that are compared with the same objects, joint by joint.
        items: The scene's objects.
        members: Indices in `items`, set after set of objects that are compared with the same groups, each
            object once, shape (k,).
        ends: End of each set in `members`, shape (s,).
        met: 1 if a set is compared with a group, else 0, shape (s, groups).
        resting: Indices in `moving.solids` and `items` of pairs that never move against one another, shape
            (k, 2).
    """

    moving: MovingParts
    groups: tuple[tuple[int, ...], ...]
    items: tuple[SceneObject, ...]
    members: NDArray[np.int64]
    ends: NDArray[np.int64]
    met: NDArray[np.uint8]
    resting: NDArray[np.int64]

    @cached_property
    def decided(self) -> bool:
        """Whether all shapes are convex solids."""
        return self.moving.decided and _are_decided(self.special.values())

    @cached_property
    def _simple(self) -> list[tuple[float, float, float, float] | None]:
        return [simple_shape(item.geometry) for item in self.items]

    @cached_property
    def special(self) -> dict[int, Solid]:
        """Indices of the objects that are not primitive shapes, and their solids for compiled code."""
        return {o: _solid_of_object(self.items[o]) for o, shape in enumerate(self._simple) if shape is None}

    @cached_property
    def object_rows(self) -> Array:
        """Rows of the objects, see `core.collision.scene_rows`, shape (k, ROW)."""
        rows = np.empty((len(self.items), ROW))
        none = (0.0, 0.0, 0.0, 0.0)
        if self.items:
            shapes = np.array([none if shape is None else shape for shape in self._simple])
            poses = np.array([item.transform_object_to_world for item in self.items])
            write_simple_rows(shapes, poses, rows)
        for o, solid in self.special.items():
            rows[o] = solid.row
        return rows

    @cached_property
    def gaps(self) -> tuple[Array, float]:
        """Lower bound of the distance of each pair in `resting`, shape (k,), and their minimum [m]."""
        gaps = np.empty(len(self.resting))
        least = write_gaps(self.moving.rows, self.object_rows, self.resting, gaps)
        return gaps, float(least)

    @property
    def solids(self) -> tuple[Solid, ...]:
        """The robot's solids."""
        return self.moving.solids

    @property
    def classes(self) -> tuple[tuple[tuple[int, int], ...], ...]:
        """Pairs of the robot with itself."""
        return self.moving.classes


def _are_decided(solids: Iterable[Solid]) -> bool:
    """Return whether all solids equal the convex hull of their core and radius."""
    return all(solid.filled and solid.kind != OTHER for solid in solids)


def structure_of(checker: CollisionChecker) -> ComparedParts:
    """Sort the pairs that a checker compares; the result is shared by all margins."""
    return _structure(checker.pepper, checker.scene)


@kept_for_robot(most=32)
def _structure(pepper: PepperModel, scene: Scene) -> ComparedParts:
    """Return the bodies and pairs to compare of a robot in a scene, cached."""
    attached = tuple(scene.attached.values())
    held = frozenset(pair for pair in scene.allowed if attached and not scene.objects.keys() & set(pair))
    moving, items = _moving(pepper, attached, held), tuple(solid_objects(scene))
    allowed, none = may_touch_in_world(scene), frozenset[str]()
    if not allowed:
        plain, based = moving.by_joint
        places, ends = np.arange(len(items)), np.array([len(items)] if items else (), np.int64)
        pairs = np.empty((len(based), len(items), 2), np.int64)
        pairs[:, :, 0], pairs[:, :, 1] = based[:, None], places
        met = np.ones((len(ends), len(plain)), np.uint8)
        return ComparedParts(moving, plain, items, places, ends, met, pairs.reshape(-1, 2))
    together: dict[tuple[int, frozenset[str]], list[int]] = {}
    for i, solid in enumerate(moving.solids):
        together.setdefault((solid.joint, allowed.get(solid.owner, none)), []).append(i)
    in_order = sorted((key for key in together if key[0] > 0), key=lambda key: key[0])
    apart: dict[str, set[int]] = {}
    for g, (_, names) in enumerate(in_order):
        for name in names:
            apart.setdefault(name, set()).add(g)
    every, sets = frozenset(range(len(in_order))), dict[frozenset[int], list[int]]()
    for o, item in enumerate(items):
        groups = every - apart[item.name] if item.name in apart else every
        sets.setdefault(groups, []).append(o)
    resting = [np.zeros((0, 2), np.int64)]
    for (joint, names), members in together.items():
        if joint == 0:
            near = np.array([o for o, item in enumerate(items) if item.name not in names], np.int64)
            resting.append(np.stack(np.meshgrid(members, near, indexing="ij"), axis=-1).reshape(-1, 2))
    met = np.zeros((len(sets), len(in_order)), np.uint8)
    for s, groups in enumerate(sets):
        met[s, list(groups)] = 1
    return ComparedParts(
        moving,
        tuple(tuple(together[key]) for key in in_order),
        items,
        np.array([o for objects in sets.values() for o in objects], np.int64),
        np.cumsum([len(objects) for objects in sets.values()], dtype=np.int64),
        met,
        np.concatenate(resting),
    )


@kept_for_robot(most=64)
def _moving(
    pepper: PepperModel, attached: tuple[AttachedObject, ...], allowed: frozenset[tuple[str, str]]
) -> MovingParts:
    """Return the parts of a robot with attached objects; pairs of names in `allowed` are not compared."""
    bodies = moving_bodies(pepper, attached)
    scene = Scene(attached={item.name: item for item in attached}, allowed=allowed)
    limbs = _limbs(pepper)
    classes: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for i, j in moving_pairs(pepper, scene, bodies):
        classes.setdefault((limbs[bodies[i].joint], limbs[bodies[j].joint]), []).append((i, j))
    return MovingParts(
        bodies, tuple(map(_solid_of_body, bodies)), tuple(tuple(pairs) for pairs in classes.values())
    )


@kept_within(MOST_BYTES / 4, lambda solid, body: bytes_of(solid, body.geometry))
def _solid_of_body(body: CollisionBody) -> Solid:
    """Return a moving body's solid for compiled code, cached."""
    return solid_of(body.owner, body.geometry, body.joint, body.pose)


_solids: WeakKeyDictionary[SceneObject, Solid] = WeakKeyDictionary()


def _solid_of_object(item: SceneObject) -> Solid:
    """Return the solid of an object of the world for compiled code, cached for all scenes that hold it."""
    found = _solids.get(item)
    if found is None:
        made = solid_of(item.name, item.geometry, 0, item.transform_object_to_world, stands=True)
        found = _solids[item] = made
    return found


def _limbs(pepper: PepperModel) -> list[int]:
    """Return for each joint the limb to which it belongs, shape (njoints,).

    From the world to the first joint with several children, each joint is a limb; beyond, each child of that
    joint and all its descendants are one limb.
    """
    parents = moving_tree(pepper).parents
    children = [[c for c in range(1, len(parents)) if parents[c] == j] for j in range(len(parents))]
    limbs = [-1] * len(parents)
    joint = limbs[0] = 0
    while len(children[joint]) == 1:
        joint = children[joint][0]
        limbs[joint] = joint
    for j in range(1, len(parents)):
        if limbs[j] < 0:
            limbs[j] = j if parents[j] == joint else limbs[parents[j]]
    return limbs


def ball_order(solid: Solid) -> tuple[bool, int]:
    """Return a sort key: in a pair, the spheres of the lesser solid are compared with the other's core."""
    return not solid.segment, len(ball_cover(solid).outer)


@kept_within(MOST_BYTES / 4, bytes_of)
def bounding_ball(solids: tuple[Solid, ...]) -> tuple[Array, float]:
    """Return center, in their joint's frame, and radius of a sphere around solids of one joint [m]."""
    points, radii = [], []
    for solid in solids:
        corners = solid.vertices
        if solid.kind != HULL:
            corners = np.unique(solid.half * _SIGNS, axis=0)
        points.append(corners @ solid.rotation.T + solid.position)
        radii += [solid.radius] * len(corners)
    return ball_around(np.concatenate(points), np.array(radii))


_SIGNS = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
