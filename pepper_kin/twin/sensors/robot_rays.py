"""Ray casting against a robot's body and the scene."""

from __future__ import annotations

from dataclasses import dataclass
from operator import is_

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, BriefRepr
from pepper_kin.collision import AttachedObject, HalfSpace, Scene, SceneObject
from pepper_kin.collision.solids import SceneGeometry
from pepper_kin.core.shading import TILES, Surfaces
from pepper_kin.kinematics import frame_poses
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import MOST, as_finite, check_choice
from pepper_kin.twin.sensors.raycast import RayCaster, Rays, rays_of

GEOMETRY_TYPES = ("visual", "collision")
_FLOOR = HalfSpace(0.0)
_EMPTY = Scene()


@dataclass(frozen=True, eq=False)
class Sight(BriefRepr):
    """What rays met.

    Attributes:
        distance: Along each ray [m], inf where nothing was met, shape (...).
        normal: Unit normal there, against the ray; 0 where nothing was met, shape (..., 3).
        color: Red, green, blue of what was met, from 0 to 1; 0 where nothing was, shape (..., 3).
    """

    distance: Array
    normal: Array
    color: Array


class RobotRays:
    """Casts rays at the robot's own shapes and at a scene; for one thread at a time.

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
        rays, place = rays_of(origins, directions), _EMPTY if scene is None else scene
        found, shape = no_surfaces(len(rays.most)), rays.shape
        self.look_checked(
            as_finite(q, "q", (self.pepper.n,), MOST), place, rays.origins, rays.directions, found
        )
        return Sight(
            found.distance.reshape(shape), found.normal.reshape(*shape, 3), found.color.reshape(*shape, 3)
        )

    def look_checked(
        self, q: Array, scene: Scene, origins: Array, directions: Array, surfaces: Surfaces
    ) -> None:
        """Write what `look` returns, for rays that need no check.

        Args:
            q: Joint positions [rad or m], shape (n,), finite.
            scene: The world.
            origins: In the world [m], shape (m, 3), finite.
            directions: Unit vectors in the world, shape (m, 3), finite.
            surfaces: Written.
        """
        surfaces.distance[:] = np.inf
        surfaces.normal[:], surfaces.color[:] = 0.0, 0.0
        # No farther than what was met before.
        rays = Rays(origins, directions, surfaces.distance, (len(directions),))
        self._place(q, scene)
        floor = len(self._world) - 1 if self.floor else -1
        self._world.show_checked(rays, self._world_colors, floor, surfaces)
        self._robot.show_checked(rays, self._colors, -1, surfaces)

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
        rays, place = rays_of(origins, directions), _EMPTY if scene is None else scene
        checked = as_finite(q, "q", (self.pepper.n,), MOST)
        return self.distances_checked(checked, place, rays.origins, rays.directions).reshape(rays.shape)

    def distances_checked(self, q: Array, scene: Scene, origins: Array, directions: Array) -> Array:
        """Return what `distances` does for rays that need no check.

        Args:
            q: Joint positions [rad or m], shape (n,), finite.
            scene: The world.
            origins: In the world [m], shape (m, 3), finite.
            directions: Unit vectors in the world, shape (m, 3), finite.
        """
        rays = Rays(origins, directions, np.full(len(directions), np.inf), (len(directions),))
        self._place(q, scene)
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
            colors = [item.color[:3] for item in items] + [TILES[0]] * len(ground)
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


def no_surfaces(count: int) -> Surfaces:
    """Return arrays for what some rays meet."""
    return Surfaces(np.empty(count), np.empty((count, 3)), np.empty((count, 3)))


def _joint(pepper: PepperModel, frame: str) -> int:
    return int(pepper.inner_model.frames[pepper.frame_id(frame)].parentJoint)
