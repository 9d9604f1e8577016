"""Contact and distance queries of pairs of shapes, by coal: cached by Pinocchio, or one pair at a time."""

from __future__ import annotations

from typing import Any

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.collision.checked_shapes import CheckedShapes
from pepper_kin.collision.round_pairs import Pose, is_round, witness

MOST_KEPT = 20_000
"""Maximum number of pairs for which Pinocchio caches requests and results: its table of pairs grows with the
square of the shapes, and is copied for each of them."""

MOST_COMPARED = 100
"""Number of bodies up to which all boxes are compared with one another; a tree of boxes, rebuilt for each
state, takes twice as long for 41 bodies, and equally long for 120."""


class KeptPairs:
    """Pairs whose requests and results Pinocchio caches; a broad phase finds the touching ones.

    Args:
        model: Pinocchio's model of the robot.
        shapes: The shapes and pairs.
        margins: Distance below which each pair counts as touching [m], shape (pairs,).
    """

    def __init__(self, model: Any, shapes: CheckedShapes, margins: Array) -> None:
        import pinocchio

        self._model, self._shapes, self._margins = model, shapes, margins
        self._kept, self._round = self._data(), round_pairs(shapes)
        self._better: dict[int, Any] = {}
        # The broad phase copies the margins when it is made.
        kind = "Naive" if len(shapes.bodies) <= MOST_COMPARED else "DynamicAABBTree"
        broad = getattr(pinocchio, f"BroadPhaseManager_{kind}CollisionManager")
        self._broad_phase = broad(model, shapes.model, self._kept)
        self._without_box = None
        if len(shapes.without_box):
            self._without_box = rest = self._data()
            for index in set(range(len(margins))) - set(shapes.without_box.tolist()):
                rest.deactivateCollisionPair(index)

    def _data(self) -> Any:
        """Return Pinocchio's data of the pairs, with the margins in its requests."""
        import pinocchio

        data = pinocchio.GeometryData(self._shapes.model)
        # By default, coal's requests have signed distances and no margins; a call for each pair costs time.
        if self._margins.any():
            for request, margin in zip(data.collisionRequests, self._margins, strict=True):
                request.security_margin = float(margin)
        return data

    def place(self, data: Any) -> None:
        """Place all shapes according to the joints of `pinocchio.Data`."""
        import pinocchio

        pinocchio.updateGeometryPlacements(self._model, data, self._shapes.model, self._kept)

    def poses(self, bodies: list[int]) -> list[Any]:
        """Return the poses of some bodies in the world, after `place`."""
        placed = self._kept.oMg
        return [placed[i] for i in bodies]

    def distance(self, index: int) -> Any:
        """Return the distance result of a pair, after `place`; it is kept for `result`."""
        import pinocchio

        found = pinocchio.computeDistance(self._shapes.model, self._kept, index)
        if found.min_distance < 0.0 and index in self._round:
            found = self._better[index] = better(self._shapes, index, self._kept.oMg, found)
        else:
            self._better.pop(index, None)
        return found

    def result(self, index: int) -> Any:
        """Return the last result of `distance` for a pair."""
        return self._better[index] if index in self._better else self._kept.distanceResults[index]

    def any_touches(self, data: Any, q_full: Array) -> bool:
        """Return whether any pair touches at a configuration of Pinocchio's model, shape (nq,)."""
        import pinocchio

        if pinocchio.computeCollisions(self._model, data, self._broad_phase, q_full, True):
            return True
        rest = self._without_box
        return rest is not None and bool(
            pinocchio.computeCollisions(self._model, data, self._shapes.model, rest, q_full, True)
        )

    def touching(self, data: Any, q_full: Array) -> list[int]:
        """Return the touching pairs, sorted, at a configuration of Pinocchio's model, shape (nq,)."""
        import pinocchio

        pinocchio.computeCollisions(self._model, data, self._shapes.model, self._kept, q_full, False)
        results = self._kept.collisionResults
        return [index for index in range(len(self._margins)) if results[index].isCollision()]


