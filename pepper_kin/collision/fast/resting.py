"""Pairs that never move against one another: settled once, by coal."""

from __future__ import annotations

from typing import Any

from pepper_kin.collision.checker import CollisionChecker


def resting_contact(checker: CollisionChecker, pairs: tuple[int, ...]) -> bool:
    """Return whether any of these pairs of a checker touches."""
    import pinocchio

    if not pairs:
        return False
    data = _placed(checker)
    return any(pinocchio.computeCollision(checker._model, data, pair) for pair in pairs)


def resting_distance(checker: CollisionChecker, pairs: tuple[int, ...]) -> float:
    """Return the least distance of these pairs of a checker [m]; inf where there are none."""
    import pinocchio

    data = _placed(checker)
    distances = [pinocchio.computeDistance(checker._model, data, pair).min_distance for pair in pairs]
    return float(min(distances, default=float("inf")))


def _placed(checker: CollisionChecker) -> Any:
    import pinocchio

    data, geometry_data = checker._data
    model = checker.pepper.pinocchio_model
    q = checker.pepper.to_full(checker.pepper.neutral())
    pinocchio.updateGeometryPlacements(model, data, checker._model, geometry_data, q)
    return geometry_data
