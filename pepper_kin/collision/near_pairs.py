"""All pairs of bodies nearer than a distance, and the gradients of the distances."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.arrays import Array, BriefRepr
from pepper_kin.collision.checker import CollisionChecker, checker_for
from pepper_kin.collision.scene import Scene
from pepper_kin.core.collision.distances import CARRIER, NearTable, find_near, near_points, slopes
from pepper_kin.core.kinematic_tree import place_joints
from pepper_kin.core.near_state import ANSWER
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_joint_vectors, check_positive


@dataclass(frozen=True, eq=False)
class NearPairs(BriefRepr):
    """Pairs of shapes nearer than a distance at one configuration, nearest first.

    Attributes:
        names: Names of each pair: two links, or a link and a scene object.
        distances: d [m], negative if the two overlap, shape (k,), read-only.
        points: The nearest points, one on each, in the world [m], shape (k, 2, 3), read-only.
        normals: Unit vectors from the second body to the first, shape (k, 3), read-only.
        gradients: dd/dq [m/rad or 1], shape (k, n), read-only.
        movers: Whether each joint moves the two against one another, shape (k, n), read-only.
        cores: Length of the straight part of either body, the shorter of the two: 0 for a sphere, the segment
            of a capsule, twice the bounding radius of anything else [m], shape (k,), read-only.
        indices: Indices among the checker's pairs, shape (k,), read-only.
        within: The requested distance: all other pairs are at least that far apart [m].
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


def near_pairs(pepper: PepperModel, q: ArrayLike, within: float, scene: Scene | None = None) -> NearPairs:
    """Return all pairs of shapes nearer than a distance, with witness points and gradients.

    With (a, b) the nearest points, n the unit vector from b to a and J the Jacobians of the points,

        dd/dq = n . (J_a - J_b).

    Adjacent bodies that `in_collision` decides by joint ranges have no distance and are left out.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (n,).
        within: Distance from which on pairs are left out [m].
        scene: The world around it; None for the robot against itself only.

    Returns:
        The pairs, nearest first; empty if nothing is near.

    Raises:
        InvalidValueError: for a distance that is not above zero, or a q of wrong shape, or with NaN.
    """
    state = as_joint_vectors(pepper, q, "q")
    if state.ndim != 1:
        raise InvalidValueError("q", f"shape {state.shape}", f"one configuration, shape ({pepper.n},)")
    return pairs_within(checker_for(pepper, scene), state, check_positive("within", within, "[m]"))


def pairs_within(checker: CollisionChecker, q: Array, distance: float) -> NearPairs:
    """Return the pairs nearer than a distance for a given checker; see `near_pairs`.

    Pairs of capsules, spheres, boxes, cylinders and half-spaces are measured in machine code, all at once;
    coal measures other pairs that may be near, and pairs whose cores overlap.

    Args:
        checker: The checker.
        q: Joint positions [rad or m], shape (n,).
        distance: Distance from which on pairs are left out [m].
    """
    tables, count = near_tables(checker), checker.pair_count
    table, full = tables.near, np.array(checker.pepper.to_full(q))
    poses, axes = np.empty((len(table.joints), 12)), np.empty((len(table.joints), 3))
    place_joints(table.joints, full, poses, axes)
    near = near_points(table, count, count)
    found, distances, points, normals, undecided = near[:5]
    size, rest = find_near(poses, table, distance, True, near)
    if rest:
        answers = measure_by_coal(checker, full[None], undecided[:rest], distance)[0]
        are_near = answers[:, 0] < distance
        end = size + int(are_near.sum())
        found[size:end], answers = undecided[:rest][are_near], answers[are_near]
        distances[size:end], normals[size:end] = answers[:, 0], answers[:, 7:]
        points[size:end] = answers[:, 1:7].reshape(-1, 2, 3)
        size = end
    order = np.lexsort((found[:size], distances[:size]))
    indices, points, normals = found[order], points[order], normals[order]
    gradients = np.empty((size, full.size))
    slopes(table, poses, axes, indices, points, normals, gradients)
    pepper = checker.pepper
    return NearPairs(
        names=tuple([tables.names[index] for index in indices.tolist()]),
        distances=_frozen(distances[order]),
        points=_frozen(points),
        normals=_frozen(normals),
        gradients=_frozen(gradients @ pepper.full_map if pepper.is_coupled else gradients),
        movers=_frozen(tables.movers[indices]),
        cores=_frozen(tables.cores[indices]),
        indices=_frozen(indices),
        within=distance,
    )


