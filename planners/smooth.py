"""Rounding of a polyline into a curve with continuous curvature that stays valid."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.exceptions import InfeasibleError, InvalidValueError
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2, Floats3

from .motion_validator import MotionValidator
from .path import Path
from .problem import Problem
from .vectors import (
    MOST_COUNT,
    BoolArray,
    FloatArray,
    finite_vector,
    positive_number,
    read_only,
    real_numbers,
    whole_number,
)

_MOST_SEGMENTS = 1_000_000
_ROUNDS = 20  # maximum number of halvings of the spacing, to a millionth of it
_COARSE = 10.0  # first spacing of breaks, in units of the problem's resolution
_FEWEST = 4  # minimum number of pieces
_SAMPLES = 32  # number of samples of a polyline for the fit of sines
_MERGE = 1e-9  # distance below which waypoints are merged, relative to the box's diagonal
_ADVICE = "plan and shortcut again at a finer resolution, or let the checker keep a margin"
_FACTORS = ((1.0, 1.0, 1.0, 1.0), (1.0, 2.0, 3.0), (2.0, 6.0), (6.0,))  # p! / (p - derivative)!


@dataclass(frozen=True, eq=False)
class SmoothPath:
    """A piecewise cubic curve of states.

    On piece i, where ``breaks[i] <= s <= breaks[i + 1]``, it is
    ``q(s) = sum_p coefficients[i, p] (s - breaks[i])^p``.

    The parameter s runs from 0 to `length`.  Paths made by `smooth` run at no more than unit speed,
    ``|w dq/ds| <= 1`` (exactly 1 on straight parts), and are twice continuously differentiable.

    Attributes:
        breaks: Ends of the pieces, shape (k + 1,), rising from 0.
        coefficients: Power-basis coefficients, constant term first, shape (k, 4, n).
        goal: The exact last state, shape (n,), which the last polynomial meets up to rounding.
    """

    breaks: FloatArray
    coefficients: FloatArray
    goal: FloatArray

    def __post_init__(self) -> None:
        """Copy and check the fields.

        Raises:
            InvalidValueError: A shape is wrong, a value is not finite, the breaks do not rise from 0, or the
                last piece does not end at the goal.
        """
        breaks = finite_vector("breaks", self.breaks)
        coefficients = np.array(self.coefficients, dtype=np.float64, order="C")
        if breaks.size < 2 or breaks[0] != 0.0 or np.any(np.diff(breaks) <= 0.0):
            raise InvalidValueError("breaks", breaks, "two or more numbers that rise from 0")
        if coefficients.ndim != 3 or coefficients.shape[:2] != (breaks.size - 1, 4) or coefficients.size == 0:
            raise InvalidValueError(
                "coefficients", f"shape {coefficients.shape}", f"shape ({breaks.size - 1}, 4, n)"
            )
        if not np.all(np.isfinite(coefficients)):
            raise InvalidValueError("coefficients", "NaN or infinity", "finite numbers")
        goal = finite_vector("goal", self.goal, coefficients.shape[2])
        object.__setattr__(self, "breaks", breaks)
        object.__setattr__(self, "coefficients", read_only(coefficients))
        object.__setattr__(self, "goal", goal)
        end = self._evaluate(breaks[-1:], 0)[0]
        if not (np.abs(end - goal) <= 1e-9 * (1.0 + np.abs(goal))).all():
            raise InvalidValueError("goal", goal, f"the end of the last piece, {end}")

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return int(self.coefficients.shape[2])

    @property
    def length(self) -> float:
        """Maximum parameter, at least the curve's length [length unit of the metric]."""
        return float(self.breaks[-1])

    @property
    def start(self) -> FloatArray:
        """The first state, shape (n,)."""
        return self.coefficients[0, 0]

    def __call__(self, s: ArrayLike, derivative: int = 0) -> FloatArray:
        """Return the states, or derivatives with respect to s, at given parameters.

        Args:
            s: Parameters within [0, length], shape (...).
            derivative: Order of the derivative, 0 to 3; the third one is constant on a piece, and taken from
                the later piece at a break.

        Returns:
            States or derivatives, shape (..., n); exactly `start` at 0 and `goal` at `length` for derivative
            0.

        Raises:
            InvalidValueError: A parameter is NaN or outside [0, length], or the order is not 0 to 3.
        """
        if derivative not in (0, 1, 2, 3):
            raise InvalidValueError("derivative", derivative, "0, 1, 2 or 3")
        values = real_numbers("s", s)
        slack = 1e-12 * self.length
        if not np.all((values >= -slack) & (values <= self.length + slack)):
            raise InvalidValueError("s", s, f"parameters within [0, {self.length:g}]")
        values = np.clip(values, 0.0, self.length)
        states = self._evaluate(values, derivative)
        return np.where((values == self.length)[..., None], self.goal, states) if derivative == 0 else states

    def sample(self, spacing: float) -> FloatArray:
        """Return states no further apart than a spacing in the parameter, on each piece equally spaced.

        Args:
            spacing: Maximum step of s.

        Returns:
            States, shape (m, n), from start to goal, breaks included.

        Raises:
            InvalidValueError: The spacing is not above zero.
        """
        spacing = positive_number("spacing", spacing)
        if self.length > MOST_COUNT * spacing:
            raise InvalidValueError("spacing", spacing, f"at least {self.length / MOST_COUNT:.1e}")
        segments = [
            np.linspace(a, b, max(1, int(np.ceil((b - a) / spacing))), endpoint=False)
            for a, b in zip(self.breaks[:-1], self.breaks[1:], strict=True)
        ]
        return self(np.concatenate((*segments, self.breaks[-1:])))

    def _evaluate(self, s: FloatArray, derivative: int) -> FloatArray:
        segment = np.clip(np.searchsorted(self.breaks, s, side="right") - 1, 0, len(self.coefficients) - 1)
        local = (s - self.breaks[segment])[..., None]
        chosen = self.coefficients[segment]
        value = np.zeros(chosen.shape[:-2] + chosen.shape[-1:])
        for power in range(3, derivative - 1, -1):  # Horner
            value = value * local + _FACTORS[derivative][power - derivative] * chosen[..., power, :]
        return value


