"""The subset of `pybullet` that programs for qiBullet use: bodies around the robot, joints, quaternions.

Bodies become obstacles of the simulation's scene: cameras and lasers detect them, and the base stops before
them.  They cannot be pushed; a body that is not fixed keeps its pose, lowered to the floor.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pepper_kin import collision, ik
from pepper_kin.arrays import Array
from pepper_kin.collision import Scene
from pepper_kin.exceptions import PepperKinError, shortened
from pepper_kin.model import (
    Box,
    Capsule,
    Cylinder,
    Sphere,
    pose,
    quaternion_from_rotation,
    rotation_from_quaternion,
    rotation_from_rpy,
)
from pepper_kin.model.poses import rpy_of
from pepper_kin.qibullet import simulation
from pepper_kin.qibullet.bodies import Standing, lowest, scaled
from pepper_kin.qibullet.errors import BulletError, SimulationError, UnsimulatedError
from pepper_kin.qibullet.pepper_virtual import PepperVirtual
from pepper_kin.qibullet.pybullet_data import FLOORS, OBJECTS
from pepper_kin.qibullet.simulation import Simulation, simulation_of

error = BulletError

CONSTANTS = {
    "GUI": 1, "DIRECT": 2, "SHARED_MEMORY": 3, "UDP": 4, "TCP": 5, "GUI_SERVER": 7,
    "GEOM_SPHERE": 2, "GEOM_BOX": 3, "GEOM_CYLINDER": 4, "GEOM_MESH": 5, "GEOM_PLANE": 6, "GEOM_CAPSULE": 7,
    "JOINT_REVOLUTE": 0, "JOINT_PRISMATIC": 1, "JOINT_SPHERICAL": 2, "JOINT_PLANAR": 3, "JOINT_FIXED": 4,
    "VELOCITY_CONTROL": 0, "TORQUE_CONTROL": 1, "POSITION_CONTROL": 2,
    "COV_ENABLE_GUI": 1, "COV_ENABLE_SHADOWS": 2, "COV_ENABLE_WIREFRAME": 3,
    "COV_ENABLE_MOUSE_PICKING": 10, "COV_ENABLE_RENDERING": 7, "COV_ENABLE_KEYBOARD_SHORTCUTS": 9,
    "COV_ENABLE_RGB_BUFFER_PREVIEW": 13, "COV_ENABLE_DEPTH_BUFFER_PREVIEW": 14,
    "COV_ENABLE_SEGMENTATION_MARK_PREVIEW": 15,
    "URDF_USE_SELF_COLLISION": 8, "URDF_USE_MATERIAL_COLORS_FROM_MTL": 32768,
    "WORLD_FRAME": 2, "LINK_FRAME": 1, "KEY_IS_DOWN": 1, "KEY_WAS_TRIGGERED": 2, "KEY_WAS_RELEASED": 4,
    "B3G_LEFT_ARROW": 65295, "B3G_RIGHT_ARROW": 65296, "B3G_UP_ARROW": 65297, "B3G_DOWN_ARROW": 65298,
    "B3G_RETURN": 65309, "B3G_SHIFT": 65306,
}  # fmt: skip
"""Constants of pybullet."""

globals().update(CONSTANTS)

JOINT_TYPES = {"revolute": 0, "continuous": 0, "prismatic": 1, "fixed": 4}

Place = tuple[tuple[float, ...], ...]
"""Pose: position [m] and quaternion x, y, z, w."""

ORIGIN, UPRIGHT = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)

_PATHS: list[Path] = []
_SLIDERS: dict[int, float] = {}
_SHAPES: dict[int, Any] = {}
_NUMBERS = itertools.count()


ACCEPTED = (
    "setTimeStep", "setPhysicsEngineParameter", "configureDebugVisualizer", "resetDebugVisualizerCamera",
    "setCollisionFilterPair", "setCollisionFilterGroupMask", "changeDynamics", "changeVisualShape",
    "removeAllUserDebugItems", "removeUserDebugItem", "resetBaseVelocity", "startStateLogging",
    "stopStateLogging",
)  # fmt: skip
"""Functions that are accepted and ignored."""

DRAWN = ("addUserDebugLine", "addUserDebugText", "loadTexture")
"""Functions that only return a number; nothing is drawn."""


def __getattr__(name: str) -> Callable[..., Any]:
    """Return functions that do nothing, or that raise UnsimulatedError when called.

    Raises:
        AttributeError: for names that are no functions.
    """
    if name.startswith("_") or not name[0].islower():
        raise AttributeError(f"module 'pybullet' has no attribute {name!r} here")

    if name in ACCEPTED:
        return lambda *_, **__: None
    if name in DRAWN:
        return lambda *_, **__: next(_NUMBERS)

    def refuse(*_: Any, **__: Any) -> Any:
        raise UnsimulatedError(f"pybullet.{name}", "see docs/qibullet.md for what is")

    return refuse


def _forget() -> None:
    """Remove search paths, sliders and shapes of an ended program."""
    for known in (_PATHS, _SLIDERS, _SHAPES):
        known.clear()


# Simulations.


def connect(method: int = 2, *_: Any, **__: Any) -> int:
    """Start a simulation, advanced by `stepSimulation`; return its number.  `GUI` opens a page per robot."""
    return simulation.launch(False, method == CONSTANTS["GUI"], None).client


def disconnect(physicsClientId: int = 0) -> None:
    """End a simulation."""
    simulation.end(physicsClientId)


def isConnected(physicsClientId: int = 0) -> int:
    """Return whether a simulation runs."""
    return int(simulation.running(physicsClientId) is not None)


def setRealTimeSimulation(enable: int, physicsClientId: int = 0) -> None:
    """Set whether the wall clock drives robots that are loaded from now on."""
    simulation_of(physicsClientId).auto_step = bool(enable)


def stepSimulation(physicsClientId: int = 0) -> None:
    """Advance the simulation by 1/240 s."""
    simulation_of(physicsClientId).step()


def setGravity(x: float, y: float, z: float, physicsClientId: int = 0) -> None:
    """Set the gravity that acts on the links [m/s^2]."""
    simulation_of(physicsClientId).set_gravity([float(x), float(y), float(z)])


def resetSimulation(*_: Any, physicsClientId: int = 0) -> None:
    """Remove all robots, bodies and the scene."""
    found = simulation_of(physicsClientId)
    found.clear()
    found.bodies.clear()
    found.set_scene(None)


# Bodies.


def setAdditionalSearchPath(path: str, physicsClientId: int = 0) -> None:
    """Add a folder to the search path of descriptions."""
    _PATHS.append(Path(path))


def loadURDF(
    fileName: str,
    basePosition: Sequence[float] = ORIGIN,
    baseOrientation: Sequence[float] = UPRIGHT,
    useMaximalCoordinates: int = 0,
    useFixedBase: int = 0,
    flags: int = 0,
    globalScaling: float = 1.0,
    physicsClientId: int = 0,
) -> int:
    """Add a body to the scene; return its number.

    Floors exist already.  A missing file of `pybullet_data` is replaced by a shape of its size.

    Args:
        fileName: URDF file, in a folder of `setAdditionalSearchPath` or below the present one.
        basePosition: Position of the root link [m], shape (3,).
        baseOrientation: Quaternion x, y, z, w of the root link.
        useMaximalCoordinates: Ignored.
        useFixedBase: Whether the body is fixed; otherwise it is lowered to the floor.
        flags: Ignored.
        globalScaling: Scale of the body's size.
        physicsClientId: Number of the simulation.

    Raises:
        SimulationError: for a file that is not found or is no valid description.
    """
    found = simulation_of(physicsClientId)
    path = Path(str(fileName).replace("\\", "/"))
    if path.name in FLOORS:
        return found.new_number()
    base = pose(basePosition, quaternion_xyzw=_unit(baseOrientation))
    files = [one for one in (path, *(folder / path for folder in _PATHS)) if one.is_file()]
    known = OBJECTS.get(path.name)
    if not files and known is None:
        raise SimulationError(f"loadURDF: there is no file {shortened(repr(fileName))}")
    try:
        objects = Scene().add_urdf("body", files[0]).objects.values() if files else ()
        parts = [(one.geometry, np.array(one.transform_object_to_world)) for one in objects]
        if known is not None and not files:
            parts = [(known[0], pose(known[1]))]
        parts = [scaled(shape, place, float(globalScaling)) for shape, place in parts]
    except PepperKinError as wrong:
        raise SimulationError(f"loadURDF: {wrong}") from wrong
    return _put(found, parts, base, bool(useFixedBase))


def loadMJCF(mjcfFileName: str, *_: Any, physicsClientId: int = 0, **__: Any) -> tuple[int, ...]:
    """Accept the ground plane, which exists already; return its number.

    Raises:
        UnsimulatedError: for other files.
    """
    if "ground_plane" not in str(mjcfFileName):
        raise UnsimulatedError("pybullet.loadMJCF", "bodies come from URDF files")
    return (simulation_of(physicsClientId).new_number(),)


def createCollisionShape(
    shapeType: int,
    radius: float = 0.5,
    halfExtents: Sequence[float] = (1.0, 1.0, 1.0),
    height: float = 1.0,
    *_: Any,
    **others: Any,
) -> int:
    """Create a sphere, a box, a cylinder or a capsule [m] for `createMultiBody`; return its number.

    Raises:
        UnsimulatedError: for other shapes.
    """
    x, y, z = halfExtents
    kinds: dict[int, Callable[[], Any]] = {
        CONSTANTS["GEOM_SPHERE"]: lambda: Sphere(radius),
        CONSTANTS["GEOM_BOX"]: lambda: Box((2.0 * float(x), 2.0 * float(y), 2.0 * float(z))),
        CONSTANTS["GEOM_CYLINDER"]: lambda: Cylinder(radius, others.get("length", height)),
        CONSTANTS["GEOM_CAPSULE"]: lambda: Capsule(radius, others.get("length", height)),
    }
    if shapeType not in kinds:
        raise UnsimulatedError("this shape of pybullet", "there are spheres, boxes, cylinders and capsules")
    number = next(_NUMBERS)
    _SHAPES[number] = kinds[shapeType]()
    return number


def createVisualShape(*_: Any, **__: Any) -> int:
    """Return -1: the collision shape is the visual shape, too."""
    return -1


def createMultiBody(
    baseMass: float = 0.0,
    baseCollisionShapeIndex: int = -1,
    baseVisualShapeIndex: int = -1,
    basePosition: Sequence[float] = ORIGIN,
    baseOrientation: Sequence[float] = UPRIGHT,
    *_: Any,
    physicsClientId: int = 0,
    **__: Any,
) -> int:
    """Add a body of one shape to the scene, fixed if its mass [kg] is 0; return its number.

    Raises:
        SimulationError: for an unknown shape.
    """
    if baseCollisionShapeIndex not in (-1, *_SHAPES):
        raise SimulationError(
            f"createMultiBody: there is no shape {shortened(repr(baseCollisionShapeIndex))}"
        )
    parts = [(_SHAPES[baseCollisionShapeIndex], np.eye(4))] if baseCollisionShapeIndex >= 0 else []
    base = pose(basePosition, quaternion_xyzw=_unit(baseOrientation))
    return _put(simulation_of(physicsClientId), parts, base, baseMass == 0.0)


def removeBody(bodyUniqueId: int, physicsClientId: int = 0) -> None:
    """Remove a body or a robot."""
    found = simulation_of(physicsClientId)
    if bodyUniqueId in found.robots:
        found.remove(bodyUniqueId)
    else:
        found.body(bodyUniqueId)
        del found.bodies[bodyUniqueId]
        found.show_bodies()


def getNumBodies(physicsClientId: int = 0) -> int:
    """Return the number of bodies and robots."""
    found = simulation_of(physicsClientId)
    return len(found.bodies) + len(found.robots)


def getBasePositionAndOrientation(bodyUniqueId: int, physicsClientId: int = 0) -> Place:
    """Return position [m] and quaternion x, y, z, w of the root link of a body or a robot."""
    found = simulation_of(physicsClientId)
    if bodyUniqueId in found.robots:
        x, y, yaw = found.robots[bodyUniqueId].getPosition()
        return (x, y, 0.0), getQuaternionFromEuler((0.0, 0.0, yaw))
    return _place_of(found.body(bodyUniqueId).base)


def resetBasePositionAndOrientation(
    bodyUniqueId: int, posObj: Sequence[float], ornObj: Sequence[float], physicsClientId: int = 0
) -> None:
    """Teleport a body, or a robot, which stays upright on the floor."""
    found = simulation_of(physicsClientId)
    if bodyUniqueId in found.robots:
        body = found.robots[bodyUniqueId].body
        with body.time.lock:
            body.place_base(np.array(simulation.pose_on_floor((*posObj[:2], 0.0), _upright(ornObj))))
        return
    found.body(bodyUniqueId).base = pose(posObj, quaternion_xyzw=_unit(ornObj))
    found.show_bodies()


# Joints and links of the robot.


def getNumJoints(bodyUniqueId: int, physicsClientId: int = 0) -> int:
    """Return the number of a robot's joints, including fixed ones; 0 for a body."""
    robot = simulation_of(physicsClientId).robots.get(bodyUniqueId)
    return 0 if robot is None else len(robot.link_dict) - 1


