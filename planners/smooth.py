"""Rounding of a polyline into a curve with continuous curvature that stays valid."""

from __future__ import annotations

import numpy as np

from pepper_kin.exceptions import InfeasibleError, InvalidValueError

from .oracle import Oracle
from .path import Path
from .problem import Problem
from .smooth_path import SmoothPath
from .vectors import BoolArray, FloatArray, positive_number

_ROUNDS = 20  # halvings of the spacing before giving up: a millionth of it
_COARSE = 10.0  # first spacing of breaks, in units of the problem's resolution
_FEWEST = 4  # pieces
_MERGE = 1e-9  # of the box's diagonal
_ADVICE = "plan and short-cut again at a finer resolution, or let the oracle keep a margin"


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

    All pieces are checked by the oracle, at their ends, their middles and as often as the resolution asks;
    around a piece that is not valid the knots t are halved, which pulls the curve to the polyline, until
    all pieces are valid.

    The path must itself be valid where the curve is checked.  A path that grazes obstacles may fail that by
    the width of a sliver, since its edges were checked at other states; so let the oracle of the planning
    problem keep a larger margin than the oracle of the problem given here.

    Source: I. J. Schoenberg, On spline functions, 1967; C. de Boor, A practical guide to splines, 2001,
    chapter XI.

    Args:
        problem: Supplies the oracle, the metric and the resolution; its start and goals are not used.
        path: A valid path of the problem's coordinates, longer than zero.  Where it turns back on itself
            exactly, the curve's speed passes through zero.
        spacing: Distance of breaks to begin with [length unit of the metric]; larger is rounder.  Ten times
            the problem's resolution if omitted; at least four pieces are made.
        resolution: Greatest distance between checked states of the curve [length unit of the metric]; the
            problem's if omitted.

    Returns:
        The curve; its parameter runs from 0 to the polyline's length.

    Raises:
        InvalidValueError: The path has another number of coordinates or no length, or an option is not
            allowed.
        InfeasibleError: The path itself is not valid at this resolution, or has no room at all at a corner.
    """
    if path.n != problem.n:
        raise InvalidValueError(
            "path", f"{path.n} coordinates", f"{problem.n} coordinates, as in the problem"
        )
    polyline = Path(path.points, problem.weights).merged(_MERGE * problem.diagonal)
    if len(polyline) < 2:
        raise InvalidValueError("path", f"length {path.length:g}", "a path whose way-points differ")
    oracle = problem.counting_oracle(resolution=resolution)
    if spacing is None:
        spacing = _COARSE * problem.counting_oracle().resolution
    pieces = max(_FEWEST, int(np.ceil(polyline.length / positive_number("spacing", spacing))))
    breaks = np.linspace(0.0, polyline.length, pieces + 1)
    return _refine_until_valid(oracle, polyline, breaks)


def _refine_until_valid(oracle: Oracle, polyline: Path, breaks: FloatArray) -> SmoothPath:
    is_new = np.ones(breaks.size, dtype=bool)
    worst = polyline.points[0]
    for _ in range(_ROUNDS):
        curve, abscissae = _schoenberg_spline(polyline, breaks)
        # A piece depends on the three breaks to either side of it at most; only those can have changed it.
        invalid = _invalid_pieces(oracle, curve, _dilated(is_new, 3)[:-1])
        if not invalid.any():
            return curve
        _refuse_straight(polyline, abscissae, curve, invalid)
        worst = curve(float(breaks[int(np.argmax(invalid))]))
        breaks, is_new = _halved(breaks, invalid)
    raise InfeasibleError("smooth path", f"the path has no room to turn near {_show(worst)}", _ADVICE)


def _schoenberg_spline(polyline: Path, breaks: FloatArray) -> tuple[SmoothPath, FloatArray]:
    from scipy.interpolate import BSpline  # takes a third of a second to import, so only here

    knots = np.concatenate((breaks[:1].repeat(3), breaks, breaks[-1:].repeat(3)))
    abscissae = np.clip((knots[1:-3] + knots[2:-2] + knots[3:-1]) / 3.0, 0.0, polyline.length)
    abscissae[-1] = polyline.length
    spline = BSpline(knots, polyline(abscissae), 3)
    factorials = (1.0, 1.0, 2.0, 6.0)
    powers = [
        spline.derivative(p)(breaks[:-1]) / factorials[p] if p else spline(breaks[:-1]) for p in range(4)
    ]
    powers[0][0] = polyline.points[0]  # which the spline's evaluation misses by a rounding
    return SmoothPath(breaks, np.stack(powers, axis=1), polyline.points[-1]), abscissae


def _invalid_pieces(oracle: Oracle, curve: SmoothPath, asked: BoolArray) -> BoolArray:
    """Return which of the pieces asked about hold an invalid state, shape (k,)."""
    widths = np.diff(curve.breaks)
    counts = np.maximum(2, np.ceil(widths / oracle.resolution).astype(int))
    invalid = np.zeros(widths.size, dtype=bool)
    chosen = np.flatnonzero(asked)
    s = [curve.breaks[i] + widths[i] * np.arange(counts[i] + 1) / counts[i] for i in chosen]
    owner = np.repeat(chosen, counts[chosen] + 1)
    # At most one step of rounding past the end, which evaluation tolerates.
    valid = oracle.states_valid(curve(np.concatenate(s)))
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
    """Halve the invalid pieces and two neighbours on either side; also return which breaks are new."""
    halve = _dilated(invalid, 2)
    middles = 0.5 * (breaks[:-1] + breaks[1:])[halve]
    together = np.concatenate((breaks, middles))
    order = np.argsort(together)
    return together[order], (np.arange(together.size) >= breaks.size)[order]


def _dilated(mask: BoolArray, radius: int) -> BoolArray:
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(mask, radius), 2 * radius + 1)
    return np.any(windows, axis=1)


def _show(state: FloatArray) -> str:
    return np.array2string(state, precision=4, separator=", ")