def smooth(
    problem: Problem, path: Path, *, spacing: float | None = None, resolution: float | None = None
) -> SmoothPath:
    """Turn a valid polyline into a valid C2 curve with the same ends.

    The curve is the Schoenberg spline of the polyline f(s), s its arc length: the clamped cubic B-spline

        q(s) = sum_i f(xi_i) B_i(s),   xi_i = (t_{i+1} + t_{i+2} + t_{i+3}) / 3   (Greville abscissae).

    Its control points lie on the polyline, so each piece lies in the convex hull of four successive points of
    the polyline: the curve stays inside every convex set that holds the path (the box of bounds), keeps near
    the polyline, and equals it where it is straight.  It starts and ends at the path's ends, at unit speed if
    the first and last edge are no shorter than a third of a piece.

    All pieces are checked at their ends, their middles and at the resolution.  Around an invalid piece the
    spacing of the knots t is halved, which pulls the curve to the polyline, until all pieces are valid.

    The path must itself be valid where the curve is checked.  A path that grazes obstacles may just fail,
    since its edges were checked at other states; so let the validity of the planning problem keep a larger
    margin than the problem given here.

    Source: I. J. Schoenberg, On spline functions, 1967; C. de Boor, A practical guide to splines, 2001,
    chapter XI.

    Args:
        problem: Supplies the validity, the metric and the resolution; its start and goals are not used.
        path: A valid path of the problem's coordinates, longer than zero.  Where it turns back on itself
            exactly, the curve's speed passes through zero.
        spacing: Initial distance of breaks [length unit of the metric]; larger is rounder.  Ten times the
            problem's resolution if omitted; at least four pieces are made.
        resolution: Maximum distance between checked states of the curve [length unit of the metric]; the
            problem's if omitted.

    Returns:
        The curve; its parameter runs from 0 to the polyline's length.

    Raises:
        InvalidValueError: The path has another number of coordinates or no length, or an option is not
            allowed.
        InfeasibleError: The path itself is not valid at this resolution, or leaves no space at a corner.
    """
    problem.require_same("path", path.n)
    polyline = Path(path.points, problem.weights).merged(_MERGE * problem.diagonal)
    if len(polyline) < 2:
        raise InvalidValueError("path", f"length {path.length:g}", "a path whose waypoints differ")
    validator = problem.validator(resolution=resolution)
    if spacing is None:
        spacing = _COARSE * problem.validator().resolution
    segments = max(_FEWEST, int(np.ceil(polyline.length / positive_number("spacing", spacing))))
    breaks = np.linspace(0.0, polyline.length, segments + 1)
    return _refine_until_valid(validator, polyline, breaks)


