"""Exact collision and distance of a robot with itself and a scene, by coal."""

from __future__ import annotations

import copy
import threading
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.collision.bodies import WORLD, Body, Looks, bodies, checked_pairs
from pepper_kin.collision.coal_shapes import coal_geometry
from pepper_kin.collision.contact import ClosestPair, Contact
from pepper_kin.collision.dependent_ranges import dependent_ranges
from pepper_kin.collision.scene import Scene
from pepper_kin.collision.solids import not_negative
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_joint_vectors
from pepper_kin.model.shapes import read_only

__all__ = ["LEVER", "ClosestPair", "CollisionChecker", "checker_for", "coal_geometry"]

LEVER = 0.1
"""About how far from their joint neighbouring bodies meet [m]: turns a distance kept into an angle kept."""


class CollisionChecker:
    """Collision and distance queries for one robot in one scene.

    Self-collision covers all pairs of links but those that the SRDF disables; of these, the pairs marked
    "DependentRange" are decided by tabulated joint ranges (yes or no, no distance).

    Args:
        pepper: The robot.
        scene: The world around it, with what the robot holds; None for none.
        margin: Distance to what stands in the world below which `in_collision` says yes [m].
        self_margin: The same for two parts of the robot, what it holds included [m].
        looks: "collision" for the shapes that contain the bodies; "visual" for the surfaces that are drawn:
            slower by far, thinner, and a part inside another does not touch it.
    """

    def __init__(
        self,
        pepper: PepperModel,
        scene: Scene | None = None,
        margin: float = 0.0,
        self_margin: float = 0.0,
        looks: Looks = "collision",
    ) -> None:
        import pinocchio

        self.pepper = pepper
        self.margin, self.self_margin = _finite("margin", margin), _finite("self_margin", self_margin)
        self.scene = scene if scene is not None else Scene()
        self._ranges = dependent_ranges(pepper) if looks == "collision" else ()
        self._bodies = bodies(pepper, self.scene, looks)
        self._model: Any = pinocchio.GeometryModel()
        for body in self._bodies:
            self._model.addGeometryObject(body.geometry_object)
        listed = list(checked_pairs(pepper, self.scene, self._bodies, looks))
        for i, j in listed:
            self._model.addCollisionPair(pinocchio.CollisionPair(i, j))
        balls = [_bounding_ball(body) for body in self._bodies]
        self._bounding_centers = [center for center, _ in balls]
        radii = np.array([radius for _, radius in balls])
        pads = np.array([body.padding for body in self._bodies])
        pairs = np.array(listed, dtype=int).reshape(-1, 2)
        self._pairs = (pairs[:, 0], pairs[:, 1])
        self._bounding_reach = radii[pairs].sum(axis=1) if len(pairs) else np.empty(0)
        self._paddings = pads[pairs].sum(axis=1) if len(pairs) else np.empty(0)
        self._to_world = np.array([self._bodies[j].kind == WORLD for _, j in listed], dtype=bool)
        self._margins = np.where(self._to_world, self.margin, self.self_margin) + self._paddings
        normals = {j: _plane_normal(self._bodies[j]) for j in {j for _, j in listed}}
        to_plane = [k for k, (_, j) in enumerate(listed) if normals[j] is not None]
        planes = [normals[listed[k][1]] for k in to_plane]
        # The broad phase misses what has no bounding box, or a flat one: those pairs are checked one and all.
        boxed = [_has_box(body) for body in self._bodies]
        self._without_box = np.flatnonzero([not (boxed[i] and boxed[j]) for i, j in listed])
        self._planes = (np.array(to_plane, dtype=int), np.array(planes).reshape(-1, 3))
        self._local = threading.local()
        self._like = self

    @property
    def shapes_of(self) -> CollisionChecker:
        """The checker whose shapes and pairs this one shares; itself where it was made anew."""
        return self._like

    def with_margins(self, margin: float, self_margin: float) -> CollisionChecker:
        """Return a checker of the same shapes with other margins [m], which costs far less than a new one."""
        made = copy.copy(self)
        made.margin, made.self_margin = _finite("margin", margin), _finite("self_margin", self_margin)
        made._margins = np.where(self._to_world, made.margin, made.self_margin) + self._paddings
        made._local = threading.local()
        return made

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
        distance, index = self._distances(self._one(q))
        if index < 0:
            return None
        names, points, _, links = self._witness(index)
        return ClosestPair(names, distance, points, links)

    def contacts(self, q: ArrayLike) -> tuple[tuple[str, str], ...]:
        """Return the names of all pairs that touch at one configuration q, shape (n,)."""
        import pinocchio

        state = self._one(q)
        found = {table.links: None for table in self._ranges if table.violated(state)}
        data, geometry_data = self._data
        pinocchio.computeCollisions(
            self.pepper.inner_model, data, self._model, geometry_data, self.pepper.to_full(state), False
        )
        for index, pair in enumerate(self._model.collisionPairs):
            if geometry_data.collisionResults[index].isCollision():
                found[(self._bodies[pair.first].owner, self._bodies[pair.second].owner)] = None
        return tuple(found)

    def contact_points(self, q: ArrayLike, within: float = 0.0) -> tuple[Contact, ...]:
        """Return where things touch at one configuration q, shape (n,), the deepest first.

        Each pair of links or objects is listed once, where it is nearest.  A pair of neighbours that a table
        decides comes last, without points.

        Args:
            q: Joint positions [rad or m], shape (n,).
            within: Pairs nearer than this are listed as well [m].

        Raises:
            InvalidValueError: for a q of wrong shape, or with NaN or infinity; for `within` below 0.
        """
        import pinocchio

        state, reach = self._one(q), not_negative("within", within)
        bounds = self._bounds(state)
        nearest: dict[tuple[str, str], tuple[float, int]] = {}
        for index in np.flatnonzero(bounds <= reach):
            result = pinocchio.computeDistance(self._model, self._data[1], int(index))
            distance = float(result.min_distance - self._paddings[index])
            names = tuple(self._bodies[pairs[index]].owner for pairs in self._pairs)
            if distance <= reach and distance < nearest.get(names, (np.inf, 0))[0]:
                nearest[names] = (distance, int(index))
        found = []
        for distance, index in sorted(nearest.values()):
            names, points, normal, links = self._witness(index)
            found.append(Contact(names, distance, points, normal, links))
        tables = [table for table in self._ranges if table.violated(state)]
        found += [Contact(table.links, None, None, None, table.links) for table in tables]
        return tuple(found)

    @property
    def _data(self) -> tuple[Any, Any]:
        """Work space of this thread."""
        data = getattr(self._local, "data", None)
        if data is None:
            import pinocchio

            geometry_data = self._geometry_data()
            model = self.pepper.inner_model
            data = self._local.data = (model.createData(), geometry_data)
            # The broad phase takes over the margins when it is made.
            broad = pinocchio.BroadPhaseManager_DynamicAABBTreeCollisionManager
            self._local.broad_phase = broad(model, self._model, geometry_data)
            self._local.without_box = None
            if len(self._without_box):
                self._local.without_box = rest = self._geometry_data()
                for index in set(range(self.pair_count)) - set(self._without_box.tolist()):
                    rest.deactivateCollisionPair(index)
        return data

    def _geometry_data(self) -> Any:
        import pinocchio

        geometry_data = pinocchio.GeometryData(self._model)
        # Distances come signed, and without margins, as coal makes requests; a call for each pair costs time.
        if self._margins.any():
            for request, margin in zip(geometry_data.collisionRequests, self._margins, strict=True):
                request.security_margin = float(margin)
        return geometry_data

    def _one(self, q: ArrayLike) -> NDArray[np.float64]:
        state = as_joint_vectors(self.pepper, q, "q")
        if state.size != self.pepper.n:
            raise InvalidValueError(
                "q", f"shape {state.shape}", f"one configuration, shape ({self.pepper.n},)"
            )
        return state.reshape(self.pepper.n)

    def _touches(self, q: NDArray[np.float64]) -> bool:
        import pinocchio

        data, model = self._data[0], self.pepper.inner_model
        full = self.pepper.to_full(q)
        if pinocchio.computeCollisions(model, data, self._local.broad_phase, full, True):
            return True
        rest = self._local.without_box
        return rest is not None and bool(
            pinocchio.computeCollisions(model, data, self._model, rest, full, True)
        )

    def _bounds(self, q: NDArray[np.float64]) -> NDArray[np.float64]:
        """Place all shapes at q and return a lower bound of each pair's distance, that of their balls [m]."""
        import pinocchio

        data, geometry_data = self._data
        model = self.pepper.inner_model
        pinocchio.updateGeometryPlacements(model, data, self._model, geometry_data, self.pepper.to_full(q))
        centers = np.array([m.act(c) for m, c in zip(geometry_data.oMg, self._bounding_centers, strict=True)])
        first, second = self._pairs
        apart = centers[first] - centers[second]
        gaps = np.linalg.norm(apart, axis=1)
        # Of a half-space the "center" is a point of its plane, and what counts is the height above that.
        to_plane, normals = self._planes
        gaps[to_plane] = np.einsum("ij,ij->i", apart[to_plane], normals)
        return gaps - self._bounding_reach - self._paddings

    def _distances(self, q: NDArray[np.float64]) -> tuple[float, int]:
        """Return the smallest distance and its pair's index (-1 where there is no pair).

        Pairs are visited by the distance of their bounding balls, a lower bound of the true one, until no
        later pair can be nearer.
        """
        import pinocchio

        if not self.pair_count:
            return float("inf"), -1
        bounds, geometry_data = self._bounds(q), self._data[1]
        best, best_index = float("inf"), -1
        order = np.argsort(bounds)
        listed = (order.tolist(), bounds[order].tolist(), self._paddings[order].tolist())
        for index, bound, padding in zip(*listed, strict=True):
            if bound > best:
                break
            distance = pinocchio.computeDistance(self._model, geometry_data, index).min_distance - padding
            if distance < best:
                best, best_index = distance, index
        return best, best_index

    def _witness(
        self, index: int
    ) -> tuple[tuple[str, str], NDArray[np.float64], NDArray[np.float64], tuple[str | None, str | None]]:
        """Return names, nearest points, normal and links of a pair whose distance was computed last."""
        first, second = (self._bodies[pairs[index]] for pairs in self._pairs)
        result = self._data[1].distanceResults[index]
        points = np.array([result.getNearestPoint1(), result.getNearestPoint2()])
        apart = points[1] - points[0]
        length = np.linalg.norm(apart)
        normal = np.array(result.normal)
        if length > 1e-9:
            normal = apart / length * (1.0 if result.min_distance > 0 else -1.0)
        points += normal * [[first.padding], [-second.padding]]
        return (first.owner, second.owner), read_only(points), read_only(normal), (first.link, second.link)


