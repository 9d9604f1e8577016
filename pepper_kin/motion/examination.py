"""Whether a whole curve is clear: steps are as long as the margin that is kept there proves enough."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pepper_kin.motion.checks import Checks
from pepper_kin.motion.native_curve import middles, stations

Array = NDArray[np.float64]

STEPS = (0.008, 0.002, 0.0005)
"""Distances that any point of the body moves between states, from far from everything to near [m]."""


def is_clear(
    checks: Checks,
    breaks: Array,
    coefficients: Array,
    reach: Array,
    margins: tuple[float, float],
) -> bool:
    """Whether margins are kept and gravity is held along a piecewise cubic curve.

    The curve is cut into intervals on which no point of the body moves farther than 8 mm.  Where the state in
    the middle of one keeps a distance of half that, nothing touches in all of the interval.  Others are cut
    into intervals of 2 mm, and those into ones of half a millimetre, whose middles need only keep the margins
    asked for.

    Args:
        checks: The robot in its scene, compiled.
        breaks: Ends of the pieces, shape (m + 1,).
        coefficients: Constant term first, shape (m, 4, n) [rad or m].
        reach: How far a joint moves a point of the body, shape (n,), see `joint_reaches`.
        margins: To the scene and to the robot itself [m].
    """
    breaks, coefficients, reach = (np.require(a, float, ["C", "W"]) for a in (breaks, coefficients, reach))
    piece, begin, width = stations(breaks, coefficients, reach, STEPS[0])
    for step, shorter in zip(STEPS, (*STEPS[1:], None), strict=True):
        states = middles(coefficients, piece, begin, width)
        if step == STEPS[0] and not checks.holds(states).all():
            return False
        if shorter is None:
            return bool(checks.free(states, *margins).all())
        far = max(margins[0], step / 2), max(margins[1], step / 2)
        near = ~checks.surely_free(states, *far)
        if not near.any():
            return True
        if not checks.free(states[near], *margins).all():
            return False
        parts = round(step / shorter)
        piece, width = np.repeat(piece[near], parts), np.repeat(width[near] / parts, parts)
        begin = np.repeat(begin[near], parts) + width * (np.arange(width.size) % parts)
    return False