def getJointInfo(bodyUniqueId: int, jointIndex: int, physicsClientId: int = 0) -> tuple[Any, ...]:
    """Return number, name, type, -1, -1, 0, damping, friction, limits, effort, velocity and link of a joint.

    Of pybullet's further values, axis and pose in the parent are placeholders; the parent's number is set.
    """
    robot, entry = _joint_entry(bodyUniqueId, jointIndex, physicsClientId)
    link = robot.link_dict[entry.child]
    moves = entry.type != "fixed"
    limits = (entry.lower, entry.upper, entry.effort, entry.velocity) if moves else (0.0, -1.0, 0.0, 0.0)
    return (
        jointIndex, entry.name.encode(), JOINT_TYPES.get(entry.type, 4), -1, -1, 0,
        entry.damping, entry.friction, *limits, entry.child.encode(),
        ORIGIN, ORIGIN, UPRIGHT, link.parent_index,
    )  # fmt: skip


def getJointState(bodyUniqueId: int, jointIndex: int, physicsClientId: int = 0) -> tuple[Any, ...]:
    """Return position, velocity, six zeros and 0 of a joint; only zeros for a fixed joint."""
    robot, entry = _joint_entry(bodyUniqueId, jointIndex, physicsClientId)
    if entry.name not in robot.joint_dict:
        return 0.0, 0.0, (0.0,) * 6, 0.0
    position, velocity = robot.getAnglesPosition(entry.name), robot.getAnglesVelocity(entry.name)
    return position, velocity, (0.0,) * 6, 0.0


