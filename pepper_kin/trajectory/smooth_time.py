"""Time law s(tau) with continuous acceleration: the moving average of a time-optimal time law."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array
from pepper_kin.core.splines import derivatives_on_segments, quintic_hermite
from pepper_kin.core.timing.grid import coefficient_states
from pepper_kin.core.timing.rate_program import POINTS, RateProgram
from pepper_kin.model import PepperModel
from pepper_kin.trajectory.limits import LimitedQuantities, Limits
from pepper_kin.trajectory.path import CubicPath

PIECES = 120
"""Approximate number of pieces of a smooth time law."""

_CLOSE = 0.03  # distance below which knots are merged, relative to a piece's length
_AT_ENDS = np.array([0.2, 0.5, 1.5])  # further knots from both ends, in pieces: the rate changes most there
_JUMPS = 16  # maximum number of jumps of acceleration that become knots
_LARGE = 0.1  # minimum size of such jumps, relative to the maximum acceleration
_PLACES = np.linspace(0.0, 1.0, POINTS)  # fractions of each piece at which limits are kept
_WEIGHTS = np.array([1, 4, 1]) / 6  # Simpson's rule
_SLOWEST = 1e-6  # minimum velocity that bounds the rate, relative to its limit


@dataclass(frozen=True, eq=False)
class SmoothTime:
    """s(tau) as quintic polynomials with continuous second derivative.

    Attributes:
        knots: Times, increasing from 0 [s], shape (K + 1,); s takes the values of the path's breaks at some
            of them.
        coefficients: Coefficients, constant term first, shape (K, 6, 1).
    """

    knots: Array
    coefficients: Array

    def at(self, segment: NDArray[np.intp], local: Array) -> tuple[Array, Array, Array, Array]:
        """Return s and its first three derivatives at local times [s] on given pieces, shape (P,) each."""
        s = derivatives_on_segments(self.coefficients, segment, local, 4)[..., 0]
        return s[0], s[1], s[2], s[3]

    def derivatives(
        self, curve: CubicPath, segment: NDArray[np.intp], local: Array
    ) -> tuple[Array, Array, Array, Array]:
        """Return Q(tau) = q(s(tau)) and its first three derivatives, shape (P, n) each."""
        s, s1, s2, s3 = (value[:, None] for value in self.at(segment, local))
        middle = self.at(np.arange(self.knots.size - 1), np.diff(self.knots) / 2)[0]
        of_path = np.clip(np.searchsorted(curve.breaks, middle) - 1, 0, curve.breaks.size - 2)[segment]
        within = s[:, 0] - curve.breaks[of_path]
        q, q1, q2, q3 = derivatives_on_segments(curve.coefficients, of_path, within, 4)
        return q, q1 * s1, q2 * s1**2 + q1 * s2, q3 * s1**3 + 3 * q2 * s1 * s2 + q1 * s3


def smooth_time(curve: CubicPath, time: Array, s: Array, window: float, pieces: int = PIECES) -> SmoothTime:
    """Return the moving average over `window` [s] of a time law with piecewise constant d2s/dt2.

        s_w(t) = (1 / w) integral of s from t - w to t:   ds_w/dt = (s(t) - s(t - w)) / w,
    so that one more derivative is continuous; the motion takes `window` longer.

    Args:
        curve: The path, whose breaks become knots.
        time: Times of the grid points [s], shape (N + 1,).
        s: Path parameter at the grid points, shape (N + 1,).
        window: Width of the average [s].
        pieces: Approximate number of pieces.
    """
    law = _TimeLaw(time, s)
    duration = float(time[-1]) + window

    def average(t: Array) -> tuple[Array, Array, Array]:
        """Return s_w and its first two derivatives at times [s], shape (T,) each."""
        now, before = law(t), law(t - window)
        return tuple((a - b) / window for a, b in zip(now, before, strict=True))  # type: ignore[return-value]

    knots = np.linspace(0.0, duration, pieces + 1)
    at_ends = duration / pieces * _AT_ENDS
    knots = np.unique(np.concatenate([knots, at_ends, duration - at_ends]))
    dense = np.linspace(0.0, duration, 20 * pieces + 1)
    along = np.maximum.accumulate(average(dense)[0])
    inner = np.interp(curve.breaks[1:-1], along, dense)
    for _ in range(6):
        place, speed, _ = average(inner)
        inner = np.clip(inner - (place - curve.breaks[1:-1]) / np.maximum(speed, 1e-12), 0.0, duration)
    knots = _with(knots, inner, _CLOSE * duration / pieces)
    knots = _with(knots, _jumps(law, window), _CLOSE * duration / pieces, set(inner))
    at_knots = (value[:, None] for value in average(knots))
    return SmoothTime(knots, quintic_hermite(np.diff(knots), *at_knots))


def _jumps(law: _TimeLaw, window: float) -> Array:
    """Return the times at which the third derivative of the average jumps most."""
    jump = np.abs(np.diff(2 * law.half, prepend=0.0, append=0.0))
    large = np.argsort(-jump)[:_JUMPS]
    large = large[jump[large] > _LARGE * np.abs(2 * law.half).max()]
    times = law.time[large]
    return np.stack([times, times + window], axis=1).ravel()


def _with(knots: Array, wanted: Array, close: float, fixed: set[float] | None = None) -> Array:
    """Return knots with further times added, each of which replaces close knots that are not fixed.

    Args:
        knots: Increasing times [s], shape (K + 1,).
        wanted: Times to add [s], shape (w,).
        close: Distance below which a knot is replaced [s].
        fixed: Times to keep, besides both ends [s].

    Returns:
        Increasing times [s]; their number depends on how many are close.
    """
    fixed = set() if fixed is None else fixed
    fixed = fixed | {knots[0], knots[-1]}
    for value in wanted:
        if min(abs(value - other) for other in fixed) < close:
            continue
        knots = np.append(knots[np.abs(knots - value) >= close], value)
        fixed = fixed | {value}
    return np.unique(np.append(knots, sorted(fixed)))


class _TimeLaw:
    """The integral of s(t), s and ds/dt, for a time law at rest before its start and after its end.

    Args:
        time: Times of the grid points [s], shape (N + 1,).
        s: Path parameter at the grid points, shape (N + 1,).
    """

    def __init__(self, time: Array, s: Array) -> None:
        h, step = np.diff(time), np.diff(s)
        speed = np.zeros(s.size)
        for i in range(h.size):  # the mean speed is the mean of both ends' speeds
            speed[i + 1] = max(2 * step[i] / h[i] - speed[i], 0.0)
        self.time, self._s, self._speed = time, s, speed
        self.half = np.diff(speed) / (2 * h)
        area = s[:-1] * h + speed[:-1] * h**2 / 2 + self.half * h**3 / 3
        self._area = np.concatenate([[0.0], np.cumsum(area)])

    def __call__(self, t: Array) -> tuple[Array, Array, Array]:
        """Return the integral of s, s and ds/dt at times [s], shape (T,) each."""
        inside = np.clip(t, 0.0, self.time[-1])
        i = np.clip(np.searchsorted(self.time, inside, side="right") - 1, 0, self.half.size - 1)
        x, w, half, s = inside - self.time[i], self._speed[i], self.half[i], self._s[i]
        place, speed = s + x * (w + x * half), w + 2 * x * half
        area = self._area[i] + x * (s + x * (w / 2 + x * half / 3))
        area = area + (t - inside) * np.where(t < 0, self._s[0], self._s[-1])
        outside = (t < 0) | (t > self.time[-1])
        return area, place, np.where(outside, 0.0, speed)


def rate_program(pepper: PepperModel, curve: CubicPath, base: SmoothTime, limits: Limits) -> RateProgram:
    """Return the optimization problem of the rate y: all limits, including jerk, along a smooth time law."""
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
    """Return the map from three coefficients of the quadratic spline to y, y' and y'' at each piece's start.

    The basis functions are B-splines with threefold knots at both ends, so that the coefficients are the
    control polygon of y.

    Args:
        knots: Increasing times [s], shape (K + 1,).

    Returns:
        Matrices from the coefficients to y, y' and y'', shape (K, 3, 3).
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
