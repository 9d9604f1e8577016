"""Pairs that never move against one another, decided once by coal."""

from __future__ import annotations

import math
from weakref import WeakKeyDictionary

import numpy as np

from pepper_kin.collision.bodies import world_body
from pepper_kin.collision.checker import RANGE_RADIUS
from pepper_kin.collision.fast.prepared import Prepared
from pepper_kin.collision.fast.structure import ComparedParts
from pepper_kin.collision.solids import PointCloud
from pepper_kin.core.collision import layout as at
from pepper_kin.core.collision.check import set_margins
from pepper_kin.core.collision.gjk import CONTACT, TIE
from pepper_kin.core.collision.narrow_phase import pair_verdict

SURE = 1e-4
"""Margin of error of bounds of distances [m]."""


def resting_contact(prepared: Prepared, margin: float) -> bool:
    """Return whether any pair that never moves against one another is nearer than a margin [m]."""
    if margin < resting_margin(prepared.structure):
        return False
    structure, (gaps, _) = prepared.structure, prepared.structure.gaps
    memory = at.aligned_copy(prepared.memory())
    set_margins(memory, margin, 0.0, RANGE_RADIUS)
    placed = np.argsort(prepared.scene.order)
    for i, o in structure.resting[gaps <= margin + SURE].tolist():
        verdict = pair_verdict(memory, i, int(placed[o]))
        if verdict == CONTACT or (verdict == TIE and _collides(structure, i, o, margin)):
            return True
    return False


def resting_margin(structure: ComparedParts) -> float:
    """Return a lower bound of the distance of pairs that never move [m]; inf if there are none."""
    return structure.gaps[1] - SURE


def resting_distance(structure: ComparedParts) -> float:
    """Return the minimum distance of the pairs that never move against one another [m]; inf without any.

    For clouds, it is the distance of their points to the boxes around the robot's solids.
    """
    (gaps, _), least = structure.gaps, float("inf")
    for k in np.argsort(gaps).tolist():
        if gaps[k] >= least:
            break
        least = min(least, _distance(structure, *structure.resting[k].tolist()))
    return least


_known: WeakKeyDictionary[ComparedParts, dict[tuple[int, int], float]] = WeakKeyDictionary()


def _distance(structure: ComparedParts, i: int, o: int) -> float:
    """Return the distance of a pair [m], or for a cloud a lower bound, measured once."""
    import coal

    known, cloud = _known.setdefault(structure, {}), structure.items[o].geometry
    if (i, o) not in known and isinstance(cloud, PointCloud):
        solid, pose = structure.solids[i], structure.items[o].transform_object_to_world
        local = (cloud.points @ pose[:3, :3].T + pose[:3, 3] - solid.position) @ solid.rotation
        beyond = np.maximum(np.abs(local) - solid.half, 0.0)
        squared = np.einsum("ij,ij->i", beyond, beyond).min()
        known[i, o] = math.sqrt(squared) - solid.radius - cloud.radius if squared > 0.0 else -math.inf
    elif (i, o) not in known:
        one, other = structure.moving.bodies[i], world_body(structure.items[o])
        a, b = one.geometry_object, other.geometry_object
        places = [coal.Transform3s(x.placement.rotation, x.placement.translation) for x in (a, b)]
        request, result = coal.DistanceRequest(), coal.DistanceResult()
        apart = coal.distance(a.geometry, places[0], b.geometry, places[1], request, result)
        known[i, o] = apart - one.padding - other.padding
    return known[i, o]


def _collides(structure: ComparedParts, i: int, o: int, margin: float) -> bool:
    """Return coal's verdict on a pair at a margin [m]."""
    import coal

    one, other = structure.moving.bodies[i], world_body(structure.items[o])
    a, b = one.geometry_object, other.geometry_object
    places = [coal.Transform3s(x.placement.rotation, x.placement.translation) for x in (a, b)]
    request, result = coal.CollisionRequest(), coal.CollisionResult()
    request.security_margin = margin + one.padding + other.padding
    return bool(coal.collide(a.geometry, places[0], b.geometry, places[1], request, result))