def getJointStates(
    bodyUniqueId: int, jointIndices: Sequence[int], physicsClientId: int = 0
) -> tuple[Any, ...]:
    """Return `getJointState` of each of several joints."""
    return tuple(getJointState(bodyUniqueId, one, physicsClientId) for one in jointIndices)


def setJointMotorControl2(
    bodyUniqueId: int, jointIndex: int, controlMode: int, *_: Any, physicsClientId: int = 0, **named: Any
) -> None:
    """Command a joint to `targetPosition` [rad].

    Raises:
        UnsimulatedError: for velocity or torque control.
    """
    if controlMode != CONSTANTS["POSITION_CONTROL"]:
        raise UnsimulatedError("control of joints by velocity or torque", "they go to positions")
    robot, entry = _joint_entry(bodyUniqueId, jointIndex, physicsClientId)
    robot.setAngles(entry.name, float(named.get("targetPosition", 0.0)), 1.0)


def setJointMotorControlArray(
    bodyUniqueId: int,
    jointIndices: Sequence[int],
    controlMode: int,
    *_: Any,
    physicsClientId: int = 0,
    **named: Any,
) -> None:
    """Command joints to `targetPositions` [rad]; see `setJointMotorControl2`."""
    targets = named.get("targetPositions", [0.0] * len(jointIndices))
    for index, target in zip(jointIndices, targets, strict=True):
        setJointMotorControl2(
            bodyUniqueId, index, controlMode, targetPosition=target, physicsClientId=physicsClientId
        )


