"""Moving obstacles, compared at the time of each configuration.

To the checks they are attached to the robot: at the ends of chains of six joints from its root link, three
prismatic and three revolute, whose positions are the obstacle's pose.  Verdicts, distances and bounds between
successive configurations are then those of a robot with more joints, by the same code.  Tables of a robot
grow with the second power of its joints, and Pinocchio's working memory with the third; so at most `GROUP`
obstacles are attached to one robot, and further ones to copies of it.
"""

from __future__ import annotations

import copy
import xml.etree.ElementTree as ET
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.arrays import Array
from pepper_kin.collision.scene import Scene
from pepper_kin.collision.scene_object import AttachedObject, SceneObject, sorted_pair
from pepper_kin.collision.solids import SceneGeometry
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel, kept_for_robot
from pepper_kin.model.dynamics_model import MOST_COMPUTED, described
from pepper_kin.model.joint_vectors import as_finite
from pepper_kin.model.urdf_document import parse_urdf

_AXES = ("1 0 0", "0 1 0", "0 0 1", "0 0 1", "0 1 0", "1 0 0")  # x, y, z, then yaw, pitch, roll
_PLACE = len(_AXES)
_FARTHEST = 1e5  # [m]
GROUP = 8
"""Maximum number of obstacles attached to one robot: Pepper then has some three times its own joints."""


@dataclass(frozen=True, eq=False)
class Movers:
    """Moving obstacles of a scene, and the robot with their poses as joints.

    Attributes:
        robot: The robot, of n + 6 k joints.
        scene: The k obstacles, attached to it, and the robot's attached objects.  Nothing else is compared.
        items: The obstacles at time 0.
        columns: Indices among the joints of `robot` of the joints of q, then of the poses, shape (n + 6 k,).
    """

    robot: PepperModel
    scene: Scene
    items: tuple[SceneObject, ...]
    columns: NDArray[np.intp]

    def states(self, q: Array, times: Array) -> Array:
        """Return configurations of `robot`, shape (T, n + 6 k), for q, shape (T, n), at times [s], (T,)."""
        places = np.empty((len(times), len(self.items), _PLACE))
        for k, item in enumerate(self.items):
            straight = item.path is None  # does not rotate
            poses = item.transform_object_to_world[None] if straight else item.poses(times)
            places[:, k, :3] = poses[:, :3, 3]
            if straight:
                places[:, k, :3] += times[:, None] * item.velocity
            places[:, k, 3:] = np.unwrap(_turns(poses), axis=0)
        return self.joined(q, places.reshape(len(times), len(self.items) * _PLACE))

    def joined(self, own: Array, places: Array) -> Array:
        """Return positions of the robot's own joints, shape (T, n), and of poses, (T, 6 k), as one row."""
        found = np.empty((len(own), self.columns.size))
        found[:, self.columns] = np.concatenate([own, places], axis=1)
        return found

    @cached_property
    def uncertainty(self) -> float:
        """Maximum uncertainty of the obstacles [m/s]."""
        return max(item.uncertainty for item in self.items)

    @cached_property
    def speed(self) -> float:
        """Maximum speed of the obstacles [m/s]."""
        return max(item.speed for item in self.items)

    @cached_property
    def alike(self) -> bool:
        """Whether all uncertainties are equal."""
        return len({item.uncertainty for item in self.items}) == 1


def movers_of(pepper: PepperModel, scene: Scene | None) -> tuple[Movers, ...]:
    """Return the moving obstacles of a scene, in groups; an empty tuple if there are none."""
    if scene is None:
        return ()
    held, most = tuple(scene.attached.values()), (MOST_COMPUTED - len(pepper.full_offset)) // _PLACE
    items, size = scene.movers, min(max(most, 1), GROUP)
    groups = (items[k : k + size] for k in range(0, len(items), size))
    return tuple(_group(pepper, group, held, scene.allowed) for group in groups)


