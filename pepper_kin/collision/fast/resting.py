"""Pairs that never move against one another: settled once, by coal."""

from __future__ import annotations

from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from pepper_kin.collision.checker import CollisionChecker
from pepper_kin.collision.fast.structure import Structure

SURE = 1e-4
"""Where the nearest pair is farther from its threshold than this [m], distances tell."""


def resting_contact(checker: CollisionChecker, structure: Structure) -> bool:
    """Return whether any pair of a checker that never moves against one another touches."""
    import pinocchio

    pairs = _not_apart(checker, structure)
    if not pairs:
        return False
    beyond = _gaps(checker.shapes_of, pairs) - checker._margins[list(pairs)]
    if abs(beyond.min()) > SURE:
        return bool(beyond.min() < 0)
    data = _placed(checker)
    return any(pinocchio.computeCollision(checker._model, data, pair) for pair in pairs)


def _not_apart(checker: CollisionChecker, structure: Structure) -> tuple[int, ...]:
    """Return those of a structure's resting pairs that a ball around the one does not part from the other."""
    every, found = (*structure.solids, *structure.objects), []
    for number in structure.resting:
        one, other = (every[int(places[number])] for places in checker._pairs)
        beyond = np.abs((one.position - other.position) @ other.rotation) - other.half
        apart = float(np.linalg.norm(np.maximum(beyond, 0.0))) - one.bounding_radius - other.radius
        if not apart > checker._margins[number] + SURE:
            found.append(number)
    return tuple(found)


_kept: WeakKeyDictionary[CollisionChecker, dict[int, float]] = WeakKeyDictionary()


def _gaps(checker: CollisionChecker, pairs: tuple[int, ...]) -> NDArray[np.float64]:
    """Return the distances of these pairs of shapes without padding [m], measured once for a checker."""
    import pinocchio

    known = _kept.setdefault(checker, {})
    for pair in pairs:
        if pair not in known:
            known[pair] = pinocchio.computeDistance(checker._model, _placed(checker), pair).min_distance
    return np.array([known[pair] for pair in pairs])


def resting_distance(checker: CollisionChecker, pairs: tuple[int, ...]) -> float:
    """Return the least distance of these pairs of a checker [m]; inf where there are none."""
    import pinocchio

    data = _placed(checker)
    distances = [pinocchio.computeDistance(checker._model, data, pair).min_distance for pair in pairs]
    return float(min(distances, default=float("inf")))


def _placed(checker: CollisionChecker) -> Any:
    import pinocchio

    data, geometry_data = checker._data
    model = checker.pepper.inner_model
    q = checker.pepper.to_full(checker.pepper.neutral())
    pinocchio.updateGeometryPlacements(model, data, checker._model, geometry_data, q)
    return geometry_data