def getLinkState(
    bodyUniqueId: int, linkIndex: int, *_: Any, physicsClientId: int = 0, **__: Any
) -> tuple[Any, ...]:
    """Return position [m] and quaternion of a link, a zero offset, and both again."""
    robot = simulation_of(physicsClientId).robot(bodyUniqueId)
    names = {link.index: name for name, link in robot.link_dict.items()}
    if linkIndex not in names:
        raise SimulationError(f"link: got {shortened(repr(linkIndex))}, expected 0 to {len(names) - 2}")
    position, quaternion = (tuple(part) for part in robot.getLinkPosition(names[linkIndex]))
    return position, quaternion, ORIGIN, UPRIGHT, position, quaternion


def calculateInverseKinematics(
    bodyUniqueId: int,
    endEffectorLinkIndex: int,
    targetPosition: Sequence[float],
    targetOrientation: Sequence[float] | None = None,
    *_: Any,
    physicsClientId: int = 0,
    **__: Any,
) -> tuple[float, ...]:
    """Return positions of all movable joints, in order, that bring a link to a pose, or near it.

    The base does not move; unlike in Bullet, the positions respect the joint limits.
    """
    robot = simulation_of(physicsClientId).robot(bodyUniqueId)
    body, link = robot.body, getJointInfo(bodyUniqueId, endEffectorLinkIndex, physicsClientId)[12].decode()
    target: Any = ik.FramePosition(link, targetPosition)
    if targetOrientation is not None:
        target = ik.FramePose(link, pose(targetPosition, quaternion_xyzw=_unit(targetOrientation)))
    solution = ik.solve(
        body.pepper, target, body.configuration(True), joints=[*body.index], collisions=False, restarts=0
    )
    found = {name: float(solution.q[body.pepper.joint_index(name)]) for name in body.index}
    return tuple(found[name] for name in robot.joint_dict if name in found)


