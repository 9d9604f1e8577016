"""Exact collision and distance of a robot with itself and a scene, by coal."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.collision.dependent_ranges import dependent_ranges
from pepper_kin.collision.scene import Scene
from pepper_kin.exceptions import FileFormatError
from pepper_kin.model import Box, Capsule, Cylinder, Geometry, Mesh, PepperModel, Sphere
from pepper_kin.model.joint_vectors import as_joint_vectors
from pepper_kin.model.shapes import read_only

LEVER = 0.1
"""About how far from their joint neighbouring bodies meet [m]: turns a distance kept into an angle kept."""


@dataclass(frozen=True, eq=False)
class ClosestPair:
    """The two things that are nearest to one another.

    Attributes:
        names: Names of the two: links of the robot, or a link and a scene object.
        distance: Distance [m]; below zero, how deep they overlap.
        points: (2, 3) the nearest points, one on each, in the world [m].
    """

    names: tuple[str, str]
    distance: float
    points: NDArray[np.float64]


class CollisionChecker:
    """Collision and distance queries for one robot in one scene.

    Self-collision covers all pairs of links but those that the SRDF disables; of these, the pairs marked
    "DependentRange" are decided by tabulated joint ranges (yes or no, no distance).

    Args:
        pepper: The robot.
        scene: The world around it; None for none.
        margin: Distance to the scene below which `in_collision` says yes [m].
        self_margin: The same for two parts of the robot [m].
    """

    def __init__(
        self,
        pepper: PepperModel,
        scene: Scene | None = None,
        margin: float = 0.0,
        self_margin: float = 0.0,
    ) -> None:
        import pinocchio

        self.pepper = pepper
        self.margin, self.self_margin = float(margin), float(self_margin)
        self.scene = scene if scene is not None else Scene()
        self._ranges = dependent_ranges(pepper)
        self._model: Any = pinocchio.GeometryModel()
        self._owners: list[str] = []
        self._add_robot()
        self._robot_count = len(self._owners)
        self._add_scene()
        self._add_pairs()
        shapes = [item.geometry for item in self._model.geometryObjects]
        for shape in shapes:
            shape.computeLocalAABB()
        self._bounding_centers = [np.array(shape.aabb_center) for shape in shapes]
        radii = np.array([shape.aabb_radius for shape in shapes])
        pairs = np.array([[p.first, p.second] for p in self._model.collisionPairs], dtype=int).reshape(-1, 2)
        self._pairs = (pairs[:, 0], pairs[:, 1])
        self._bounding_reach = radii[pairs].sum(axis=1)
        self._local = threading.local()

    @property
    def pair_count(self) -> int:
        """Number of pairs of shapes that are checked."""
        return len(self._model.collisionPairs)

    def in_collision(self, q: ArrayLike) -> NDArray[np.bool_]:
        """Whether anything touches, shape (...,), at joint positions q, shape (..., n) [rad or m]."""
        q_all = as_joint_vectors(self.pepper, q, "q")
        flat = q_all.reshape(-1, self.pepper.n)
        touching = np.zeros(flat.shape[0], dtype=bool)
        for table in self._ranges:
            touching |= table.violated(flat, self.self_margin / LEVER)
        for i in np.flatnonzero(~touching):
            touching[i] = self._touches(flat[i])
        return touching.reshape(q_all.shape[:-1])

    def clearance(self, q: ArrayLike) -> NDArray[np.float64]:
        """Smallest distance over the checked pairs [m], shape (...,), at q, shape (..., n) [rad or m].

        Below zero: how deep the deepest pair overlaps.  inf where nothing is there to collide with.
        """
        q_all = as_joint_vectors(self.pepper, q, "q")
        flat = q_all.reshape(-1, self.pepper.n)
        distances = np.array([self._distances(state)[0] for state in flat]).reshape(q_all.shape[:-1])
        return distances

    def closest_pair(self, q: ArrayLike) -> ClosestPair | None:
        """Return the nearest pair at one configuration q, shape (n,); None where no pair is checked."""
        state = as_joint_vectors(self.pepper, q, "q").reshape(self.pepper.n)
        distance, index = self._distances(state)
        if index < 0:
            return None
        pair = self._model.collisionPairs[index]
        result = self._data[1].distanceResults[index]
        points = read_only([result.getNearestPoint1(), result.getNearestPoint2()])
        return ClosestPair((self._owners[pair.first], self._owners[pair.second]), distance, points)

    def contacts(self, q: ArrayLike) -> tuple[tuple[str, str], ...]:
        """Return the names of all pairs that touch at one configuration q, shape (n,)."""
        import pinocchio

        state = as_joint_vectors(self.pepper, q, "q").reshape(self.pepper.n)
        found = {table.links: None for table in self._ranges if table.violated(state)}
        data, geometry_data = self._data
        pinocchio.computeCollisions(
            self.pepper.pinocchio_model, data, self._model, geometry_data, self.pepper.to_full(state), False
        )
        for index, pair in enumerate(self._model.collisionPairs):
            if geometry_data.collisionResults[index].isCollision():
                found[(self._owners[pair.first], self._owners[pair.second])] = None
        return tuple(found)

    @property
    def _data(self) -> tuple[Any, Any]:
        """Work space of this thread."""
        data = getattr(self._local, "data", None)
        if data is None:
            import pinocchio

            geometry_data = pinocchio.GeometryData(self._model)
            for request in geometry_data.distanceRequests:
                request.enable_signed_distance = True
            for request, second in zip(geometry_data.collisionRequests, self._pairs[1], strict=True):
                to_scene = second >= self._robot_count
                request.security_margin = self.margin if to_scene else self.self_margin
            data = self._local.data = (self.pepper.pinocchio_model.createData(), geometry_data)
        return data

    def _touches(self, q: NDArray[np.float64]) -> bool:
        import pinocchio

        data, geometry_data = self._data
        model = self.pepper.pinocchio_model
        return bool(
            pinocchio.computeCollisions(model, data, self._model, geometry_data, self.pepper.to_full(q), True)
        )

    def _distances(self, q: NDArray[np.float64]) -> tuple[float, int]:
        """Return the smallest distance and its pair's index (-1 where there is no pair).

        Pairs are visited by the distance of their bounding spheres, a lower bound of the true one, until no
        later pair can be nearer.
        """
        import pinocchio

        if not self.pair_count:
            return float("inf"), -1
        data, geometry_data = self._data
        model = self.pepper.pinocchio_model
        pinocchio.updateGeometryPlacements(model, data, self._model, geometry_data, self.pepper.to_full(q))
        centers = np.array([m.act(c) for m, c in zip(geometry_data.oMg, self._bounding_centers, strict=True)])
        first, second = self._pairs
        bounds = np.linalg.norm(centers[first] - centers[second], axis=1) - self._bounding_reach
        best, best_index = float("inf"), -1
        for index in np.argsort(bounds):
            if bounds[index] > best:
                break
            distance = pinocchio.computeDistance(self._model, geometry_data, int(index)).min_distance
            if distance < best:
                best, best_index = float(distance), int(index)
        return best, best_index

    def _add_robot(self) -> None:
        import pinocchio

        model = self.pepper.pinocchio_model
        for shape in self.pepper.collision_shapes:
            frame = self.pepper.frame_id(shape.link)
            joint = model.frames[frame].parentJoint
            placement = model.frames[frame].placement * pinocchio.SE3(shape.transform_shape_to_link)
            geometry = coal_geometry(shape.geometry)
            self._model.addGeometryObject(
                pinocchio.GeometryObject(shape.name, joint, frame, placement, geometry)
            )
            self._owners.append(shape.link)

    def _add_scene(self) -> None:
        import pinocchio

        for item in self.scene.objects.values():
            placement = pinocchio.SE3(item.transform_object_to_world)
            geometry = coal_geometry(item.geometry)
            name = f"scene/{item.name}"
            self._model.addGeometryObject(pinocchio.GeometryObject(name, 0, 0, placement, geometry))
            self._owners.append(item.name)

    def _add_pairs(self) -> None:
        import pinocchio

        disabled = self.pepper.semantics.disabled_pairs
        objects = self._model.geometryObjects
        for i in range(self._robot_count):
            for j in range(i + 1, len(objects)):
                a, b = sorted((self._owners[i], self._owners[j]))
                of_robot = j < self._robot_count
                # Shapes on one joint never move against one another; a base that does not move against the
                # scene is still checked, because a plan in a wall should be refused.
                if of_robot and (objects[i].parentJoint == objects[j].parentJoint or (a, b) in disabled):
                    continue
                self._model.addCollisionPair(pinocchio.CollisionPair(i, j))


def coal_geometry(geometry: Geometry) -> Any:
    """Return coal's shape for a geometry.

    Raises:
        FileFormatError: for a mesh whose file cannot be read.
    """
    import coal

    if isinstance(geometry, Box):
        return coal.Box(*geometry.size)
    if isinstance(geometry, Sphere):
        return coal.Sphere(geometry.radius)
    if isinstance(geometry, Cylinder):
        return coal.Cylinder(geometry.radius, geometry.length)
    if isinstance(geometry, Capsule):
        return coal.Capsule(geometry.radius, geometry.length)
    return _coal_mesh(geometry)


def _coal_mesh(mesh: Mesh) -> Any:
    import coal

    try:
        return coal.MeshLoader().load(str(mesh.path), np.array(mesh.scale))
    except (RuntimeError, ValueError) as error:
        raise FileFormatError(mesh.path, f"cannot be read as a mesh: {error}") from error


@lru_cache(maxsize=32)
def checker_for(
    pepper: PepperModel, scene: Scene | None = None, margin: float = 0.0, self_margin: float = 0.0
) -> CollisionChecker:
    """Return the checker of a robot in a scene, built once and kept for the next call."""
    return CollisionChecker(pepper, scene, margin, self_margin)
