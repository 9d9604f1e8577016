"""All pairs of bodies nearer than a distance, and how the joints change these distances."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.collision.checker import CollisionChecker, checker_for
from pepper_kin.collision.scene import Scene
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_joint_vectors, check_positive

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class NearPairs:
    """Pairs of shapes nearer than a distance at one configuration, nearest first.

    Attributes:
        names: Of each pair: two links, or a link and a scene object.
        distances: d [m], below zero where the two overlap, shape (k,), read-only.
        points: The nearest points, one on each, in the world [m], shape (k, 2, 3), read-only.
        normals: Unit vectors from the second thing to the first, shape (k, 3), read-only.
        gradients: dd/dq [m/rad or 1], shape (k, n), read-only.
        movers: Which joints move the two against one another at all, shape (k, n), read-only.
        cores: Length of the straight part of the one of the two where it is shorter: 0 for a ball, the
            segment of a capsule, twice the bounding radius of anything else [m], shape (k,), read-only.
        indices: Places among the checker's pairs, shape (k,), read-only.
        within: The distance that was asked for: all other pairs are at least that far apart [m].
    """

    names: tuple[tuple[str, str], ...]
    distances: Array
    points: Array
    normals: Array
    gradients: Array
    movers: NDArray[np.bool_]
    cores: Array
    indices: NDArray[np.intp]
    within: float

    def __len__(self) -> int:
        return len(self.names)


def near_pairs(pepper: PepperModel, q: ArrayLike, distance: float, scene: Scene | None = None) -> NearPairs:
    """Return all pairs of shapes nearer than a distance, with witness points and gradients.

    With (a, b) the nearest points, n the unit vector from b to a and J the Jacobians of the points,

        dd/dq = n . (J_a - J_b).

    Neighbouring bodies that `in_collision` decides by joint ranges have no distance and are left out.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (n,).
        distance: Pairs at this distance or farther are left out [m].
        scene: The world around it; None for the robot against itself only.

    Returns:
        The pairs, nearest first; none of them where nothing is near.

    Raises:
        InvalidValueError: for a distance that is not above zero, or a q of wrong shape, or with NaN.
    """
    state = as_joint_vectors(pepper, q, "q")
    if state.ndim != 1:
        raise InvalidValueError("q", f"shape {state.shape}", f"one configuration, shape ({pepper.n},)")
    return pairs_within(checker_for(pepper, scene), state, check_positive("distance", distance, "[m]"))


def pairs_within(checker: CollisionChecker, q: Array, distance: float) -> NearPairs:
    """Return the pairs nearer than a distance for a checker that is at hand; see `near_pairs`."""
    import pinocchio

    full, geometry_data = checker.pepper.to_full(q), checker._data[1]
    tables = _tables_of(checker)
    found: list[tuple[float, int, int]] = []
    witnesses: list[tuple[Array, Array, Array]] = []
    near = np.flatnonzero(checker._bounds(q) < distance) if checker.pair_count else np.empty(0, int)
    for index in near.tolist():
        result = pinocchio.computeDistance(checker._model, geometry_data, index)
        apart = result.min_distance - checker._paddings[index]
        if apart < distance:
            found.append((apart, index, len(witnesses)))
            witnesses.append((result.getNearestPoint1(), result.getNearestPoint2(), result.normal))
    found.sort()
    pairs = np.array([index for _, index, _ in found], dtype=int)
    order = [place for _, _, place in found]
    a, b = checker._pairs[0][pairs], checker._pairs[1][pairs]
    owners = [body.owner for body in checker._bodies]
    seen = np.array(witnesses).reshape(-1, 3, 3)[order]
    points, normals = seen[:, :2], -seen[:, 2]
    gradients = _gradients(checker, full, tables.bodies[a], tables.bodies[b], points, normals)
    return NearPairs(
        names=tuple((owners[i], owners[j]) for i, j in zip(a.tolist(), b.tolist(), strict=True)),
        distances=_frozen(np.array([d for d, _, _ in found])),
        points=_frozen(points),
        normals=_frozen(normals),
        gradients=_frozen(gradients),
        movers=_frozen((tables.moved[a] ^ tables.moved[b]) @ tables.follows),
        cores=_frozen(np.minimum(tables.cores[a], tables.cores[b])),
        indices=_frozen(pairs),
        within=distance,
    )


def distances_along(checker: CollisionChecker, path: Array, indices: NDArray[np.intp]) -> Array:
    """Return the distances of some pairs at every configuration of a path.

    Args:
        checker: The checker.
        path: Joint positions [rad or m], shape (m, n).
        indices: Places among the checker's pairs, shape (k,).

    Returns:
        Distances [m], shape (m, k).
    """
    import pinocchio

    model, (data, geometry_data) = checker.pepper.pinocchio_model, checker._data
    found = np.empty((len(path), len(indices)))
    for row, q in enumerate(checker.pepper.to_full(path)):
        pinocchio.updateGeometryPlacements(model, data, checker._model, geometry_data, q)
        for place, index in enumerate(indices.tolist()):
            found[row, place] = pinocchio.computeDistance(checker._model, geometry_data, index).min_distance
    return found - checker._paddings[indices]


@dataclass(frozen=True, eq=False)
class _Tables:
    """What of a checker's shapes never changes: their joint, what moves them, their straight part.

    `moved` is by the coordinates of Pinocchio's model, which follow the robot's joints as `follows` says.
    """

    bodies: NDArray[np.intp]
    moved: NDArray[np.bool_]
    follows: NDArray[np.bool_]
    cores: Array


_kept: WeakKeyDictionary[CollisionChecker, _Tables] = WeakKeyDictionary()


def _tables_of(checker: CollisionChecker) -> _Tables:
    tables = _kept.get(checker)
    if tables is None:
        model, pepper = checker.pepper.pinocchio_model, checker.pepper
        objects = checker._model.geometryObjects
        bodies = np.array([item.parentJoint for item in objects], dtype=int)
        carried = np.zeros((model.njoints, model.nv), dtype=bool)
        for joint in range(1, model.njoints):
            for above in model.supports[joint].tolist()[1:]:
                first = model.joints[above].idx_v
                carried[joint, first : first + model.joints[above].nv] = True
        tables = _kept[checker] = _Tables(
            bodies=bodies,
            moved=carried[bodies],
            follows=np.abs(pepper.full_map) > 0,
            cores=np.array([_core(item.geometry) for item in objects]),
        )
    return tables


def _core(geometry: Any) -> float:
    """Return the length of what a ball is swept along to make a shape [m]."""
    import coal

    if isinstance(geometry, coal.Sphere):
        return 0.0
    if isinstance(geometry, coal.Capsule):
        return 2.0 * float(geometry.halfLength)
    return 2.0 * float(geometry.aabb_radius)


def _gradients(
    checker: CollisionChecker,
    q_full: Array,
    first: NDArray[np.intp],
    second: NDArray[np.intp],
    points: Array,
    normals: Array,
) -> Array:
    """Return n . (J_a - J_b), as (n, p x n) . J with J of the body about the world's origin."""
    import pinocchio

    model, data = checker.pepper.pinocchio_model, checker.pepper.pinocchio_data
    pinocchio.computeJointJacobians(model, data, q_full)
    used = sorted({*first.tolist(), *second.tolist()})
    place = np.zeros(model.njoints, dtype=int)
    place[used] = np.arange(len(used))
    jacobians = np.zeros((max(len(used), 1), 6, model.nv))
    for row, body in enumerate(used):
        if body:
            jacobians[row] = pinocchio.getJointJacobian(model, data, body, pinocchio.WORLD)
    moments = np.cross(points, normals[:, None, :])
    gradients = (normals[:, None, :] @ (jacobians[place[first], :3] - jacobians[place[second], :3]))[:, 0]
    gradients += (moments[:, None, 0] @ jacobians[place[first], 3:])[:, 0]
    gradients -= (moments[:, None, 1] @ jacobians[place[second], 3:])[:, 0]
    return gradients @ checker.pepper.full_map if checker.pepper.is_coupled else gradients


def _frozen(array: NDArray) -> NDArray:
    array.setflags(write=False)
    return array