class SinglePairs:
    """Queries for more pairs than can be cached: coal tests pairs with near bounding spheres one at a time.

    Args:
        model: Pinocchio's model of the robot.
        shapes: The shapes and pairs.
        margins: Distance below which each pair counts as touching [m], shape (pairs,).
    """

    def __init__(self, model: Any, shapes: CheckedShapes, margins: Array) -> None:
        import coal

        self._model, self._shapes, self._margins = model, shapes, margins
        self._coal = [body.geometry_object.geometry for body in shapes.bodies]
        self._placements = [body.geometry_object.placement for body in shapes.bodies]
        self._joints = [body.joint for body in shapes.bodies]
        self._first, self._second = (places.tolist() for places in shapes.pairs)
        self._poses = list(self._placements)
        self._transforms = [coal.Transform3s(pose.rotation, pose.translation) for pose in self._poses]
        self._moving = [i for i, joint in enumerate(self._joints) if joint]
        self._results: dict[int, Any] = {}
        self._round = round_pairs(shapes)

    def place(self, data: Any) -> None:
        """Place all shapes according to the joints of `pinocchio.Data`."""
        import coal

        self._results.clear()
        for i in self._moving:
            pose = self._poses[i] = data.oMi[self._joints[i]] * self._placements[i]
            self._transforms[i] = coal.Transform3s(pose.rotation, pose.translation)

    def poses(self, bodies: list[int]) -> list[Any]:
        """Return the poses of some bodies in the world, after `place`."""
        return [self._poses[i] for i in bodies]

    def distance(self, index: int) -> Any:
        """Return the distance result of a pair, after `place`; it is kept for `result`."""
        import coal

        i, j = self._first[index], self._second[index]
        found, request = coal.DistanceResult(), coal.DistanceRequest()
        coal.distance(self._coal[i], self._transforms[i], self._coal[j], self._transforms[j], request, found)
        if found.min_distance < 0.0 and index in self._round:
            found = better(self._shapes, index, self._poses, found)
        self._results[index] = found
        return found

    def result(self, index: int) -> Any:
        """Return the last result of `distance` for a pair."""
        return self._results[index]

    def any_touches(self, data: Any, q_full: Array) -> bool:
        """Return whether any pair touches at a configuration of Pinocchio's model, shape (nq,)."""
        return any(self._touches(index) for index in self._near(data, q_full))

    def touching(self, data: Any, q_full: Array) -> list[int]:
        """Return the touching pairs, sorted, at a configuration of Pinocchio's model, shape (nq,)."""
        return [index for index in self._near(data, q_full) if self._touches(index)]

    def _near(self, data: Any, q_full: Array) -> list[int]:
        """Return the pairs whose bounding spheres are within the margins at a configuration, shape (nq,)."""
        import pinocchio

        pinocchio.forwardKinematics(self._model, data, q_full)
        self.place(data)
        bounds = ball_distances(self._shapes, self.poses(list(range(len(self._coal)))))
        return [int(k) for k in np.flatnonzero(bounds <= self._margins)]

    def _touches(self, index: int) -> bool:
        """Return coal's verdict on a pair."""
        import coal

        i, j = self._first[index], self._second[index]
        request, found = coal.CollisionRequest(), coal.CollisionResult()
        request.security_margin = float(self._margins[index])
        coal.collide(self._coal[i], self._transforms[i], self._coal[j], self._transforms[j], request, found)
        return bool(found.isCollision())


def pair_queries(model: Any, shapes: CheckedShapes, margins: Array) -> KeptPairs | SinglePairs:
    """Return the queries suited to the number of pairs, for one thread; margins [m], shape (pairs,)."""
    return (KeptPairs if len(margins) <= MOST_KEPT else SinglePairs)(model, shapes, margins)


def round_pairs(shapes: CheckedShapes) -> frozenset[int]:
    """Return the pairs both of whose shapes are spheres, capsules or cylinders."""
    kinds = np.array([is_round(body.geometry_object.geometry) for body in shapes.bodies], dtype=bool)
    first, second = shapes.pairs
    return frozenset(np.flatnonzero(kinds[first] & kinds[second]).tolist())


def better(shapes: CheckedShapes, index: int, poses: Any, result: Any) -> Any:
    """Return coal's result on a pair of overlapping round shapes, or a better one; `poses` of all bodies."""
    places = [int(each[index]) for each in shapes.pairs]
    first, second = (shapes.bodies[place].geometry_object.geometry for place in places)
    at: list[Pose] = [(np.array(poses[k].rotation), np.array(poses[k].translation)) for k in places]
    return witness((first, second), (at[0], at[1]), result)


def ball_distances(shapes: CheckedShapes, poses: list[Any]) -> Array:
    """Return a lower bound of the distance of coal's shapes of each pair, from bounding spheres [m].

    Args:
        shapes: The shapes and pairs.
        poses: Poses of all bodies in the world.
    """
    placed = zip(poses, shapes.bounding_centers, strict=True)
    centers = np.array([pose.act(center) for pose, center in placed]).reshape(-1, 3)  # also if there are none
    first, second = shapes.pairs
    apart = centers[first] - centers[second]
    gaps = np.linalg.norm(apart, axis=1)
    # The "center" of a half-space is a point of its plane; the distance is the height above the plane.
    to_plane, normals = shapes.planes
    gaps[to_plane] = np.einsum("ij,ij->i", apart[to_plane], normals)
    return np.asarray(gaps - shapes.bounding_reach)
