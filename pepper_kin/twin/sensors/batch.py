"""Readings of the sensors of many robots, without noise."""

from __future__ import annotations

import copy
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.arrays import Array
from pepper_kin.collision import Scene, in_collision
from pepper_kin.collision.movers import Movers, movers_of, without_self_pairs
from pepper_kin.collision.scene_object import AttachedObject
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.kinematics import frame_acceleration, frame_pose, frame_velocity
from pepper_kin.model import Box, PepperModel, kept_for_robot
from pepper_kin.model.dynamics_model import described
from pepper_kin.model.joint_vectors import as_joint_vectors
from pepper_kin.model.poses import rpy_of
from pepper_kin.model.urdf_document import parse_urdf
from pepper_kin.twin.sensors.camera import Intrinsics, camera_intrinsics
from pepper_kin.twin.sensors.range_sensors import cone, fan
from pepper_kin.twin.sensors.raycast import RayCaster, Rays
from pepper_kin.twin.sensors.specification import SensorSpecification, sensor_specifications

if TYPE_CHECKING:
    from pepper_kin.twin.batch_world import BatchBodies

_COARSE = 5
_MOVING = np.array([1.0, 0.0, 0.0])  # [m/s] of bodies whose places are given: at any speed they are joints


class BatchRanges:
    """Lasers and sonars of N robots in one scene; the robots themselves are not seen.

    Args:
        pepper: The robot.
        scene: What stands around it.
        names: Of the sensors, such as "laser_front" or "sonar_front"; the lasers if omitted.
        floor: Whether there is a floor at z = 0 besides what the scene holds.

    Raises:
        UnknownNameError: for a sensor or a frame that there is not.
    """

    def __init__(
        self, pepper: PepperModel, scene: Scene, names: tuple[str, ...] = (), *, floor: bool = True
    ) -> None:
        known = sensor_specifications()
        ranging = {name: each for name, each in known.items() if each.kind in ("laser", "sonar")}
        self._pepper, self._fans = pepper, []
        for name in names or tuple(name for name in ranging if ranging[name].kind == "laser"):
            if name not in ranging:
                raise UnknownNameError("range sensor", name, ranging)
            pepper.frame_id(ranging[name].frame)
            self._fans.append((ranging[name], _directions(ranging[name])))
        self._caster = _caster(scene, floor)

    def read(self, q: ArrayLike) -> Array:
        """Return the distances along all beams, a sonar's the least of its cone [m].

        -inf stands for too near and inf for too far or nothing, as in readings of a `SensorSuite`.

        Args:
            q: Joint positions [rad or m], shape (N, n).

        Returns:
            Shape (N, beams), the sensors side by side.

        Raises:
            InvalidValueError: for a wrong shape, NaN or infinity.
        """
        states = np.atleast_2d(as_joint_vectors(self._pepper, q, "q"))
        count, width = len(states), sum(len(directions) for _, directions in self._fans)
        origins, aims, most = (
            np.empty((count, width, 3)),
            np.empty((count, width, 3)),
            np.empty((count, width)),
        )
        parts, end = [], 0
        for specification, directions in self._fans:
            part = slice(end, end + len(directions))
            pose = frame_pose(self._pepper, states, specification.frame)
            origins[:, part] = (pose[:, :3, 3] + specification.height * pose[:, :3, 2])[:, np.newaxis]
            aims[:, part] = directions @ pose[:, :3, :3].transpose(0, 2, 1)
            most[:, part], end = specification.maximum, part.stop
            parts.append((specification, part))
        rays = Rays(origins.reshape(-1, 3), aims.reshape(-1, 3), most.ravel(), (count, width))
        far, found = self._caster.distances_checked(rays).reshape(count, width), []
        for specification, part in parts:
            own = far[:, part]
            own = own.min(axis=1, keepdims=True) if specification.kind == "sonar" else own
            own = np.where(own > specification.maximum, np.inf, own)
            found.append(np.where(own < specification.minimum, -np.inf, own))
        return np.concatenate(found, axis=1)


