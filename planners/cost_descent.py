"""Descent of the integral of 1 + c(x) along a path, where c >= 0 is the price of being at x."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.core.clock import seconds_now
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2, Ints1

from .cbirrt import require_fit
from .constraint_manifold import (
    INNER,
    BoxedManifold,
    CompiledManifold,
    ConstraintManifold,
    OnSurface,
    edge_holds,
    evaluate,
    no_surface,
    project,
)
from .deadline import Deadline, load_code
from .motion_validator import machine_code_of
from .path import Path
from .problem import Problem
from .sampling import stream_key, uniform
from .search_space import ITERATIONS, STOP, SearchSpace, distance, edge_valid, space_of, step_count
from .vectors import FloatArray, finite_points, seed_number, whole_number

_FEWEST, _MOST = 24, 400  # minimum and maximum number of points
_SHARE_OF_STEP = 2.0  # distance of points relative to the resolution, without a manifold
_SHARE_ON_MANIFOLD = 0.5  # distance of points relative to the resolution, on a manifold
_LEAST_GAIN = 1e-4  # minimum gain of a shortcut, or of a useful step, relative to the integral
_WEAK_ROUNDS = 3  # number of successive rounds with little gain that ends the descent
_BLOCKS = 8  # steps per round of some coordinates of a part of the path
_ROUNDS = 5  # maximum number of trials of a step, each with more points that stay where it is invalid
_MOST_STAY = 0.5  # maximum fraction of the points that stay
_SPREAD = 10.0  # maximum power of two by which a part's damping exceeds the whole path's damping
_BESIDE = 2  # points to either side of an invalid edge that stay too
_SOFTER, _STIFFER, _STIFFEST = 0.3, 4.0, 1e8
_FIRST_DAMPING = 10.0  # initial damping times the square of the length
_USED = 0.5  # fraction of the tolerance left by projections from which a constraint counts as active
_UNEVEN = 3.0  # ratio of the longest to the mean edge at which points are spaced evenly again
_STREAM = 7
_DRAWS = 2  # random numbers of one shortcut
_STEP_DRAWS = 3  # random numbers of one step of a part

# Rows of `lines`.
_COST, _TRIAL_COST, _SPAN, _DIAGONAL, _STAYS, _ALONG = range(6)

# Indices into `memory`: state that is kept from one call to the next.
_TOTAL, _BEFORE, _DAMPING, _WHOLE_DAMPING, _LEAST, _STIFF, _WEAK = range(7)


@dataclass(frozen=True, eq=False)
class StateCost:
    """A price c(x) >= 0 of being at a state x, per unit of length, and its gradient.

    Attributes:
        function: A callable from states, shape (m, n), to c, shape (m, 1), and its gradient, shape (m, 1, n);
            or machine code that writes c and its gradient.  Negative values count as 0, NaN as infinite.
        n: Number of coordinates of a state.
    """

    function: Callable[[FloatArray], tuple[ArrayLike, ArrayLike]] | CompiledManifold
    n: int

    def __post_init__(self) -> None:
        """Check the fields.

        Raises:
            InvalidValueError: The function is not callable, or the number of coordinates is not a positive
                integer.
        """
        object.__setattr__(self, "n", self.manifold.n)

    @property
    def manifold(self) -> ConstraintManifold:
        """The function as a manifold of one residual, for machine code."""
        return ConstraintManifold(self.function, self.n, 1)

    def at(self, states: ArrayLike) -> FloatArray:
        """Return c at states, shape (m, n); shape (m,).

        Raises:
            InvalidValueError: The states or the results of the function have the wrong shape.
        """
        rows, wide = np.array(finite_points("states", states, self.n)), np.full(self.n, math.inf)
        found = np.empty(len(rows))
        with OnSurface(self.manifold, -wide, wide, np.ones(self.n)) as surface:
            measure_costs(surface, rows, len(rows), found)
        return found

    def along(self, path: Path) -> float:
        """Return the integral of 1 + c along a polyline, by the trapezoidal rule between its points."""
        price = 1.0 + self.at(path.points)
        return float(np.sum(np.diff(path.arc_lengths) * (price[1:] + price[:-1]) / 2))


class Band(NamedTuple):
    """A polyline of N points, and scratch space.

    Attributes:
        points: The points, shape (N, n).
        trial: Points that are tried, shape (N, n).
        step: Steps of the points, shape (N, n).
        gradient: Gradient of c at the points, in scaled coordinates, shape (N, n).
        lines: Values per point, see the rows above, shape (6, N).
        rows: Scratch space for states, shape (4, n).
        memory: State of the descent, see the indices above, shape (7,).
        chosen: Whether a step moves a coordinate, shape (n,).
        counters: Counters of the planner, see `search_space.STATES`.
    """

    points: Floats2
    trial: Floats2
    step: Floats2
    gradient: Floats2
    lines: Floats2
    rows: Floats2
    memory: Floats1
    chosen: Floats1
    counters: Ints1


def descend_cost(
    problem: Problem,
    cost: StateCost,
    path: Path,
    *,
    manifold: ConstraintManifold | None = None,
    seed: int = 0,
    shortcuts: int = 100,
    iterations: int = 200,
    timeout: float = 1.0,
) -> Path:
    """Lower the integral of 1 + c(x) along a path; the ends stay, and c = 0 leaves the length alone.

    The path is resampled at equal distances.  First, straight edges between random pairs of points replace
    the path between them where that costs less.  Then all points move at once by damped Gauss-Newton
    steps: with x the states in the scaled coordinates of the metric, edges of length l_k and price
    w_k = 1 + mean of c at their ends, the gradient across the path is

        g_k = h_k grad c(x_k) + w_{k-1} u_{k-1} - w_k u_k,   u_k the direction of edge k, h_k mean of its l,

    and the step -(A + mu H)^-1 g, where A is the second difference with w_k / l_k and H = diag(h).  The step
    spreads a local gradient over the path, like CHOMP's (N. Ratliff, M. Zucker, J. A. Bagnell and
    S. Srinivasa, ICRA 2009), and is Newton's step for the length.  mu grows where a step does not lower the
    integral.  On a manifold the gradient is taken along it, and a projection follows each step.
    Points whose edges would not be valid stay, and the others move without them; in between, random parts of
    the path are moved in random coordinates, which leads along obstacles.  The method is local: the path
    passes an obstacle on the same side as the initial path.

    Args:
        problem: Supplies box, validity, metric and resolution; its start and goals are not used.
        cost: The price.
        path: A valid path of the problem's coordinates; with a manifold, a path of `cbirrt`.
        manifold: Constraints that every point meets; None for none.
        seed: Seed of the shortcuts; the same seed gives the same path unless time runs out.
        shortcuts: Number of attempts of shortcuts.
        iterations: Maximum number of steps.
        timeout: Time budget [s].

    Returns:
        A path whose integral is lower, of points at nearly equal distances; the path given if no better one
        is found.  On a manifold its waypoints are no further apart than the resolution.

    Raises:
        InvalidValueError: The path, cost or manifold has another number of coordinates than the problem, or
            an option is not allowed.
    """
    load_code(shorten_by_cost, descend, measure_costs)
    problem.require_same("path", path.n)
    problem.require_same("cost", cost.n)
    if manifold is not None:
        require_fit(problem, manifold)
    seed, shortcuts = seed_number(seed), whole_number("shortcuts", shortcuts)
    iterations, deadline = whole_number("iterations", iterations), Deadline(timeout)
    if path.length == 0.0:
        return path
    apart = problem.spacing * (_SHARE_OF_STEP if manifold is None else _SHARE_ON_MANIFOLD)
    count = min(max(_FEWEST, math.ceil(path.length / apart)), _MOST)
    band = _band(path(np.linspace(0.0, path.length, count + 1)))
    box = problem.lower, problem.upper, problem.metric.weights
    with ExitStack() as stack:
        code = stack.enter_context(machine_code_of(problem, deadline, counters=band.counters))
        space = space_of(problem, code, problem.spacing)
        price = stack.enter_context(OnSurface(cost.manifold, *box))
        surface = no_surface(*box) if manifold is None else stack.enter_context(OnSurface(manifold, *box))
        before = start_band(space, price, surface, band)
        if not math.isfinite(before):
            return path
        key = stream_key(seed, _STREAM)
        for work, most in ((shorten_by_cost, shortcuts), (descend, iterations)):
            band.counters[ITERATIONS] = 0
            while not (deadline.expired or price.stop[0] or surface.stop[0] or band.counters[STOP]):
                if work(space, price, surface, band, deadline.time_slice, key, most):
                    break
    found = Path.trusted(band.points.copy(), problem.metric)
    return found if cost.along(found) < cost.along(_even(path, count)) else path


def _even(path: Path, count: int) -> Path:
    """Return the polyline with points at equal distances besides its own."""
    places = np.union1d(path.arc_lengths, np.linspace(0.0, path.length, count + 1))
    return Path.trusted(path(places), path.metric)


def _band(points: FloatArray) -> Band:
    """Return a band of points, shape (N, n), with new scratch space."""
    count, n = points.shape
    trial, step, gradient = np.zeros((3, count, n))
    lines, rows, memory = np.zeros((6, count)), np.zeros((4, n)), np.zeros(7)
    counters = np.zeros(ITERATIONS + 1, dtype=np.int64)
    return Band(
        np.ascontiguousarray(points), trial, step, gradient, lines, rows, memory, np.ones(n), counters
    )


@compiled("float64(BoxedManifold, float64[::1])")
def price_at(cost: BoxedManifold, state: Floats1) -> float:
    """Return c at a state; its gradient is left in `cost.out`."""
    evaluate(cost, state)
    found = cost.out[0]
    if math.isnan(found):
        return math.inf
    return max(found, 0.0)


@compiled("void(BoxedManifold, float64[:, ::1], int64, float64[::1])")
def measure_costs(cost: BoxedManifold, states: Floats2, count: int, found: Floats1) -> None:
    """Write c at the first `count` of states of shape (m, n)."""
    for k in range(count):
        found[k] = price_at(cost, states[k])


@compiled
def _total(points: FloatArray, costs: FloatArray, weights: FloatArray) -> float:
    """Return the integral of 1 + c along a polyline, by the trapezoidal rule."""
    total = 0.0
    for k in range(points.shape[0] - 1):
        total += distance(points[k], points[k + 1], weights) * (1.0 + 0.5 * (costs[k] + costs[k + 1]))
    return total


@compiled
def _edge_good(space: SearchSpace, surface: BoxedManifold, band: Band, a: FloatArray, b: FloatArray) -> bool:
    """Return whether an edge from a valid state on the manifold to another is valid and on the manifold."""
    length = distance(a, b, space.weights)
    if surface.norms.size > 0 and (length > space.resolution or not edge_holds(surface, a, b)):
        return False
    return edge_valid(space, a, b, step_count(length, space.resolution), band.rows, band.counters, False)


@compiled
def _moved_onto(surface: BoxedManifold, state: FloatArray) -> bool:
    """Move a state onto the manifold in place; return whether it is on it."""
    return surface.norms.size == 0 or project(surface, state, INNER)


@compiled("float64(SearchSpace, BoxedManifold, BoxedManifold, Band)")
def start_band(space: SearchSpace, cost: BoxedManifold, surface: BoxedManifold, band: Band) -> float:
    """Move the points of a band onto the manifold; return its integral, infinite where it is not valid."""
    points, last = band.points, band.points.shape[0] - 1
    for k in range(1, last):
        if not _moved_onto(surface, points[k]):
            return math.inf
    if surface.norms.size > 0:
        for k in range(last):
            if not _edge_good(space, surface, band, points[k], points[k + 1]):
                return math.inf
    measure_costs(cost, points, last + 1, band.lines[_COST])
    return _total(points, band.lines[_COST], space.weights)


@compiled("boolean(SearchSpace, BoxedManifold, BoxedManifold, Band, float64, uint64, int64)")
def shorten_by_cost(
    space: SearchSpace,
    cost: BoxedManifold,
    surface: BoxedManifold,
    band: Band,
    seconds: float,
    key: np.uint64,
    attempts: int,
) -> bool:
    """Replace parts of a band by straight edges that cost less; see `descend_cost`.

    Args:
        space: Box, metric and validity.
        cost: The price.
        surface: The manifold; one without constraints for none.
        band: The polyline.
        seconds: Time budget [s].
        key: Key of the stream of random numbers.
        attempts: Number of attempts in all, earlier calls included.

    Returns:
        Whether all attempts have been made.
    """
    points, trial, lines, counters = band.points, band.trial, band.lines, band.counters
    place, count, n = np.empty(2, np.int64), points.shape[0], points.shape[1]
    end, memory = seconds_now(space.clock, place) + seconds, band.memory
    if counters[ITERATIONS] == 0:
        memory[_TOTAL] = _total(points, lines[_COST], space.weights)
    while counters[ITERATIONS] < attempts:
        if counters[STOP] != 0 or cost.stop[0] != 0 or seconds_now(space.clock, place) >= end:
            return False
        number = counters[ITERATIONS] * _DRAWS
        counters[ITERATIONS] += 1
        i, j = int(uniform(key, number) * count), int(uniform(key, number + 1) * count)
        i, j = min(i, j), max(i, j)
        if counters[ITERATIONS] == 1:
            i, j = 0, count - 1
        if j - i < 2:
            continue
        size, good = j - i + 1, True
        for k in range(i, j + 1):
            for c in range(n):
                trial[k, c] = points[i, c] + (points[j, c] - points[i, c]) * (k - i) / (j - i)
            if k == j:
                for c in range(n):
                    trial[k, c] = points[j, c]
            elif k > i and good:
                good = _moved_onto(surface, trial[k])
        if not good:
            continue
        measure_costs(cost, trial[i : j + 1], size, lines[_TRIAL_COST, i : j + 1])
        new = _total(trial[i : j + 1], lines[_TRIAL_COST, i : j + 1], space.weights)
        old = _total(points[i : j + 1], lines[_COST, i : j + 1], space.weights)
        if not new < old - _LEAST_GAIN * memory[_TOTAL]:
            continue
        k = i
        while k < j and _edge_good(space, surface, band, trial[k], trial[k + 1]):
            k += 1
        if k == j:
            memory[_TOTAL] += new - old
            _take(band, i, j + 1)
    return True


@compiled
def _take(band: Band, first: int, end: int) -> None:
    """Replace the points from `first` up to `end` by the trial points."""
    for k in range(first, end):
        band.lines[_COST, k] = band.lines[_TRIAL_COST, k]
        for c in range(band.points.shape[1]):
            band.points[k, c] = band.trial[k, c]


@compiled("boolean(SearchSpace, BoxedManifold, BoxedManifold, Band, float64, uint64, int64)")
def descend(
    space: SearchSpace,
    cost: BoxedManifold,
    surface: BoxedManifold,
    band: Band,
    seconds: float,
    key: np.uint64,
    iterations: int,
) -> bool:
    """Move all points of a band by damped Gauss-Newton steps; see `descend_cost`.

    Args:
        space: Box, metric and validity.
        cost: The price.
        surface: The manifold; one without constraints for none.
        band: The polyline.
        seconds: Time budget [s].
        key: Key of the stream of random numbers.
        iterations: Maximum number of steps in all, earlier calls included.

    Returns:
        Whether the descent has ended.
    """
    points, lines, counters, place = band.points, band.lines, band.counters, np.empty(2, np.int64)
    end, memory = seconds_now(space.clock, place) + seconds, band.memory
    if counters[ITERATIONS] == 0:
        length = 0.0
        for k in range(points.shape[0] - 1):
            length += distance(points[k], points[k + 1], space.weights)
        memory[_TOTAL] = memory[_BEFORE] = _total(points, lines[_COST], space.weights)
        memory[_WEAK], memory[_WHOLE_DAMPING] = 0.0, _FIRST_DAMPING * memory[_TOTAL] / length**3
        memory[_LEAST] = memory[_WHOLE_DAMPING] / _STIFFEST
        memory[_STIFF] = memory[_WHOLE_DAMPING] * _STIFFEST
    while counters[ITERATIONS] < iterations and memory[_WEAK] < _WEAK_ROUNDS:
        if counters[STOP] != 0 or cost.stop[0] != 0 or surface.stop[0] != 0:
            return False
        if seconds_now(space.clock, place) >= end:
            return False
        number, last = counters[ITERATIONS], points.shape[0] - 1
        whole, low, high, rounds = number % (_BLOCKS + 1) == 0, 0, last, _ROUNDS
        counters[ITERATIONS] += 1
        memory[_DAMPING] = memory[_WHOLE_DAMPING]
        if not whole:
            first = number * (_STEP_DRAWS + points.shape[1])
            low, high = int(uniform(key, first) * last), int(uniform(key, first + 1) * last) + 1
            low, high, rounds = min(low, high - 1), max(low + 2, high), 1
            memory[_DAMPING] *= 2.0 ** (_SPREAD * uniform(key, first + 2))
        for c in range(points.shape[1]):
            drawn = 0.0 if whole else uniform(key, number * (_STEP_DRAWS + points.shape[1]) + 3 + c)
            band.chosen[c] = 1.0 if drawn < 0.5 else 0.0
        _linearize(space, cost, surface, band, low, min(high, last))
        new = _stepped(space, cost, surface, band, low, min(high, last), rounds)
        if new < memory[_TOTAL]:
            _take(band, 1, last)
            memory[_TOTAL] = _evened(space, cost, surface, band, new)
        if whole:
            softer = new < math.inf
            memory[_WHOLE_DAMPING] *= _SOFTER if softer else _STIFFER
            memory[_WHOLE_DAMPING] = min(max(memory[_WHOLE_DAMPING], memory[_LEAST]), memory[_STIFF])
        elif number % (_BLOCKS + 1) == _BLOCKS:
            small = memory[_TOTAL] > (1.0 - _LEAST_GAIN) * memory[_BEFORE]
            memory[_WEAK] = memory[_WEAK] + 1.0 if small else 0.0
            memory[_BEFORE] = memory[_TOTAL]
    return True


@compiled
def _linearize(
    space: SearchSpace, cost: BoxedManifold, surface: BoxedManifold, band: Band, low: int, high: int
) -> None:
    """Write lengths of edges, and the gradient of the integral across the path in scaled coordinates.

    The gradient is written for the points between `low` and `high`.
    """
    points, lines, gradient, weights = band.points, band.lines, band.gradient, space.weights
    last, n = points.shape[0] - 1, points.shape[1]
    for k in range(last):
        lines[_SPAN, k] = max(distance(points[k], points[k + 1], weights), 1e-12)
    for k in range(low + 1, high):
        before, after = lines[_SPAN, k - 1], lines[_SPAN, k]
        price_before = 1.0 + 0.5 * (lines[_COST, k - 1] + lines[_COST, k])
        price_after = 1.0 + 0.5 * (lines[_COST, k] + lines[_COST, k + 1])
        positive = price_at(cost, points[k]) > 0.0
        along = square = 0.0
        for c in range(n):
            slope = cost.out[1 + cost.columns[c]] / weights[c] if positive else 0.0
            to, on = points[k, c] - points[k - 1, c], points[k + 1, c] - points[k, c]
            pull = (price_before * to / before - price_after * on / after) * weights[c]
            gradient[k, c] = 0.5 * (before + after) * slope + pull
            tangent = (to + on) * weights[c]
            along += gradient[k, c] * tangent
            square += tangent * tangent
        for c in range(n):
            tangent = (points[k + 1, c] - points[k - 1, c]) * weights[c]
            gradient[k, c] = (gradient[k, c] - along / max(square, 1e-24) * tangent) * band.chosen[c]
        if surface.norms.size > 0:
            _keep_along(surface, points[k], gradient[k], space.resolution)


@compiled
def _keep_along(surface: BoxedManifold, state: FloatArray, gradient: FloatArray, resolution: float) -> None:
    """Remove from a gradient in scaled coordinates the components that lead off the manifold.

    A constraint whose tolerance is used up within a step is an equation: all its rows are removed.  A wider
    constraint counts where much of its tolerance is used, and where the descent would use more.
    """
    evaluate(surface, state)
    rows, n, kept, r = surface.slopes, gradient.size, 0, surface.groups.size
    for g in range(surface.norms.size):
        steepest = 0.0
        for k in range(r):
            if surface.groups[k] == g:
                square = 0.0
                for c in range(n):
                    slope = surface.out[r + k * surface.width + surface.columns[c]] / surface.weights[c]
                    square += slope * slope
                steepest = max(steepest, math.sqrt(square))
        if surface.tolerances[g] < steepest * resolution:
            for k in range(r):
                if surface.groups[k] == g:
                    for c in range(n):
                        slope = surface.out[r + k * surface.width + surface.columns[c]]
                        rows[kept, c] = slope / surface.weights[c]
                    kept += _independent(rows, kept)
        elif surface.norms[g] > _USED * INNER * surface.tolerances[g]:
            outward = 0.0
            for c in range(n):
                rows[kept, c] = 0.0
                for k in range(r):
                    if surface.groups[k] == g:
                        slope = surface.out[r + k * surface.width + surface.columns[c]]
                        rows[kept, c] += surface.out[k] * slope / surface.weights[c]
                outward -= rows[kept, c] * gradient[c]
            kept += _independent(rows, kept) if outward > 0.0 else 0
    for k in range(kept):
        along = 0.0
        for c in range(n):
            along += rows[k, c] * gradient[c]
        for c in range(n):
            gradient[c] -= along * rows[k, c]


@compiled
def _independent(rows: FloatArray, count: int) -> int:
    """Make a row orthonormal to the rows before it; return 1, or 0 if it depends on them linearly."""
    n, before, square = rows.shape[1], 0.0, 0.0
    for c in range(n):
        before += rows[count, c] * rows[count, c]
    for k in range(count):
        along = 0.0
        for c in range(n):
            along += rows[k, c] * rows[count, c]
        for c in range(n):
            rows[count, c] -= along * rows[k, c]
    for c in range(n):
        square += rows[count, c] * rows[count, c]
    if not square > 1e-12 * before:
        return 0
    for c in range(n):
        rows[count, c] /= math.sqrt(square)
    return 1


@compiled
def _stepped(
    space: SearchSpace,
    cost: BoxedManifold,
    surface: BoxedManifold,
    band: Band,
    low: int,
    high: int,
    rounds: int,
) -> float:
    """Try a step of the points between `low` and `high`; points at invalid edges stay in further trials.

    Returns the new integral; infinite if it is not lower, or the step is not valid.
    """
    points, trial, lines, last = band.points, band.trial, band.lines, band.points.shape[0] - 1
    for k in range(last + 1):
        lines[_STAYS, k] = 0.0 if low < k < high else 1.0
        lines[_TRIAL_COST, k] = lines[_COST, k]
        for c in range(points.shape[1]):
            trial[k, c] = points[k, c]
    for _ in range(rounds):
        _solve(band, band.memory[_DAMPING])
        for k in range(low + 1, high):
            for c in range(points.shape[1]):
                moved = points[k, c] + band.step[k, c] / space.weights[c]
                most = space.lower[c] + space.extent[c]
                trial[k, c] = min(max(moved, space.lower[c]), most)
            if lines[_STAYS, k] == 0.0 and not _moved_onto(surface, trial[k]):
                _let_stay(lines, k, last)
        for k in range(low + 1, high):
            lines[_TRIAL_COST, k] = price_at(cost, trial[k]) if lines[_STAYS, k] == 0.0 else lines[_COST, k]
        new = _total(trial, lines[_TRIAL_COST], space.weights)
        if not new < band.memory[_TOTAL]:
            return math.inf
        valid, stay = True, 0
        for k in range(last):
            # An edge between points that stay is as valid as it was.
            if lines[_STAYS, k] != 0.0 and lines[_STAYS, k + 1] != 0.0:
                continue
            if not _edge_good(space, surface, band, trial[k], trial[k + 1]):
                valid = False
                _let_stay(lines, k, last)
                _let_stay(lines, k + 1, last)
        if valid:
            return new
        for k in range(low + 1, high):
            stay += 1 if lines[_STAYS, k] != 0.0 else 0
        if stay > _MOST_STAY * (high - low):
            return math.inf
    return math.inf


@compiled
def _let_stay(lines: FloatArray, k: int, last: int) -> None:
    """Mark a point and its neighbors as points that stay."""
    for j in range(max(k - _BESIDE, 0), min(k + _BESIDE, last) + 1):
        lines[_STAYS, j] = 1.0


@compiled
def _solve(band: Band, damping: float) -> None:
    """Write the step d, (A + mu H) d = -g, of the points that do not stay, by Thomas's algorithm."""
    lines, gradient, step = band.lines, band.gradient, band.step
    last, n = step.shape[0] - 1, step.shape[1]
    for c in range(n):
        step[0, c] = step[last, c] = 0.0
    factor = 0.0
    for k in range(1, last):
        before, after = lines[_SPAN, k - 1], lines[_SPAN, k]
        left = (1.0 + 0.5 * (lines[_COST, k - 1] + lines[_COST, k])) / before
        right = (1.0 + 0.5 * (lines[_COST, k] + lines[_COST, k + 1])) / after
        if lines[_STAYS, k] != 0.0:
            lines[_ALONG, k], factor = 0.0, 0.0
            for c in range(n):
                step[k, c] = 0.0
            continue
        free = 1.0 if k > 1 and lines[_STAYS, k - 1] == 0.0 else 0.0
        factor = left * free
        pivot = left + right + damping * 0.5 * (before + after) - factor * lines[_ALONG, k - 1] * free
        lines[_ALONG, k] = right / pivot
        for c in range(n):
            step[k, c] = (-gradient[k, c] + factor * step[k - 1, c]) / pivot
    for k in range(last - 2, 0, -1):
        for c in range(n):
            step[k, c] += lines[_ALONG, k] * step[k + 1, c]


