"""Rounding errors of single precision when spheres are placed and compared."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pepper_kin.collision.fast.solids import Solid
from pepper_kin.core.collision.layout import WIDEST
from pepper_kin.model import PepperModel
from pepper_kin.symbolic.tree import read_frames

ROUNDING = 2.0**-24
"""Maximum relative error u of one operation in single precision."""
COORDINATE = 10.0 * WIDEST * ROUNDING
"""Error of a coordinate of at most WIDEST [rad or m].

On an edge it is a + (b - a) s in single precision, with |b - a| at most 2 WIDEST: s, b - a and their product
have an error of u times 2 WIDEST each, a, the sum and the gain of a mimic joint an error of u times WIDEST.
"""
ANGLE = COORDINATE + 3e-7
"""Error of an angle, and of its sine and cosine [rad]."""
COMPARING = 16.0 * ROUNDING
"""Maximum error of comparing placed spheres, relative to the sum of the coordinates: the robot's, and an
object's as far as the robot can reach it."""
FAR = 1e3
"""Limit of an object's size in the error: larger objects reach the robot wherever they are [m]."""
TURN = 2.0 * ANGLE + 24.0 * ROUNDING
"""Error that one joint adds to a rotation (spectral norm).

Sine and cosine have an error of ANGLE each: at most 2 ANGLE.  A constant rotation is stored with an error
below 3 u, its product with the one before has entries of three products each, of rows and columns of length
one: below 9 u in all; mixing two columns by sine and cosine adds less than 9 u; the rest is for second-order
terms.
"""


class Rounding:
    """Errors of single precision for a robot's solids.

    The error of a body's origin is its parent's, plus its parent's rotation error times the distance between
    both, plus 8 u times the accumulated distances; a prismatic joint adds the error of its coordinate, which
    may be WIDEST.

    Args:
        pepper: The robot.
        solids: Solids of the robot.

    Attributes:
        placed: Maximum error of the placement of a body's spheres and cores [m], shape (bodies,), world last.
        farthest: Maximum reach of the robot [m].
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
        """Return the maximum error of comparing placed spheres of the robot with one another [m]."""
        return COMPARING * self.farthest
