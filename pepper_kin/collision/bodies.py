"""Collision bodies of a checker: parts of the robot, attached objects and obstacles of the world."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import read_only
from pepper_kin.collision.coal_shapes import coal_geometry, is_empty
from pepper_kin.collision.dependent_ranges import REASON
from pepper_kin.collision.scene import Scene
from pepper_kin.collision.scene_object import AttachedObject, SceneObject
from pepper_kin.collision.solids import HalfSpace, SceneGeometry, padding
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.model import PepperModel, kept_for_robot
from pepper_kin.model.joint_vectors import check_choice
from pepper_kin.model.moving_tree import moving_tree

GeometryType = Literal["collision", "visual"]
"""Geometry that represents the robot: its collision shapes, or the visual surfaces."""

ROBOT, ATTACHED, WORLD = "robot", "attached", "world"


@dataclass(frozen=True, eq=False)
class CollisionBody:
    """One collision body.

    Attributes:
        owner: Name of the link or object that it belongs to.
        kind: ROBOT, ATTACHED or WORLD.
        link: Name of the link or frame it moves with; None for the world.
        frame: Pinocchio's id of that frame; 0 for the world.
        joint: Pinocchio's id of the joint that moves it; 0 for none.
        geometry: Geometry of the body.
        pose: Transform from the shape's own frame to the joint's, shape (4, 4).
        label: Pinocchio's name for it.
        may_touch: Names of the links that an attached object may touch.
    """

    owner: str
    kind: str
    link: str | None
    frame: int
    joint: int
    geometry: SceneGeometry
    pose: np.ndarray
    label: str
    may_touch: frozenset[str] = frozenset()

    @property
    def padding(self) -> float:
        """Distance by which the body extends beyond coal's shape [m]."""
        return padding(self.geometry)

    @property
    def is_half_space(self) -> bool:
        """Whether the body is a half-space, which has no bounding sphere."""
        return isinstance(self.geometry, HalfSpace)

    @cached_property
    def geometry_object(self) -> Any:
        """Pinocchio's geometry object, with coal's shape, made at its first use.

        Raises:
            FileFormatError: for a mesh whose file cannot be read.
        """
        import pinocchio

        placement, shape = pinocchio.SE3(self.pose), coal_geometry(self.geometry)
        if not self.is_half_space:
            shape.computeLocalAABB()
        return pinocchio.GeometryObject(self.label, self.joint, self.frame, placement, shape)


def bodies(pepper: PepperModel, scene: Scene, geometry_type: str = "collision") -> tuple[CollisionBody, ...]:
    """Return all bodies: the robot's, then attached ones, then the world's.

    Raises:
        UnknownNameError: for a frame or link that the robot lacks.
        InvalidValueError: for an object named like a link, or an unknown geometry type.
        FileFormatError: for a mesh whose file cannot be read.
    """
    check_geometry_type(geometry_type)
    check_names(pepper, scene)
    moving = moving_bodies(pepper, tuple(scene.attached.values()), geometry_type)
    return (*moving, *map(world_body, solid_objects(scene)))


def check_geometry_type(geometry_type: str) -> None:
    """Refuse a geometry type that is not in `GeometryType`.

    Raises:
        InvalidValueError: for an unknown type; the message names the known ones.
    """
    check_choice("geometry_type", geometry_type, get_args(GeometryType))


@kept_for_robot(most=64)
def moving_bodies(
    pepper: PepperModel, attached: tuple[AttachedObject, ...], geometry_type: str = "collision"
) -> tuple[CollisionBody, ...]:
    """Return the bodies of the robot, which do not depend on attached objects, then the attached bodies."""
    if attached:
        return (*moving_bodies(pepper, (), geometry_type), *_attached(pepper, attached))
    return tuple(_robot(pepper, geometry_type))


def solid_objects(scene: Scene) -> list[SceneObject]:
    """Return the objects of a scene's world that are not empty."""
    return [item for item in scene.objects.values() if not is_empty(item.geometry)]


def world_body(item: SceneObject) -> CollisionBody:
    """Return the body of an object of the world."""
    pose, label = item.transform_object_to_world, f"scene/{item.name}"
    return CollisionBody(item.name, WORLD, None, 0, 0, item.geometry, pose, label)


def checked_pairs(
    pepper: PepperModel, scene: Scene, solids: tuple[CollisionBody, ...], geometry_type: str = "collision"
) -> NDArray[np.intp]:
    """Return indices of the pairs of bodies that are checked, the world's body second, sorted, shape (k, 2).

    Pairs of two bodies of the world, pairs that `moving_pairs` leaves out, and pairs that may touch in the
    world are not checked; see `may_touch_in_world`.
    """
    moving = tuple([body for body in solids if body.kind != WORLD])
    world = [body.owner for body in solids[len(moving) :]]
    own = np.array(moving_pairs(pepper, scene, moving, geometry_type), np.intp).reshape(-1, 2)
    allowed, met = may_touch_in_world(scene), np.ones((len(moving), len(world)), dtype=bool)
    for i, body in enumerate(moving):
        if body.owner in allowed:
            met[i] = [name not in allowed[body.owner] for name in world]
    listed = np.concatenate([own, np.argwhere(met) + np.array([0, len(moving)])])
    return np.asarray(listed[np.lexsort((listed[:, 1], listed[:, 0]))])