def getContactPoints(
    bodyA: int = -1, bodyB: int = -1, linkIndexA: int = -2, linkIndexB: int = -2, physicsClientId: int = 0
) -> tuple[tuple[Any, ...], ...]:
    """Return contacts of a robot with itself or bodies: 0, bodies, links, points, normal, distance, zeros."""
    found = simulation_of(physicsClientId)
    contacts = []
    for model, robot in found.robots.items():
        with robot.body.time.lock:
            q = robot.body.configuration(True)
        for one in collision.contacts(robot.body.pepper, q, found.scene):
            ends = [_end_of(found, model, robot, name) for name in one.names]
            if one.points is None or one.normal is None:
                continue
            ends, points, normal = ends, one.points, one.normal
            if bodyA not in (-1, ends[0][0]) or bodyB not in (-1, ends[1][0]):
                ends, points, normal = ends[::-1], points[::-1], -normal
            wanted = ((bodyA, linkIndexA), (bodyB, linkIndexB))
            if all(w[0] in (-1, e[0]) and w[1] in (-2, e[1]) for w, e in zip(wanted, ends, strict=True)):
                (a, link_a), (b, link_b) = ends
                on_a, on_b = (tuple(map(float, point)) for point in points)
                contacts.append(
                    (0, a, b, link_a, link_b, on_a, on_b, tuple(map(float, -normal)), one.distance, 0.0,
                     0.0, ORIGIN, 0.0, ORIGIN)
                )  # fmt: skip
    return tuple(contacts)


# Sliders and events of Bullet's window, which does not exist.


def addUserDebugParameter(
    paramName: str,
    rangeMin: float = 0.0,
    rangeMax: float = 1.0,
    startValue: float = 0.0,
    physicsClientId: int = 0,
) -> int:
    """Create a slider, which keeps its initial value; return its number."""
    number = next(_NUMBERS)
    _SLIDERS[number] = float(startValue)
    return number


def readUserDebugParameter(itemUniqueId: int, physicsClientId: int = 0) -> float:
    """Return the initial value of a slider.

    Raises:
        SimulationError: for an unknown slider.
    """
    if itemUniqueId not in _SLIDERS:
        raise SimulationError(f"readUserDebugParameter: there is no slider {shortened(repr(itemUniqueId))}")
    return _SLIDERS[itemUniqueId]


