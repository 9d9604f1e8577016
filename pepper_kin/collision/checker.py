"""Exact collision and distance of a robot with itself and a scene, by coal."""

from __future__ import annotations

import threading
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.arrays import read_only
from pepper_kin.collision.bodies import GeometryType, check_geometry_type, check_names
from pepper_kin.collision.checked_shapes import CheckedShapes, PairsTo
from pepper_kin.collision.coal_shapes import coal_geometry
from pepper_kin.collision.contact import ClosestPair, Contact
from pepper_kin.collision.dependent_ranges import DependentRange, dependent_ranges
from pepper_kin.collision.kept_size import MOST_BYTES, checker_size
from pepper_kin.collision.mesh_changes import as_on_disk
from pepper_kin.collision.pair_queries import KeptPairs, SinglePairs, ball_distances, pair_queries
from pepper_kin.collision.scene import Scene
from pepper_kin.collision.solids import not_negative
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import Mesh, PepperModel, kept_for_robot
from pepper_kin.model.dynamics_model import working_memory
from pepper_kin.model.joint_vectors import as_joint_vectors, as_real

__all__ = ["RANGE_RADIUS", "ClosestPair", "CollisionChecker", "checker_for", "coal_geometry"]

RANGE_RADIUS = 0.1
"""Approximate distance from their joint at which adjacent bodies touch [m]: converts a margin to an angle."""


