"""Whether a whole curve is clear: steps are as long as the margin that is kept there proves enough."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pepper_kin.motion.checks import Checks
from pepper_kin.motion.native_curve import states_within, stations

Array = NDArray[np.float64]

LONGEST_STEP = 0.008
"""Distance that any point of the body moves between states that are far from everything [m]."""

SHORTEST_STEP = 0.0005
"""The same where the margin proves nothing [m]."""


def is_clear(
    checks: Checks,
    breaks: Array,
    coefficients: Array,
    reach: Array,
    margins: tuple[float, float],
) -> bool:
    """Whether margins are kept and gravity is held all along a piecewise cubic curve.

    Between two states at most half a step away no point of the body moves farther than that; so where they
    keep a distance of half a step, nothing touches in between.  States far from everything are looked at
    every 8 mm.  Around those that are nearer, the curve is looked at again with the margins asked for, every
    half millimetre or, where the margins are wider, every so much as they are.

    Args:
        checks: The robot in its scene, compiled.
        breaks: Ends of the pieces, shape (m + 1,).
        coefficients: Constant term first, shape (m, 4, n) [rad or m].
        reach: How far a joint moves a point of the body, shape (n,), see `joint_reaches`.
        margins: To the scene and to the robot itself [m].
    """
    fine = min(max(min(margins), SHORTEST_STEP), LONGEST_STEP)
    half = LONGEST_STEP / 2
    far = max(margins[0], half), max(margins[1], half)
    piece, local, width = stations(breaks, coefficients, reach, LONGEST_STEP)
    states = states_within(coefficients, piece, local, width, 1)
    if not checks.holds(states).all():
        return False
    near = ~checks.free(states, *far)
    if not near.any():
        return True
    if far != margins and not checks.free(states[near], *margins).all():
        return False
    again = np.flatnonzero(near[:-1] | near[1:])
    parts = math.ceil(LONGEST_STEP / fine)
    between = states_within(coefficients, piece[again], local[again], width[again], parts)
    return bool(checks.free(between, *margins).all())
