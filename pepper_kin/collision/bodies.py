"""The solids of a checker: parts of the robot, what hangs on it and what stands around it."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

from pepper_kin.collision.coal_shapes import coal_geometry, is_empty
from pepper_kin.collision.dependent_ranges import REASON
from pepper_kin.collision.scene import Scene
from pepper_kin.collision.solids import HalfSpace, padding
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.model import PepperModel

Looks = Literal["collision", "visual"]
"""What stands for the robot: its collision shapes, or the surfaces that are drawn."""

ROBOT, ATTACHED, WORLD = "robot", "attached", "world"


@dataclass(frozen=True, eq=False)
class Body:
    """One solid.

    Attributes:
        owner: The link or object that it belongs to.
        kind: ROBOT, ATTACHED or WORLD.
        link: The link or frame it moves with; None for the world.
        joint: Pinocchio's joint that moves it; 0 for none.
        padding: How far it reaches beyond coal's shape [m].
        may_touch: Links that an attached object may touch.
        geometry_object: Pinocchio's, with coal's shape.
        is_half_space: Whether it is one: it has no bounding ball.
    """

    owner: str
    kind: str
    link: str | None
    joint: int
    padding: float
    may_touch: frozenset[str]
    geometry_object: Any
    is_half_space: bool = False


def bodies(pepper: PepperModel, scene: Scene, looks: str = "collision") -> tuple[Body, ...]:
    """Return all solids: those of the robot, then attached ones, then the world's.

    Raises:
        UnknownNameError: for a frame or link that the robot lacks.
        InvalidValueError: for an object named like a link, or unknown looks.
        FileFormatError: for a mesh whose file cannot be read.
    """
    if looks not in get_args(Looks):
        raise InvalidValueError("looks", repr(looks), f"one of {', '.join(get_args(Looks))}")
    check_names(pepper, scene)
    return (*_robot(pepper, looks), *_attached(pepper, scene), *_world(scene))


def checked_pairs(
    pepper: PepperModel, scene: Scene, solids: tuple[Body, ...], looks: str = "collision"
) -> Iterator[tuple[int, int]]:
    """Yield places of the pairs of solids that are checked, the world's second.

    Not checked are: two solids on one joint (they never move against one another; a base that does not move
    is still checked against the world, because a plan in a wall should be refused), two of the world, pairs
    of links that the SRDF disables, pairs that the scene allows, and an attached object against links that it
    may touch.
    """
    disabled = pepper.semantics.disabled_pairs
    if looks == "visual":
        # Surfaces can tell apart what capsules cannot.
        disabled = {pair: reason for pair, reason in disabled.items() if reason != REASON}
    for i, first in enumerate(solids):
        if first.kind == WORLD:
            break
        for j in range(i + 1, len(solids)):
            second = solids[j]
            pair = (min(first.owner, second.owner), max(first.owner, second.owner))
            if second.kind != WORLD and (first.joint == second.joint or pair in disabled):
                continue
            if pair in scene.allowed or first.owner in second.may_touch:
                continue
            yield i, j


def check_names(pepper: PepperModel, scene: Scene) -> None:
    """Refuse a scene whose names do not fit a robot.

    Raises:
        UnknownNameError: for a frame, link or allowed name that neither robot nor scene has.
        InvalidValueError: for an object named like a link.
    """
    frames = set(pepper.frame_names)
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


def _robot(pepper: PepperModel, looks: str) -> Iterator[Body]:
    shapes = pepper.collision_shapes if looks == "collision" else pepper.visual_shapes
    for shape in shapes:
        link, pose = shape.link, shape.transform_shape_to_link
        yield _body(pepper, shape.name, link, ROBOT, link, pose, shape.geometry)


def _attached(pepper: PepperModel, scene: Scene) -> Iterator[Body]:
    model = pepper.inner_model
    for item in scene.attached.values():
        if is_empty(item.geometry):
            continue
        joint = model.frames[pepper.frame_id(item.frame)].parentJoint
        hand = _hand(pepper, joint)
        held = {shape.link for shape in pepper.collision_shapes if _joint(pepper, shape.link) in hand}
        may_touch = frozenset(held | set(item.touch_links))
        pose, name = item.transform_object_to_frame, item.name
        yield _body(pepper, name, name, ATTACHED, item.frame, pose, item.geometry, may_touch)


def _world(scene: Scene) -> Iterator[Body]:
    import pinocchio

    for item in scene.objects.values():
        if is_empty(item.geometry):
            continue
        placement = pinocchio.SE3(item.transform_object_to_world)
        geometry, half = coal_geometry(item.geometry), isinstance(item.geometry, HalfSpace)
        solid = pinocchio.GeometryObject(f"scene/{item.name}", 0, 0, placement, geometry)
        yield Body(item.name, WORLD, None, 0, padding(item.geometry), frozenset(), solid, half)


def _body(
    pepper: PepperModel,
    name: str,
    owner: str,
    kind: str,
    frame: str,
    pose: np.ndarray,
    geometry: Any,
    may_touch: frozenset[str] = frozenset(),
) -> Body:
    import pinocchio

    index = pepper.frame_id(frame)
    placed = pepper.inner_model.frames[index]
    placement = placed.placement * pinocchio.SE3(pose)
    label = name if kind == ROBOT else f"attached/{name}"
    solid = pinocchio.GeometryObject(label, placed.parentJoint, index, placement, coal_geometry(geometry))
    return Body(owner, kind, frame, placed.parentJoint, padding(geometry), may_touch, solid)


def _hand(pepper: PepperModel, joint: int) -> frozenset[int]:
    """Return the joints of the hand that a joint moves or is part of, by the SRDF's end effectors."""
    model, text = pepper.inner_model, pepper.semantics.text
    for effector in ET.fromstring(text).findall("end_effector") if text else ():
        link = effector.get("parent_link", "")
        wrist = _joint(pepper, link) if link in pepper.frame_names else 0
        if wrist and joint in set(model.subtrees[wrist]):
            return frozenset(model.subtrees[wrist])
    return frozenset()


def _joint(pepper: PepperModel, link: str) -> int:
    return int(pepper.inner_model.frames[pepper.frame_id(link)].parentJoint)