class CollisionChecker:
    """Collision and distance queries for one robot in one scene.

    Self-collision covers all pairs of links except those that the SRDF disables; of the latter, pairs marked
    "DependentRange" are decided by tabulated joint ranges (yes or no, no distance).

    Args:
        pepper: The robot.
        scene: The world around it, with attached objects; None for none.
        margin: Distance to obstacles below which `in_collision` is true [m].
        self_margin: Distance between two parts of the robot, including attached objects, below which
            `in_collision` is true [m].
        geometry_type: "collision" for the shapes that contain the bodies; "visual" for the visual surfaces,
            which are much slower and thinner, and do not touch a part that is inside.
    """

    def __init__(
        self,
        pepper: PepperModel,
        scene: Scene | None = None,
        margin: float = 0.0,
        self_margin: float = 0.0,
        geometry_type: GeometryType = "collision",
    ) -> None:
        self.pepper = pepper
        self.margin, self.self_margin = _finite("margin", margin), _finite("self_margin", self_margin)
        self.scene = as_on_disk(scene) or Scene()
        check_geometry_type(geometry_type)
        check_names(pepper, self.scene)
        self._ranges = dependent_ranges(pepper) if geometry_type == "collision" else ()
        self._shapes = CheckedShapes(pepper, self.scene, geometry_type)
        geometries = [item.geometry for item in self.scene.objects.values()]
        for geometry in (*geometries, *(item.geometry for item in self.scene.attached.values())):
            if isinstance(geometry, Mesh):
                coal_geometry(geometry)  # a file that cannot be read is reported now
        self._local = threading.local()
        self._like: CollisionChecker | None = None  # not itself: only the garbage collector would free it

    @cached_property
    def _margins(self) -> NDArray[np.float64]:
        """Distance of coal's shapes below which each pair counts as touching [m]."""
        shapes = self._shapes
        return np.asarray(np.where(shapes.to_world, self.margin, self.self_margin) + shapes.paddings)

    @property
    def shapes_of(self) -> CollisionChecker:
        """Checker whose shapes and pairs this one shares; itself if it shares none."""
        return self if self._like is None else self._like

    def with_margins(self, margin: float, self_margin: float) -> CollisionChecker:
        """Return a checker of the same shapes with other margins [m], at far less cost than a new one."""
        made = object.__new__(type(self))
        made.__dict__.update(self.__dict__)
        made.margin, made.self_margin = _finite("margin", margin), _finite("self_margin", self_margin)
        made.__dict__.pop("_margins", None)
        made._local, made._like = threading.local(), self.shapes_of
        return made

    @property
    def dependent_ranges(self) -> tuple[DependentRange, ...]:
        """Tables of joint ranges that decide pairs of adjacent bodies; none for visual surfaces."""
        return self._ranges

    @property
    def pair_count(self) -> int:
        """Number of pairs of shapes that are checked."""
        return len(self._shapes.pairs[0])

    @property
    def pairs_to_world(self) -> NDArray[np.bool_]:
        """Whether each pair is with an obstacle of the world, shape (pair_count,)."""
        return self._shapes.to_world

    def in_collision(self, q: ArrayLike) -> NDArray[np.bool_]:
        """Return whether anything collides, shape (...,), at joint positions q, shape (..., n) [rad or m]."""
        q_all = as_joint_vectors(self.pepper, q, "q")
        flat = q_all.reshape(-1, self.pepper.n)
        touching = np.zeros(flat.shape[0], dtype=bool)
        for table in self._ranges:
            touching |= table.violated(flat, self.self_margin / RANGE_RADIUS)
        for i in np.flatnonzero(~touching):
            touching[i] = self._touches(flat[i])
        return touching.reshape(q_all.shape[:-1])

    def clearance(self, q: ArrayLike, to: PairsTo = "all") -> NDArray[np.float64]:
        """Return the minimum distance of checked pairs [m], shape (...,), at q, shape (..., n) [rad or m].

        A negative value is the depth of the deepest overlap; inf if no pair is checked.  `to` selects the
        pairs of the robot with itself or with obstacles only.
        """
        q_all = as_joint_vectors(self.pepper, q, "q")
        flat = q_all.reshape(-1, self.pepper.n)
        distances = np.array([self._distances(state, to)[0] for state in flat]).reshape(q_all.shape[:-1])
        return distances

    def closest_pair(self, q: ArrayLike, to: PairsTo = "all") -> ClosestPair | None:
        """Return the nearest pair at one configuration q, shape (n,); None if no pair is checked."""
        distance, index = self._distances(self._one(q), to)
        if index < 0:
            return None
        names, points, _, links = self._witness(index)
        return ClosestPair(names, distance, points, links)

    def contacts(self, q: ArrayLike) -> tuple[tuple[str, str], ...]:
        """Return the names of all pairs that touch at one configuration q, shape (n,)."""
        state = self._one(q)
        found = {table.links: None for table in self._ranges if table.violated(state)}
        data, queries = self._data
        for index in queries.touching(data, self.pepper.to_full(state)):
            first, second = (self._shapes.bodies[pairs[index]] for pairs in self._shapes.pairs)
            found[(first.owner, second.owner)] = None
        return tuple(found)

    def contact_points(self, q: ArrayLike, within: float = 0.0) -> tuple[Contact, ...]:
        """Return the contacts at one configuration q, shape (n,), the deepest first.

        Each pair of links or objects is listed once, at its nearest points.  Pairs of adjacent links that a
        table decides come last, without points.

        Args:
            q: Joint positions [rad or m], shape (n,).
            within: Distance up to which nearby pairs are listed as well [m].

        Raises:
            InvalidValueError: for a q of wrong shape, or with NaN or infinity; for a negative `within`.
        """
        state, reach = self._one(q), not_negative("within", within)
        bounds = self._bounds(state)
        nearest: dict[tuple[str, str], tuple[float, int]] = {}
        for index in np.flatnonzero(bounds <= reach):
            result = self._data[1].distance(int(index))
            distance = float(result.min_distance - self._shapes.paddings[index])
            names = tuple(self._shapes.bodies[pairs[index]].owner for pairs in self._shapes.pairs)
            if distance <= reach and distance < nearest.get(names, (np.inf, 0))[0]:
                nearest[names] = (distance, int(index))
        found = []
        for distance, pair in sorted(nearest.values()):
            names, points, normal, links = self._witness(pair)
            found.append(Contact(names, distance, points, normal, links))
        tables = [table for table in self._ranges if table.violated(state)]
        found += [Contact(table.links, None, None, None, table.links) for table in tables]
        return tuple(found)

    @property
    def _data(self) -> tuple[Any, KeptPairs | SinglePairs]:
        """Pinocchio's data of the joints, and the pair queries, of this thread."""
        data = getattr(self._local, "data", None)
        if data is None:
            model = self.pepper.inner_model
            joints = _joints_of(self.pepper)
            if not hasattr(joints, "data"):
                joints.data = working_memory(model)
            data = self._local.data = joints.data, pair_queries(model, self._shapes, self._margins)
        return data

    def _one(self, q: ArrayLike) -> NDArray[np.float64]:
        """Return one configuration q [rad or m], n numbers in any shape, as an array of shape (n,)."""
        state = as_joint_vectors(self.pepper, q, "q")
        if state.size != self.pepper.n:
            raise InvalidValueError(
                "q", f"shape {state.shape}", f"one configuration, shape ({self.pepper.n},)"
            )
        return state.reshape(self.pepper.n)

    def _touches(self, q: NDArray[np.float64]) -> bool:
        """Return whether anything collides at one configuration q [rad or m], shape (n,)."""
        data, queries = self._data
        return queries.any_touches(data, self.pepper.to_full(q))

    def _bounds(self, q: NDArray[np.float64]) -> NDArray[np.float64]:
        """Place all shapes at q, shape (n,), and return a lower bound of each pair's distance [m].

        The bounds are the distances of the bounding spheres, shape (pairs,).
        """
        import pinocchio

        data, queries = self._data
        pinocchio.forwardKinematics(self.pepper.inner_model, data, self.pepper.to_full(q))
        queries.place(data)
        poses = queries.poses(list(range(len(self._shapes.bodies))))
        return ball_distances(self._shapes, poses) - self._shapes.paddings

    def _distances(self, q: NDArray[np.float64], to: PairsTo) -> tuple[float, int]:
        """Return the minimum distance [m] at q, shape (n,), and its pair's index, -1 if no pair counts.

        Pairs are visited by the distance of their bounding spheres, a lower bound of the true one, until no
        later pair can be nearer.
        """
        counted = self._shapes.counted(to)
        if not counted.any():
            return float("inf"), -1
        bounds, queries = self._bounds(q), self._data[1]
        best, best_index = float("inf"), -1
        order = np.argsort(bounds)
        if to != "all":
            order = order[counted[order]]
        listed = (order.tolist(), bounds[order].tolist(), self._shapes.paddings[order].tolist())
        for index, bound, padding in zip(*listed, strict=True):
            if bound > best:
                break
            distance = queries.distance(index).min_distance - padding
            if distance < best:
                best, best_index = distance, index
        return best, best_index

    def _witness(
        self, index: int
    ) -> tuple[tuple[str, str], NDArray[np.float64], NDArray[np.float64], tuple[str | None, str | None]]:
        """Return names, nearest points, normal and links of the pair whose distance was computed last."""
        first, second = (self._shapes.bodies[pairs[index]] for pairs in self._shapes.pairs)
        result = self._data[1].result(index)
        points = np.array([result.getNearestPoint1(), result.getNearestPoint2()])
        apart = points[1] - points[0]
        length = np.linalg.norm(apart)
        normal = np.array(result.normal)
        if length > 1e-9:
            normal = apart / length * (1.0 if result.min_distance > 0 else -1.0)
        points += normal * [[first.padding], [-second.padding]]
        return (first.owner, second.owner), read_only(points), read_only(normal), (first.link, second.link)


