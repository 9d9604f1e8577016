"""The world around the robot: named obstacles, and objects attached to the robot."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.collision.attachment import attached, released
from pepper_kin.collision.mesh_file import points_of, triangles_of
from pepper_kin.collision.named_items import NamedItems
from pepper_kin.collision.scene_file import load_scene, save_scene
from pepper_kin.collision.scene_object import (
    PALETTE,
    PLASTER,
    AttachedObject,
    Color,
    SceneObject,
    as_rigid,
    checked_pairs,
    grown,
    number_of,
    placed,
    same_item,
    sorted_pair,
)
from pepper_kin.collision.solids import (
    ConvexMesh,
    HalfSpace,
    PointCloud,
    SceneGeometry,
    TriangleMesh,
    not_negative,
    within_world,
)
from pepper_kin.collision.urdf_object import objects_of_urdf
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.lazy_names import lazy_module
from pepper_kin.model import Box, Capsule, Cylinder, PepperModel, Sphere
from pepper_kin.model.joint_vectors import as_finite, as_numbers
from pepper_kin.model.shapes import rotation_to_axis

if TYPE_CHECKING:
    from pepper_kin.collision.robot_motion import PolynomialMotion

robot_motion = lazy_module("pepper_kin.collision.robot_motion")

VOXEL = 0.02
"""Default edge of the cubes to which point clouds are thinned [m]."""


class Scene:
    """Named obstacles, fixed in the world, and objects attached to the robot.

    A scene never changes: every method returns a new one, so a planner that holds a scene cannot see a
    half-changed world.

        scene = Scene().add_box("table", size=(0.6, 1.0, 0.04), position=(0.55, 0.0, 0.70))

    Attributes:
        objects: Name -> `SceneObject` of each obstacle of the world, read-only, in the order of addition.
        attached: Name -> `AttachedObject` of each object that moves with the robot, read-only.
        allowed: Sorted pairs of names that may touch: two objects, or an object and a link of the robot.
    """

    objects: NamedItems[SceneObject]
    attached: NamedItems[AttachedObject]
    allowed: frozenset[tuple[str, str]]

    def __init__(
        self,
        objects: Mapping[str, SceneObject] | None = None,
        attached: Mapping[str, AttachedObject] | None = None,
        allowed: Iterable[tuple[str, str]] = (),
    ) -> None:
        for quantity, items in (("objects", objects), ("attached", attached)):
            if not (items is None or isinstance(items, Mapping)):
                raise InvalidValueError(quantity, repr(items), "a mapping from names to objects, or None")
        standing, hanging = dict(objects or {}), dict(attached or {})
        for names, kind in ((standing, SceneObject), (hanging, AttachedObject)):
            for name, item in names.items():
                if not isinstance(item, kind) or item.name != name:
                    raise InvalidValueError(f"object {name!r}", repr(item), f"a {kind.__name__} so named")
        for name in standing.keys() & hanging.keys():
            raise InvalidValueError("object name", repr(name), "a name used once, in the world or attached")
        pairs = frozenset(checked_pairs(allowed))
        self._take(NamedItems(standing), NamedItems(hanging), pairs)

    def _take(
        self,
        objects: NamedItems[SceneObject],
        attached: NamedItems[AttachedObject],
        allowed: frozenset[tuple[str, str]],
    ) -> None:
        object.__setattr__(self, "objects", objects)
        object.__setattr__(self, "attached", attached)
        object.__setattr__(self, "allowed", allowed)

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError("a Scene is frozen: its methods return a new one")

    def __reduce__(self) -> tuple[Any, ...]:
        return (Scene, (dict(self.objects), dict(self.attached), sorted(self.allowed)))

    def __repr__(self) -> str:
        hanging = [str(item) for item in self.attached.values()]
        return f"Scene({', '.join([*self.objects, *hanging]) or 'empty'})"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all objects, the obstacles of the world first."""
        return (*self.objects, *self.attached)

    def add(
        self,
        name: str,
        geometry: SceneGeometry,
        position: ArrayLike = (0.0, 0.0, 0.0),
        rpy: ArrayLike = (0.0, 0.0, 0.0),
        color: Color | None = None,
        **motion: Any,
    ) -> Scene:
        """Return a scene with an additional obstacle.

        Args:
            name: New name in the scene.
            geometry: Geometry of the obstacle.
            position: Position of its center in the world [m], shape (3,).
            rpy: Roll, pitch and yaw about fixed axes [rad], shape (3,).
            color: Red, green, blue and opacity, 0 to 1; the next one of eight if omitted.
            **motion: `velocity`, constant from there on [m/s], shape (3,); `uncertainty` of its position, by
                which the distance to keep from it grows with time [m/s].  See `at`.

        Raises:
            InvalidValueError: for a name that is taken, a pose or velocity with NaN or of wrong length, a
                negative uncertainty, or a moving half-space.

        Warns:
            UserWarning: for a position beyond 50 m, which suggests millimeters.
        """
        self._check_new(name)
        pose = placed(name, position, rpy)
        chosen = PALETTE[len(self.objects) % len(PALETTE)] if color is None else color
        return self._and_one(SceneObject(name, geometry, pose, chosen, **motion))

    def add_box(
        self,
        name: str,
        size: ArrayLike,
        position: ArrayLike,
        rpy: ArrayLike = (0.0, 0.0, 0.0),
        **motion: Any,
    ) -> Scene:
        """Return a scene with an additional box of full lengths `size` [m], shape (3,); see `add`."""
        lengths = as_finite(size, f"size of {name!r}", (3,))
        shape = Box((float(lengths[0]), float(lengths[1]), float(lengths[2])))
        return self.add(name, shape, position, rpy, **motion)

    def add_sphere(self, name: str, radius: float, position: ArrayLike, **motion: Any) -> Scene:
        """Return a scene with an additional sphere, radius [m], position [m], shape (3,); see `add`."""
        return self.add(name, Sphere(number_of(name, "radius", radius)), position, **motion)

    def add_cylinder(
        self,
        name: str,
        radius: float,
        length: float,
        position: ArrayLike,
        rpy: ArrayLike = (0.0, 0.0, 0.0),
        **motion: Any,
    ) -> Scene:
        """Return a scene with an additional cylinder along z [m]; position, rpy: shape (3,), see `add`."""
        shape = Cylinder(number_of(name, "radius", radius), number_of(name, "length", length))
        return self.add(name, shape, position, rpy, **motion)

    def add_capsule(
        self,
        name: str,
        radius: float,
        length: float,
        position: ArrayLike,
        rpy: ArrayLike = (0.0, 0.0, 0.0),
        **motion: Any,
    ) -> Scene:
        """Return a scene with an additional capsule along z [m]; position, rpy: shape (3,), see `add`.

        `length` is the length of the straight part.
        """
        shape = Capsule(number_of(name, "radius", radius), number_of(name, "length", length))
        return self.add(name, shape, position, rpy, **motion)

    def add_half_space(self, name: str, normal: ArrayLike, offset: float = 0.0) -> Scene:
        """Return a scene in which all points x with normal . x <= offset are solid, too.

        A floor is `add_half_space("floor", (0, 0, 1))`; the parts of the robot that stand on it have to be
        allowed to touch it, see `allow`.

        Args:
            name: New name in the scene.
            normal: Direction out of the solid, shape (3,); its length does not matter.
            offset: Distance of the plane from the origin along the normal [m].

        Raises:
            InvalidValueError: for a name that is taken, a zero normal, NaN or wrong shape.
        """
        self._check_new(name)
        direction = as_finite(normal, f"normal of {name!r}", (3,))
        length = float(np.linalg.norm(direction))
        if not (np.isfinite(length) and length > 1e-12):
            raise InvalidValueError(f"normal of {name!r}", direction, "a direction: not all zeros")
        pose = np.eye(4)
        if not np.allclose(direction / length, [0, 0, 1], rtol=0, atol=1e-15):
            pose[:3, :3] = rotation_to_axis(direction)
        pose[:3, 3] = direction / length * number_of(name, "offset", offset)
        return self._and_one(SceneObject(name, HalfSpace(), pose, PLASTER))

    def add_convex_mesh(
        self,
        name: str,
        vertices: ArrayLike | str | os.PathLike[str],
        position: ArrayLike = (0.0, 0.0, 0.0),
        rpy: ArrayLike = (0.0, 0.0, 0.0),
        *,
        scale: ArrayLike = 1.0,
        **motion: Any,
    ) -> Scene:
        """Return a scene with the convex hull of points as an additional solid; see `add`.

        Args:
            name: New name in the scene.
            vertices: Points [m], shape (k, 3), or a mesh file (STL, OBJ) whose vertices are used.
            position: Position of the points' origin in the world [m], shape (3,).
            rpy: Roll, pitch and yaw about fixed axes [rad], shape (3,).
            scale: Factor from the unit of the points, or of the file, to meters.
            **motion: `velocity` and `uncertainty`, as in `add`.

        Raises:
            InvalidValueError: for points in a plane, NaN, a taken name; see `add`.
            FileFormatError: naming the file and the fault.
        """
        return self.add(name, ConvexMesh(points_of(name, vertices, scale)), position, rpy, **motion)

    def add_mesh(
        self,
        name: str,
        vertices: ArrayLike | str | os.PathLike[str],
        faces: ArrayLike | None = None,
        position: ArrayLike = (0.0, 0.0, 0.0),
        rpy: ArrayLike = (0.0, 0.0, 0.0),
        *,
        scale: ArrayLike = 1.0,
        **motion: Any,
    ) -> Scene:
        """Return a scene with an additional surface of triangles; see `add`.

        The surface is solid, not its interior: for a body that must not be entered, even in one step, use
        `add_convex_mesh`, with several parts if it is not convex.

        Args:
            name: New name in the scene.
            vertices: Points [m], shape (k, 3), or a mesh file (STL, OBJ, formats that coal reads).
            faces: Indices of each triangle's vertices, shape (f, 3); None with a file.
            position: Position of the points' origin in the world [m], shape (3,).
            rpy: Roll, pitch and yaw about fixed axes [rad], shape (3,).
            scale: Factor from the unit of the points, or of the file, to meters.
            **motion: `velocity` and `uncertainty`, as in `add`.

        Raises:
            InvalidValueError: for a face with an invalid vertex, no triangle with an area, NaN, a taken name.
            FileFormatError: naming the file and the fault.
        """
        points, triangles = triangles_of(name, vertices, faces, scale)
        return self.add(name, TriangleMesh(points, triangles), position, rpy, **motion)

    def add_point_cloud(
        self,
        name: str,
        points: ArrayLike,
        radius: float,
        position: ArrayLike = (0.0, 0.0, 0.0),
        rpy: ArrayLike = (0.0, 0.0, 0.0),
        *,
        voxel: float | None = VOXEL,
        **motion: Any,
    ) -> Scene:
        """Return a scene with an additional cloud of spheres around points; see `add`.

        Args:
            name: New name in the scene.
            points: Points [m], shape (k, 3); may be empty.
            radius: Radius of the sphere around each point [m], 0 or more.
            position: Position of the points' origin, for example of the camera, in the world [m], shape (3,).
            rpy: Roll, pitch and yaw about fixed axes [rad], shape (3,).
            voxel: Edge of the cubes of which each keeps one point [m]; the radius grows so that all spheres
                are covered, see `PointCloud.thinned`.  None keeps all points.
            **motion: `velocity` and `uncertainty`, as in `add`.

        Raises:
            InvalidValueError: for NaN (drop such pixels first), a negative radius, a voxel of 0, a taken
                name.
        """
        if voxel is None:
            return self.add(name, PointCloud(np.asarray(points), radius), position, rpy, **motion)
        return self.add(name, PointCloud.thinned(points, radius, voxel), position, rpy, **motion)

    def add_urdf(
        self,
        name: str,
        urdf: str | Path,
        position: ArrayLike = (0.0, 0.0, 0.0),
        rpy: ArrayLike = (0.0, 0.0, 0.0),
        *,
        meshes: str = "hull",
        package_dirs: Sequence[str | Path] = (),
    ) -> Scene:
        """Return a scene with the collision shapes of a URDF, such as a table's, added; see `add`.

        A description with one shape becomes the object `name`, others `name/shape`; a shape without a name is
        called `link_collision_number`.  Joints are at zero, and all of it is fixed in the world.

        Args:
            name: New name in the scene.
            urdf: Path of a URDF file, or its text.
            position: Position of the root link in the world [m], shape (3,).
            rpy: Roll, pitch and yaw about fixed axes [rad], shape (3,).
            meshes: "hull": meshes become their convex hulls, solid inside; "surface": triangles.
            package_dirs: Folders that contain packages, as for `load_robot`.

        Raises:
            InvalidValueError: for a name that is taken, or a pose with NaN or of wrong length.
            FileFormatError: if a file cannot be read.
            ModelError: if the description is malformed, or has no collision shapes.

        Warns:
            ModelWarning: naming shapes of size zero, which are left out.
        """
        place = placed(name, position, rpy)
        grown = self
        self._check_new(name)
        for item in objects_of_urdf(name, urdf, place, meshes, package_dirs):
            grown._check_new(item.name)
            grown = grown._and_one(item)
        return grown

    def add_robot(
        self,
        name: str,
        robot: PepperModel,
        q: ArrayLike | PolynomialMotion,
        pose: ArrayLike | None = None,
        *,
        begin: float = 0.0,
        meshes: str = "hull",
    ) -> Scene:
        """Return a scene with the collision shapes of another robot added, named `name/shape`.

        With a trajectory, the shapes move with the robot's links: functions of a motion, with `times` or
        `start_time`, compare them where they are at each time; all other functions use their poses at time 0.
        Before the trajectory the robot rests at its start, afterwards at its end.  A driving base is part of
        the trajectory (`base="planar"`).

        Args:
            name: New name in the scene.
            robot: The other robot, of any kind.
            q: Its joint positions [rad or m], shape (n,), or its `Trajectory`.
            pose: transform_base_to_world, pose of its own world in this one (see `pk.pose`), shape (4, 4);
                the identity if omitted.
            begin: Time of the trajectory at the scene's time 0 [s]; negative if the trajectory starts later.
            meshes: "hull": meshes become their convex hulls, solid inside; "surface": triangles.

        Raises:
            InvalidValueError: for a name that is taken, a q of wrong length, a trajectory of other joints, or
                a pose that is not rigid.
            ModelError: for a robot without collision shapes.
        """
        self._check_new(name)
        grown, place = self, np.eye(4) if pose is None else pose
        for item in robot_motion.objects_of_robot(
            name, robot, q, place, number_of(name, "begin", begin), meshes
        ):
            grown._check_new(item.name)
            grown = grown._and_one(item)
        return grown

    def remove(self, name: str) -> Scene:
        """Return a scene without one object and its allowed pairs.

        Raises:
            UnknownNameError: listing the objects.
        """
        self._check_known(name)
        return self._with(
            objects={k: v for k, v in self.objects.items() if k != name},
            attached={k: v for k, v in self.attached.items() if k != name},
            allowed=[pair for pair in self.allowed if name not in pair],
        )

    def move(self, name: str, position: ArrayLike, rpy: ArrayLike = (0.0, 0.0, 0.0)) -> Scene:
        """Return a scene with one obstacle at another position [m] and rpy [rad], shape (3,) each; see `add`.

        Raises:
            UnknownNameError: listing the obstacles.
            InvalidValueError: for an object attached to the robot.
        """
        self._check_standing(name)
        pose = placed(name, position, rpy)
        return self._replaced({name: replace(self.objects[name], transform_object_to_world=pose)})

    def moved(
        self, poses: Mapping[str, ArrayLike], velocities: Mapping[str, ArrayLike] | None = None
    ) -> Scene:
        """Return a scene with several obstacles at other poses.

        Args:
            poses: Name -> position [m], shape (3,), with unchanged orientation; or transform from the object
                to the world, shape (4, 4).
            velocities: Name -> new constant velocity [m/s], shape (3,); others keep theirs.

        Raises:
            UnknownNameError: listing the obstacles.
            InvalidValueError: for NaN, another shape, a transform that is not rigid, a position beyond the
                world's limits, and an object attached to the robot.
        """
        if not isinstance(poses, Mapping):
            raise InvalidValueError("poses", repr(poses)[:80], "a mapping from names to poses")
        found = np.empty((len(poses), 4, 4))
        for row, (name, pose) in zip(found, poses.items(), strict=True):
            self._check_standing(name)
            given = pose if isinstance(pose, np.ndarray) else as_numbers(pose, f"pose of {name!r}")
            if given.shape[:1] == (4,):
                row[:] = as_rigid(given, f"pose of {name!r}")
            else:
                row[:] = self.objects[name].transform_object_to_world
                row[:3, 3] = as_finite(given, f"position of {name!r}", (3,))
        within_world("position of an object", found[:, :3, 3])
        found.setflags(write=False)
        changed = {name: self.objects[name].moved_to(pose) for name, pose in zip(poses, found, strict=True)}
        for name, velocity in (velocities or {}).items():
            self._check_standing(name)
            item = changed.get(name, self.objects[name])
            changed[name] = replace(item, velocity=np.array(velocity, dtype=float))
        return self._replaced(changed)

    @property
    def movers(self) -> tuple[SceneObject, ...]:
        """Obstacles with a velocity, a trajectory or an uncertainty.

        Functions of a motion compare them where they are at each of its times, `follow` and `sequence` refuse
        them; all other functions, such as planners, use their poses at time 0.
        """
        return tuple(item for item in self.objects.values() if item.moves)

    @property
    def standing(self) -> Scene:
        """The scene without its movers: the same value as long as only movers change."""
        found: Scene | None = self.__dict__.get("_standing")
        if found is None:
            items = {name: item for name, item in self.objects.items() if not item.moves}
            gone = self.objects.keys() - items
            pairs = [pair for pair in self.allowed if not gone & set(pair)]
            found = self._with(objects=items, allowed=pairs) if gone else self
            object.__setattr__(self, "_standing", found)
        return found

    def at(self, time: float, *, enlarged: bool = True) -> Scene:
        """Return the scene at a later time: obstacles moved by their velocities, and grown by uncertainty.

        Args:
            time: Time after this scene's [s], 0 or more.
            enlarged: Whether obstacles are enlarged by their uncertainty at that time, as by `padded`.

        Raises:
            InvalidValueError: for a negative time or NaN, or an obstacle beyond the world's limits by then.
        """
        later = not_negative("time", time)
        changed = {item.name: item.at(later, enlarged) for item in self.movers}
        for item in changed.values():
            within_world(f"position of {item.name!r}", item.transform_object_to_world[:3, 3])
        return self._replaced(changed)

    def with_cloud(self, name: str, points: ArrayLike, radius: float, **options: Any) -> Scene:
        """Return a scene in which a point cloud replaces the obstacle of the same name, if any, in its color.

        Arguments and errors are those of `add_point_cloud`; an object attached to the robot is refused, too.
        """
        if name not in self.names:
            return self.add_point_cloud(name, points, radius, **options)
        self._check_standing(name)
        options.setdefault("color", self.objects[name].color)
        alone = Scene().add_point_cloud(name, points, radius, **options)
        return self._replaced(dict(alone.objects))

    def padded(self, margin: float) -> Scene:
        """Return a scene whose obstacles are larger by a margin on every side.

        Objects attached to the robot are unchanged: they are part of it, and only one of two bodies that keep
        a distance has to grow.

        Args:
            margin: Distance added to every side [m].

        Raises:
            InvalidValueError: for a margin that is not a finite number of 0 or more.
        """
        by = not_negative("margin", margin)
        items = self.objects.items()
        return self._with(
            objects={name: replace(item, geometry=grown(item.geometry, by)) for name, item in items}
        )

    def allow(self, name: str, *others: str) -> Scene:
        """Return a scene in which an object may touch others, or links of the robot.

            scene.allow("floor", "Tibia", "WheelB_link", "WheelFL_link", "WheelFR_link")

        Args:
            name: An object of the scene.
            others: Links of the robot, or objects.  The checker, which knows the robot, refuses any other
                name.

        Raises:
            UnknownNameError: listing the objects.
            InvalidValueError: for a pair of an object with itself, or a name that is not a string.
        """
        self._check_known(name)
        for other in others:
            if not isinstance(other, str) or other == name:
                raise InvalidValueError(
                    f"pair allowed for {name!r}", repr(other), "the name of another thing"
                )
        return self._with(allowed=[*self.allowed, *(sorted_pair(name, other) for other in others)])

    def disallow(self, name: str, *others: str) -> Scene:
        """Return a scene in which an object may no longer touch given others, or any if none is given.

        Raises:
            UnknownNameError: listing the objects, or the pairs that are allowed.
        """
        self._check_known(name)
        mine = {next((n for n in pair if n != name), name): pair for pair in self.allowed if name in pair}
        for other in others:
            if other not in mine:
                raise UnknownNameError(f"pair allowed for {name!r} with", other, mine)
        gone = {mine[other] for other in (others or mine)}
        return self._with(allowed=self.allowed - gone)

    def attach(
        self,
        name: str,
        frame: str,
        transform_object_to_frame: ArrayLike | None = None,
        *,
        pepper: PepperModel | None = None,
        q: ArrayLike | None = None,
        touch_links: Iterable[str] = (),
        mass: float = 0.0,
        center_of_mass: ArrayLike | None = None,
    ) -> Scene:
        """Return a scene in which an obstacle is attached to the robot and moves with it.

            scene.attach("cup", "l_gripper", pepper=pepper, q=q, mass=0.3)   # at its current pose
            scene.attach("cup", "l_gripper", transform)                      # at a pose in the hand

        Its mass is used by all functions that take the scene, in addition to a payload; see
        `collision.loads_of`.

        Args:
            name: An obstacle of the scene.
            frame: The link or frame to which it is attached.
            transform_object_to_frame: Its pose in the frame, shape (4, 4) [m]; or instead
            pepper: Robot that grasps the obstacle at its current pose,
            q: and its joint positions then, shape (n,) [rad or m].
            touch_links: Links that it may touch, in addition to those that move with the frame and, on a
                hand, its fingers.
            mass: Mass of the object, a solid of uniform density [kg]; 0: it does not count.
            center_of_mass: Center of mass in the object's own frame [m], shape (3,); its centroid if omitted.

        Raises:
            UnknownNameError: for an unknown obstacle, frame or link (frames and links only if a robot is
                given; otherwise the checker refuses them).
            InvalidValueError: for a half-space, neither or both of transform and robot, a transform that is
                not rigid, an invalid q, a negative mass or NaN, or a shape without volume that has a mass.
        """
        self._check_standing(name)
        hanging = attached(
            self.objects[name], frame, transform_object_to_frame, pepper, q, touch_links, mass, center_of_mass
        )
        return self._with(
            objects={k: v for k, v in self.objects.items() if k != name},
            attached={**self.attached, name: hanging},
        )

    def release(self, pepper: PepperModel, name: str, q: ArrayLike) -> Scene:
        """Return a scene in which an attached object is an obstacle at its pose at q, shape (n,).

        Raises:
            UnknownNameError: listing the attached objects.
            InvalidValueError: for a q of wrong length, or with NaN or infinity.
        """
        if name not in self.attached:
            raise UnknownNameError("attached object", name, self.attached)
        return self._with(
            objects={**self.objects, name: released(self.attached[name], pepper, q)},
            attached={k: v for k, v in self.attached.items() if k != name},
        )

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the scene as a JSON file, whole or not at all; see `pepper_kin.collision.scene_file`."""
        save_scene(self, path)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Scene:
        """Read a scene written by `save`.

        Raises:
            FileFormatError: naming the file, the place in it and the fault.
        """
        return load_scene(path, cls)

    def equals(self, other: Scene) -> bool:
        """Return whether two scenes have equal content, to the last bit and in the same order.

        `==` compares identity, by which checkers are cached.
        """
        mine: list[SceneObject | AttachedObject] = [*self.objects.values(), *self.attached.values()]
        theirs: list[SceneObject | AttachedObject] = [*other.objects.values(), *other.attached.values()]
        same = len(mine) == len(theirs) and self.allowed == other.allowed
        return same and all(same_item(a, b) for a, b in zip(mine, theirs, strict=True))

    def _with(self, **changed: Any) -> Scene:
        parts = {"objects": self.objects, "attached": self.attached, "allowed": self.allowed}
        return Scene(**{**parts, **changed})

    def _replaced(self, changed: Mapping[str, SceneObject]) -> Scene:
        found: Scene = object.__new__(Scene)
        found._take(self.objects.replaced(changed), self.attached, self.allowed)
        if all(item.moves and self.objects[name].moves for name, item in changed.items()):
            object.__setattr__(found, "_standing", self.standing)
        return found

    def _and_one(self, item: SceneObject) -> Scene:
        """Return a scene with an additional obstacle of a new name; the cost does not grow with the scene."""
        grown: Scene = object.__new__(Scene)
        grown._take(self.objects.and_one(item.name, item), self.attached, self.allowed)
        return grown

    def _check_new(self, name: str) -> None:
        known = isinstance(name, str) and (name in self.objects or name in self.attached)
        if not isinstance(name, str) or not name or known:
            raise InvalidValueError("object name", repr(name), f"a new name; taken: {', '.join(self.names)}")

    def _check_known(self, name: str) -> None:
        if name not in self.objects and name not in self.attached:
            raise UnknownNameError("scene object", name, self.names)

    def _check_standing(self, name: str) -> None:
        self._check_known(name)
        if name in self.attached:
            said = f"one that stands in the world; this one hangs on {self.attached[name].frame}: release it"
            raise InvalidValueError("object", repr(name), said)
