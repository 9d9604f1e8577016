"""The planning scene, with the topics and services of MoveIt's clients."""

from __future__ import annotations

import itertools
import logging
import threading
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.collision import ConvexMesh, Scene, TriangleMesh
from pepper_kin.exceptions import InvalidValueError, PepperKinError, UnknownNameError
from pepper_kin.model import Box, Cylinder, Sphere
from pepper_kin.model.poses import rpy_of
from pepper_kin.ros.commands import world_pose
from pepper_kin.ros.message_parts import POINT, header, pose_message, pose_of
from pepper_kin.ros.qos import LATCHED
from pepper_kin.ros_messages import message_type

if TYPE_CHECKING:
    from pepper_kin.ros.node import RobotNode

logger = logging.getLogger(__name__)

_SOLID: Any = message_type("shape_msgs/msg/SolidPrimitive")
_OBJECT: Any = message_type("moveit_msgs/msg/CollisionObject")
_ATTACHED: Any = message_type("moveit_msgs/msg/AttachedCollisionObject")
_SCENE: Any = message_type("moveit_msgs/msg/PlanningScene")

WORLD = "world"


class PlanningScene:
    """Updates the scene of the simulated body from messages.

    A message is applied completely or not at all: a refused message is logged, and `success` is False.  An
    object of one shape has its own name in the scene; the parts of an object of several shapes are
    `name/number`.

    Args:
        node: The node.
    """

    def __init__(self, node: RobotNode) -> None:
        self.node, self._one = node, threading.Lock()
        self._places: dict[str, Array] = {}  # object of a message -> its pose, shape (4, 4)
        apply, ask = "moveit_msgs/srv/ApplyPlanningScene", "moveit_msgs/srv/GetPlanningScene"
        self._answers = message_type(f"{apply}_Response"), message_type(f"{ask}_Response")
        node.offer_service("/apply_planning_scene", apply, self.on_apply)
        node.offer_service("/get_planning_scene", ask, lambda _: self._answers[1](scene=self.message()))
        node.listen("/planning_scene", _SCENE.type_name, self._on_scene)
        node.listen("/collision_object", _OBJECT.type_name, self._on_object)
        node.listen("/attached_collision_object", _ATTACHED.type_name, self._on_attached)
        self._published = node.advertise("/monitored_planning_scene", _SCENE.type_name, LATCHED)
        self._published.publish(self.message())

    def on_apply(self, request: Any) -> Any:
        """Apply a scene; return moveit_msgs/srv/ApplyPlanningScene_Response."""
        return self._answers[0](success=self.take(request.scene))

    def _on_scene(self, message: Any) -> None:
        self.take(message)

    def _on_object(self, message: Any) -> None:
        scene = _SCENE(is_diff=True)
        scene.world.collision_objects = [message]
        self.take(scene)

    def _on_attached(self, message: Any) -> None:
        scene = _SCENE(is_diff=True)
        scene.robot_state.attached_collision_objects = [message]
        self.take(scene)

    def take(self, message: Any) -> bool:
        """Change the scene by a moveit_msgs/msg/PlanningScene; return whether it was accepted."""
        body = self.node.body
        with self._one:
            before = dict(self._places)
            try:
                scene = (body.scene or Scene()) if message.is_diff else Scene()
                for one in message.world.collision_objects:
                    scene = self._changed(scene, one)
                for one in message.robot_state.attached_collision_objects:
                    scene = self._attached(scene, one)
                scene = _allowed(scene, message.allowed_collision_matrix)
            except (PepperKinError, ValueError, IndexError) as error:
                logger.warning("planning scene: refused: %s", error)
                self._places = before
                return False
            with body.time.lock:
                body.scene = scene
        self._published.publish(self.message())
        return True

    def _changed(self, scene: Scene, message: Any) -> Scene:
        """Return a scene with an object added, extended, moved or removed."""
        name, operation = str(message.id), int(message.operation)
        parts = _parts(scene, name)
        if operation == _OBJECT.REMOVE:
            for part in parts if name else tuple(scene.objects):
                scene = scene.remove(part)
            self._places.pop(name, None)
            return scene
        if not name:
            raise InvalidValueError("id of a collision object", repr(name), "a name")
        place = world_pose(self.node, message) if str(message.header.frame_id) else pose_of(message.pose)
        if operation == _OBJECT.MOVE:
            if not parts:
                raise UnknownNameError("collision object", name, scene.objects)
            old = self._places.get(name, scene.objects[parts[0]].transform_object_to_world)
            self._places[name] = place
            for part in parts:
                moved = place @ np.linalg.inv(old) @ scene.objects[part].transform_object_to_world
                scene = scene.move(part, moved[:3, 3], rpy_of(moved[:3, :3]))
            return scene
        kept = []
        if operation == _OBJECT.APPEND:
            kept = [(scene.objects[p].geometry, scene.objects[p].transform_object_to_world) for p in parts]
        for part in parts:
            scene = scene.remove(part)
        self._places[name] = place
        shapes = kept + [(shape, place @ pose_of(at)) for shape, at in _shapes(message)]
        for k, (shape, at) in enumerate(shapes):
            part = name if len(shapes) == 1 else f"{name}/{k}"
            scene = scene.add(part, shape, at[:3, 3], rpy_of(at[:3, :3]))
        return scene

    def _attached(self, scene: Scene, message: Any) -> Scene:
        """Return a scene with an object attached to a link of the robot, or released."""
        body, name, link = self.node.body, str(message.object.id), str(message.link_name)
        with body.time.lock:
            q = body.configuration(True)
        if int(message.object.operation) == _OBJECT.REMOVE:
            hanging = [part for part in scene.attached if _is_part(part, name) or not name]
            for part in hanging:
                scene = scene.release(body.pepper, part, q)
            return scene
        if message.object.primitives or message.object.meshes or message.object.planes:
            scene = self._changed(scene, message.object)
        parts = _parts(scene, name)
        if not parts:
            raise UnknownNameError("collision object", name, scene.objects)
        touching, mass = [str(other) for other in message.touch_links], float(message.weight) / len(parts)
        for part in parts:
            scene = scene.attach(
                part, link, pepper=body.pepper, q=q, touch_links=touching, mass=max(mass, 0.0)
            )
        return scene

    def message(self) -> Any:
        """Return the scene as moveit_msgs/msg/PlanningScene."""
        body = self.node.body
        with body.time.lock:
            scene, q = body.scene or Scene(), body.configuration(True)
        made = _SCENE(name="pepper_kin", robot_model_name=body.pepper.name)
        standing = {
            name: (one.geometry, one.transform_object_to_world) for name, one in scene.objects.items()
        }
        made.world.collision_objects = self._objects(standing)
        for name in scene.attached:
            one = scene.attached[name]
            there = scene.release(body.pepper, name, q).objects[name]
            messages = self._objects({name: (there.geometry, there.transform_object_to_world)})
            made.robot_state.attached_collision_objects += [
                _ATTACHED(link_name=one.frame, object=each, touch_links=sorted(one.touch_links))
                for each in messages
            ]
        names = sorted({name for pair in scene.allowed for name in pair})
        matrix = made.allowed_collision_matrix
        matrix.entry_names = names
        entry = message_type("moveit_msgs/msg/AllowedCollisionEntry")
        pairs = {frozenset(pair) for pair in scene.allowed}
        matrix.entry_values = [entry(enabled=[frozenset((a, b)) in pairs for b in names]) for a in names]
        return made

    def _objects(self, shapes: dict[str, tuple[Any, Array]]) -> list[Any]:
        """Return moveit_msgs/msg/CollisionObject of shapes by name; shapes that MoveIt lacks are left out."""
        made: dict[str, Any] = {}
        for part, (shape, at) in shapes.items():
            name = next((one for one in self._places if _is_part(part, one)), part)
            place = self._places.get(name, at)
            one = made.setdefault(
                name, _OBJECT(id=name, header=header(self.node.now, WORLD), pose=pose_message(place))
            )
            if not _tell(one, shape, pose_message(np.linalg.inv(place) @ at)):
                logger.info("planning scene: %s has a shape that is not sent", part)
        return [one for one in made.values() if one.primitives or one.meshes]