def _group(
    pepper: PepperModel,
    items: tuple[SceneObject, ...],
    held: tuple[AttachedObject, ...],
    allowed: frozenset[tuple[str, str]],
) -> Movers:
    """Return obstacles attached to one robot."""
    shapes = tuple((item.name, item.geometry) for item in items)
    robot, scene, columns = _robot_of(pepper, shapes, held, allowed)
    return Movers(robot, scene, items, columns)


def _turns(poses: Array) -> Array:
    """Return yaw, pitch and roll of poses, shape (T, 4, 4), as [rad], shape (T, 3)."""
    pitch = np.arctan2(-poses[:, 2, 0], np.hypot(poses[:, 0, 0], poses[:, 1, 0]))
    yaw, roll = np.arctan2(poses[:, 1, 0], poses[:, 0, 0]), np.arctan2(poses[:, 2, 1], poses[:, 2, 2])
    return np.stack([yaw, pitch, roll], axis=1)


def checked_times(times: ArrayLike, count: int) -> Array:
    """Return the times of configurations [s], one for each, 0 or more.

    Raises:
        InvalidValueError: for negative times, NaN or infinity.
    """
    found = np.broadcast_to(as_finite(times, "times", np.shape(times)), (count,))
    if found.min(initial=0.0) < 0.0:
        raise InvalidValueError("times", float(found.min()), "times of 0 or more [s]")
    return np.array(found)


def without_self_pairs(robot: PepperModel) -> dict[tuple[str, str], str]:
    """Return all pairs of a robot's own links, as disabled pairs."""
    return {sorted_pair(*pair): "Never" for pair in combinations(robot.link_names, 2)}


@kept_for_robot(most=64)
def _robot_of(
    pepper: PepperModel,
    shapes: tuple[tuple[str, SceneGeometry], ...],
    held: tuple[AttachedObject, ...],
    allowed: frozenset[tuple[str, str]],
) -> tuple[PepperModel, Scene, NDArray[np.intp]]:
    """Return a robot with poses of obstacles as joints, the scene in which they are attached, and columns."""
    links, names = pepper.link_names, [name for name, _ in shapes]
    hanging = {
        name: AttachedObject(name, shape, _link(k, _PLACE), np.eye(4))
        for k, (name, shape) in enumerate(shapes)
    }
    own = {item.name: replace(item, touch_links=links) for item in held}
    pairs = [
        pair for pair in allowed if set(pair) <= {*links, *names, *own}
    ]  # all other pairs are with standing obstacles of the world
    pairs += [sorted_pair(*pair) for pair in (*combinations(names, 2), *combinations(own, 2))]
    robot, scene = _with_places(pepper, len(shapes)), Scene(None, {**hanging, **own}, pairs)
    joints = (
        *pepper.joint_names,
        *(_link(k, axis + 1) for k in range(len(shapes)) for axis in range(_PLACE)),
    )
    return robot, scene, np.array([robot.joint_index(name) for name in joints])


@kept_for_robot(most=8)
def _with_places(pepper: PepperModel, count: int) -> PepperModel:
    """Return a robot with chains of joints, one for each obstacle, without self-collision checks."""
    described(pepper)
    root = copy.deepcopy(pepper.document.tree)
    for k in range(count):
        parent = pepper.document.root
        for axis, direction in enumerate(_AXES):
            child = _link(k, axis + 1)
            ET.SubElement(root, "link", name=child)
            joint = ET.SubElement(root, "joint", name=child, type="prismatic" if axis < 3 else "continuous")
            ET.SubElement(joint, "parent", link=parent)
            ET.SubElement(joint, "child", link=child)
            ET.SubElement(joint, "axis", xyz=direction)
            limit = {"lower": f"{-_FARTHEST}", "upper": f"{_FARTHEST}"} if axis < 3 else {}
            ET.SubElement(joint, "limit", {"velocity": "1", "effort": "1", **limit})
            parent = child
    document = parse_urdf(ET.tostring(root, encoding="unicode"), pepper.document.package_dirs)
    semantics = replace(pepper.semantics, disabled_pairs=without_self_pairs(pepper))
    return PepperModel(document, semantics)


def _link(k: int, axis: int) -> str:
    """Return the name of the link at the end of a chain's joint."""
    return f"place of moving object {k}, {axis}"