def _bounding_ball(body: Body) -> tuple[NDArray[np.float64], float]:
    """Return centre, in the frame of coal's shape, and radius [m]; for a half-space, a point on it."""
    shape = body.geometry_object.geometry
    if body.is_half_space:
        return np.array(shape.n) * shape.d, 0.0
    shape.computeLocalAABB()
    return np.array(shape.aabb_center), float(shape.aabb_radius)


def _has_box(body: Body) -> bool:
    return not body.is_half_space and body.geometry_object.geometry.aabb_local.volume() > 0


def _plane_normal(body: Body) -> NDArray[np.float64] | None:
    """Return the direction out of a half-space in the world, shape (3,); None for other bodies."""
    if not body.is_half_space:
        return None
    return np.array(body.geometry_object.placement.rotation @ body.geometry_object.geometry.n)


def _finite(quantity: str, value: float) -> float:
    number = float(value)
    if not np.isfinite(number):
        raise InvalidValueError(quantity, value, "a finite distance [m]")
    return number


def checker_for(
    pepper: PepperModel,
    scene: Scene | None = None,
    margin: float = 0.0,
    self_margin: float = 0.0,
    looks: Looks = "collision",
) -> CollisionChecker:
    """Return the checker of a robot in a scene, built once and kept for the next call."""
    return _checker_for(pepper, scene, margin, self_margin, looks)


@lru_cache(maxsize=64)
def _checker_for(
    pepper: PepperModel, scene: Scene | None, margin: float, self_margin: float, looks: Looks
) -> CollisionChecker:
    """Keep one checker however the arguments are written."""
    if margin == 0.0 and self_margin == 0.0:
        return CollisionChecker(pepper, scene, looks=looks)
    return _checker_for(pepper, scene, 0.0, 0.0, looks).with_margins(margin, self_margin)
