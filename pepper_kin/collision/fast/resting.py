"""Pairs that never move against one another: settled once, by coal."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from pepper_kin.collision.bodies import world_body
from pepper_kin.collision.fast.solids import Array
from pepper_kin.collision.fast.structure import Structure

SURE = 1e-4
"""Where the nearest pair is farther from its threshold than this [m], distances tell."""


def resting_contact(structure: Structure, margin: float) -> bool:
    """Return whether any pair that never moves against one another is nearer than a margin [m]."""
    gaps = _gaps(structure)
    if not gaps.size or gaps.min() > margin + SURE:
        return False
    for pair in structure.resting[gaps <= margin + SURE].tolist():
        i, o = pair
        beyond = _distance(structure, i, o) - margin
        if beyond < -SURE or (beyond <= SURE and _collides(structure, i, o, margin)):
            return True
    return False


def resting_distance(structure: Structure) -> float:
    """Return the least distance of pairs that never move against one another [m]; inf without any."""
    gaps, least = _gaps(structure), float("inf")
    for k in np.argsort(gaps).tolist():
        if gaps[k] >= least:
            break
        least = min(least, _distance(structure, *structure.resting[k].tolist()))
    return least


def _gaps(structure: Structure) -> Array:
    """Return a lower bound of the distance of each pair: of a ball around the one from the other [m]."""
    found = _bounds.get(structure)
    if found is None:
        found = _bounds[structure] = _lower_bounds(structure)
    return found


_bounds: WeakKeyDictionary[Structure, Array] = WeakKeyDictionary()
_known: WeakKeyDictionary[Structure, dict[tuple[int, int], float]] = WeakKeyDictionary()


def _lower_bounds(structure: Structure) -> NDArray[np.float64]:
    first, second = structure.resting.T
    if not first.size:
        return np.zeros(0)
    ours = np.array([solid.row for solid in structure.solids])[first]
    rows = structure.object_rows[second]
    local = np.einsum("kj,kij->ki", ours[:, 8:11] - rows[:, 8:11], rows[:, 11:].reshape(-1, 3, 3))
    beyond = np.maximum(np.abs(local) - rows[:, 5:8], 0.0)
    return np.asarray(np.sqrt((beyond**2).sum(axis=1)) - ours[:, 2] - rows[:, 1])


def _distance(structure: Structure, i: int, o: int) -> float:
    """Return the distance of a pair [m], measured once."""
    import coal

    known = _known.setdefault(structure, {})
    if (i, o) not in known:
        one, other = structure.moving.bodies[i], world_body(structure.items[o])
        a, b = one.geometry_object, other.geometry_object
        places = [coal.Transform3s(x.placement.rotation, x.placement.translation) for x in (a, b)]
        request, result = coal.DistanceRequest(), coal.DistanceResult()
        apart = coal.distance(a.geometry, places[0], b.geometry, places[1], request, result)
        known[i, o] = apart - one.padding - other.padding
    return known[i, o]


def _collides(structure: Structure, i: int, o: int, margin: float) -> bool:
    """Return coal's verdict on a pair."""
    import coal

    one, other = structure.moving.bodies[i], world_body(structure.items[o])
    a, b = one.geometry_object, other.geometry_object
    places = [coal.Transform3s(x.placement.rotation, x.placement.translation) for x in (a, b)]
    request, result = coal.CollisionRequest(), coal.CollisionResult()
    request.security_margin = margin + one.padding + other.padding
    return bool(coal.collide(a.geometry, places[0], b.geometry, places[1], request, result))
