"""One joint's keys and handles as cubic pieces of time."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model.joint_vectors import as_real, check_choice

KINDS = ("bezier", "linear", "constant", "auto")
_CUTS = 64  # pieces of a Bezier segment whose time is no cubic's
_THIRD = 1.0 / 3.0


@dataclass(frozen=True)
class Handle:
    """How a curve leaves or meets a key.

    Attributes:
        kind: "bezier" (the control point is at the key plus (time, value)), "linear" (the control point is
            the key itself), "constant" (behind the key the value stays until the next key) or "auto" (flat
            where the key is an extreme, else along its neighbors, without overshooting them).
        time: Of the control point, from the key [s]; negative before the key, positive behind it.
        value: Of the control point, from the key [rad].
    """

    kind: str = "auto"
    time: float = 0.0
    value: float = 0.0

    def __post_init__(self) -> None:
        """Check the fields.

        Raises:
            InvalidValueError: for another kind, or a NaN.
        """
        check_choice("handle", self.kind, KINDS)
        if not (math.isfinite(as_real(self.time)) and math.isfinite(as_real(self.value))):
            raise InvalidValueError("handle", (self.time, self.value), "finite numbers")


@dataclass(frozen=True)
class Key:
    """A value at a time, with its handles.

    Attributes:
        time: [s].
        value: [rad].
        before: The handle on the side of the past.
        behind: The handle on the side of the future.
    """

    time: float
    value: float
    before: Handle = Handle()
    behind: Handle = Handle()

    def __post_init__(self) -> None:
        """Check the fields.

        Raises:
            InvalidValueError: for a NaN, or a handle on the wrong side of its key.
        """
        if not (math.isfinite(as_real(self.time)) and math.isfinite(as_real(self.value))):
            raise InvalidValueError("key", (self.time, self.value), "a finite time and a finite value")
        for side, handle, wrong in (
            ("before", self.before, self.before.time > 0),
            ("behind", self.behind, self.behind.time < 0),
        ):
            if handle.kind == "bezier" and wrong:
                raise InvalidValueError(
                    f"handle {side} the key at {self.time:.6g} s",
                    f"{handle.time} s",
                    "a time on that side of the key",
                )


def curve_segments(keys: tuple[Key, ...], start: float, duration: float) -> tuple[Array, Array]:
    """Return the curve through keys from time 0 to the duration.

    With P0, P3 two keys and P1, P2 their control points in the plane of time and value, a segment is
        P(u) = (1-u)^3 P0 + 3 (1-u)^2 u P1 + 3 (1-u) u^2 P2 + u^3 P3.
    Where both handles are a third of the segment long, time is linear in u and the segment is one cubic in
    time, exactly.  Else it is cut into 64 cubics that meet its value and slope at their ends.  A handle
    longer than its segment is shortened to it.

    Args:
        keys: In order of time.
        start: Value at time 0 where the first key is later [rad].
        duration: End, not before the last key; the last value stays until then [s].

    Returns:
        breaks [s], shape (m + 1,), and coefficients of powers of (t - break), constant first, shape (m, 4).
    """
    if keys[0].time > 0:
        keys = (Key(0.0, start), *keys)
    if keys[-1].time < duration:
        last = keys[-1]
        held = Key(last.time, last.value, last.before, Handle("constant"))
        keys = (*keys[:-1], held, Key(duration, last.value))
    breaks, powers = [np.array([0.0])], []
    for i in range(len(keys) - 1):
        times, coefficients = _segment(keys, i)
        breaks.append(times[1:])
        powers.append(coefficients)
    return np.concatenate(breaks), np.concatenate(powers)


def _segment(keys: tuple[Key, ...], i: int) -> tuple[Array, Array]:
    first, last = keys[i], keys[i + 1]
    length, rise = last.time - first.time, last.value - first.value
    ends = np.array([first.time, last.time])
    if first.behind.kind == "constant":
        return ends, np.array([[first.value, 0.0, 0.0, 0.0]])
    leave = _control(keys, i, first.behind, length, 1.0)
    meet = _control(keys, i + 1, last.before, length, -1.0)
    if leave == meet == (0.0, 0.0):
        return ends, np.array([[first.value, rise / length, 0.0, 0.0]])
    x = np.array([0.0, leave[0], length + meet[0], length])
    y = first.value + np.array([0.0, leave[1], rise + meet[1], rise])
    if np.allclose(x, length * np.array([0.0, _THIRD, 2 * _THIRD, 1.0]), atol=1e-9 * length, rtol=0):
        return ends, (_powers(y) / length ** np.arange(4))[None]
    return _cut(first.time, x, y)


def _control(
    keys: tuple[Key, ...], i: int, handle: Handle, length: float, side: float
) -> tuple[float, float]:
    """Return the control point of a handle, from its key; the side is 1 behind the key and -1 before."""
    if handle.kind == "auto":
        step = side * length * _THIRD
        return step, step * _auto_slope(keys, i)
    if handle.kind in ("linear", "constant"):
        return 0.0, 0.0
    shorten = min(1.0, length / abs(handle.time)) if handle.time else 1.0
    return handle.time * shorten, handle.value * shorten


def _auto_slope(keys: tuple[Key, ...], i: int) -> float:
    """Return the slope of an automatic handle: that of the neighbors' secant, if neither is overshot."""
    if i in (0, len(keys) - 1):
        return 0.0
    before, key, behind = keys[i - 1 : i + 2]
    rise, more = key.value - before.value, behind.value - key.value
    if rise * more <= 0:
        return 0.0
    secant = (behind.value - before.value) / (behind.time - before.time)
    most = 3.0 * min(abs(rise) / (key.time - before.time), abs(more) / (behind.time - key.time))
    return float(np.sign(secant) * min(abs(secant), most))


