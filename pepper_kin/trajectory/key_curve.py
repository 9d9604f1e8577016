"""Conversion of keys with handles, and of keyframes, to piecewise cubics in time."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.arrays import Array
from pepper_kin.core.splines import shifted
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_finite, as_real, check_choice, check_within_limits

if TYPE_CHECKING:
    from pepper_kin.trajectory.trajectory import Trajectory

KINDS = ("bezier", "linear", "constant", "auto")
_CUTS = 64  # number of cubics that replace a Bezier segment whose time is not linear in its parameter
_THIRD = 1.0 / 3.0
Part = TypeVar("Part")
_SAME = 1e-9  # distance below which two knots are merged [s]
Frame: TypeAlias = str | Mapping[str, ArrayLike] | Sequence[float] | NDArray[np.float64]
"""A posture's name, joints and groups with their positions, or the positions of all joints."""


@dataclass(frozen=True)
class Handle:
    """Handle of a key, which shapes the curve on one side of the key.

    Attributes:
        kind: "bezier" (the control point is at the key plus (time, value)), "linear" (the control point is
            the key itself), "constant" (after the key the value stays until the next key) or "auto" (flat
            where the key is an extreme, else along the secant of its neighbors, without overshooting them).
        time: Time of the control point relative to the key [s]; negative before the key, positive after it.
        value: Value of the control point relative to the key [rad].
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
        time: Time of the key [s].
        value: Joint position [rad].
        before: Handle on the side of earlier times.
        behind: Handle on the side of later times.
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
    If both handles are a third of the segment long, time is linear in u and the segment is exactly one cubic
    in time.  Otherwise it is replaced by 64 cubics that match its value and slope at their ends.  A handle
    longer than its segment is shortened to it.

    Args:
        keys: Keys in order of time.
        start: Value at time 0, used if the first key is later [rad].
        duration: End of the curve [s], not before the last key; the last value stays until then.

    Returns:
        Breaks [s], shape (m + 1,), and coefficients of powers of (t - break), constant first, shape (m, 4).
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
    """Return the control point of a handle relative to its key; `side` is 1 after the key, -1 before it."""
    if handle.kind == "auto":
        step = side * length * _THIRD
        return step, step * _auto_slope(keys, i)
    if handle.kind in ("linear", "constant"):
        return 0.0, 0.0
    shorten = min(1.0, length / abs(handle.time)) if handle.time else 1.0
    return handle.time * shorten, handle.value * shorten


def _auto_slope(keys: tuple[Key, ...], i: int) -> float:
    """Return the slope of an automatic handle: the neighbors' secant, limited so that neither is overshot."""
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
    """Return cubics in time that match value and slope of a Bezier segment at many points.

    Args:
        begin: Time of the segment's first key [s].
        x: Times of the control points since the first key [s], shape (4,).
        y: Values of the control points [rad], shape (4,).

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
    # If a handle has no length in time, the slope at its key leads to the next control point.
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
        otherwise: Slope to return if the curve is vertical [rad/s].
    """
    if abs(y[1] - y[0]) > 1e-12:
        return otherwise  # the curve is vertical at this key
    return float((y[2] - y[0]) / (x[2] - x[0])) if abs(x[2] - x[0]) > 1e-12 else otherwise


def checked_parts(quantity: str, parts: Sequence[Part], kind: type[Part]) -> tuple[Part, ...]:
    """Return keys or curves as a tuple; refuse anything else among them."""
    found = tuple(parts)
    for part in found:
        if not isinstance(part, kind):
            raise InvalidValueError(quantity, repr(part), f"a {kind.__name__}")
    return found


@dataclass(frozen=True)
class JointCurve:
    """The keys of one joint, in order of time.

    Attributes:
        joint: Name of the joint.
        keys: Keys, one or more.
    """

    joint: str
    keys: tuple[Key, ...]

    def __post_init__(self) -> None:
        """Check the keys.

        Raises:
            InvalidValueError: naming the joint, for no key, or times that do not increase from 0 or later.
        """
        object.__setattr__(self, "keys", checked_parts(f"keys of {self.joint}", self.keys, Key))
        times = [key.time for key in self.keys]
        if not times or times[0] < 0 or any(b <= a for a, b in pairwise(times)):
            raise InvalidValueError(
                f"times of {self.joint}", times[:8], "one or more increasing times, the first 0 or later"
            )