def _is_part(part: str, name: str) -> bool:
    return part == name or part.startswith(f"{name}/")


def _parts(scene: Scene, name: str) -> list[str]:
    return [part for part in scene.objects if _is_part(part, name)]


def _shapes(message: Any) -> list[tuple[Any, Any]]:
    """Return the shapes of an object with the messages of their poses.

    Raises:
        InvalidValueError: for cones, prisms and planes, or if the numbers of poses and shapes differ.
    """
    found = []
    for kind, shapes, poses in (
        ("primitives", message.primitives, message.primitive_poses),
        ("meshes", message.meshes, message.mesh_poses),
    ):
        places: Sequence[Any] = poses or [message_type("geometry_msgs/msg/Pose")()] * len(shapes)
        if len(places) != len(shapes):
            raise InvalidValueError(f"poses of {kind}", len(places), f"{len(shapes)}, one of each")
        found += [(_shape(shape), at) for shape, at in zip(shapes, places, strict=True)]
    if message.planes or not found:
        raise InvalidValueError(
            f"shapes of {message.id!r}", "planes or none", "boxes, spheres, ... or meshes"
        )
    return found


def _shape(message: Any) -> Any:
    """Convert a SolidPrimitive or a Mesh to a shape."""
    if hasattr(message, "vertices"):
        vertices = np.array([[p.x, p.y, p.z] for p in message.vertices]).reshape(-1, 3)
        faces = np.array([[*one.vertex_indices] for one in message.triangles], dtype=int).reshape(-1, 3)
        return TriangleMesh(vertices, faces)
    size = [float(value) for value in message.dimensions]
    kinds = {_SOLID.BOX: 3, _SOLID.SPHERE: 1, _SOLID.CYLINDER: 2}
    if kinds.get(int(message.type)) != len(size):
        raise InvalidValueError(
            "solid primitive", (int(message.type), size), "a box (x, y, z), a sphere (r) or a cylinder (h, r)"
        )
    if len(size) == 3:
        return Box((size[0], size[1], size[2]))
    return Sphere(size[0]) if len(size) == 1 else Cylinder(size[1], size[0])


