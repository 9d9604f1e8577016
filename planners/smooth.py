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
    knots = np.concatenate((breaks[:1].repeat(3), breaks, breaks[-1:].repeat(3)))
    abscissae = np.clip((knots[1:-3] + knots[2:-2] + knots[3:-1]) / 3.0, 0.0, polyline.length)
    abscissae[-1] = polyline.length
    coefficients = _power_basis(knots, polyline(abscissae))
    return SmoothPath(breaks, coefficients, polyline.points[-1]), abscissae


def _power_basis(knots: FloatArray, control: FloatArray) -> FloatArray:
    """Return the polynomials of a cubic B-spline, shape (k, 4, n); knots (k + 7,), control points (k + 3, n).

    On the piece from t_j to t_{j+1} the control points are the values of the polar form at three successive
    knots each, (t_{j-2}, t_{j-1}, t_j) and so on; interpolation in one argument at a time gives those at
    (s, s, s), (s, s, e), (s, e, e) and (e, e, e), s and e the ends of the piece: its Bezier points.

    Source: L. Ramshaw, Blossoms are polar forms, Computer Aided Geometric Design 6, 1989.
    """
    count = len(control) - 3
    t = [knots[1 + i : 1 + i + count, None] for i in range(6)]  # t_{j-2} .. t_{j+3}
    p = [control[i : i + count] for i in range(4)]
    s, e = t[2], t[3]
    across = (p[2] - p[1]) / (t[4] - t[1])
    sse, see = p[1] + (s - t[1]) * across, p[1] + (e - t[1]) * across
    before = p[0] + (s - t[0]) / (e - t[0]) * (p[1] - p[0])
    after = p[2] + (e - s) / (t[5] - s) * (p[3] - p[2])
    sss = before + (s - t[1]) / (e - t[1]) * (sse - before)
    eee = see + (e - s) / (t[4] - s) * (after - see)
    width = e - s
    first, second, third = (sse - sss) / width, (see - sse) / width, (eee - see) / width
    bend = (second - first) / width
    cubic = ((third - second) / width - bend) / width
    return np.stack((sss, 3.0 * first, 3.0 * bend, cubic), axis=1)


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
    wide = mask.copy()
    for shift in range(1, radius + 1):
        wide[shift:] |= mask[:-shift]
        wide[:-shift] |= mask[shift:]
    return wide


def _show(state: FloatArray) -> str:
    return np.array2string(state, precision=4, separator=", ")
