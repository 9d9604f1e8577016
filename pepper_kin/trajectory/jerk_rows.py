"""Limits on the rate of a smooth time law, as rows of a program."""

from __future__ import annotations

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.core.timing.grid import coefficient_states
from pepper_kin.core.timing.rate_program import POINTS, RateProgram
from pepper_kin.model import PepperModel
from pepper_kin.trajectory.limits import LimitedQuantities, Limits
from pepper_kin.trajectory.path import CubicPath
from pepper_kin.trajectory.smooth_time import SmoothTime

_PLACES = np.linspace(0.0, 1.0, POINTS)  # in each piece, where limits are kept
_WEIGHTS = np.array([1, 4, 1]) / 6  # Simpson's rule
_SLOWEST = 1e-6  # share of a limit from which on a velocity counts


def rate_program(pepper: PepperModel, curve: CubicPath, base: SmoothTime, limits: Limits) -> RateProgram:
    """Evaluate all limits, those of jerk among them, along a smooth time law."""
    assert limits.jerk is not None
    step = np.diff(base.knots)
    segment = np.repeat(np.arange(step.size), POINTS)
    local = (step[:, None] * _PLACES).ravel()
    q, first, second, third = base.derivatives(curve, segment, local)
    quantities = LimitedQuantities(pepper, limits)
    states = np.empty((3, 3 * len(q), q.shape[1]))
    coefficient_states(np.stack([q, first, second]), states)
    torque_limit, edges = quantities.torque_limit, quantities.edges
    moves, strong = first.any(axis=0), np.isfinite(torque_limit)
    jerky, rapid = moves & np.isfinite(limits.jerk), moves & np.isfinite(limits.acceleration)
    ends = np.cumsum([jerky.sum(), rapid.sum(), strong.sum(), edges])
    rows = np.zeros((ends[-1] + 1, 4, len(q)))
    jerk, acceleration, torque, moments = np.split(rows, ends)[:4]
    for order, gain in enumerate((third, 1.5 * second, first / 2)):
        jerk[:, order] = (gain[:, jerky] / limits.jerk[jerky]).T
    for order, gain in enumerate((second, first / 2)):
        acceleration[:, order] = (gain[:, rapid] / limits.acceleration[rapid]).T
    if torque_limit.size:
        share = quantities.torque(*states)[:, strong] / torque_limit[strong]
        c, a, b = share.T.reshape(-1, 3, len(q)).swapaxes(0, 1)
        torque[:, 0], torque[:, 1], torque[:, 3] = b - c, (a - c) / 2, c
    if edges:
        c, a, b = quantities.moments(*states).T.reshape(edges, 3, len(q)).swapaxes(0, 1)
        weight = np.abs(c).max()  # h >= 0 as 1 - h / weight <= 1
        moments[:, 0], moments[:, 1] = (c - b) / weight, (c - a) / (2 * weight)
        moments[:, 3] = 1 - c / weight
    speeds = [np.abs(first) / limits.velocity, quantities.speed(q, first)]
    rows[-1, 0] = np.maximum(np.concatenate(speeds, axis=1).max(axis=1), _SLOWEST) ** 2
    powers = to_powers(base.knots)[segment]
    x = local[:, None]
    slope = powers[:, 1] + x * powers[:, 2]
    basis = np.stack([powers[:, 0] + x * (powers[:, 1] + slope) / 2, slope, powers[:, 2]], axis=1)
    return RateProgram(basis, (step[:, None] * _WEIGHTS).ravel(), rows, int(ends[0]), int(ends[2]))


def to_powers(knots: Array) -> Array:
    """Return y, y' and y'' at the start of each piece from three coefficients of the quadratic spline.

    The basis is that of B-splines with threefold knots at both ends, so that all coefficients are positive
    values of y's control polygon.

    Args:
        knots: Rising [s], shape (K + 1,).

    Returns:
        Gains of the coefficients on y, y' and y'', shape (K, 3, 3).
    """
    t = np.concatenate([knots[:1], knots[:1], knots, knots[-1:], knots[-1:]])
    k = np.arange(knots.size - 1) + 2  # the piece is [t[k], t[k + 1]]
    h = t[k + 1] - t[k]
    before, after = t[k + 1] - t[k - 1], t[k + 2] - t[k]
    powers = np.zeros((k.size, 3, 3))
    powers[:, 0, 0], powers[:, 0, 1] = h / before, (t[k] - t[k - 1]) / before
    powers[:, 1, 0], powers[:, 1, 1] = -2 / before, 2 / before
    powers[:, 2, 0], powers[:, 2, 2] = 2 / (h * before), 2 / (h * after)
    powers[:, 2, 1] = -powers[:, 2, 0] - powers[:, 2, 2]
    return powers
