"""What single precision may be wrong by where balls are placed and compared."""

from __future__ import annotations

import numpy as np

from pepper_kin.collision.fast.structure import Structure
from pepper_kin.core.collision.layout import WIDEST
from pepper_kin.model import PepperModel
from pepper_kin.symbolic.tree import read_tree

ROUNDING = 2.0**-24
"""Greatest relative error of one operation in single precision."""
ANGLE = WIDEST * ROUNDING + 3e-7
"""Error of an angle of at most WIDEST as it is stored, and of its sine and cosine [rad]."""
FAR = 1e3
"""Objects are not larger than this, or meet the robot where they are [m]."""
TURN = 2.0 * ANGLE + 24.0 * ROUNDING
"""What one joint adds to the error of a rotation (spectral norm).

Sine and cosine are wrong by ANGLE each: at most 2 ANGLE.  A constant rotation is stored with an error below
3 u, its product with the one before has entries of three products each, of rows and columns of length one:
below 9 u in all; mixing two columns by sine and cosine adds less than 9 u; the rest is for terms of second
order.
"""


class Rounding:
    """What single precision may be wrong by for a robot's solids.

    A body's origin is wrong by what its parent's is, by its parent's rotation error times the distance
    between both, and by 8 u times the distances that are added; sliding adds the error of the coordinate,
    which may be WIDEST.

    Args:
        pepper: The robot.
        structure: Its solids.
    """

    def __init__(self, pepper: PepperModel, structure: Structure) -> None:
        tree = read_tree(pepper, compact=True)
        count = len(tree.bodies)
        turn, shift, reach = np.zeros(count + 1), np.zeros(count + 1), np.zeros(count + 1)  # the world last
        for b, body in enumerate(tree.bodies):
            lever = float(np.linalg.norm(np.array(body.translation, dtype=float))) + (
                WIDEST if body.slides else 0.0
            )
            turn[b] = turn[body.parent] + (12.0 * ROUNDING if body.slides else TURN)
            reach[b] = reach[body.parent] + lever
            shift[b] = shift[body.parent] + turn[b] * lever + 8.0 * ROUNDING * reach[b]
            shift[b] += ANGLE if body.slides else 0.0
        self._placed = self._farthest = 0.0
        for solid in structure.solids:
            b = solid.joint - 1
            origin = tree.alignments[b].origin if solid.joint else np.zeros(3)
            own = float(np.linalg.norm(solid.position - origin)) + solid.bounding_radius
            self._placed = max(self._placed, shift[b] + turn[b] * own + 8.0 * ROUNDING * (reach[b] + own))
            self._farthest = max(self._farthest, reach[b] + own)

    def allowance(self, structure: Structure) -> float:
        """Return an upper bound of how far the distance of a ball to anything may be wrong [m].

        Both sides of a comparison may be misplaced, and comparing adds 16 u times the coordinates that are
        compared: those of the scene, as far as it can be met.
        """
        scale = self._farthest
        for item in structure.objects:
            half = float(np.linalg.norm(np.where(np.isfinite(item.half), item.half, 0.0)))
            scale = max(scale, min(half + item.radius, FAR) + self._farthest)
        return 2.0 * self._placed + 16.0 * ROUNDING * scale
