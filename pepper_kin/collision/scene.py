"""The world around the robot: named obstacles, and objects that the robot holds."""

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
"""Edge of the cubes to which clouds are thinned by default [m]."""


class Scene:
    """Named obstacles, fixed in the world, and objects that hang on the robot.

    A scene never changes: every method returns a new one, so a planner that holds a scene cannot see a
    half-changed world.

        scene = Scene().add_box("table", size=(0.6, 1.0, 0.04), position=(0.55, 0.0, 0.70))

    Attributes:
        objects: Name -> `SceneObject`, what is fixed in the world, read-only, in the order of addition.
        attached: Name -> `AttachedObject`, what moves with the robot, read-only.
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
        """Names of all objects, those in the world first."""
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
        """Return a scene with one more obstacle.

        Args:
            name: A name that the scene does not have yet.
            geometry: Its shape.
            position: Position of its center in the world [m], shape (3,).
            rpy: Roll, pitch and yaw about fixed axes [rad], shape (3,).
            color: Red, green, blue and opacity, 0 to 1; the next one of eight if omitted.
            **motion: `velocity`, with which it moves on from there [m/s], shape (3,); `uncertainty` of where
                it will be, by which the distance to keep from it grows with time [m/s].  See `at`.

        Raises:
            InvalidValueError: for a name that is taken, a pose or velocity with NaN or of wrong length, an
                uncertainty below 0, or a half-space that moves.

        Warns:
            UserWarning: for a position beyond 50 m, as millimeters are.
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
        """Return a scene with a box of full lengths `size` [m], shape (3,), more; see `add`."""
        lengths = as_finite(size, f"size of {name!r}", (3,))
        shape = Box((float(lengths[0]), float(lengths[1]), float(lengths[2])))
        return self.add(name, shape, position, rpy, **motion)

    def add_sphere(self, name: str, radius: float, position: ArrayLike, **motion: Any) -> Scene:
        """Return a scene with a sphere of a radius [m] more, at a position [m], shape (3,); see `add`."""
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
        """Return a scene with a cylinder along its z axis [m] more; position, rpy: shape (3,), see `add`."""
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
        """Return a scene with a capsule along its z axis [m] more; position, rpy: shape (3,), see `add`.

        `length` is that of the straight part.
        """
        shape = Capsule(number_of(name, "radius", radius), number_of(name, "length", length))
        return self.add(name, shape, position, rpy, **motion)

    def add_half_space(self, name: str, normal: ArrayLike, offset: float = 0.0) -> Scene:
        """Return a scene in which all points x with normal . x <= offset are solid as well.

        A floor is `add_half_space("floor", (0, 0, 1))`; the parts of the robot that stand on it have to be
        allowed to touch it, see `allow`.

        Args:
            name: A name that the scene does not have yet.
            normal: Direction out of the solid, shape (3,); its length does not matter.
            offset: Distance of the plane from the origin along the normal [m].

        Raises:
            InvalidValueError: for a name that is taken, a normal of no length, NaN or wrong shape.
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
        """Return a scene with the convex hull of points, solid inside, more; see `add`.

        Args:
            name: A name that the scene does not have yet.
            vertices: Points [m], shape (k, 3), or a mesh file (STL, OBJ) whose vertices are taken.
            position: Position of the points' origin in the world [m], shape (3,).
            rpy: Roll, pitch and yaw about fixed axes [rad], shape (3,).
            scale: Factor from the unit of the points, or of the file, to meters.
            **motion: As in `add`.

        Raises:
            InvalidValueError: for points in a plane, NaN, a taken name; see `add`.
            FileFormatError: naming the file and what is wrong with it.
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
        """Return a scene with a surface of triangles more; see `add`.

        The surface is solid, not what it encloses: for a body that must not be entered, even in one step,
        take `add_convex_mesh`, of several parts where it is not convex.

        Args:
            name: A name that the scene does not have yet.
            vertices: Points [m], shape (k, 3), or a mesh file (STL, OBJ, what coal reads).
            faces: Indices of each triangle's vertices, shape (f, 3); None with a file.
            position: Position of the points' origin in the world [m], shape (3,).
            rpy: Roll, pitch and yaw about fixed axes [rad], shape (3,).
            scale: Factor from the unit of the points, or of the file, to meters.
            **motion: As in `add`.

        Raises:
            InvalidValueError: for a face that names no vertex, no triangle with an area, NaN, a taken name.
            FileFormatError: naming the file and what is wrong with it.
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
        """Return a scene with balls around points more; see `add`.

        Args:
            name: A name that the scene does not have yet.
            points: Points [m], shape (k, 3); none is fine.
            radius: Radius of the ball around each [m], 0 or more.
            position: Position of the points' origin, say of the camera, in the world [m], shape (3,).
            rpy: Roll, pitch and yaw about fixed axes [rad], shape (3,).
            voxel: Edge of the cubes of which each keeps one point [m]; the balls grow so that they cover
                those of all points, see `PointCloud.thinned`.  None keeps all points.
            **motion: As in `add`.

        Raises:
            InvalidValueError: for NaN (drop such pixels first), a radius below 0, a voxel of 0, a taken name.
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
        """Return a scene with the collision shapes of a URDF more, such as a table's; see `add`.

        A description of one shape becomes the object `name`, others `name/shape`, a shape without a name
        being `link_collision_number`.  Joints stand at zero, and the world holds all of it.

        Args:
            name: A name that the scene does not have yet.
            urdf: Path of a URDF file, or its text.
            position: Position of the root link in the world [m], shape (3,).
            rpy: Roll, pitch and yaw about fixed axes [rad], shape (3,).
            meshes: "hull": meshes become their convex hulls, solid inside; "surface": triangles.
            package_dirs: Folders that hold packages, as `load_robot` has them.

        Raises:
            InvalidValueError: for a name that is taken, or a pose with NaN or of wrong length.
            FileFormatError: where a file cannot be read.
            ModelError: where the description is malformed, or has no collision shapes.

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
        """Return a scene with the collision shapes of another robot more, named `name/shape`.

        With a trajectory, the shapes move as the robot's links: functions of a motion, with `times` or
        `start_time`, compare them where they are at each time; all others take them as standing where they
        are at time 0.  Before the trajectory the robot stands at its start, afterwards at its end.  A base
        that drives is part of the trajectory (`base="planar"`).

        Args:
            name: A name that the scene does not have yet.
            robot: The other robot, of any kind.
            q: Its joint positions [rad or m], shape (n,), or its `Trajectory`.
            pose: transform_base_to_world, where its own world stands in this one (see `pk.pose`), shape
                (4, 4); the same place if omitted.
            begin: Time of the trajectory at the scene's time 0 [s]; below 0 where it begins later.
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
        """Return a scene without one object, and without what was allowed for it.

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
            InvalidValueError: for an object that hangs on the robot.
        """
        self._check_standing(name)
        pose = placed(name, position, rpy)
        return self._replaced({name: replace(self.objects[name], transform_object_to_world=pose)})

    def moved(
        self, poses: Mapping[str, ArrayLike], velocities: Mapping[str, ArrayLike] | None = None
    ) -> Scene:
        """Return a scene with obstacles elsewhere, all at once.

        Args:
            poses: Name -> position [m], shape (3,), the object keeping its orientation; or transform from the
                object to the world, shape (4, 4).
            velocities: Name -> with what it moves on from there [m/s], shape (3,); others keep theirs.

        Raises:
            UnknownNameError: listing the obstacles.
            InvalidValueError: for NaN, another shape, what is not rigid, a place beyond the world, and an
                object that hangs on the robot.
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
        them; all others, as planners, take them as standing where they are at time 0.
        """
        return tuple(item for item in self.objects.values() if item.moves)

    @property
    def standing(self) -> Scene:
        """The scene without its movers: one and the same as long as only these change."""
        found: Scene | None = self.__dict__.get("_standing")
        if found is None:
            items = {name: item for name, item in self.objects.items() if not item.moves}
            gone = self.objects.keys() - items
            pairs = [pair for pair in self.allowed if not gone & set(pair)]
            found = self._with(objects=items, allowed=pairs) if gone else self
            object.__setattr__(self, "_standing", found)
        return found

    def at(self, time: float, *, enlarged: bool = True) -> Scene:
        """Return the scene as it is later: obstacles moved by their velocities, and grown by uncertainty.

        Args:
            time: From when this scene is [s], 0 or more.
            enlarged: Whether they are larger by their uncertainty then, as `padded` makes them.

        Raises:
            InvalidValueError: for a time below 0 or NaN, or an obstacle beyond the world by then.
        """
        later = not_negative("time", time)
        changed = {item.name: item.at(later, enlarged) for item in self.movers}
        for item in changed.values():
            within_world(f"position of {item.name!r}", item.transform_object_to_world[:3, 3])
        return self._replaced(changed)

    def with_cloud(self, name: str, points: ArrayLike, radius: float, **options: Any) -> Scene:
        """Return a scene with a point cloud in the place of what has the name, if anything has, in its color.

        Arguments and errors are those of `add_point_cloud`, and of an object that hangs on the robot.
        """
        if name not in self.names:
            return self.add_point_cloud(name, points, radius, **options)
        self._check_standing(name)
        options.setdefault("color", self.objects[name].color)
        alone = Scene().add_point_cloud(name, points, radius, **options)
        return self._replaced(dict(alone.objects))

    def padded(self, margin: float) -> Scene:
        """Return a scene whose obstacles are larger by a margin on every side.

        Objects that hang on the robot stay as they are: they are part of it, and only one of two things that
        keep a distance has to grow.

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
            others: Links of the robot, or objects.  A name that is neither is refused by the checker, which
                knows the robot.

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
        """Return a scene in which an object may no longer touch others; without others, nothing at all.

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
        """Return a scene in which an obstacle hangs on the robot and moves with it.

            scene.attach("cup", "l_gripper", pepper=pepper, q=q, mass=0.3)   # where it stands
            scene.attach("cup", "l_gripper", transform)                      # at a place in the hand

        Its mass counts in all that takes the scene, and adds to a payload; see `collision.loads_of`.

        Args:
            name: An obstacle of the scene.
            frame: The link or frame that it hangs on.
            transform_object_to_frame: Its pose in the frame, shape (4, 4) [m]; or, in its place,
            pepper: the robot that grasps it where it stands,
            q: at these joint positions, shape (n,) [rad or m].
            touch_links: Links that it may touch, besides those that move with the frame and, on a hand, its
                fingers.
            mass: Of the object, a solid of uniform density [kg]; 0: it does not count.
            center_of_mass: In the object's own frame [m], shape (3,); its centroid if omitted.

        Raises:
            UnknownNameError: for an unknown obstacle, frame or link (the last two where a robot is given;
                else by the checker).
            InvalidValueError: for a half-space, neither or both of transform and robot, a transform that is
                not rigid, a bad q, a mass below 0 or NaN, or a shape that has no volume for it.
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
        """Return a scene in which an attached object stands where the robot has it at q, shape (n,).

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
        """Read a scene that `save` wrote.

        Raises:
            FileFormatError: naming the file, the place in it and what is wrong.
        """
        return load_scene(path, cls)

    def equals(self, other: Scene) -> bool:
        """Whether two scenes hold the same, to the last bit and in the same order.

        `==` asks whether they are one and the same value, by which checkers are kept.
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
        """Return a scene with an obstacle more, whose name is new; its cost does not grow with the scene."""
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