def moving_pairs(
    pepper: PepperModel, scene: Scene, solids: tuple[CollisionBody, ...], geometry_type: str = "collision"
) -> list[tuple[int, int]]:
    """Return indices of the pairs of robot bodies and attached objects that are checked.

    Not checked are: two bodies on one joint, which never move against one another, pairs of links that the
    SRDF disables, pairs that the scene allows, and an attached object against links that it may touch.
    """
    disabled = pepper.semantics.disabled_pairs
    if geometry_type == "visual":
        # Visual surfaces can separate pairs that overlapping capsules cannot.
        disabled = {pair: reason for pair, reason in disabled.items() if reason != REASON}
    found = []
    for i, first in enumerate(solids):
        for j in range(i + 1, len(solids)):
            second = solids[j]
            pair = (min(first.owner, second.owner), max(first.owner, second.owner))
            if first.joint == second.joint or pair in disabled or pair in scene.allowed:
                continue
            if first.owner not in second.may_touch:
                found.append((i, j))
    return found


def may_touch_in_world(scene: Scene) -> dict[str, frozenset[str]]:
    """Map each link or attached object that may touch objects of the world to the names of these objects.

    Everything else is checked against all of the world, also a base that does not move, because a plan that
    starts inside a wall should be refused.
    """
    found: dict[str, set[str]] = {}
    for pair in scene.allowed:
        for owner, other in (pair, pair[::-1]):
            if other in scene.objects:
                found.setdefault(owner, set()).add(other)
    return {owner: frozenset(names) for owner, names in found.items()}


def check_names(pepper: PepperModel, scene: Scene) -> None:
    """Refuse a scene whose names do not fit a robot.

    Raises:
        UnknownNameError: for a frame, link or allowed name that neither robot nor scene has.
        InvalidValueError: for an object named like a link.
    """
    frames = _frames(pepper.frame_names)
    for name in scene.names:
        if name in frames:
            raise InvalidValueError("object name", repr(name), "a name that no link of the robot has")
    for item in scene.attached.values():
        for frame in (item.frame, *item.touch_links):
            pepper.frame_id(frame)
    for pair in sorted(scene.allowed):
        for name in pair:
            if name not in frames and name not in scene.names:
                known = (*scene.names, *dict.fromkeys(shape.link for shape in pepper.collision_shapes))
                raise UnknownNameError("link or object in an allowed pair", name, known)


@lru_cache(maxsize=32)
def _frames(names: tuple[str, ...]) -> frozenset[str]:
    return frozenset(names)


def _robot(pepper: PepperModel, geometry_type: str) -> Iterator[CollisionBody]:
    """Yield the bodies of the robot's own links."""
    shapes = pepper.collision_shapes if geometry_type == "collision" else pepper.visual_shapes
    for shape in shapes:
        frame, joint, pose = _on_frame(pepper, shape.link, shape.transform_shape_to_link)
        yield CollisionBody(shape.link, ROBOT, shape.link, frame, joint, shape.geometry, pose, shape.name)


def _attached(pepper: PepperModel, attached: tuple[AttachedObject, ...]) -> Iterator[CollisionBody]:
    """Yield the bodies of attached objects that are not empty."""
    for item in attached:
        if is_empty(item.geometry):
            continue
        frame, joint, pose = _on_frame(pepper, item.frame, item.transform_object_to_frame)
        may_touch, label = _links_of_hand(pepper, joint) | set(item.touch_links), f"attached/{item.name}"
        yield CollisionBody(
            item.name, ATTACHED, item.frame, frame, joint, item.geometry, pose, label, may_touch
        )


def _on_frame(pepper: PepperModel, name: str, pose: np.ndarray) -> tuple[int, int, np.ndarray]:
    """Return Pinocchio's ids of a frame and its joint, and a pose converted from the frame to the joint.

    Both poses have shape (4, 4), their translations are in [m].
    """
    tree = moving_tree(pepper)
    return pepper.frame_id(name), tree.frame_joints[name], read_only(tree.frame_poses[name] @ pose)


@kept_for_robot(most=256)
def _links_of_hand(pepper: PepperModel, joint: int) -> frozenset[str]:
    """Return the links of the hand that a joint moves or belongs to."""
    hand = _hand(pepper, joint)
    links = {shape.link for shape in pepper.collision_shapes if _joint(pepper, shape.link) in hand}
    return frozenset(links)


def _hand(pepper: PepperModel, joint: int) -> frozenset[int]:
    """Return the joints of the hand that a joint moves or belongs to, by the SRDF's end effectors."""
    tree, semantics = moving_tree(pepper), pepper.semantics
    for effector in semantics.tree.findall("end_effector") if semantics.text else ():
        link = effector.get("parent_link", "")
        wrist = _joint(pepper, link) if link in pepper.frame_names else 0
        if wrist and joint in tree.below(wrist):
            return frozenset(tree.below(wrist))
    return frozenset()


def _joint(pepper: PepperModel, link: str) -> int:
    """Return the id of the joint that moves a link."""
    return moving_tree(pepper).frame_joints[link]