def _refine_until_valid(validator: MotionValidator, polyline: Path, breaks: FloatArray) -> SmoothPath:
    """Return a valid spline, with pieces halved around invalid ones; raise InfeasibleError if none is."""
    is_new = np.ones(breaks.size, dtype=bool)
    worst = polyline.points[0]
    for _ in range(_ROUNDS):
        curve, abscissae = _spline(polyline, breaks)
        # A piece depends on at most three breaks to either side of it; only new breaks there change it.
        invalid = _invalid_segments(validator, curve, _dilated(is_new, 3)[:-1])
        if not invalid.any():
            return curve
        _refuse_straight(polyline, abscissae, curve, invalid)
        worst = curve(float(breaks[int(np.argmax(invalid))]))
        breaks, is_new = _halved(breaks, invalid)
    reason = f"the path leaves no space for a smooth corner near {_show(worst)}"
    raise InfeasibleError("smooth path", reason, _ADVICE)


def rounded_waypoints(path: Path, segments: int) -> FloatArray:
    """Return the states at equally spaced breaks of the Schoenberg spline of a path.

    See `smooth` for the curve; nothing is checked here.

    Args:
        path: Path of two or more waypoints, longer than zero.
        segments: Number of pieces, 1 to 1,000,000.

    Returns:
        States, shape (segments + 1, n); the first and the last row are the path's ends.

    Raises:
        InvalidValueError: for another number of pieces.
    """
    segments = whole_number("segments", segments, 1, _MOST_SEGMENTS)
    breaks = np.linspace(0.0, path.length, segments + 1)
    coefficients = np.empty((segments, 4, path.n))
    schoenberg_spline(path.points, path.arc_lengths, breaks, np.empty(segments + 3), coefficients)
    return np.concatenate((coefficients[:, 0], path.points[-1:]))


def _spline(polyline: Path, breaks: FloatArray) -> tuple[SmoothPath, FloatArray]:
    """Return the Schoenberg spline of a polyline, and the arc lengths of its control points."""
    segments = breaks.size - 1
    coefficients, abscissae = np.empty((segments, 4, polyline.n)), np.empty(segments + 3)
    schoenberg_spline(polyline.points, polyline.arc_lengths, breaks, abscissae, coefficients)
    return SmoothPath(breaks, coefficients, polyline.points[-1]), abscissae


@compiled
def _on_polyline(points: FloatArray, lengths: FloatArray, s: float, state: FloatArray) -> None:
    """Write the state of a polyline at an arc length; `lengths` holds the arc lengths of its points."""
    k = 0
    while k < lengths.size - 2 and lengths[k + 1] <= s:
        k += 1
    span = lengths[k + 1] - lengths[k]
    share = (s - lengths[k]) / span if span > 0.0 else 1.0
    for i in range(state.size):
        state[i] = points[k + 1, i]
        if share < 1.0:
            state[i] = points[k, i] + max(share, 0.0) * (points[k + 1, i] - points[k, i])