@kept_for_robot(most=1)
def _joints_of(pepper: PepperModel) -> threading.local:
    """Return the holder of Pinocchio's data of a thread, which every query of any checker overwrites."""
    return threading.local()


def _finite(quantity: str, value: float) -> float:
    """Return a margin [m] after a check that it is finite."""
    number = as_real(value)
    if not np.isfinite(number):
        raise InvalidValueError(quantity, value, "a finite distance [m]")
    return number


def checker_for(
    pepper: PepperModel,
    scene: Scene | None = None,
    margin: float = 0.0,
    self_margin: float = 0.0,
    geometry_type: GeometryType = "collision",
) -> CollisionChecker:
    """Return the checker of a robot in a scene, cached for the next call."""
    return _checker_for(pepper, as_on_disk(scene), margin, self_margin, geometry_type)


@kept_for_robot(most=64, most_bytes=MOST_BYTES, size_of=checker_size)
def _checker_for(
    pepper: PepperModel, scene: Scene | None, margin: float, self_margin: float, geometry_type: GeometryType
) -> CollisionChecker:
    """Return one cached checker for all spellings of the arguments."""
    if margin == 0.0 and self_margin == 0.0:
        return CollisionChecker(pepper, scene, geometry_type=geometry_type)
    return _checker_for(pepper, scene, 0.0, 0.0, geometry_type).with_margins(margin, self_margin)