def on_common_knots(
    pepper: PepperModel, curves: Sequence[JointCurve], rest: Array, duration: float
) -> tuple[Array, Array]:
    """Return common knots [s], shape (m + 1,), and coefficients of all joints [rad/s^p], shape (m, 4, n).

    Args:
        pepper: The robot.
        curves: Curves of some of the robot's joints.
        rest: Positions at time 0 of curves that begin later, and of joints without a curve [rad or m], (n,).
        duration: Time of the last knot [s].
    """
    segments = {
        pepper.joint_index(curve.joint): curve_segments(
            curve.keys, float(rest[pepper.joint_index(curve.joint)]), duration
        )
        for curve in curves
    }
    knots = _merged([breaks for breaks, _ in segments.values()], duration)
    coefficients = np.zeros((knots.size - 1, 4, pepper.n))
    coefficients[:, 0] = rest
    for j, (breaks, powers) in segments.items():
        coefficients[:, :, j] = _on(knots, breaks, powers)
    return knots, coefficients


def _merged(all_breaks: list[Array], duration: float) -> Array:
    """Return the knots of all joints from 0 to the duration [s], shape (m + 1,), nearly equal ones merged."""
    knots = np.unique(np.concatenate([[0.0, duration], *all_breaks]))
    keep = np.concatenate([[True], np.diff(knots) > _SAME])
    knots = knots[keep]
    knots[-1] = duration
    return knots


def _on(knots: Array, breaks: Array, powers: Array) -> Array:
    """Return the cubic pieces of one joint on finer knots, shape (m, 4)."""
    middle = (knots[:-1] + knots[1:]) / 2
    segment = np.clip(np.searchsorted(breaks, middle, side="right") - 1, 0, breaks.size - 2)
    return shifted(powers[segment][..., None], knots[:-1] - breaks[segment])[..., 0]


def from_keyframes(
    kind: type[Trajectory],
    pepper: PepperModel,
    keyframes: Mapping[float, Frame] | Iterable[tuple[float, Frame]],
    start: str | ArrayLike | None,
) -> Trajectory:
    """Return the trajectory of `Trajectory.from_keyframes`, which describes arguments and errors.

    `kind` is the class of the result; a start that is not a posture's name has shape (n,) [rad or m].
    """
    frames = _in_order(keyframes)
    keys: dict[str, list[Key]] = {name: [] for name in pepper.joint_names}
    for time, frame in frames:
        q = _position(pepper, frame, f"keyframe at {time:.6g} s")
        for name in pepper.resolve_joints(frame) if isinstance(frame, Mapping) else pepper.joint_names:
            keys[name].append(Key(time, float(q[pepper.joint_index(name)])))
    curves = tuple(JointCurve(name, tuple(those)) for name, those in keys.items() if those)
    begin = pepper.neutral() if start is None else _position(pepper, start, "start")
    knots, coefficients = on_common_knots(pepper, curves, begin, frames[-1][0])
    return kind(pepper.joint_names, knots, coefficients, pepper.joint_units)


def _in_order(keyframes: Any) -> list[tuple[float, Frame]]:
    allowed = "time [s] -> frame, or pairs of both, with two or more times that increase from 0 or later"
    try:
        entries = keyframes.items() if isinstance(keyframes, Mapping) else keyframes
        pairs = [(time, frame) for time, frame in entries]
    except (TypeError, ValueError):
        raise InvalidValueError("keyframes", repr(keyframes), allowed) from None
    times = [float(as_finite(time, "time of a keyframe", ())) for time, _ in pairs]
    if (
        not times
        or times[0] < 0
        or times[-1] == 0
        or any(after <= before for before, after in pairwise(times))
    ):
        raise InvalidValueError("times of keyframes", times[:8], allowed)
    return list(zip(times, (frame for _, frame in pairs), strict=True))


def _position(pepper: PepperModel, frame: Any, quantity: str) -> NDArray[np.float64]:
    """Return the joint vector of a frame; joints that it does not name are at their neutral position."""
    if isinstance(frame, str):
        return pepper.posture(frame)
    if isinstance(frame, Mapping) and not frame:
        raise InvalidValueError(quantity, "no joint", "a posture, or at least one joint")
    try:
        q = pepper.joint_vector(frame)
    except InvalidValueError as error:
        raise InvalidValueError(f"{quantity}: {error.quantity}", error.value, error.allowed) from error
    check_within_limits(pepper, q, quantity)
    return q