class BatchDepth:
    """A depth camera of N robots in one scene; the robots themselves are not seen.

    Args:
        pepper: The robot.
        scene: What stands around it.
        intrinsics: Of the camera; a fifth of the columns and rows of `camera_depth` in QVGA if omitted.
        name: "camera_depth", or another camera.
        floor: Whether there is a floor at z = 0 besides what the scene holds.

    Raises:
        UnknownNameError: for a camera or a frame that there is not.
    """

    def __init__(
        self,
        pepper: PepperModel,
        scene: Scene,
        intrinsics: Intrinsics | None = None,
        name: str = "camera_depth",
        *,
        floor: bool = True,
    ) -> None:
        full = camera_intrinsics(name, "QVGA")
        small = Intrinsics(
            full.width // _COARSE, full.height // _COARSE, *(x / _COARSE for x in (full.fx, full.fy)),
            *((x + 0.5) / _COARSE - 0.5 for x in (full.cx, full.cy)),
        )  # fmt: skip
        self._pepper, self._caster = pepper, _caster(scene, floor)
        self._frame = sensor_specifications()[name].frame
        pepper.frame_id(self._frame)
        points = (small if intrinsics is None else intrinsics).rays()
        self.shape = points.shape[:2]
        self._away = np.linalg.norm(points, axis=2).ravel()
        self._directions = points.reshape(-1, 3) / self._away[:, np.newaxis]

    def read(self, q: ArrayLike) -> Array:
        """Return distances along the optical axis [m], inf where nothing is.

        Args:
            q: Joint positions [rad or m], shape (N, n).

        Returns:
            Shape (N, rows, columns).

        Raises:
            InvalidValueError: for a wrong shape, NaN or infinity.
        """
        states = np.atleast_2d(as_joint_vectors(self._pepper, q, "q"))
        pose = frame_pose(self._pepper, states, self._frame)
        aims = self._directions @ pose[:, :3, :3].transpose(0, 2, 1)
        origins = np.repeat(pose[:, np.newaxis, :3, 3], len(self._directions), axis=1)
        shape = aims.shape[:2]
        rays = Rays(origins.reshape(-1, 3), aims.reshape(-1, 3), np.full(aims[..., 0].size, np.inf), shape)
        far = self._caster.distances_checked(rays).reshape(shape) / self._away
        return np.asarray(far.reshape(-1, *self.shape))


