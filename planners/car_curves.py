"""Shortest curves of a car on the plane: forward only (Dubins), or forward and backward (Reeds and Shepp).

A pose is (x, y, yaw).  The car drives along its heading, on arcs whose radius is at least the turning radius.

Sources: L. E. Dubins, On curves of minimal length with a constraint on average curvature, American J. of
Mathematics 79, 1957; J. A. Reeds and L. A. Shepp, Optimal paths for a car that goes both forwards and
backwards, Pacific J. of Mathematics 145(2), 1990, whose formulas 8.1 to 8.11 are used here with their
numbers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2

from .vectors import FloatArray, finite_vector, positive_number, read_only, real_numbers

PIECES = 5
"""Maximum number of pieces of a shortest curve."""

LEFT, STRAIGHT, RIGHT = 1.0, 0.0, -1.0

_HALF = 0.5 * math.pi
_TINY = 1e-10
"""Tolerance for rounding: angles and squares below zero by less count as zero."""


@dataclass(frozen=True, eq=False)
class CarCurve:
    """A curve of a car: arcs and straight lines, one after the other.

    Attributes:
        start: (x, y, yaw) [m, m, rad], shape (3,).
        turns: 1 for a left turn, -1 for a right one, 0 for straight on, shape (k,).
        lengths: Lengths of the pieces [m], negative where the car drives backward, shape (k,).
        radius: The turning radius [m].
    """

    start: FloatArray
    turns: FloatArray
    lengths: FloatArray
    radius: float

    def __post_init__(self) -> None:
        """Refuse arrays of other shapes, which machine code reads.

        Raises:
            InvalidValueError: naming the array.
        """
        finite_vector("start", self.start, 3)
        positive_number("radius", self.radius)
        count = len(finite_vector("turns", self.turns)) if np.size(self.turns) else 0
        if count or np.size(self.lengths):
            finite_vector("lengths", self.lengths, count)

    @property
    def length(self) -> float:
        """Length of the curve [m]."""
        return float(np.abs(self.lengths).sum())

    def __call__(self, s: ArrayLike) -> FloatArray:
        """Return the poses at lengths along the curve [m], shape (...); yaw is continuous, shape (..., 3).

        Raises:
            InvalidValueError: for anything but numbers, or NaN.
        """
        places = np.ascontiguousarray(real_numbers("s", s))
        if np.isnan(places).any():
            raise InvalidValueError("s", math.nan, "lengths along the curve [m]")
        poses = np.empty((places.size, 3))
        poses_on_curve(self.start.copy(), self.segments, self.radius, places.reshape(-1), poses)
        return poses.reshape(*np.shape(s), 3)

    @property
    def segments(self) -> FloatArray:
        """Turns and lengths [m] of the pieces for machine code, shape (2, k)."""
        return np.ascontiguousarray(np.stack([self.turns, self.lengths]))

    def part(self, begin: float, end: float) -> CarCurve:
        """Return the part between two lengths along the curve [m].

        Raises:
            InvalidValueError: for lengths that are not finite numbers.
        """
        for name, place in (("begin", begin), ("end", end)):
            if real_numbers(name, place).shape != () or not np.isfinite(place):
                raise InvalidValueError(name, place, "a finite length along the curve [m]")
        ends = np.cumsum(np.abs(self.lengths))
        starts = ends - np.abs(self.lengths)
        kept = np.clip(np.minimum(ends, end) - np.maximum(starts, begin), 0.0, None)
        used = kept > 0.0
        lengths = np.copysign(kept, self.lengths)[used]
        return CarCurve(read_only(self(begin)), self.turns[used], read_only(lengths), self.radius)


def car_curve(start: ArrayLike, end: ArrayLike, radius: float, *, backward: bool = True) -> CarCurve:
    """Return the shortest curve from one pose to another.

    Args:
        start: (x, y, yaw) [m, m, rad], shape (3,).
        end: (x, y, yaw) [m, m, rad], shape (3,); its yaw is met up to full turns.
        radius: Minimum turning radius [m].
        backward: Whether the car may go backward too.

    Raises:
        InvalidValueError: A pose has another shape or is not finite, or the radius is not above zero.
    """
    begin, target = finite_vector("start", start, 3), finite_vector("end", end, 3)
    radius, segments = positive_number("radius", radius), np.zeros((2, PIECES))
    shortest_curve(begin.copy(), target.copy(), radius, backward, segments)
    used = segments[1] != 0.0
    return CarCurve(begin, read_only(segments[0, used]), read_only(segments[1, used]), radius)


@compiled
def _wrapped(angle: float) -> float:
    """Return an angle in [-pi, pi]."""
    return angle - 2.0 * math.pi * math.floor(angle / (2.0 * math.pi) + 0.5)


@compiled
def _turned(angle: float) -> float:
    """Return an angle in [0, 2 pi); an angle below zero by rounding becomes zero."""
    rest = angle - 2.0 * math.pi * math.floor(angle / (2.0 * math.pi))
    return 0.0 if rest > 2.0 * math.pi - _TINY else rest


@compiled
def _keep(
    best: float, segments: Floats2, mirror: float, sign: float, turns: Floats1, values: Floats1
) -> float:
    """Write a word of up to five pieces if it is shorter than the best so far; return the best length."""
    total = 0.0
    for k in range(PIECES):
        total += abs(values[k])
    if total >= best:
        return best
    for k in range(PIECES):
        segments[0, k], segments[1, k] = mirror * turns[k], sign * values[k]
    return total


@compiled
def _word(capacity: Floats2, a: float, b: float, c: float, d: float, e: float) -> None:
    """Write the turns of a word."""
    capacity[0, 0], capacity[0, 1], capacity[0, 2], capacity[0, 3], capacity[0, 4] = a, b, c, d, e


@compiled
def _values(capacity: Floats2, a: float, b: float, c: float, d: float, e: float) -> None:
    """Write the lengths of a word, in radii."""
    capacity[1, 0], capacity[1, 1], capacity[1, 2], capacity[1, 3], capacity[1, 4] = a, b, c, d, e


@compiled
def _tau_omega(u: float, v: float, xi: float, eta: float, phi: float) -> tuple[float, float]:
    """Return the outer arcs of the words with two equal inner ones."""
    delta = _wrapped(u - v)
    a, b = math.sin(u) - math.sin(delta), math.cos(u) - math.cos(delta) - 1.0
    first = math.atan2(eta * a - xi * b, xi * a + eta * b)
    side = 2.0 * (math.cos(delta) - math.cos(v) - math.cos(u)) + 3.0
    tau = _wrapped(first + math.pi) if side < 0.0 else _wrapped(first)
    return tau, _wrapped(tau - u + v - phi)


@compiled
def _forward_words(
    x: float, y: float, phi: float, mirror: float, best: float, segments: Floats2, capacity: Floats2
) -> float:
    """Try the words of Dubins that begin to the left."""
    xi, eta = x - math.sin(phi), y - 1.0 + math.cos(phi)
    far, theta = math.hypot(xi, eta), math.atan2(eta, xi)
    t = _turned(theta)
    _word(capacity, LEFT, STRAIGHT, LEFT, 0.0, 0.0)
    _values(capacity, t, far, _turned(phi - t), 0.0, 0.0)
    best = _keep(best, segments, mirror, 1.0, capacity[0], capacity[1])
    if far <= 4.0:
        middle = 2.0 * math.pi - 2.0 * math.asin(far / 4.0)
        t = _turned(theta - math.asin(far / 4.0) + math.pi)
        _word(capacity, LEFT, RIGHT, LEFT, 0.0, 0.0)
        _values(capacity, t, middle, _turned(phi - t + middle), 0.0, 0.0)
        best = _keep(best, segments, mirror, 1.0, capacity[0], capacity[1])
    xi, eta = x + math.sin(phi), y - 1.0 - math.cos(phi)
    square = xi * xi + eta * eta
    if square >= 4.0 - _TINY:
        u = math.sqrt(max(square - 4.0, 0.0))
        t = _turned(math.atan2(eta, xi) + math.atan2(2.0, u))
        _word(capacity, LEFT, STRAIGHT, RIGHT, 0.0, 0.0)
        _values(capacity, t, u, _turned(t - phi), 0.0, 0.0)
        best = _keep(best, segments, mirror, 1.0, capacity[0], capacity[1])
    return best


@compiled
def _both_ways_words(
    x: float,
    y: float,
    phi: float,
    mirror: float,
    sign: float,
    best: float,
    segments: Floats2,
    capacity: Floats2,
) -> float:
    """Try the words of Reeds and Shepp that begin forward to the left and whose reversal is no new word."""
    turns, values = capacity[0], capacity[1]
    xi, eta = x - math.sin(phi), y - 1.0 + math.cos(phi)
    far, theta = math.hypot(xi, eta), math.atan2(eta, xi)
    v = _wrapped(phi - theta)
    if theta >= -_TINY and v >= -_TINY:  # 8.1
        _word(capacity, LEFT, STRAIGHT, LEFT, 0.0, 0.0)
        _values(capacity, theta, far, v, 0.0, 0.0)
        best = _keep(best, segments, mirror, sign, turns, values)
    xi, eta = x + math.sin(phi), y - 1.0 - math.cos(phi)
    square = xi * xi + eta * eta
    far = math.sqrt(square)
    if square >= 4.0:  # 8.2
        u = math.sqrt(square - 4.0)
        t = _wrapped(math.atan2(eta, xi) + math.atan2(2.0, u))
        v = _wrapped(t - phi)
        if t >= -_TINY and v >= -_TINY:
            _word(capacity, LEFT, STRAIGHT, RIGHT, 0.0, 0.0)
            _values(capacity, t, u, v, 0.0, 0.0)
            best = _keep(best, segments, mirror, sign, turns, values)
    _word(capacity, LEFT, RIGHT, LEFT, RIGHT, 0.0)
    rho = 0.25 * (2.0 + far)
    if rho <= 1.0:  # 8.7
        u = math.acos(rho)
        t, v = _tau_omega(u, -u, xi, eta, phi)
        if t >= -_TINY and v <= _TINY:
            _values(capacity, t, u, -u, v, 0.0)
            best = _keep(best, segments, mirror, sign, turns, values)
    rho = (20.0 - square) / 16.0
    if 0.0 <= rho <= 1.0:  # 8.8
        u = -math.acos(rho)
        t, v = _tau_omega(u, u, xi, eta, phi)
        if t >= -_TINY and v >= -_TINY:
            _values(capacity, t, u, u, v, 0.0)
            best = _keep(best, segments, mirror, sign, turns, values)
    if far >= 2.0:  # 8.11
        u = 4.0 - math.sqrt(square - 4.0)
        if u <= 0.0:
            t = _wrapped(math.atan2((4.0 - u) * xi - 2.0 * eta, -2.0 * xi + (u - 4.0) * eta))
            v = _wrapped(t - phi)
            if t >= -_TINY and v >= -_TINY:
                _word(capacity, LEFT, RIGHT, STRAIGHT, LEFT, RIGHT)
                _values(capacity, t, -_HALF, u, -_HALF, v)
                best = _keep(best, segments, mirror, sign, turns, values)
    return best


@compiled
def _one_way_words(
    end: tuple[float, float, float],
    mirror: float,
    sign: float,
    best: float,
    segments: Floats2,
    capacity: Floats2,
    backwards: bool,
) -> float:
    """Try the words whose reversal is another word: of three arcs, and with one quarter of a circle."""
    x, y, phi = end
    turns, values = capacity[0], capacity[1]
    xi, eta = x - math.sin(phi), y - 1.0 + math.cos(phi)
    far, theta = math.hypot(xi, eta), math.atan2(eta, xi)
    if far <= 4.0:  # 8.3
        u = -2.0 * math.asin(0.25 * far)
        t = _wrapped(theta + 0.5 * u + math.pi)
        v = _wrapped(phi - t + u)
        if t >= -_TINY:
            _word(capacity, LEFT, RIGHT, LEFT, 0.0, 0.0)
            if backwards:
                _values(capacity, v, u, t, 0.0, 0.0)
            else:
                _values(capacity, t, u, v, 0.0, 0.0)
            best = _keep(best, segments, mirror, sign, turns, values)
    if far >= 2.0:  # 8.9
        r = math.sqrt(far * far - 4.0)
        u, t = 2.0 - r, _wrapped(theta + math.atan2(r, -2.0))
        v = _wrapped(phi - _HALF - t)
        if t >= -_TINY and u <= 0.0 and v <= _TINY:
            if backwards:
                _word(capacity, LEFT, STRAIGHT, RIGHT, LEFT, 0.0)
                _values(capacity, v, u, -_HALF, t, 0.0)
            else:
                _word(capacity, LEFT, RIGHT, STRAIGHT, LEFT, 0.0)
                _values(capacity, t, -_HALF, u, v, 0.0)
            best = _keep(best, segments, mirror, sign, turns, values)
    xi, eta = x + math.sin(phi), y - 1.0 - math.cos(phi)
    far, t = math.hypot(xi, eta), math.atan2(xi, -eta)
    if far >= 2.0:  # 8.10
        u, v = 2.0 - far, _wrapped(t + _HALF - phi)
        if t >= -_TINY and v <= _TINY:
            if backwards:
                _word(capacity, RIGHT, STRAIGHT, RIGHT, LEFT, 0.0)
                _values(capacity, v, u, -_HALF, t, 0.0)
            else:
                _word(capacity, LEFT, RIGHT, STRAIGHT, RIGHT, 0.0)
                _values(capacity, t, -_HALF, u, v, 0.0)
            best = _keep(best, segments, mirror, sign, turns, values)
    return best


@compiled("float64(float64[::1], float64[::1], float64, boolean, float64[:, ::1])")
def shortest_curve(a: Floats1, b: Floats1, radius: float, backward: bool, segments: Floats2) -> float:
    """Write the pieces of the shortest curve between two poses; return its length [m].

    Args:
        a: (x, y, yaw) [m, m, rad].
        b: (x, y, yaw) [m, m, rad].
        radius: Turning radius [m].
        backward: Whether the car may go backward too.
        segments: Turns and signed lengths [m], written, shape (2, PIECES); unused pieces have length 0.
    """
    dx, dy, c, s = (b[0] - a[0]) / radius, (b[1] - a[1]) / radius, math.cos(a[2]), math.sin(a[2])
    x, y, phi = c * dx + s * dy, c * dy - s * dx, _wrapped(b[2] - a[2])
    best, capacity = math.inf, np.empty((2, PIECES))
    for mirror in (1.0, -1.0):
        if not backward:
            best = _forward_words(x, mirror * y, mirror * phi, mirror, best, segments, capacity)
            continue
        for sign in (1.0, -1.0):
            px, py, angle = sign * x, mirror * y, sign * mirror * phi
            best = _both_ways_words(px, py, angle, mirror, sign, best, segments, capacity)
            best = _one_way_words((px, py, angle), mirror, sign, best, segments, capacity, False)
            bx = px * math.cos(angle) + py * math.sin(angle)
            by = px * math.sin(angle) - py * math.cos(angle)
            best = _one_way_words((bx, by, angle), mirror, sign, best, segments, capacity, True)
    for k in range(PIECES):
        segments[1, k] *= radius
    return best * radius


@compiled("void(float64[::1], float64[:, ::1], float64, float64, float64[::1])")
def pose_on_curve(a: Floats1, segments: Floats2, radius: float, s: float, pose: Floats1) -> None:
    """Write the pose at a length along a curve; its yaw is the yaw of the start plus all rotations.

    Args:
        a: Start pose of the curve (x, y, yaw) [m, m, rad].
        segments: Turns and signed lengths [m], shape (2, k).
        radius: Turning radius [m].
        s: Length from the beginning [m]; the curve's end where it is longer.
        pose: Shape (3,); it may be `a`.
    """
    x, y, yaw, left = a[0], a[1], a[2], max(s, 0.0)
    for k in range(segments.shape[1]):
        step = min(abs(segments[1, k]), left)
        left -= step
        way = step if segments[1, k] > 0.0 else -step
        if segments[0, k] == STRAIGHT:
            x, y = x + way * math.cos(yaw), y + way * math.sin(yaw)
            continue
        turn = segments[0, k] * radius
        then = yaw + way / turn
        x, y = x + turn * (math.sin(then) - math.sin(yaw)), y - turn * (math.cos(then) - math.cos(yaw))
        yaw = then
    pose[0], pose[1], pose[2] = x, y, yaw


@compiled("void(float64[::1], float64[:, ::1], float64, float64[::1], float64[:, ::1])")
def poses_on_curve(a: Floats1, segments: Floats2, radius: float, places: Floats1, poses: Floats2) -> None:
    """Write the poses, shape (m, 3), at lengths along a curve [m], shape (m,); see `pose_on_curve`."""
    for k in range(places.size):
        pose_on_curve(a, segments, radius, places[k], poses[k])
