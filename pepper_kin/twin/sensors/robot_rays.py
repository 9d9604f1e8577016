"""Ray casting against a robot's body and the scene."""

from __future__ import annotations

from dataclasses import dataclass
from operator import is_

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.collision import AttachedObject, HalfSpace, Scene, SceneObject
from pepper_kin.collision.solids import SceneGeometry
from pepper_kin.kinematics import frame_poses
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import MOST, as_finite, check_choice
from pepper_kin.twin.sensors.raycast import RayCaster, RayHits, Rays, rays_of

Array = NDArray[np.float64]

GEOMETRY_TYPES = ("visual", "collision")
_FLOOR_COLORS = ((0.78, 0.78, 0.76), (0.66, 0.66, 0.65))
_FLOOR = HalfSpace(0.0)
_TILE = 0.5  # [m] of the floor's pattern
_EMPTY = Scene()


@dataclass(frozen=True, eq=False)
class Sight:
    """What rays met.

    Attributes:
        distance: Along each ray [m], inf where nothing was met, shape (...).
        normal: Unit normal there, against the ray; 0 where nothing was met, shape (..., 3).
        color: Red, green, blue from 0 to 1 of what was met, shape (..., 3).
    """

    distance: Array
    normal: Array
    color: Array


class RobotRays:
    """Casts rays at the robot's own shapes and at a scene.

    Args:
        pepper: The robot.
        geometry_type: "visual" for the surfaces that are drawn, "collision" for the shapes around them.
        blind_to: A frame: the shapes that are fixed to the same joint are left out, such as the housing
            around a camera.
        floor: Whether there is a floor at z = 0 besides what the scene holds.

    Raises:
        InvalidValueError: for other geometry types.
        UnknownNameError: for a frame that the robot lacks.
    """

    def __init__(
        self,
        pepper: PepperModel,
        geometry_type: str = "visual",
        *,
        blind_to: str | None = None,
        floor: bool = True,
    ) -> None:
        check_choice("geometry_type", geometry_type, GEOMETRY_TYPES)
        self.pepper, self.floor = pepper, floor
        shapes = pepper.visual_shapes if geometry_type == "visual" else pepper.collision_shapes
        if blind_to is not None:
            hidden = _joint(pepper, blind_to)
            shapes = tuple(shape for shape in shapes if _joint(pepper, shape.link) != hidden)
        self._links = tuple(dict.fromkeys(shape.link for shape in shapes))
        self._rows = np.array([self._links.index(shape.link) for shape in shapes], dtype=np.int64)
        self._local = np.array([shape.transform_shape_to_link for shape in shapes]).reshape(-1, 4, 4)
        self._colors = np.array([shape.color[:3] for shape in shapes]).reshape(-1, 3)
        unplaced = np.broadcast_to(np.eye(4), self._local.shape)
        self._robot = RayCaster([shape.geometry for shape in shapes], unplaced)
        self._q: Array | None = None
        self._scene: Scene | None = None
        self._shapes: list[SceneGeometry] = []
        self._world = RayCaster([], np.empty((0, 4, 4)))
        self._world_colors = np.empty((0, 3))

    def look(self, q: ArrayLike, scene: Scene | None, origins: ArrayLike, directions: ArrayLike) -> Sight:
        """Return what rays meet first.

        Args:
            q: Joint positions [rad or m], shape (n,).
            scene: The world; None for an empty one.
            origins: Where the rays start, in the world [m], shape (..., 3).
            directions: Their directions in the world, shape (..., 3).

        Raises:
            InvalidValueError: for NaN, infinity, or wrong shapes.
            UnknownNameError: for an attached object on a frame that the robot lacks.
        """
        self._place(as_finite(q, "q", (self.pepper.n,), MOST), _EMPTY if scene is None else scene)
        rays = rays_of(origins, directions)
        other = self._world.cast_checked(rays)
        own = self._robot.cast_checked(rays._replace(most=other.distance))
        nearer = (own.solid >= 0)[:, None]
        color = np.where(nearer, self._own_color(own), self._paint(other, rays))
        normal = np.where(nearer, own.normal, other.normal)
        shape = rays.shape
        distance = np.minimum(own.distance, other.distance)
        return Sight(distance.reshape(shape), normal.reshape(*shape, 3), color.reshape(*shape, 3))

    def distances(
        self, q: ArrayLike, scene: Scene | None, origins: ArrayLike, directions: ArrayLike
    ) -> Array:
        """Return only the distances of `look`, inf where nothing is met, shape (...) [m].

        Args:
            q: Joint positions [rad or m], shape (n,).
            scene: The world; None for an empty one.
            origins: Where the rays start, in the world [m], shape (..., 3).
            directions: Their directions in the world, shape (..., 3).
        """
        self._place(as_finite(q, "q", (self.pepper.n,), MOST), _EMPTY if scene is None else scene)
        rays = rays_of(origins, directions)
        other = self._world.distances_checked(rays)
        own = self._robot.distances_checked(rays._replace(most=other))
        return np.minimum(own, other).reshape(rays.shape)

    def distances_checked(self, q: Array, scene: Scene, origins: Array, directions: Array) -> Array:
        """Return what `distances` does for rays that need no check.

        Args:
            q: Joint positions [rad or m], shape (n,), finite.
            scene: The world.
            origins: In the world [m], shape (m, 3), finite.
            directions: Unit vectors in the world, shape (m, 3), finite.
        """
        self._place(q, scene)
        rays = Rays(origins, directions, np.full(len(directions), np.inf), (len(directions),))
        other = self._world.distances_checked(rays)
        return np.minimum(self._robot.distances_checked(rays._replace(most=other)), other)

    def _place(self, q: Array, scene: Scene) -> None:
        """Move robot and world to where they are with the robot at q [rad or m], shape (n,)."""
        moved = self._q is None or not np.array_equal(q, self._q)
        if moved and self._links:
            poses = frame_poses(self.pepper, q, self._links)
            self._robot.place_checked(poses[self._rows] @ self._local)
        if scene is not self._scene:
            items: list[SceneObject | AttachedObject] = [*scene.objects.values(), *scene.attached.values()]
            ground = (_FLOOR,) if self.floor else ()
            shapes = [item.geometry for item in items] + list(ground)
            if len(shapes) == len(self._shapes) and all(map(is_, shapes, self._shapes)):
                self._world.place_checked(self._world_poses(q, scene))
            else:
                self._world, self._shapes = RayCaster(shapes, self._world_poses(q, scene)), shapes
            colors = [item.color[:3] for item in items] + [_FLOOR_COLORS[0]] * len(ground)
            self._world_colors = np.array(colors).reshape(-1, 3)
        elif moved and scene.attached:
            self._world.place_checked(self._world_poses(q, scene))
        self._q, self._scene = q.copy(), scene

    def _world_poses(self, q: Array, scene: Scene) -> Array:
        """Return the poses of the world's m shapes, shape (m, 4, 4), at q [rad or m], shape (n,)."""
        poses = [item.transform_object_to_world for item in scene.objects.values()]
        held = tuple(scene.attached.values())
        if held:
            frames = frame_poses(self.pepper, q, [item.frame for item in held])
            poses += [pose @ item.transform_object_to_frame for pose, item in zip(frames, held, strict=True)]
        return np.array([*poses, *([np.eye(4)] if self.floor else [])]).reshape(-1, 4, 4)

    def _own_color(self, hits: RayHits) -> Array:
        if not len(self._colors):
            return np.zeros((*hits.solid.shape, 3))
        return np.asarray(self._colors[hits.solid])

    def _paint(self, hits: RayHits, rays: Rays) -> Array:
        """Return the colors of what the world shows, with tiles on the floor."""
        if not len(self._world_colors):
            return np.zeros((*hits.solid.shape, 3))
        color = np.array(self._world_colors[hits.solid])
        if not self.floor:
            return color
        on_floor = hits.solid == len(self._world_colors) - 1
        far = np.where(on_floor, hits.distance, 0.0)
        place = rays.origins[:, :2] + far[:, None] * rays.directions[:, :2]
        dark = on_floor & (np.floor(place / _TILE).sum(axis=-1) % 2 == 1)
        color[dark] = _FLOOR_COLORS[1]
        return color


def _joint(pepper: PepperModel, frame: str) -> int:
    return int(pepper.inner_model.frames[pepper.frame_id(frame)].parentJoint)
