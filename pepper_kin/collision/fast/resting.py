"""Pairs that never move against one another: settled once, by coal."""

from __future__ import annotations

from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from pepper_kin.collision.checker import CollisionChecker

SURE = 1e-4
"""Where the nearest pair is farther from its threshold than this [m], distances tell."""


def resting_contact(checker: CollisionChecker, pairs: tuple[int, ...]) -> bool:
    """Return whether any of these pairs of a checker touches."""
    import pinocchio

    if not pairs:
        return False
    beyond = _gaps(checker.shapes_of, pairs) - checker._margins[list(pairs)]
    if abs(beyond.min()) > SURE:
        return bool(beyond.min() < 0)
    data = _placed(checker)
    return any(pinocchio.computeCollision(checker._model, data, pair) for pair in pairs)


_kept: WeakKeyDictionary[CollisionChecker, NDArray[np.float64]] = WeakKeyDictionary()


def _gaps(checker: CollisionChecker, pairs: tuple[int, ...]) -> NDArray[np.float64]:
    """Return the distances of these pairs of shapes without padding [m], measured once for a checker."""
    import pinocchio

    if checker not in _kept:
        data = _placed(checker)
        found = [pinocchio.computeDistance(checker._model, data, pair).min_distance for pair in pairs]
        _kept[checker] = np.array(found)
    return _kept[checker]


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