@compiled
def _evened(
    space: SearchSpace, cost: BoxedManifold, surface: BoxedManifold, band: Band, total: float
) -> float:
    """Space the points evenly again where they have become uneven; return the integral."""
    points, trial, lines, last = band.points, band.trial, band.lines, band.points.shape[0] - 1
    length = widest = 0.0
    for k in range(last):
        lines[_SPAN, k] = distance(points[k], points[k + 1], space.weights)
        length, widest = length + lines[_SPAN, k], max(widest, lines[_SPAN, k])
    if widest * last < _UNEVEN * length:
        return total
    edge, begin = 0, 0.0
    for k in range(1, last):
        wanted = length * k / last
        while edge < last - 1 and begin + lines[_SPAN, edge] < wanted:
            begin += lines[_SPAN, edge]
            edge += 1
        share = min((wanted - begin) / max(lines[_SPAN, edge], 1e-12), 1.0)
        for c in range(points.shape[1]):
            trial[k, c] = points[edge, c] + share * (points[edge + 1, c] - points[edge, c])
        if not _moved_onto(surface, trial[k]):
            return total
    for c in range(points.shape[1]):
        trial[0, c], trial[last, c] = points[0, c], points[last, c]
    for k in range(last):
        if not _edge_good(space, surface, band, trial[k], trial[k + 1]):
            return total
    measure_costs(cost, trial, last + 1, lines[_TRIAL_COST])
    new = _total(trial, lines[_TRIAL_COST], space.weights)
    if not math.isfinite(new):
        return total
    _take(band, 1, last)
    return new
