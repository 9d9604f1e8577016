"""The two passes of TOPP-RA over constraints that have been evaluated beforehand.

H. Pham and Q.-C. Pham, A new approach to time-optimal path parameterization based on reachability analysis,
IEEE Trans. Robotics 34, 2018.
"""

from __future__ import annotations

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.core.timing.tables import PathGrid, PathRows, ProfileSpace
from pepper_kin.kernels.compiled_function import compiled

_PARALLEL = 1e-12  # gain on u, relative to the gain on x, up to which a row does not bound u
_ROUNDING = 1e-12  # relative tolerance of bounds that meet


@compiled("int64(PathGrid, PathRows, ProfileSpace)", lean=True)
def fastest_profile(grid: PathGrid, rows: PathRows, space: ProfileSpace) -> int:
    """Find the maximum squared speed from `space.x[0]` at the start to rest at the end.

    With u = d2s/dt2 constant on each interval and x = (ds/dt)^2, the rows low <= a u + b x + c <= high hold
    at both ends of every interval, at the second with x + 2 D u in place of x, D the interval's length.  The
    backward pass finds the maximum and minimum x from which the end can be reached, the forward pass the
    maximum u.

    Each linear program has two variables.  For a given x the rows leave an interval of u, whose ends are a
    concave and a convex function of x; the maximum x is where they meet, and Newton's method finds it from
    the right in finitely many steps, for both are piecewise linear.

    Args:
        grid: The path.
        rows: The constraints.
        space: Workspace; x[0] is input, the other x are output.

    Returns:
        -1; or, if there is no profile, the grid point at which the search ended.
    """
    reset_profile(space)
    return repeat_passes(grid, rows, space)


@compiled(lean=True)
def reset_profile(space: ProfileSpace) -> None:
    """Reset the passes, so that only the squared speed at the start is kept."""
    for i in range(space.x.size):
        space.reach[i, 0] = space.reach[i, 1] = 0.0
    space.x[1:] = 0.0
    for i in range(space.changed.size):
        space.changed[i] = True


@compiled("int64(PathGrid, PathRows, ProfileSpace)", lean=True)
def repeat_passes(grid: PathGrid, rows: PathRows, space: ProfileSpace) -> int:
    """Run the passes where constraints have changed since the last call, and where the results change.

    Args:
        grid: The path.
        rows: The constraints.
        space: Workspace kept between calls; `changed` marks the intervals on which constraints, or bounds on
            x at their start, are new.

    Returns:
        -1, or the grid point at which the search ended, as for `fastest_profile`.
    """
    lines, span, reach, x = space.lines, space.span, space.reach, space.x
    size, last = grid.step.size, 2 * rows.low.shape[1]
    fresh = True  # whether the set from which the interval's end can be reached is new
    for i in range(size - 1, -1, -1):
        if not (space.changed[i] or fresh):
            continue
        if space.changed[i]:
            _write_lines(i, grid.step[i], grid.first[i], rows, lines, span)
        slope = 1 / (2 * grid.step[i])
        lines[i, 0, last], lines[i, 1, last] = reach[i + 1, 1] * slope, reach[i + 1, 0] * slope
        lines[i, 2, last] = slope
        from_x, to_x = span[i, 0], min(span[i, 1], rows.x_most[i])
        greatest = _extreme(lines, i, to_x, True)
        if not (greatest >= from_x - _ROUNDING * abs(from_x)):
            return i
        smallest = 0.0
        if from_x > 0.0 or reach[i + 1, 0] > 0.0 or not span[i, 2]:
            smallest = min(_extreme(lines, i, from_x, False), greatest)
        fresh = smallest != reach[i, 0] or greatest != reach[i, 1]
        reach[i, 0], reach[i, 1] = smallest, greatest
        space.changed[i] = True
    if not reach[0, 0] <= x[0] <= reach[0, 1]:
        return 0
    fresh = False
    for i in range(size):
        if not (space.changed[i] or fresh):
            continue
        u = _greatest_u(lines, i, x[i])
        ahead = min(max(x[i] + 2 * grid.step[i] * u, reach[i + 1, 0]), reach[i + 1, 1])
        if not x[i] + ahead > 0.0:
            return i
        fresh = ahead != x[i + 1]
        x[i + 1] = ahead
    return -1