def _powers(control: Array) -> Array:
    """Return a cubic's coefficients in u, constant first, from its control points, shape (4,) each."""
    a, b, c, d = control
    return np.array([a, 3 * (b - a), 3 * (a - 2 * b + c), d - 3 * c + 3 * b - a])


def _cut(begin: float, x: Array, y: Array) -> tuple[Array, Array]:
    """Return cubics in time through value and slope of a Bezier segment at many places.

    Args:
        begin: Time of its first key [s].
        x: Times of its control points since then [s], shape (4,).
        y: Values of its control points [rad], shape (4,).

    Returns:
        Times [s], shape (m + 1,), and coefficients, constant first, shape (m, 4).
    """
    from scipy.interpolate import CubicHermiteSpline

    u = np.linspace(0.0, 1.0, _CUTS + 1)
    value = [np.polyval(_powers(points)[::-1], u) for points in (x, y)]
    rate = [np.polyval(np.polyder(_powers(points)[::-1]), u) for points in (x, y)]
    time = value[0]
    keep = np.concatenate([[True], np.diff(np.maximum.accumulate(time)) > 1e-9 * x[-1]])
    keep[-1] = True
    time, position = time[keep], value[1][keep]
    secant = np.gradient(position, time)
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = rate[1][keep] / rate[0][keep]
    # Where a handle has no length in time, the slope there is that of the curve's next control point.
    slope[0] = slope[0] if rate[0][0] > 1e-9 * x[-1] else _limit_slope(x, y, secant[0])
    slope[-1] = slope[-1] if rate[0][-1] > 1e-9 * x[-1] else _limit_slope(x[::-1], y[::-1], secant[-1])
    slope = np.where(np.isfinite(slope), slope, secant)
    spline = CubicHermiteSpline(time, position, slope)
    return begin + time, np.ascontiguousarray(spline.c[::-1].T)


def _limit_slope(x: Array, y: Array, otherwise: float) -> float:
    """Return the slope [rad/s] at the first control point when the second is at the same time.

    Args:
        x: Times of the control points [s], shape (4,).
        y: Values of the control points [rad], shape (4,).
        otherwise: Slope where the curve is upright [rad/s].
    """
    if abs(y[1] - y[0]) > 1e-12:
        return otherwise  # the curve is upright there
    return float((y[2] - y[0]) / (x[2] - x[0])) if abs(x[2] - x[0]) > 1e-12 else otherwise
