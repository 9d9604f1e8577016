"""Arrays of a motion's costs and constraints, and scratch space for their evaluation."""

from __future__ import annotations

from typing import NamedTuple

from pepper_kin.kernels.signatures import Floats1, Floats2, Floats3, Floats4, Ints1, Ints2

FIXED = 3
"""Number of control points at either end that start and goal fix."""
ORDERS = 3
"""Number of derivatives whose control points are bounded: velocity, acceleration, jerk."""

ADDRESS, MEMORY, SAMPLING, ROWS_COUNT, PARTS, WALL, FIRST, FLOORS = range(8)
"""Columns of `SplineTables.terms`."""
ABOVE_ZERO, WITHIN_ONE = 0, 1
CONSTRAINT = -1.0
"""Entry of `SplineTables.shares` for a term that is a constraint."""

SLOPE, CORNER, COST, WALLS, MU, SHARE, DAMPING, DURATION, FALL, STEP, QUIET, BEND = range(12)
"""Indices into `SplineWorkspace.numbers`: right-hand side and diagonal of the duration; cost and barrier;
weight mu of the barrier and its ratio to the cost; damping; the duration; predicted gain of the step, and the
step of the duration; number of last steps with hardly any gain; mu of the step before."""
NUMBERS = 12


class SplineTables(NamedTuple):
    """A motion of n coordinates; M intervals, degree p, C = M + p control points, T terms, S samplings.

    Attributes:
        basis: Weights of the p + 1 control points in position, velocity and acceleration by s at samples,
            shape (S, 3, K, p + 1).
        counts: Number of samples, and of samples in an interval, shape (S, 2).
        terms: Integers of the terms, see the columns above, shape (T, 8).
        shares: Weights of costs; CONSTRAINT for constraints, shape (T,).
        rates: Row i of the matrix from control points to control points of a derivative, from column i on,
            shape (ORDERS, C, ORDERS + 1).
        inverse_limits: Inverse limits of the derivatives, 0 for none, shape (ORDERS, n).
        box: Lower and upper limits of positions, and the width that counts as 1, shape (3, n).
        jerk: Matrix J of the jerk's integral c . J c, its lower band: J[i + d, i], shape (C, p + 1).
        jerk_weight: Weights of the squared jerks, shape (n,).
        time_weight: Weight of the duration, shape (1,).
    """

    basis: Floats4
    counts: Ints2
    terms: Ints2
    shares: Floats1
    rates: Floats3
    inverse_limits: Floats2
    box: Floats2
    jerk: Floats2
    jerk_weight: Floats1
    time_weight: Floats1


class SplineWorkspace(NamedTuple):
    """Scratch space of one search.

    Attributes:
        states: Positions, velocities and accelerations at samples, shape (S, 3 K n).
        results: Results of all terms, one after the other.
        slacks: Slacks of positions, two, and of rates, two each, shape (2 + 2 ORDERS, C, n).
        band: Matrix of the control points, see `banded`, shape (size n, (p + 1) n + PADDING), and some rows
            more, since whole tiles are added.
        right: Right-hand side of the control points, shape (size n,).
        border: Matrix column of the duration, shape (size n,).
        rows: Derivatives of a sample's values by an interval's control points, each padded by zeros to m
            numbers, the next multiple of a tile's columns, shape (R + 4, (p + 1) m); R is the number of rows
            of all terms.
        scaled: Entries of `rows`, each row times its curvature, shape (R + 4, (p + 1) m).
        shares: Factors of the rows: first derivatives of cost and barrier by the values; second derivatives
            times the values' derivatives by the duration; and scratch space, shape (3, R + 4 + m).
        sums: Matrices of four samples, shape (4, m, m).
        across: Solution for the border, shape (size n,).
        step: Step of the control points, shape (size n,).
        control: Control points, shape (C, n).
        trial: Control points that are tried, shape (C, n).
        numbers: Numbers of the search, see the indices above, shape (12,).
        clock: Scratch space of the clock, shape (2,).
    """

    states: Floats2
    results: Floats1
    slacks: Floats3
    band: Floats2
    right: Floats1
    border: Floats1
    rows: Floats2
    scaled: Floats2
    shares: Floats2
    sums: Floats3
    across: Floats1
    step: Floats1
    control: Floats2
    trial: Floats2
    numbers: Floats1
    clock: Ints1
