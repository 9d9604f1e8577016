"""Rounding errors of single precision where balls are placed and compared."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pepper_kin.collision.fast.solids import Solid
from pepper_kin.core.collision.layout import WIDEST
from pepper_kin.model import PepperModel
from pepper_kin.symbolic.tree import read_frames

ROUNDING = 2.0**-24
"""Greatest relative error of one operation in single precision."""
COORDINATE = 10.0 * WIDEST * ROUNDING
"""Error of a coordinate of at most WIDEST [rad or m].

On an edge it is a + (b - a) s in single precision, with |b - a| at most 2 WIDEST: s, b - a and their product
are wrong by u of 2 WIDEST each, a, the sum and the gain of a joint that follows another by u of WIDEST.
"""
ANGLE = COORDINATE + 3e-7
"""Error of an angle, and of its sine and cosine [rad]."""
COMPARING = 16.0 * ROUNDING
"""What comparing placed balls adds at most, over the sum of the coordinates: the robot's, and those of an
object as far as it can be met."""
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
        solids: Its solids.

    Attributes:
        placed: How far a body's balls and cores may be misplaced [m], shape (bodies,), the world last.
        farthest: How far the robot reaches [m].
    """

    def __init__(self, pepper: PepperModel, solids: Sequence[Solid]) -> None:
        tree = read_frames(pepper, compact=True)
        count = len(tree.bodies)
        turn, shift, reach = np.zeros(count + 1), np.zeros(count + 1), np.zeros(count + 1)  # the world last
        for b, body in enumerate(tree.bodies):
            lever = float(np.linalg.norm(np.array(body.translation, dtype=float))) + (
                WIDEST if body.slides else 0.0
            )
            turn[b] = turn[body.parent] + (12.0 * ROUNDING if body.slides else TURN)
            reach[b] = reach[body.parent] + lever
            shift[b] = shift[body.parent] + turn[b] * lever + 8.0 * ROUNDING * reach[b]
            shift[b] += COORDINATE if body.slides else 0.0
        self.placed, self.farthest = np.zeros(count + 1), 0.0
        for solid in solids:
            b = solid.joint - 1
            origin = tree.alignments[b].origin if solid.joint else np.zeros(3)
            own = float(np.linalg.norm(solid.position - origin)) + solid.bounding_radius
            error = shift[b] + turn[b] * own + 8.0 * ROUNDING * (reach[b] + own)
            self.placed[b] = max(self.placed[b], error)
            self.farthest = max(self.farthest, reach[b] + own)

    def comparing(self) -> float:
        """Return what comparing placed balls of the robot with one another adds at most [m]."""
        return COMPARING * self.farthest
