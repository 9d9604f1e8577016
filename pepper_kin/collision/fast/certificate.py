"""Proof that a whole straight line of configurations is collision-free, not only samples of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.collision.dependent_ranges import DependentRange

DEEPEST = 14
"""Maximum number of halvings in the search for a proof."""
MOST = 4096
"""Maximum number of intervals of a line that may be without proof at a time."""


def certified(
    bounds_of: Callable[[Array], Array],
    ranges: Sequence[DependentRange],
    range_margin: float,
    motion_bounds: Array,
    margins: Array,
    a: Array,
    b: Array,
) -> bool:
    """Return whether q(t) = a + (b - a) t is proven free for all t in [0, 1].

    Part p of the robot keeps a distance of at least B_p(q) from the bodies it is compared with.  In an
    interval of length h around its middle m, that distance changes by at most h / 2 * L_p with
    L_p = sum_j bound_pj |b_j - a_j|, so that B_p(q(m)) - margin_p > h / 2 * L_p for all p proves the
    interval. Intervals without proof are halved.  If some B_p at a middle is not above its margin, the search
    ends: halving does not help there.

    Args:
        bounds_of: Function from configurations (m, n) to lower bounds (m, parts) [m].
        ranges: Dependent joint ranges, which are checked exactly.
        range_margin: Angle by which the ranges are narrowed [rad].
        motion_bounds: Motion bounds, shape (parts, n) [m/rad, or 1].
        margins: Margins, shape (parts,) [m].
        a: Start of the line, shape (n,) [rad or m].
        b: End of the line, shape (n,) [rad or m].
    """
    if any(leaves_range(table, range_margin, a, b) for table in ranges):
        return False
    change = np.abs(b - a)
    moving = change > 0
    motion = motion_bounds[:, moving] @ change[moving]
    if not np.isfinite(motion).all():
        return False
    starts, length = np.zeros(1), 1.0
    for _ in range(DEEPEST):
        middles = starts + length / 2
        slack = bounds_of(a + (b - a) * middles[:, None]) - margins
        if not (slack > 0).all():
            return False
        open_segments = ~(slack > motion * length / 2).all(axis=1)
        if not open_segments.any():
            return True
        left = starts[open_segments]
        length /= 2
        starts = np.concatenate([left, left + length])
        if starts.size > MOST:
            return False
    return False


def leaves_range(table: DependentRange, margin: float, a: Array, b: Array) -> bool:
    """Return whether a straight line leaves a dependent range anywhere.

    Between two rows of the table the bounds are constant and the line is straight, so that checking its ends
    there suffices.  The result is exact except for lines that run along a row of the table, for which the
    narrower of both sides applies.

    Args:
        table: The dependent range.
        margin: Angle that the second joint keeps from a contact [rad].
        a: Joint positions at the line's start [rad or m], shape (n,).
        b: Joint positions at the line's end [rad or m], shape (n,).
    """
    x0, x1, y0, y1 = a[table.first], b[table.first], a[table.second], b[table.second]
    if table.violated(np.array([a, b]), margin).any():
        return True
    if x0 > x1:
        x0, x1, y0, y1 = x1, x0, y1, y0
    edges = np.concatenate([[-np.inf], table.positions, [np.inf]])
    lower = np.concatenate([table.lower[:1], table.lower, table.lower[-1:]])
    upper = np.concatenate([table.upper[:1], table.upper, table.upper[-1:]])
    first = max(int(np.searchsorted(edges, x0, side="right")) - 1, 0)
    last = min(int(np.searchsorted(edges, x1, side="left")) - 1, len(edges) - 2)
    for k in range(first, last + 1):
        low, high = max(lower[k], lower[k + 1]) + margin, min(upper[k], upper[k + 1]) - margin
        slope = (y1 - y0) / (x1 - x0) if x1 > x0 else 0.0
        ends = (y0, y1)
        if x1 > x0:
            ends = tuple(y0 + slope * (min(max(edge, x0), x1) - x0) for edge in (edges[k], edges[k + 1]))
        if min(ends) < low or max(ends) > high:
            return True
    return False
