"""Tables of a path on its grid, its limits and the workspace of its timing; u = d2s/dt2, x = (ds/dt)^2."""

from __future__ import annotations

from typing import NamedTuple

from pepper_kin.kernels.signatures import Flags1, Floats1, Floats2, Floats3, Ints1


class PathGrid(NamedTuple):
    """A piecewise cubic path of n joints on a grid that keeps its breaks.

    Where two segments of the path meet there are two nodes, one for each segment.

    Attributes:
        step: Length of each interval, shape (N,).
        first: Index of the node at the start of each interval; the next node is its end, shape (N,).
        s: Path parameter at the grid points, shape (N + 1,).
        at: q [rad or m], q' and q'' at the nodes, shape (3, M, n).
        taylor: Taylor coefficients of the path at the start of each interval, shape (N, 4, n).
    """

    step: Floats1
    first: Ints1
    s: Floats1
    at: Floats3
    taylor: Floats3


class PathEffects(NamedTuple):
    """Limited quantities along a path other than joint velocities and accelerations.

    Attributes:
        torque: Torques at `grid.coefficient_states`, shape (3, M, n or 0) [N m or N].
        moments: Edge moments of the support polygon at the same states, shape (3, M, k) [N m].
        frame_speed: |dp/ds| of each limited frame over its limit at the nodes, shape (M, f).
        frame_middle: |dp/ds| over the limit in the middle of the intervals, shape (N, f).
    """

    torque: Floats3
    moments: Floats3
    frame_speed: Floats2
    frame_middle: Floats2


class PathLimits(NamedTuple):
    """Limits of a path's timing.

    Attributes:
        velocity: Velocity limits of the joints, shape (n,) [rad/s or m/s].
        acceleration: Acceleration limits of the joints, shape (n,) [rad/s^2 or m/s^2].
        torque: Torque limits of the joints, shape (n or 0,) [N m or N].
        x: Bound on x where nothing else bounds it.
    """

    velocity: Floats1
    acceleration: Floats1
    torque: Floats1
    x: float


class PathRows(NamedTuple):
    """Constraints low <= a u + b x + c <= high at both ends of each interval, and x <= x_most.

    The first n rows are accelerations, followed by torques and edge moments.

    Attributes:
        a: Gains on u at the nodes, shape (M, r).
        b: Gains on x at the nodes, shape (M, r).
        c: Values at rest, shape (M, r).
        middle: a, b and c in the middle of every interval, without accelerations, shape (3, N, r - n).
        low: Lower bounds by interval, shape (N, r).
        high: Upper bounds by interval, shape (N, r).
        x_most: Upper bounds on x at the grid points, finite, shape (N + 1,).
    """

    a: Floats2
    b: Floats2
    c: Floats2
    middle: Floats3
    low: Floats2
    high: Floats2
    x_most: Floats1


class ProfileSpace(NamedTuple):
    """Workspace of the passes, which keep results between calls, and the profiles found.

    Attributes:
        lines: Rows as bounds on u: upper, lower, and slope in x, shape (N, 3, 2 r + 1).
        span: Bounds on x from rows without u, and whether the path allows rest (1 or 0), shape (N, 3).
        reach: Minimum and maximum x from which the end can be reached, shape (N + 1, 2).
        changed: Whether an interval's bounds are new, shape (N,).
        x: Squared speed of the passes at the grid points, shape (N + 1,).
        best: Squared speed of the best of several passes, shape (N + 1,).
    """

    lines: Floats3
    span: Floats2
    reach: Floats2
    changed: Flags1
    x: Floats1
    best: Floats1


class Instants(NamedTuple):
    """Sample times of a motion along a path.

    Attributes:
        interval: Interval of the grid, shape (T,).
        local: Time since the start of the interval, in the motion before stretching [s], shape (T,).
    """

    interval: Ints1
    local: Floats1


class StateEffects(NamedTuple):
    """Limited quantities of some states.

    Attributes:
        torque: Torques, shape (T, n or 0) [N m or N].
        moments: Edge moments, at least 0 if the robot does not tip, shape (T, k) [N m].
        frame_speed: Ratio of each frame's speed to its limit, shape (T, f).
    """

    torque: Floats2
    moments: Floats2
    frame_speed: Floats2