def getKeyboardEvents(physicsClientId: int = 0) -> dict[int, int]:
    """Return an empty dictionary: no keys are pressed."""
    return {}


def getMouseEvents(physicsClientId: int = 0) -> tuple[Any, ...]:
    """Return an empty tuple: there are no mouse events."""
    return ()


# Quaternions x, y, z, w.


def getQuaternionFromEuler(eulerAngles: Sequence[float], physicsClientId: int = 0) -> tuple[float, ...]:
    """Return the quaternion of roll, pitch and yaw about fixed axes [rad]."""
    return tuple(map(float, quaternion_from_rotation(rotation_from_rpy(eulerAngles))))


def getEulerFromQuaternion(quaternion: Sequence[float], physicsClientId: int = 0) -> tuple[float, ...]:
    """Return roll, pitch and yaw about fixed axes [rad]."""
    return tuple(map(float, rpy_of(rotation_from_quaternion(_unit(quaternion)))))


def getMatrixFromQuaternion(quaternion: Sequence[float], physicsClientId: int = 0) -> tuple[float, ...]:
    """Return the nine numbers of the rotation matrix, row by row."""
    return tuple(map(float, rotation_from_quaternion(_unit(quaternion)).ravel()))


def multiplyTransforms(
    positionA: Sequence[float],
    orientationA: Sequence[float],
    positionB: Sequence[float],
    orientationB: Sequence[float],
    physicsClientId: int = 0,
) -> Place:
    """Return position [m] and quaternion of the product of two transforms."""
    first = pose(positionA, quaternion_xyzw=_unit(orientationA))
    return _place_of(first @ pose(positionB, quaternion_xyzw=_unit(orientationB)))


def invertTransform(position: Sequence[float], orientation: Sequence[float]) -> Place:
    """Return position [m] and quaternion of the inverse of a transform."""
    return _place_of(np.asarray(np.linalg.inv(pose(position, quaternion_xyzw=_unit(orientation)))))


def _unit(quaternion: Sequence[float]) -> Array:
    q = np.array(simulation.numbers(quaternion, "quaternion", 4, "1"))
    length = float(np.linalg.norm(q))
    if length < 1e-9:
        raise SimulationError(f"quaternion: got {shortened(repr(quaternion))}, expected one of length 1")
    return q / length


def _upright(quaternion: Sequence[float]) -> tuple[float, ...]:
    return getQuaternionFromEuler((0.0, 0.0, getEulerFromQuaternion(quaternion)[2]))


def _place_of(place: Array) -> Place:
    position, quaternion = place[:3, 3], quaternion_from_rotation(place[:3, :3])
    return tuple(map(float, position)), tuple(map(float, quaternion))


def _put(found: Simulation, parts: list[tuple[Any, Array]], base: Array, fixed: bool) -> int:
    """Add a body at a pose, lowered to the floor unless fixed; return its number."""
    if not fixed and parts and found.gravity[2] < 0.0:
        least = min(lowest(shape, base @ place) for shape, place in parts)
        base = pose((0.0, 0.0, -max(least, 0.0))) @ base
    number = found.new_number()
    found.bodies[number] = Standing(base, parts)
    found.show_bodies()
    return number


def _joint_entry(number: int, index: int, client: int) -> tuple[PepperVirtual, Any]:
    """Return a robot and a joint's entry in its description.

    Raises:
        SimulationError: for an unknown robot or joint.
    """
    robot = simulation_of(client).robot(number)
    children = {link.index: name for name, link in robot.link_dict.items() if link.index >= 0}
    if index not in children:
        got = shortened(repr(index))
        raise SimulationError(f"joint: got {got}, expected 0 to {len(children) - 1}")
    entries = robot.body.pepper.document.joints
    return robot, next(entry for entry in entries if entry.child == children[index])


def _end_of(found: Simulation, model: int, robot: PepperVirtual, name: str) -> tuple[int, int]:
    """Return the numbers of the body or robot, and of the link, of a name in a contact."""
    body = next((k for k in found.bodies if name.startswith(f"body {k}/")), None)
    if body is not None:
        return body, -1
    return model, robot.link_dict[name].index if name in robot.link_dict else -1
