"""Robots as obstacles of a scene, standing or along a trajectory."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from math import comb
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, FrozenArrays
from pepper_kin.collision.motion_tree import bounds_anywhere
from pepper_kin.collision.scene_object import SceneObject, as_rigid
from pepper_kin.collision.urdf_object import objects_of_shapes
from pepper_kin.exceptions import InvalidValueError, ModelError
from pepper_kin.kinematics import frame_poses
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_joint_vector


class PolynomialMotion(Protocol):
    """A motion of joints as piecewise polynomials, such as `pepper_kin.Trajectory`."""

    joint_names: tuple[str, ...]
    breaks: Array
    coefficients: Array

    def __call__(self, t: ArrayLike) -> Any:
        """Return the state at times [s] within the motion."""


@dataclass(frozen=True, eq=False)
class RobotMotion:
    """Motion of another robot, which rests at its start before and at its end afterwards.

    Attributes:
        robot: The robot.
        motion: Motion of its joints.
        transform_base_to_world: Pose of the robot's own world, shape (4, 4).
        links: Names of the links whose poses are computed.
    """

    robot: PepperModel
    motion: PolynomialMotion
    transform_base_to_world: Array
    links: tuple[str, ...]

    def poses(self, times: Array) -> Array:
        """Return the poses of the links in the world at times [s] of the motion, shape (T, links, 4, 4)."""
        known: tuple[Array, Array] | None = self.__dict__.get("_known")
        if known is None or not np.array_equal(known[0], times):
            q = self.motion(np.clip(times, 0.0, self.motion.breaks[-1])).position
            known = np.array(times), self.transform_base_to_world @ frame_poses(self.robot, q, self.links)
            self.__dict__["_known"] = known
        return known[1]

    @cached_property
    def speed(self) -> float:
        """A bound on the speed of all points of the robot, at all times [m/s].

        The bound is sum_j r_j |dq_j/dt|, with r of `motion_bounds`, and |dq_j/dt| at most the maximum
        Bernstein coefficient of its polynomial on each segment.
        """
        powers = self.motion.coefficients[:, 1:] * np.arange(1, self.motion.coefficients.shape[1])[:, None]
        if not powers.shape[1]:
            return 0.0
        count = powers.shape[1]
        scaled = powers * np.diff(self.motion.breaks)[:, None, None] ** np.arange(count)[:, None]
        change = [[comb(i, k) / comb(count - 1, k) for k in range(count)] for i in range(count)]
        most = np.abs(np.einsum("ik,pkj->pij", np.array(change), scaled)).max(axis=1)
        return float((most @ bounds_anywhere(self.robot)).max())


@dataclass(frozen=True, eq=False)
class LinkPath(FrozenArrays):
    """Path of a shape on a link of a moving robot.

    Attributes:
        of: Motion of the robot.
        link: Index of the link among those of the motion.
        transform_object_to_link: Pose of the shape in the link, shape (4, 4).
        begin: Time of the motion at the scene's time 0 [s]; negative if the motion starts later.
    """

    of: RobotMotion
    link: int
    transform_object_to_link: Array
    begin: float

    @property
    def speed(self) -> float:
        """A bound on the speed of all points of the shape [m/s]."""
        return self.of.speed

    def poses(self, times: Array) -> Array:
        """Return transform_object_to_world at times of the scene [s], shape (T, 4, 4)."""
        found: Array = self.of.poses(self.begin + times)[:, self.link] @ self.transform_object_to_link
        return found

    def later(self, time: float) -> LinkPath:
        """Return the path for a scene that starts later by a time [s]."""
        return replace(self, begin=self.begin + time)


def objects_of_robot(
    name: str, robot: PepperModel, q: ArrayLike | PolynomialMotion, pose: ArrayLike, begin: float, meshes: str
) -> Iterator[SceneObject]:
    """Yield the collision shapes of a robot as obstacles; see `Scene.add_robot`."""
    if not isinstance(robot, PepperModel):
        raise InvalidValueError("robot", repr(robot)[:80], "a PepperModel, as of load_pepper or load_robot")
    if not robot.collision_shapes:
        raise ModelError(f"robot {robot.name!r} has no collision shapes")
    place = as_rigid(pose, f"pose of {name!r}")
    links = tuple(dict.fromkeys(shape.link for shape in robot.collision_shapes))
    path: RobotMotion | None = None
    if hasattr(q, "coefficients"):
        motion: PolynomialMotion = q  # type: ignore[assignment]
        if tuple(motion.joint_names) != robot.joint_names:
            raise InvalidValueError(
                f"joints of the motion of {name!r}",
                ", ".join(motion.joint_names),
                ", ".join(robot.joint_names),
            )
        path = RobotMotion(robot, motion, place, links)
        poses = path.poses(np.array([begin]))[0]
    else:
        poses = place @ frame_poses(robot, as_joint_vector(robot, q, f"q of {name!r}"), links)
    placed = dict(zip(links, poses, strict=True))
    shapes = robot.collision_shapes
    for item, shape in zip(
        objects_of_shapes(name, robot.visual_shapes, shapes, placed, meshes), shapes, strict=True
    ):
        if path is None:
            yield item
        else:
            own = LinkPath(path, links.index(shape.link), shape.transform_shape_to_link, begin)
            yield replace(item, path=own)
