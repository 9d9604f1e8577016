"""Contacts of edges, corners and meshes by coal, one point for each pair."""

from __future__ import annotations

from typing import Any

import numpy as np

from pepper_kin.collision.round_pairs import is_round, witness
from pepper_kin.core.simulation.narrow_phase import FREE, MARGIN, ContactPoints
from pepper_kin.twin.world.colliders import Colliders


class CoalContacts:
    """Contacts of pairs of shapes that the compiled narrow phase cannot decide.

    Args:
        shapes: The shapes.
    """

    def __init__(self, shapes: Colliders) -> None:
        import coal

        self._shapes, self._coal = shapes, coal
        self._request: Any = coal.DistanceRequest()
        self._request.enable_signed_distance = True
        self._place = (coal.Transform3s(), coal.Transform3s())

    def decide(self, pair: tuple[int, int], h: float, points: ContactPoints, row: int) -> int:
        """Write the contact of two shapes if it is near enough for a step; return the number of contacts.

        Args:
            pair: Rows of the shapes.
            h: Length of the step [s].
            points: Receives the contact.
            row: Row of the contact in `points`.
        """
        (i, j), table, pads = pair, self._shapes.table, self._shapes.pads
        shapes = (self._shapes.coal_shape(i), self._shapes.coal_shape(j))
        for transform, k in zip(self._place, (i, j), strict=True):
            transform.setRotation(table.rotation[k])
            transform.setTranslation(table.position[k])
        result = self._coal.DistanceResult()
        distance = self._coal.distance(
            shapes[0], self._place[0], shapes[1], self._place[1], self._request, result
        )
        if distance < 0.0 and is_round(shapes[0]) and is_round(shapes[1]):
            first_pose, second_pose = ((table.rotation[k], table.position[k]) for k in (i, j))
            result = witness(shapes, (first_pose, second_pose), result)
            distance = result.min_distance
        gap = distance - pads[i] - pads[j]
        if not gap <= MARGIN + h * (table.speed[i] + table.speed[j]):
            return 0
        first, second = np.array(result.getNearestPoint1()), np.array(result.getNearestPoint2())
        normal = first - second
        length = float(np.linalg.norm(normal))
        normal = normal / (length if distance > 0 else -length) if length > 1e-9 else -np.array(result.normal)
        points.rows[row, :3] = 0.5 * (first - pads[i] * normal + second + pads[j] * normal)
        if gap > 0 and table.mover[j] != FREE:
            points.rows[row, :3] += 0.5 * gap * normal
        points.rows[row, 3:6] = normal
        points.rows[row, 6] = gap
        points.shapes[row] = i, j
        return 1
