"""Collision checks of states and curves of one motion, with steps that grow with the clearance."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.core.collision.check import set_margins
from pepper_kin.core.collision.gjk import FREE, TIE
from pepper_kin.core.collision.joint_ranges import curve_keeps_ranges
from pepper_kin.core.collision.layout import (
    ALLOWANCES,
    LEVERS,
    STATES_AT_ONCE,
    head_of,
    section,
)
from pepper_kin.core.collision.records import HEAD
from pepper_kin.core.kernel_batch import evaluate_batch
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.intrinsics import call_four
from pepper_kin.kernels.signatures import Floats1, Floats2, Floats3, Ints1

LONGEST, SHORTER = 0.008, 4
"""Maximum distance that a point of the body moves between states of a curve at which margins are kept [m],
and the factor by which each further step is shorter."""
FIRST = SHORTER * LONGEST
"""Step of the first pass, in which margins are proven to be kept between the states as well [m]."""
SHORTEST = LONGEST / SHORTER**2
"""Half a millimeter [m]: the step at which other curves are checked."""
FINEST = SHORTEST / SHORTER**2
"""Minimum step [m], for states that pass something nearer than half of `SHORTEST`: nothing can penetrate
deeper than half of this step between two states."""

SPARSE = 8
"""Stride of the first pass over the states, since obstacles are mostly wider than one step."""


class MotionCheck(NamedTuple):
    """Checks of the states of one motion: whether they are collision-free and can be held still.

    Attributes:
        verdicts: Address of `check.row_verdicts`; 0: all states are decided by `ask`.
        ask: Address of `int64 ask(const double* states, int64 count, int64* verdicts, const double*
            margins)`, which replaces each TIE among the verdicts by FREE or CONTACT, and returns 0.
            Without states it returns whether bodies that never move are nearer to the world than the margins.
        load: Address of `batch` of the kernel from a configuration and the masses to the holding torques
            and, if there are edges, the floor's force along z and its moments about x and y.
        quick: Whether ties count as near where only the distance that allows longer steps is tested.
        least: Margin to the scene below which bodies that never move need no check [m].
        radius: Radius that converts margins to angles, see `check.set_margins` [m].
        still: Block that compares bodies that stand still, shape (s,).
        moving: Block that compares bodies that move, shape (t,).
        standing: Positions of the joints that do not move, shape (n,) [rad or m].
        effort: Maximum torque or force of each joint while holding still, shape (n,) [N m or N].
        masses: Masses of the payload [kg], shape (m,).
        edges: Factors of the floor's force and moments, for each edge that the robot could tip over; no sum
            of the products may be negative, shape (k, 3).
        heads: Heads of the tables of dependent joint ranges, see `joint_ranges`, shape (HEAD t,).
        tables: Rows of the tables of dependent joint ranges, shape (r,).
        held_step: Maximum distance that a point of the body moves between states that are to be held [m].
        states: Workspace, shape (STATES_AT_ONCE, n).
        inputs: Workspace, shape (STATES_AT_ONCE, n + m).
        torques: Workspace, shape (STATES_AT_ONCE, n), or (STATES_AT_ONCE, n + 3) if there are edges.
        answers: Workspace, shape (STATES_AT_ONCE,).
        margins: Workspace, shape (2,).
        work: Workspace of the kernel, shape (>= work_size,).
        words: Workspace, shape (8,).
    """

    verdicts: int
    ask: int
    load: int
    quick: bool
    least: float
    radius: float
    still: Floats1
    moving: Floats1
    standing: Floats1
    effort: Floats1
    masses: Floats1
    edges: Floats2
    heads: Floats1
    tables: Floats1
    held_step: float
    states: Floats2
    inputs: Floats2
    torques: Floats2
    answers: Ints1
    margins: Floats1
    work: Floats1
    words: Ints1


class Intervals(NamedTuple):
    """Intervals of a piecewise polynomial curve.

    Attributes:
        segment: Segment of each interval, shape (N,).
        begin: Parameter at the start of each interval, from the segment's first break, shape (N,).
        width: Width of each interval, shape (N,).
    """

    segment: Ints1
    begin: Floats1
    width: Floats1


@compiled
def _ask(check: MotionCheck, states: Array, count: int, verdicts: np.ndarray) -> None:
    """Call `ask` to decide the ties among verdicts, if there are any.

    Args:
        check: Checks of the states of one motion.
        states: Configurations, shape (>= count, n) [rad or m].
        count: Number of states.
        verdicts: FREE, CONTACT or TIE of each, shape (>= count,); ties are overwritten.
    """
    for i in range(count):
        if verdicts[i] == TIE:
            margins = check.margins.ctypes.data
            call_four(check.ask, states.ctypes.data, count, verdicts.ctypes.data, margins)
            return


@compiled
def blocked(check: MotionCheck, margin: float, self_margin: float) -> bool:
    """Return whether something that does not move is nearer than margins [m], which are stored.

    Where machine code leaves a TIE, coal decides on all of `standing`.
    """
    check.margins[0], check.margins[1] = margin, self_margin
    if check.verdicts == 0:
        return False
    set_margins(check.still, margin, self_margin, check.radius)
    set_margins(check.moving, margin, self_margin, check.radius)
    answers = check.answers.ctypes.data
    if margin >= check.least and call_four(check.ask, 0, 0, answers, check.margins.ctypes.data) != 0:
        return True
    call_four(check.verdicts, check.still.ctypes.data, check.standing.ctypes.data, 1, answers)
    if check.answers[0] == TIE:
        call_four(check.ask, check.standing.ctypes.data, 1, answers, check.margins.ctypes.data)
    return check.answers[0] != FREE


@compiled
def _check_states(check: MotionCheck, states: Array, count: int, margins: tuple[float, float]) -> None:
    """Write the verdicts on states at given margins into `answers`.

    Args:
        check: Checks of the states of one motion.
        states: The states, shape (>= count, n) [rad or m].
        count: Number of states, STATES_AT_ONCE at most.
        margins: Margins to the scene and to the robot itself [m].
    """
    answers = check.answers
    check.margins[0], check.margins[1] = margins
    if check.verdicts != 0:
        set_margins(check.moving, margins[0], margins[1], check.radius)
        call_four(check.verdicts, check.moving.ctypes.data, states.ctypes.data, count, answers.ctypes.data)
    else:
        for i in range(count):
            answers[i] = TIE
    _ask(check, states, count, answers)


@compiled
def _check_far(
    check: MotionCheck, count: int, kept: tuple[float, float], allowances: Array, farther: float
) -> None:
    """Write the verdicts on the first `states` at increased margins into `answers`; quick checks leave ties.

    Args:
        check: Checks of the states of one motion.
        count: Number of states, STATES_AT_ONCE at most.
        kept: Margins to the scene and to the robot itself [m].
        allowances: Additional margin of each class of pairs, then each group, shape (c,) [m].
        farther: Additional margin of all pairs where coal decides [m].
    """
    answers, states = check.answers, check.states.ctypes.data
    check.margins[0], check.margins[1] = kept[0] + farther, kept[1] + farther
    if check.verdicts != 0:
        set_margins(check.moving, kept[0], kept[1], check.radius)
        section(check.moving, ALLOWANCES)[:] = allowances
        call_four(check.verdicts, check.moving.ctypes.data, states, count, answers.ctypes.data)
    else:
        for i in range(count):
            answers[i] = TIE
    if not check.quick:
        _ask(check, check.states, count, answers)


@compiled
def _write_loads(check: MotionCheck, count: int) -> None:
    """Write into `torques` the holding torques of the first configurations in `states`."""
    inputs, n = check.inputs, check.effort.size
    for k in range(count):
        for j in range(n):
            inputs[k, j] = check.states[k, j]
        for j in range(check.masses.size):
            inputs[k, n + j] = check.masses[j]
    evaluate_batch(check.load, inputs[:count], inputs, inputs, check.torques[:count], check.work, check.words)


@compiled
def _least_moment(check: MotionCheck, k: int) -> float:
    """Return the minimum moment of the floor about an edge [N m], at a configuration whose loads are written.

    It is the robot's weight times the distance of the center of mass from the edge; infinite without edges.
    """
    least, n = math.inf, check.effort.size
    for e in range(check.edges.shape[0]):
        moment = 0.0
        for j in range(check.edges.shape[1]):
            moment += check.edges[e, j] * check.torques[k, n + j]
        least = min(least, moment) if moment == moment else -math.inf
    return least


@compiled
def _held(check: MotionCheck, count: int) -> bool:
    """Return whether the first configurations in `states` can be held still without tipping over."""
    _write_loads(check, count)
    for k in range(count):
        for j in range(check.effort.size):
            if not abs(check.torques[k, j]) <= check.effort[j]:
                return False
        if not _least_moment(check, k) >= 0.0:
            return False
    return True


@compiled
def _kept_ends(check: MotionCheck, ends: Array, margin: float, self_margin: float) -> int:
    """Return how many states, shape (m, n) [rad or m], keep margins [m]; 0 if the first state does not."""
    if blocked(check, margin, self_margin):
        return 0
    found = 0
    for first in range(0, ends.shape[0], STATES_AT_ONCE):
        count = min(STATES_AT_ONCE, ends.shape[0] - first)
        _check_states(check, ends[first:], count, (margin, self_margin))
        if first == 0 and check.answers[0] != FREE:
            return 0
        for i in range(count):
            found += 1 if check.answers[i] == FREE else 0
    return found


@compiled("void(MotionCheck, float64[:, ::1], float64, float64, float64[::1])")
def kept_margins(check: MotionCheck, ends: Floats2, margin: float, least: float, kept: Floats1) -> None:
    """Write the margins that the ends of a motion allow, to the scene and to the robot itself [m].

    Each margin is halved until the start and a goal keep it; the margin to the robot itself is then halved
    once more if it was reduced, since joints near one another have to move.

    Args:
        check: Checks of the states of one motion.
        ends: The start, then goals, shape (1 + m, n) [rad or m].
        margin: Requested margin [m].
        least: Margin up to which a margin counts as zero [m].
        kept: Output: margins to the scene and to the robot itself, shape (2,).
    """
    own = scene = margin
    while own > least and _kept_ends(check, ends, 0.0, own) < 2:
        own /= 2.0
    own = 0.0 if own <= least else own if own == margin else own / 2.0
    while scene > least and _kept_ends(check, ends, scene, own) < 2:
        scene /= 2.0
    kept[0], kept[1] = 0.0 if scene <= least else scene, own


@compiled("boolean(MotionCheck, float64[:, ::1], float64, float64, float64[::1])")
def sound_ends(check: MotionCheck, ends: Floats2, margin: float, least: float, kept: Floats1) -> bool:
    """Return whether all ends of a motion are collision-free and can be held; if so, write their margins.

    Arguments, shapes and units are those of `kept_margins`.
    """
    for first in range(0, ends.shape[0], STATES_AT_ONCE):
        count = min(STATES_AT_ONCE, ends.shape[0] - first)
        for k in range(count):
            for j in range(ends.shape[1]):
                check.states[k, j] = ends[first + k, j]
        if not _held(check, count):
            return False
    kept[0] = kept[1] = margin
    if margin > least and _kept_ends(check, ends, margin, margin) == ends.shape[0]:
        return True
    if _kept_ends(check, ends, 0.0, 0.0) < ends.shape[0]:
        return False
    kept_margins(check, ends, margin, least, kept)
    return True


@compiled(inline=True, lean=True)
def _greatest_rate(coefficients: Array, i: int, j: int, h: float) -> float:
    """Return the maximum |dq_j/ds| of the control values on segment i, of length h; curve: shape (m, 4, n).

    It bounds the derivative, a quadratic Bezier curve.
    """
    first, second, third = coefficients[i, 1, j], coefficients[i, 2, j], coefficients[i, 3, j]
    middle = first + second * h
    last = middle + (second + 3.0 * third * h) * h
    return max(abs(first), abs(middle), abs(last))


@compiled("int64(float64[::1], float64[:, :, ::1], float64[::1], float64, int64[::1])")
def count_intervals(
    breaks: Floats1, coefficients: Floats3, reach: Floats1, step: float, counts: Ints1
) -> int:
    """Write the number of intervals of each segment; return their sum.

    In no interval does a point of the body move farther than the step: a point moves at most
    sum_j reach_j |dq_j|.

    Args:
        breaks: Ends of the segments, shape (m + 1,).
        coefficients: Constant term first, shape (m, 4, n).
        reach: Motion bound of each joint, shape (n,) [m/rad, or 1].
        step: Maximum distance in an interval [m].
        counts: Output: number of intervals of each segment, shape (m,).
    """
    total = 0
    for i in range(coefficients.shape[0]):
        h, speed = breaks[i + 1] - breaks[i], 0.0
        for j in range(reach.size):
            speed += reach[j] * _greatest_rate(coefficients, i, j, h)
        counts[i] = max(1, math.ceil(h * speed / step))
        total += counts[i]
    return total


@compiled("void(float64[::1], int64[::1], Intervals)")
def write_intervals(breaks: Floats1, counts: Ints1, parts: Intervals) -> None:
    """Write equal intervals of each segment; counts have shape (m,), breaks shape (m + 1,)."""
    place = 0
    for i in range(counts.size):
        h = (breaks[i + 1] - breaks[i]) / counts[i]
        for k in range(counts[i]):
            parts.segment[place], parts.begin[place], parts.width[place] = i, k * h, h
            place += 1


@compiled
def _write_middle(coefficients: Array, i: int, x: float, state: Array) -> None:
    """Write the state, shape (n,), of a curve, shape (m, 4, n), at parameter x of segment i [rad or m]."""
    for j in range(state.size):
        value = coefficients[i, 2, j] + x * coefficients[i, 3, j]
        state[j] = coefficients[i, 0, j] + x * (coefficients[i, 1, j] + x * value)


@compiled
def _pair_motions(check: MotionCheck, breaks: Array, coefficients: Array, counts: np.ndarray) -> Array:
    """Return how far pair classes, then groups, move at most in half an interval, shape (c,) [m].

    Args:
        check: Checks of the states of one motion.
        breaks: Ends of the segments, shape (m + 1,).
        coefficients: Constant term first, shape (m, 4, n) [rad or m].
        counts: Number of intervals of each segment, see `count_intervals`, shape (m,).
    """
    n, most = coefficients.shape[2], np.zeros(0)
    if check.verdicts == 0:
        return most
    levers, shifts = section(check.moving, LEVERS), np.empty(n)
    most = np.zeros(section(check.moving, ALLOWANCES).size)
    for i in range(counts.size):
        h = breaks[i + 1] - breaks[i]
        for j in range(n):
            shifts[j] = 0.5 * h / counts[i] * _greatest_rate(coefficients, i, j, h)
        for c in range(most.size):
            shift = 0.0
            for j in range(n):
                shift += levers[n * c + j] * shifts[j] if shifts[j] > 0.0 else 0.0
            most[c] = max(most[c], shift)
    for c in range(most.size):
        most[c] = min(most[c], 0.5 * FIRST)
    return most


@compiled
def _near_ones(
    check: MotionCheck,
    coefficients: Array,
    parts: Intervals,
    kept: tuple[float, float],
    step: float,
    strictly: bool,
    motions: Array,
) -> int:
    """Move the intervals that have to be divided to the front; return their number, or -1 on a collision.

    Args:
        check: Checks of the states of one motion.
        coefficients: Coefficients of the curve, constant term first, shape (m, 4, n) [rad or m].
        parts: The intervals.
        kept: Margins to the scene and to itself that all midpoints have to keep [m].
        step: Maximum distance that a point of the body moves in an interval [m].
        strictly: Whether the margin to the scene must hold in all of an interval.
        motions: Result of `_pair_motions` for a step of FIRST, shape (c,) [m].
    """
    last, classes = step <= FINEST, HEAD.classes(head_of(check.moving)) if motions.size else 0
    allowances = motions * (step / FIRST)
    for c in range(motions.size if step <= LONGEST else 0):
        if c < classes or not strictly:
            allowances[c] = max(0.0, allowances[c] - kept[0 if c >= classes else 1])
    if strictly and last:
        kept = kept[0] + 0.5 * step, kept[1]
    states, answers, near = check.states, check.answers, 0
    for first in range(0, parts.segment.size, STATES_AT_ONCE):
        count = left = min(STATES_AT_ONCE, parts.segment.size - first)
        for k in range(count):
            place = first + k
            middle = parts.begin[place] + 0.5 * parts.width[place]
            _write_middle(coefficients, parts.segment[place], middle, states[k])
        if not last:
            _check_far(check, count, kept, allowances, 0.5 * step)
            left = 0
            for k in range(count):
                if answers[k] != FREE:
                    for j in range(states.shape[1]):
                        states[left, j] = states[k, j]
                    _copy_interval(parts, first + k, parts, near + left)
                    left += 1
        if left > 0:
            _check_states(check, states, left, kept)
            for k in range(left):
                if answers[k] != FREE:
                    return -1
        near += 0 if last else left
    return near


@compiled
def _copy_interval(source: Intervals, k: int, target: Intervals, place: int) -> None:
    """Copy an interval to index `place` of a target, which may be the source."""
    target.segment[place], target.begin[place] = source.segment[k], source.begin[k]
    target.width[place] = source.width[k]


@compiled
def _sparse_first(parts: Intervals) -> Intervals:
    """Return the intervals reordered, every `SPARSE`th one before all others."""
    count, place = parts.segment.size, 0
    ordered = Intervals(np.empty(count, np.int64), np.empty(count), np.empty(count))
    for k in range(SPARSE // 2, count, SPARSE):
        _copy_interval(parts, k, ordered, place)
        place += 1
    for k in range(count):
        if k % SPARSE != SPARSE // 2:
            _copy_interval(parts, k, ordered, place)
            place += 1
    return ordered


@compiled
def _held_along(check: MotionCheck, breaks: Array, coefficients: Array, reach: Array) -> bool:
    """Return whether the robot can hold still, without tipping over, all along a curve.

    Args:
        check: Checks of the states of one motion.
        breaks: Ends of the segments, shape (m + 1,).
        coefficients: Constant term first, shape (m, 4, n) [rad or m].
        reach: Motion bound of each joint, shape (n,) [m/rad, or 1].
    """
    counts = np.empty(coefficients.shape[0], np.int64)
    count_intervals(breaks, coefficients, reach, check.held_step, counts)
    waiting = 0
    for i in range(counts.size):
        h = (breaks[i + 1] - breaks[i]) / counts[i]
        for k in range(counts[i]):
            _write_middle(coefficients, i, (k + 0.5) * h, check.states[waiting])
            waiting += 1
            if waiting == STATES_AT_ONCE:
                if not _held(check, waiting):
                    return False
                waiting = 0
    return waiting == 0 or _held(check, waiting)


@compiled(
    "boolean(MotionCheck, float64[::1], float64[:, :, ::1], float64[::1], float64, float64, boolean, boolean)"
)
def is_clear(
    check: MotionCheck,
    breaks: Floats1,
    coefficients: Floats3,
    reach: Floats1,
    margin: float,
    self_margin: float,
    held: bool,
    strictly: bool,
) -> bool:
    """Return whether margins are kept, and gravity can be held, along a piecewise cubic curve.

    The curve is divided into intervals in which no point of the body moves farther than FIRST.  If the state
    in the middle of an interval keeps the margins plus the distance that each pair of bodies moves in half of
    the interval, the margins are kept in all of it.  Other intervals are divided into shorter ones, whose
    midpoints have to keep the margins, and distances at which nothing collides in the whole interval; and
    so on, down to FINEST, where midpoints need to keep the margins only.  Dependent joint ranges are kept at
    every point.

    Args:
        check: Checks of the states of one motion.
        breaks: Ends of the segments, shape (m + 1,).
        coefficients: Constant term first, shape (m, 4, n) [rad or m].
        reach: Motion bound of each joint, shape (n,) [m/rad, or 1].
        margin: Margin to the scene [m].
        self_margin: Margin to the robot itself [m].
        held: Whether the joints have to be able to hold still along the curve.
        strictly: Whether the margin to the scene is proven at every point, also between the examined states.
    """
    if blocked(check, margin, self_margin):
        return False
    if not curve_keeps_ranges(check.heads, check.tables, breaks, coefficients):
        return False
    counts, step = np.empty(coefficients.shape[0], np.int64), FIRST if check.verdicts != 0 else LONGEST
    total = count_intervals(breaks, coefficients, reach, step, counts)
    motions = _pair_motions(check, breaks, coefficients, counts)
    parts = Intervals(np.empty(total, np.int64), np.empty(total), np.empty(total))
    write_intervals(breaks, counts, parts)
    parts = _sparse_first(parts)
    near = _near_ones(check, coefficients, parts, (margin, self_margin), step, strictly, motions)
    while near > 0:
        step /= SHORTER
        cut = Intervals(
            np.empty(SHORTER * near, np.int64), np.empty(SHORTER * near), np.empty(SHORTER * near)
        )
        for k in range(SHORTER * near):
            source = k // SHORTER
            width = parts.width[source] / SHORTER
            cut.segment[k], cut.width[k] = parts.segment[source], width
            cut.begin[k] = parts.begin[source] + width * (k % SHORTER)
        parts = cut
        near = _near_ones(check, coefficients, parts, (margin, self_margin), step, strictly, motions)
    return near == 0 and (not held or _held_along(check, breaks, coefficients, reach))