@compiled("void(float64[:, ::1], float64[::1], float64[::1], float64[::1], float64[:, :, ::1])")
def schoenberg_spline(
    points: Floats2, lengths: Floats1, breaks: Floats1, abscissae: Floats1, coefficients: Floats3
) -> None:
    """Write the polynomials of the Schoenberg spline of a polyline; see `smooth`.

    Args:
        points: The polyline, two points or more, shape (m, n).
        lengths: Arc length at each point, shape (m,), rising.
        breaks: Ends of the k pieces, shape (k + 1,), rising from 0 to the polyline's length.
        abscissae: Written: arc lengths of the control points, shape (k + 3,).
        coefficients: Written: constant term first, shape (k, 4, n).
    """
    segments = breaks.size - 1
    knots, control = np.empty(segments + 7), np.empty((segments + 3, points.shape[1]))
    for j in range(knots.size):
        knots[j] = breaks[min(max(j - 3, 0), segments)]
    for i in range(segments + 3):
        abscissae[i] = min((knots[i + 1] + knots[i + 2] + knots[i + 3]) / 3.0, lengths[-1])
        if i == segments + 2:
            abscissae[i] = lengths[-1]
        _on_polyline(points, lengths, abscissae[i], control[i])
    power_basis(knots, control, coefficients)


@compiled("void(float64[:, ::1], float64[::1], int64, float64, float64[:, ::1])")
def sine_waypoints(points: Floats2, lengths: Floats1, waves: int, scale: float, curve: Floats2) -> None:
    """Write points of a curve: the straight line plus few sines, fitted to a polyline.

    With q_0 and q_1 the ends of a polyline f, u its arc length as a fraction of the whole, and M samples:

        q(u) = q_0 + u (q_1 - q_0) + a sum_{k=1}^{K} c_k sin(k pi u),
        c_k = 2 / M sum_{i=1}^{M-1} (f(i / M) - q_0 - i / M (q_1 - q_0)) sin(k pi i / M),

    which for a = 1 is the least-squares fit (the discrete sine transform).  The curve has no corners to slow
    down at; it cuts sharp corners of f, which a larger a compensates.

    Args:
        points: The polyline, two points or more, shape (m, n).
        lengths: Arc length at each point, shape (m,), rising.
        waves: Number K of sines, below M = 32.
        scale: Amplitude factor a.
        curve: Written: the points at equal steps of u, shape (k + 1, n).
    """
    n, segments, pi = points.shape[1], curve.shape[0] - 1, math.pi
    state, found, first, last = np.empty(n), np.zeros((waves, n)), points[0], points[points.shape[0] - 1]
    for i in range(1, _SAMPLES):
        u = i / _SAMPLES
        _on_polyline(points, lengths, u * lengths[-1], state)
        for k in range(waves):
            factor = 2.0 / _SAMPLES * math.sin((k + 1) * pi * u)
            for j in range(n):
                found[k, j] += factor * (state[j] - first[j] - u * (last[j] - first[j]))
    for i in range(segments + 1):
        u = i / segments
        for j in range(n):
            curve[i, j] = first[j] + u * (last[j] - first[j]) if i < segments else last[j]
        for k in range(waves if 0 < i < segments else 0):
            factor = scale * math.sin((k + 1) * pi * u)
            for j in range(n):
                curve[i, j] += factor * found[k, j]


