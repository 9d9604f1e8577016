"""The search for contacts: bounds for all pairs, then points for the few that are near."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pepper_kin.collision.fast.options import OPTIONS
from pepper_kin.twin.world.colliders import Colliders
from pepper_kin.twin.world.kinds import BOX, CAPSULE, HALF_SPACE, OTHER
from pepper_kin.twin.world.manifold import OPEN, of_round, on_box, on_plane

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

MARGIN = 2e-3
"""Points this near count as contacts whatever their speed [m]."""
MOST_POINTS = 256
"""Contact points at one time."""


class ContactSearch:
    """Finds the contact points of a table of shapes.

    Attributes:
        rows: Points: point, normal (from the second shape to the first) and gap, shape (MOST_POINTS, 7).
        shapes: The two shapes of each point, shape (MOST_POINTS, 2).
        count: How many there are.
    """

    def __init__(self, table: Colliders) -> None:
        import coal

        self._table = table
        self.rows = np.zeros((MOST_POINTS, 7))
        self.shapes = np.zeros((MOST_POINTS, 2), np.int64)
        self.count = 0
        self._undecided = np.zeros((MOST_POINTS, 2), np.int64)
        self._coal: Any = coal
        self._request = coal.DistanceRequest()
        self._request.enable_signed_distance = True
        self._place = (coal.Transform3s(), coal.Transform3s())

    def run(self, h: float) -> int:
        """Search at the present poses, for a step of length h [s].

        Returns:
            How many points there are; -1 if more than there is room for.
        """
        table = self._table
        found, undecided = find(
            table.pairs, table.kind, table.size, table.rotation, table.position, table.middle, table.ball,
            table.speed, h, self.rows, self.shapes, self._undecided,
        )  # fmt: skip
        if found < 0 or found + undecided > MOST_POINTS:
            return -1
        for i, j in self._undecided[:undecided].tolist():
            found += self._by_coal(i, j, h, found)
        self.count = found
        return found

    def _by_coal(self, i: int, j: int, h: float, row: int) -> int:
        table = self._table
        shapes = (table.coal_shape(i), table.coal_shape(j))
        for transform, k in zip(self._place, (i, j), strict=True):
            transform.setRotation(table.rotation[k])
            transform.setTranslation(table.position[k])
        result = self._coal.DistanceResult()
        distance = self._coal.distance(
            shapes[0], self._place[0], shapes[1], self._place[1], self._request, result
        )
        gap = distance - table.pads[i] - table.pads[j]
        if not gap <= MARGIN + h * (table.speed[i] + table.speed[j]):
            return 0
        first, second = np.array(result.getNearestPoint1()), np.array(result.getNearestPoint2())
        normal = first - second
        length = float(np.linalg.norm(normal))
        normal = normal / (length if distance > 0 else -length) if length > 1e-9 else -np.array(result.normal)
        self.rows[row, :3] = 0.5 * (first - table.pads[i] * normal + second + table.pads[j] * normal)
        self.rows[row, 3:6] = normal
        self.rows[row, 6] = gap
        self.shapes[row] = i, j
        return 1


@njit(
    "float64(int64, float64[::1], float64[:, ::1], float64[::1], float64[::1], float64)",
    **OPTIONS,
)
def _above(kind: int, size: Array, rotation: Array, centre: Array, middle: Array, radius: float) -> float:
    """Return a lower bound of the distance of a ball from a half-space or a box [m]."""
    if kind == HALF_SPACE:
        height = -size[0] - radius
        for i in range(3):
            height += rotation[i, 2] * (middle[i] - centre[i])
        return height
    square = 0.0
    for k in range(3):
        along = 0.0
        for i in range(3):
            along += rotation[i, k] * (middle[i] - centre[i])
        square += max(0.0, abs(along) - size[k]) ** 2
    return math.sqrt(square) - radius


@njit(
    "UniTuple(int64, 2)(int64[:, ::1], int64[::1], float64[:, ::1], float64[:, :, ::1], float64[:, ::1], "
    "float64[:, ::1], float64[:, ::1], float64[::1], float64, float64[:, ::1], int64[:, ::1], "
    "int64[:, ::1])",
    **OPTIONS,
)
def find(
    pairs: Indices,
    kind: Indices,
    size: Array,
    rotation: Array,
    position: Array,
    middle: Array,
    ball: Array,
    speed: Array,
    h: float,
    rows: Array,
    shapes: Indices,
    undecided: Indices,
) -> tuple[int, int]:
    """Write all contacts that faces and round ends decide, and the pairs that they do not."""
    found, left = 0, 0
    for p in range(len(pairs)):
        i, j = pairs[p, 0], pairs[p, 1]
        margin = MARGIN + h * (speed[i] + speed[j])
        a, b = kind[i], kind[j]
        if b != HALF_SPACE:
            square = 0.0
            for k in range(3):
                square += (middle[i, k] - middle[j, k]) ** 2
            if square > (ball[i, 3] + ball[j, 3] + margin) ** 2:
                continue
        if b in (BOX, HALF_SPACE) and (
            _above(b, size[j], rotation[j], position[j], middle[i], ball[i, 3]) > margin
        ):
            continue
        if (
            a == BOX
            and b != HALF_SPACE
            and (_above(a, size[i], rotation[i], position[i], middle[j], ball[j, 3]) > margin)
        ):
            continue
        if found + 4 > len(rows) or left == len(undecided):
            return -1, 0
        new, swapped, room = OPEN, False, rows[found:]
        if b == HALF_SPACE and a != OTHER:
            new = on_plane(
                a, size[i], rotation[i], position[i], b, size[j], rotation[j], position[j], margin, room
            )  # fmt: skip
        elif a <= CAPSULE and b <= CAPSULE:
            new = of_round(
                a, size[i], rotation[i], position[i], b, size[j], rotation[j], position[j], margin, room
            )  # fmt: skip
        elif b == BOX and a != OTHER:
            new = on_box(
                a, size[i], rotation[i], position[i], b, size[j], rotation[j], position[j], margin, room
            )  # fmt: skip
        elif a == BOX and b < HALF_SPACE:
            swapped = True
            new = on_box(
                b, size[j], rotation[j], position[j], a, size[i], rotation[i], position[i], margin, room
            )  # fmt: skip
        if new == OPEN:
            undecided[left, 0], undecided[left, 1] = i, j
            left += 1
            continue
        for k in range(found, found + new):
            shapes[k, 0], shapes[k, 1] = i, j
            if swapped:
                for m in range(3, 6):
                    rows[k, m] = -rows[k, m]
        found += new
    return found, left