def _tell(message: Any, shape: Any, at: Any) -> bool:
    """Add a shape to a CollisionObject; return whether the message supports it."""
    if isinstance(shape, Box | Sphere | Cylinder):
        kind, size = _SOLID.BOX, list(getattr(shape, "size", ()))
        if isinstance(shape, Sphere):
            kind, size = _SOLID.SPHERE, [shape.radius]
        elif isinstance(shape, Cylinder):
            kind, size = _SOLID.CYLINDER, [shape.length, shape.radius]
        message.primitives += [_SOLID(type=kind, dimensions=size)]
        message.primitive_poses += [at]
        return True
    if not isinstance(shape, ConvexMesh | TriangleMesh):
        return False
    triangle = message_type("shape_msgs/msg/MeshTriangle")
    mesh: Any = message_type("shape_msgs/msg/Mesh")()
    mesh.vertices = [POINT(x=x, y=y, z=z) for x, y, z in shape.vertices.tolist()]
    mesh.triangles = [triangle(vertex_indices=face) for face in shape.faces.tolist()]
    message.meshes += [mesh]
    message.mesh_poses += [at]
    return True


def _allowed(scene: Scene, matrix: Any) -> Scene:
    """Return a scene with the allowed collisions of a matrix, of pairs with an object of the scene."""
    names = [str(name) for name in matrix.entry_names]
    rows = [list(one.enabled) for one in matrix.entry_values]
    if [len(row) for row in rows] != [len(names)] * len(names):
        raise InvalidValueError("allowed_collision_matrix", "rows of other lengths", f"{len(names)} each")
    for (i, one), (j, other) in itertools.combinations(enumerate(names), 2):
        known = next((name for name in (one, other) if name in scene.names), None)
        if rows[i][j] and known is not None:
            scene = scene.allow(known, other if known == one else one)
    return scene