@compiled("void(float64[::1], float64[:, ::1], float64[:, :, ::1])")
def power_basis(knots: Floats1, control: Floats2, coefficients: Floats3) -> None:
    """Write the polynomials of a cubic B-spline.

    On the piece from t_j to t_{j+1} the control points are the values of the polar form at three successive
    knots each, (t_{j-2}, t_{j-1}, t_j) and so on; interpolation in one argument at a time gives the values at
    (s, s, s), (s, s, e), (s, e, e) and (e, e, e), s and e the ends of the piece: its Bezier points.

    Source: L. Ramshaw, Blossoms are polar forms, Computer Aided Geometric Design 6, 1989.

    Args:
        knots: Knots t, shape (k + 7,).
        control: Control points, shape (k + 3, n).
        coefficients: Written: constant term first, shape (k, 4, n).
    """
    for j in range(coefficients.shape[0]):
        # t_{j-2} .. t_{j+3} of the docstring
        t0, t1, s, e, t4, t5 = (
            knots[j + 1], knots[j + 2], knots[j + 3], knots[j + 4], knots[j + 5], knots[j + 6]
        )  # fmt: skip
        width = e - s
        for i in range(control.shape[1]):
            p0, p1, p2, p3 = control[j, i], control[j + 1, i], control[j + 2, i], control[j + 3, i]
            across = (p2 - p1) / (t4 - t1)
            sse, see = p1 + (s - t1) * across, p1 + (e - t1) * across
            before = p0 + (s - t0) / (e - t0) * (p1 - p0)
            after = p2 + (e - s) / (t5 - s) * (p3 - p2)
            sss = before + (s - t1) / (e - t1) * (sse - before)
            eee = see + (e - s) / (t4 - s) * (after - see)
            first, second, third = (sse - sss) / width, (see - sse) / width, (eee - see) / width
            bend = (second - first) / width
            coefficients[j, 0, i], coefficients[j, 1, i] = sss, 3.0 * first
            coefficients[j, 2, i] = 3.0 * bend
            coefficients[j, 3, i] = ((third - second) / width - bend) / width


def _invalid_segments(validator: MotionValidator, curve: SmoothPath, which: BoolArray) -> BoolArray:
    """Return which of the chosen pieces contain an invalid state, shape (k,)."""
    widths = np.diff(curve.breaks)
    counts = np.maximum(2, np.ceil(widths / validator.resolution).astype(int))
    invalid = np.zeros(widths.size, dtype=bool)
    chosen = np.flatnonzero(which)
    s = [curve.breaks[i] + widths[i] * np.arange(counts[i] + 1) / counts[i] for i in chosen]
    owner = np.repeat(chosen, counts[chosen] + 1)
    # At most one step of rounding past the end, which evaluation tolerates.
    valid = validator.states_valid(curve(np.concatenate(s)))
    invalid[owner[~valid]] = True
    return invalid


def _refuse_straight(polyline: Path, abscissae: FloatArray, curve: SmoothPath, invalid: BoolArray) -> None:
    """Raise if a piece that runs along a straight edge is invalid: no refinement would change it."""
    edges = polyline.edge_index(abscissae)
    straight = edges[:-3] == edges[3:]
    for i in np.flatnonzero(invalid & straight):
        where = _show(curve(float(curve.breaks[i : i + 2].mean())))
        raise InfeasibleError("smooth path", f"the path itself is not valid near {where}", _ADVICE)


def _halved(breaks: FloatArray, invalid: BoolArray) -> tuple[FloatArray, BoolArray]:
    """Halve the invalid pieces and two neighbors on either side; also return which breaks are new."""
    halve = _dilated(invalid, 2)
    middles = 0.5 * (breaks[:-1] + breaks[1:])[halve]
    together = np.concatenate((breaks, middles))
    order = np.argsort(together)
    return together[order], (np.arange(together.size) >= breaks.size)[order]


def _dilated(mask: BoolArray, radius: int) -> BoolArray:
    """Return a mask that is also True up to `radius` entries to either side of a True entry."""
    wide = mask.copy()
    for shift in range(1, radius + 1):
        wide[shift:] |= mask[:-shift]
        wide[:-shift] |= mask[shift:]
    return wide


def _show(state: FloatArray) -> str:
    return np.array2string(state, precision=4, separator=", ")