@compiled(lean=True)
def _write_lines(i: int, step: float, node: int, rows: PathRows, lines: Array, span: Array) -> None:
    """Write every row of an interval as bottom - slope x <= u <= top - slope x; and its bounds on x.

    Args:
        i: Index of the interval.
        step: Length of the interval.
        node: First node of the interval.
        rows: The constraints.
        lines: Entry i is output, except for the last line, see `ProfileSpace`, shape (N, 3, 2 r + 1).
        span: Row i is output, see `ProfileSpace`, shape (N, 3).
    """
    count, flat, moves = rows.low.shape[1], 0, 0
    for end in range(2):
        at, twice, k = node + end, 2 * step * end, end * count
        for r in range(count):
            beta, offset = rows.b[at, r], rows.c[at, r]
            alpha = rows.a[at, r] + twice * beta
            flat += abs(alpha) <= _PARALLEL * step * abs(beta)
            inverse, up, down = 1 / alpha, rows.high[i, r] - offset, rows.low[i, r] - offset
            moves += (up < 0.0) | (down > 0.0)
            up, down = up * inverse, down * inverse
            lines[i, 0, k + r] = up if up > down else down
            lines[i, 1, k + r] = down if up > down else up
            lines[i, 2, k + r] = beta * inverse
    span[i, 0], span[i, 1], span[i, 2] = 0.0, np.inf, moves == 0
    if flat:
        _remove_rows_without_u(i, step, node, rows, lines, span)


@compiled(lean=True)
def _remove_rows_without_u(i: int, step: float, node: int, rows: PathRows, lines: Array, span: Array) -> None:
    """Convert interval i's rows without u from lines, shape (N, 3, 2 r + 1), to bounds on x, shape (N, 3)."""
    count = rows.low.shape[1]
    from_x, to_x = 0.0, np.inf
    for end in range(2):
        for r in range(count):
            beta, offset = rows.b[node + end, r], rows.c[node + end, r]
            alpha = rows.a[node + end, r] + 2 * step * end * beta
            if not abs(alpha) <= _PARALLEL * step * abs(beta):
                continue
            k = end * count + r
            lines[i, 0, k], lines[i, 1, k], lines[i, 2, k] = np.inf, -np.inf, 0.0
            up, down = rows.high[i, r] - offset, rows.low[i, r] - offset
            if beta > 0:
                to_x, from_x = min(to_x, up / beta), max(from_x, down / beta)
            elif beta < 0:
                to_x, from_x = min(to_x, down / beta), max(from_x, up / beta)
            elif up < 0 or down > 0:
                to_x = -np.inf
    span[i, 0], span[i, 1] = from_x, to_x


@compiled(lean=True)
def _extreme(lines: Array, i: int, x: float, greatest: bool) -> float:
    """Return the maximum x up to this one (or minimum from it) with a u within lines, shape (N, 3, k)."""
    last = lines.shape[2] - 1
    for _ in range(200):
        upper, lower = _greatest_u(lines, i, x), _least_u(lines, i, x)
        gap = lower - upper
        if gap <= _ROUNDING * (abs(lower) + abs(upper)):
            return x
        k = j = 0
        while k < last and lines[i, 0, k] - lines[i, 2, k] * x > upper:
            k += 1
        while j < last and lines[i, 1, j] - lines[i, 2, j] * x < lower:
            j += 1
        turn = lines[i, 2, k] - lines[i, 2, j]  # d gap / dx
        if (turn <= 0) if greatest else (turn >= 0):
            return np.nan
        meet = (lines[i, 0, k] - lines[i, 1, j]) / turn
        if (meet >= x) if greatest else (meet <= x):
            return x
        x = meet
    return x


@compiled(lean=True)
def _greatest_u(lines: Array, i: int, x: float) -> float:
    """Return the minimum of all upper bounds on u at x on interval i, from lines, shape (N, 3, k).

    Four bounds are compared at a time, so that they are vectorized.
    """
    p = q = r = s = np.inf
    count = lines.shape[2]
    whole = count // 4 * 4
    for k in range(0, whole, 4):
        value = lines[i, 0, k] - lines[i, 2, k] * x
        p = value if value < p else p
        value = lines[i, 0, k + 1] - lines[i, 2, k + 1] * x
        q = value if value < q else q
        value = lines[i, 0, k + 2] - lines[i, 2, k + 2] * x
        r = value if value < r else r
        value = lines[i, 0, k + 3] - lines[i, 2, k + 3] * x
        s = value if value < s else s
    for k in range(whole, count):
        value = lines[i, 0, k] - lines[i, 2, k] * x
        p = value if value < p else p
    p, r = q if q < p else p, s if s < r else r
    return r if r < p else p


@compiled(lean=True)
def _least_u(lines: Array, i: int, x: float) -> float:
    """Return the maximum of all lower bounds, from lines, shape (N, 3, k); see `_greatest_u`."""
    p = q = r = s = -np.inf
    count = lines.shape[2]
    whole = count // 4 * 4
    for k in range(0, whole, 4):
        value = lines[i, 1, k] - lines[i, 2, k] * x
        p = value if value > p else p
        value = lines[i, 1, k + 1] - lines[i, 2, k + 1] * x
        q = value if value > q else q
        value = lines[i, 1, k + 2] - lines[i, 2, k + 2] * x
        r = value if value > r else r
        value = lines[i, 1, k + 3] - lines[i, 2, k + 3] * x
        s = value if value > s else s
    for k in range(whole, count):
        value = lines[i, 1, k] - lines[i, 2, k] * x
        p = value if value > p else p
    p, r = q if q > p else p, s if s > r else r
    return r if r > p else p