class BatchInertial:
    """Accelerometers and gyroscopes of N robots.

    Args:
        pepper: The robot.
        names: Of the sensors; all that its base and torso have if omitted.

    Raises:
        UnknownNameError: for a sensor or a frame that there is not.
    """

    def __init__(self, pepper: PepperModel, names: tuple[str, ...] = ()) -> None:
        known = sensor_specifications()
        inertial = {n: each for n, each in known.items() if each.kind in ("accelerometer", "gyroscope")}
        for name in names:
            if name not in inertial:
                raise UnknownNameError("inertial sensor", name, inertial)
        self._pepper, self._sensors = pepper, [inertial[name] for name in names or inertial]
        for sensor in self._sensors:
            pepper.frame_id(sensor.frame)

    def read(self, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> Array:
        """Return specific forces R^T (a - g) [m/s^2] and angular velocities [rad/s] in the frames' axes.

        Args:
            q: Joint positions [rad or m], shape (N, n).
            v: Joint velocities, shape (N, n).
            a: Joint accelerations, shape (N, n).

        Returns:
            Shape (N, 3 k), the sensors side by side.

        Raises:
            InvalidValueError: for a wrong shape, NaN or infinity.
        """
        gravity, found = np.array(self._pepper.inner_model.gravity.linear), []
        for sensor in self._sensors:
            turn = frame_pose(self._pepper, q, sensor.frame)[..., :3, :3]
            if sensor.kind == "gyroscope":
                seen = frame_velocity(self._pepper, q, v, sensor.frame)[..., 3:]
            else:
                seen = frame_acceleration(self._pepper, q, v, a, sensor.frame)[..., :3] - gravity
            found.append(np.einsum("...ji,...j->...i", turn, seen))
        return np.concatenate([np.atleast_2d(part) for part in found], axis=1)


class BatchSwitches:
    """Bumpers and touch sensors of N robots: whether an object reaches into their pads.

    A `SensorSuite` that is given contacts counts those as well that lie within 1 cm of a pad.

    Args:
        pepper: The robot.
        scene: What stands around it; `world.snapshot()` for that of a `World`.
        names: Of the sensors, such as "bumper_back" or "left_hand_touch"; all if omitted.
        bodies: Objects of the scene that are elsewhere for each robot.

    Raises:
        UnknownNameError: for a sensor, a frame or an object that there is not.
    """

    def __init__(
        self, pepper: PepperModel, scene: Scene, names: tuple[str, ...] = (), bodies: tuple[str, ...] = ()
    ) -> None:
        known = {name: each for name, each in sensor_specifications().items() if each.kind == "switch"}
        for name in names:
            if name not in known:
                raise UnknownNameError("bumper or touch sensor", name, known)
        for name in bodies:
            if name not in scene.objects:
                raise UnknownNameError("object", name, scene.objects)
        self._pads, self._bodies, self._pepper = _without_shapes(pepper), tuple(bodies), pepper
        objects = {
            name: replace(item, velocity=_MOVING if name in bodies else np.zeros(3))
            for name, item in scene.objects.items()
        }
        self._around: list[tuple[Scene, tuple[Movers, ...]]] = []
        for name in names or known:
            frame = known[name].frame
            pepper.frame_id(frame)
            pad = AttachedObject("pad", Box(known[name].pad), frame, np.eye(4))
            around = Scene(objects, {"pad": pad})
            self._around.append((around.standing, movers_of(self._pads, around)))

    def read(self, q: ArrayLike, bodies: Mapping[str, BatchBodies] | None = None) -> NDArray[np.bool_]:
        """Return which pads are pressed.

        Args:
            q: Joint positions [rad or m], shape (N, n).
            bodies: Object -> where it is, such as `twins.body(name)`, for all that the class was given.

        Returns:
            Shape (N, sensors).

        Raises:
            InvalidValueError: for a wrong shape, NaN or infinity, or a body of another number of robots.
            UnknownNameError: where a body is missing.
        """
        states, given = np.atleast_2d(as_joint_vectors(self._pepper, q, "q")), dict(bodies or {})
        for name in self._bodies:
            if name not in given:
                raise UnknownNameError("body", name, given)
            if len(given[name].position) != len(states):
                found_at = f"{len(given[name].position)} places"
                raise InvalidValueError(f"body {name!r}", found_at, f"one for each of {len(states)} robots")
        found = np.empty((len(states), len(self._around)), bool)
        for k, (standing, groups) in enumerate(self._around):
            found[:, k] = in_collision(self._pads, states, standing)
            for movers in groups:
                places = [_place(given[item.name]) for item in movers.items]
                joined = movers.joined(states, np.concatenate(places, axis=1))
                found[:, k] |= in_collision(movers.robot, joined, movers.scene)
        return found


def _place(bodies: BatchBodies) -> Array:
    """Return x, y, z [m], yaw, pitch and roll [rad] of bodies, shape (N, 6)."""
    turns = np.array([rpy_of(rotation)[::-1] for rotation in bodies.rotation])
    return np.concatenate([bodies.position, turns], axis=1)


@kept_for_robot(most=4)
def _without_shapes(pepper: PepperModel) -> PepperModel:
    """Return a robot that has no shapes to be touched."""
    described(pepper)
    root = copy.deepcopy(pepper.document.tree)
    for link in root.iter("link"):
        for shape in link.findall("collision"):
            link.remove(shape)
    document = parse_urdf(ET.tostring(root, encoding="unicode"), pepper.document.package_dirs)
    return PepperModel(document, replace(pepper.semantics, disabled_pairs=without_self_pairs(pepper)))


def _caster(scene: Scene, floor: bool) -> RayCaster:
    """Return a caster of rays at a scene, and at a floor at z = 0."""
    scene = scene.add_half_space("floor of rays", (0.0, 0.0, 1.0)) if floor else scene
    items = list(scene.objects.values())
    poses = np.array([item.transform_object_to_world for item in items]).reshape(-1, 4, 4)
    return RayCaster([item.geometry for item in items], poses)


def _directions(specification: SensorSpecification) -> Array:
    """Return the beams of a sensor in its frame, shape (k, 3)."""
    half = specification.field_of_view / 2
    return cone(half) if specification.kind == "sonar" else fan(half, specification.beams)