def measure_by_coal(
    checker: CollisionChecker, states: Array, indices: NDArray[np.intp], within: float
) -> Array:
    """Measure some pairs at some configurations by coal.

    Args:
        checker: The checker.
        states: Configurations of Pinocchio's model [rad or m], shape (m, nq).
        indices: Indices among the checker's pairs, shape (k,).
        within: Distance from which on only the distance of a pair is returned, without points [m].

    Returns:
        Distances, nearest points of both and normals, see `core.near_state.ANSWER`, shape (m, k, ANSWER).
    """
    import pinocchio

    data, queries = checker._data
    found, paddings = np.zeros((len(states), len(indices), ANSWER)), checker._shapes.paddings
    for row, q_full in zip(found, states, strict=True):
        pinocchio.forwardKinematics(checker.pepper.inner_model, data, q_full)
        queries.place(data)
        for answer, index in zip(row, indices.tolist(), strict=True):
            result = queries.distance(index)
            distance = answer[0] = result.min_distance - paddings[index]
            if distance < within:
                answer[1:4], answer[4:7] = result.getNearestPoint1(), result.getNearestPoint2()
                answer[7:] = -result.normal
    return found


@dataclass(frozen=True, eq=False)
class NearTables:
    """Constant data of a checker's shapes and pairs.

    Attributes:
        near: The shapes and pairs.
        names: Names of the owners of each pair.
        movers: Whether each joint moves the two of each pair against one another.
        cores: Length of the straight part of each pair, see `NearPairs`.
        owners: Index that is the same for all pairs of the same two owners.
    """

    near: NearTable
    names: tuple[tuple[str, str], ...]
    movers: NDArray[np.bool_]
    cores: Array
    owners: NDArray[np.int64]


_kept: WeakKeyDictionary[CollisionChecker, NearTables] = WeakKeyDictionary()


def near_tables(checker: CollisionChecker) -> NearTables:
    """Return the tables of a checker, cached as long as it lives."""
    tables = _kept.get(checker)
    if tables is None:
        tables = _kept[checker] = _make_tables(checker)
    return tables


def _make_tables(checker: CollisionChecker) -> NearTables:
    """Return the tables of a checker's shapes and pairs."""
    from pepper_kin.collision.fast.near_table import near_table

    near, bodies, (first, second) = near_table(checker), checker._shapes.bodies, checker._shapes.pairs
    moved = near.above[near.shapes[:, CARRIER].astype(int)]
    cores = np.array([_core(body.geometry_object.geometry) for body in bodies])
    owners = [body.owner for body in bodies]
    numbers = np.unique(owners, return_inverse=True)[1] if owners else np.empty(0, np.int64)
    return NearTables(
        near=near,
        names=tuple([(owners[a], owners[b]) for a, b in zip(first.tolist(), second.tolist(), strict=True)]),
        movers=(moved[first] != moved[second]) @ (np.abs(checker.pepper.full_map) > 0),
        cores=np.minimum(cores[first], cores[second]),
        owners=numbers[first] * len(owners) + numbers[second],
    )


def _core(geometry: Any) -> float:
    """Return the length along which a sphere is swept to make a shape [m]."""
    import coal

    if isinstance(geometry, coal.Sphere):
        return 0.0
    if isinstance(geometry, coal.Capsule):
        return 2.0 * float(geometry.halfLength)
    return 2.0 * float(geometry.aabb_radius)


def _frozen(array: NDArray[Any]) -> NDArray[Any]:
    """Return an array, of any shape, made read-only."""
    array.setflags(write=False)
    return array
