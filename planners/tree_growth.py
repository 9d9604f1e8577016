"""The two trees of RRT-Connect and the machine code that plants and grows them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pepper_kin.core.clock import seconds_now
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2, Ints1

from .deadline import TIME_SLICE
from .sampling import random_state, uniform, within_ellipsoid
from .search_space import (
    ITERATIONS,
    STOP,
    SearchSpace,
    distance,
    edge_valid,
    last_valid_step,
    measure,
    step_count,
)
from .tree import (
    BY_EDGE,
    FOUND,
    FULL,
    GOAL_NODE,
    GOAL_SIZE,
    GOING_ON,
    OWN_COUNTERS,
    OWN_ROWS,
    SAMPLE,
    START_NODE,
    START_SIZE,
    TARGET,
    TIME_UP,
    Trees,
    add_node,
    nearest_node,
    nearest_within,
    room,
    scale,
    trace,
    way_point_count,
)
from .vectors import FloatArray

_UNEVEN = 1.0  # relative difference of the trees' sizes from which only the smaller one grows
# Radius of a node's domain in diagonals of the box: first, minimum, and relative change.
_FIRST_RADIUS, _LEAST_RADIUS, _RADIUS_CHANGE = 0.36, 0.07, 1e-4
_CLOCK_EVERY = 64  # number of goals or samples between two readings of the clock
ROUND = 16_384  # number of samples of the shortest round
# Width of the first region in straight lines, and ratio of diagonals, region to box, below which a region is
# searched before the box.
WIDTH, SMALL = 2.0, 0.5
_TRIES = 8  # attempts to draw a useful sample inside the box

START_INVALID = FULL + 1
"""Status of a call whose start is invalid, in addition to the statuses of growth."""

# Indices into `counters`, after the indices common to all trees.
GROWING, DRAWN = OWN_COUNTERS, OWN_COUNTERS + 1
WAY_POINTS, GOAL = DRAWN + 1, DRAWN + 2  # number of waypoints that `first_round` wrote, and the path's goal
TRIED, GREW = GOAL + 1, GOAL + 3  # numbers of samples and of extensions, two entries each, one per tree
MOMENT = GREW + 2  # two numbers of the clock

# Rows of `rows`, after the rows common to all trees; SHIFTED has two.
ORIGIN, SHIFTED = OWN_ROWS, OWN_ROWS + 1

# Indices into `values`: maximum distance of samples to which a node is extended, and length of the path from
# its root [length unit of the metric].
RADIUS, COST = 0, 1

# Indices into `numbers`: upper bound on the path's length, infinite for none; and the length of the paths
# through the samples that are drawn, infinite for samples of the whole box of the space, which contains all
# paths below the bound.
BOUND, WITHIN = 0, 1


@compiled("float64(float64[:, ::1], float64[::1])", lean=True)
def diagonal_of(region: Floats2, weights: Floats1) -> float:
    """Return the length of the diagonal of a box, given by its bounds, shape (2, n)."""
    return distance(region[0], region[1], weights)


@compiled(lean=True)
def _diagonal(space: SearchSpace) -> float:
    """Return the length of the diagonal of the space's box."""
    total = 0.0
    for i in range(space.extent.size):
        total += (space.extent[i] * space.weights[i]) ** 2
    return math.sqrt(total)


@compiled(lean=True)
def _add(space: SearchSpace, trees: Trees, side: int, parent: int, state: FloatArray) -> int:
    """Add a node to a tree; return its index."""
    cost, costs = 0.0, trees.values[COST, side]
    if parent >= 0:
        cost = costs[parent] + distance(trees.states[side, parent], state, space.weights)
    node = add_node(space, trees, side, parent, state)
    trees.values[RADIUS, side, node], costs[node] = math.inf, cost
    return node


@compiled(lean=True)
def _nearest(space: SearchSpace, trees: Trees, side: int, state: FloatArray, bound: float) -> int:
    """Return the nearest node through which a state is reached below a cost; -1 for none."""
    if bound == math.inf:
        return nearest_node(space, trees, side, state)
    scale(space, trees, state)
    costs, size = trees.values[COST, side], trees.counters[START_SIZE + side]
    return nearest_within(trees.lanes[side], costs, size, trees.scaled, bound, trees.squares)


@compiled(lean=True)
def _from_root(space: SearchSpace, trees: Trees, side: int, state: FloatArray) -> float:
    """Return the distance of a state from the nearest root of a tree."""
    least, node, parents = math.inf, 0, trees.parents[side]
    while node < trees.counters[START_SIZE + side] and parents[node] < 0:
        least = min(least, distance(trees.states[side, node], state, space.weights))
        node += 1
    return least


@compiled(lean=True)
def _draw(space: SearchSpace, trees: Trees, key: np.uint64) -> None:
    """Write a sample into rows[SAMPLE]: of the box, or of its states on paths that may be short enough."""
    counters, sample, within = trees.counters, trees.rows[SAMPLE], trees.numbers[WITHIN]
    n = sample.size
    if within < math.inf:
        roots = 0
        while roots < counters[GOAL_SIZE] and trees.parents[1, roots] < 0:
            roots += 1
        for _ in range(_TRIES):
            goal = trees.states[1, int(uniform(key, counters[DRAWN]) * roots)]
            start, offset = trees.states[0, 0], trees.rows[ORIGIN]
            inside = within_ellipsoid(space, key, counters[DRAWN] + 1, start, goal, within, offset, sample)
            counters[DRAWN] += 2 * n + 2
            if inside:
                return
    counters[DRAWN] += random_state(space, key, counters[DRAWN], sample)


@compiled(lean=True)
def _interruption(space: SearchSpace, trees: Trees, end: float, spare: int) -> int:
    """Return TIME_UP, FULL if there may be no space for the nodes of one more iteration, or GOING_ON."""
    counters = trees.counters
    late = counters[ITERATIONS] % _CLOCK_EVERY == 0 and seconds_now(space.clock, counters[MOMENT:]) >= end
    if late or counters[STOP] != 0:
        return TIME_UP
    return FULL if room(trees) < spare else GOING_ON


@compiled(lean=True)
def _choose_tree(counters: Ints1) -> int:
    """Return the tree that grows next: the trees take turns, unless the other one is twice as large."""
    side = counters[GROWING]
    own, other = counters[START_SIZE + side], counters[GOAL_SIZE - side]
    if abs(own - other) < _UNEVEN * own:
        side = counters[GROWING] = 1 - side
    return side


@compiled(lean=True)
def _choose_node(space: SearchSpace, trees: Trees, side: int, sample: FloatArray, key: np.uint64) -> int:
    """Return the node of a tree nearest to a sample, -1 if the sample is outside the node's domain.

    If paths have to be short, only nodes count that lead to the sample below a cost drawn between the minimum
    possible and the maximum of use.
    """
    allowed, bound = math.inf, trees.numbers[BOUND]
    if bound < math.inf:
        before, after = _from_root(space, trees, side, sample), _from_root(space, trees, 1 - side, sample)
        if before + after >= bound:
            return -1
        allowed = before + (bound - before - after) * uniform(key, trees.counters[DRAWN])
        trees.counters[DRAWN] += 1
    near = _nearest(space, trees, side, sample, allowed)
    if near < 0 or trees.values[RADIUS, side, near] < math.sqrt(trees.squares[0]):
        return -1
    return near


@compiled(lean=True)
def _step_towards(
    space: SearchSpace, origin: FloatArray, sample: FloatArray, state: FloatArray, counters: Ints1
) -> bool:
    """Write the state one step from a node towards a sample; return whether the edge to it is valid."""
    apart, reach = distance(origin, sample, space.weights), space.reach
    share = 1.0 if apart < reach else reach / apart
    for i in range(state.size):
        state[i] = origin[i] + (sample[i] - origin[i]) * share
    steps = step_count(apart * share, space.resolution)
    return last_valid_step(space, origin, state, steps, counters) == steps


@compiled(lean=True)
def _adapt_domain(radii: FloatArray, node: int, extended: bool, diagonal: float) -> None:
    """Enlarge the ball of samples to which a node is extended, or shrink it after a failed extension."""
    if extended:
        radii[node] *= 1.0 + _RADIUS_CHANGE
    elif radii[node] == math.inf:
        radii[node] = _FIRST_RADIUS * diagonal
    else:
        radii[node] = max(radii[node] * (1.0 - _RADIUS_CHANGE), _LEAST_RADIUS * diagonal)


@compiled(lean=True)
def _better_parent(space: SearchSpace, trees: Trees, side: int, near: int, key: np.uint64) -> int:
    """Return the parent of the state in rows[TARGET]: `near`, or one of lower cost for short paths."""
    if trees.numbers[BOUND] == math.inf:
        return near
    state, counters = trees.rows[TARGET], trees.counters
    least = _from_root(space, trees, side, state)
    cost = trees.values[COST, side, near] + distance(trees.states[side, near], state, space.weights)
    while True:
        allowed = least + (cost - least) * uniform(key, counters[DRAWN])
        counters[DRAWN] += 1
        other = _nearest(space, trees, side, state, allowed)
        if other < 0 or other == near:
            return near
        origin = trees.states[side, other]
        apart = distance(origin, state, space.weights)
        if trees.values[COST, side, other] + apart >= cost:
            return near
        steps = step_count(apart, space.resolution)
        if last_valid_step(space, origin, state, steps, counters) < steps:
            return near
        near, cost = other, trees.values[COST, side, other] + apart


@compiled(lean=True)
def _connect(space: SearchSpace, trees: Trees, side: int, node: int) -> tuple[int, int]:
    """Extend a tree from a node to the nearest node of the other tree; return both nodes that meet, or -1.

    If paths have to be short, only nodes of the other tree that make a short path count.
    """
    counters, state = trees.counters, trees.rows[ORIGIN]
    allowed = trees.numbers[BOUND] - trees.values[COST, side, node]
    goal = _nearest(space, trees, 1 - side, trees.states[side, node], allowed)
    if goal < 0:
        return -1, -1
    target, origin = trees.states[1 - side, goal], trees.states[side, node]
    apart = distance(origin, target, space.weights)
    parts = step_count(apart, space.reach)
    steps = step_count(apart / parts, space.resolution)
    for k in range(1, parts + 1):
        for i in range(state.size):
            state[i] = target[i] if k == parts else origin[i] + (target[i] - origin[i]) * k / parts
        if last_valid_step(space, trees.states[side, node], state, steps, counters) < steps:
            return -1, -1
        node = _add(space, trees, side, node, state)
    return node, goal


@compiled("boolean(SearchSpace, Trees, float64, float64, float64[:, ::1])", lean=True)
def narrow(space: SearchSpace, trees: Trees, width: float, length: float, region: Floats2) -> bool:
    """Cut off parts of a box through which no path to a root is below a length.

    Args:
        space: Supplies the metric.
        trees: The trees, with their roots.
        width: The length in straight lines to the nearest root; 0 to use `length`.
        length: The length if `width` is 0 [length unit of the metric].
        region: Lower and upper bounds, shape (2, n).

    Returns:
        Whether anything was cut off.
    """
    start, weights, roots, cut = trees.states[0, 0], space.weights, 0, False
    if width > 0.0:
        length = width * _from_root(space, trees, 1, start)
    while roots < trees.counters[GOAL_SIZE] and trees.parents[1, roots] < 0:
        roots += 1
    for i in range(start.size):
        low, high = math.inf, -math.inf
        for g in range(roots):
            goal = trees.states[1, g]
            apart, way = distance(start, goal, weights), 0.5 * (goal[i] - start[i])
            across = math.sqrt(max(0.25 * (length * length - apart * apart), 0.0)) / weights[i]
            half = math.sqrt(across * across + way * way)
            low, high = min(low, start[i] + way - half), max(high, start[i] + way + half)
        if low > region[0, i]:
            region[0, i], cut = low, True
        if high < region[1, i]:
            region[1, i], cut = high, True
    return cut


@compiled("int64(SearchSpace, Trees, float64, float64[::1], float64[:, ::1], int64[::1], int64)", lean=True)
def plant(
    space: SearchSpace,
    trees: Trees,
    seconds: float,
    start: Floats1,
    goals: Floats2,
    order: Ints1,
    first: int,
) -> int:
    """Make valid ends the roots of the trees, and try the straight edges between them.

    Args:
        space: Box, metric and validity.
        trees: The trees.
        seconds: Time budget [s].
        start: Start state, shape (n,).
        goals: Goal states, shape (k, n).
        order: Indices of the goals in the order in which they are tried, shape (k,).
        first: Index of the first row of `goals` among all goals of the run.

    Returns:
        FOUND (a straight edge; counters[BY_EDGE] is set), GOING_ON, TIME_UP or START_INVALID.
    """
    counters = trees.counters
    place = counters[MOMENT:]
    end = seconds_now(space.clock, place) + seconds
    if counters[START_SIZE] == 0:
        if last_valid_step(space, start, start, 1, counters) == 0:
            return TIME_UP if counters[STOP] != 0 else START_INVALID
        _add(space, trees, 0, -1, start)
    old = counters[GOAL_SIZE]
    for j in range(order.size):
        if counters[STOP] != 0 or (j % _CLOCK_EVERY == 0 and seconds_now(space.clock, place) >= end):
            return TIME_UP
        goal = goals[order[j]]
        if last_valid_step(space, goal, goal, 1, counters) == 1:
            _add(space, trees, 1, -1 - first - order[j], goal)
    for node in range(old, counters[GOAL_SIZE]):
        goal = trees.states[1, node]
        steps = step_count(distance(start, goal, space.weights), space.resolution)
        if edge_valid(space, start, goal, steps, trees.rows[SHIFTED:], counters, False):
            counters[START_NODE], counters[GOAL_NODE] = 0, node
            counters[BY_EDGE] = 1
            return FOUND
        if counters[STOP] != 0 or seconds_now(space.clock, place) >= end:
            return TIME_UP
    return TIME_UP if counters[STOP] != 0 else GOING_ON


@compiled("int64(SearchSpace, Trees, float64, uint64, int64)", lean=True)
def grow(space: SearchSpace, trees: Trees, seconds: float, key: np.uint64, iterations: int) -> int:
    """Grow both trees until they meet; see `rrt_connect` for the method.

    Args:
        space: Box, metric and validity.
        trees: The trees.
        seconds: Time budget [s].
        key: Key of the stream of random numbers.
        iterations: Number of samples in all, earlier calls included.

    Returns:
        FOUND (the trees meet at counters[START_NODE] and counters[GOAL_NODE]), GOING_ON if the iterations are
        used up, TIME_UP, or FULL if there may be no space for the nodes of one more iteration.
    """
    counters, sample, state = trees.counters, trees.rows[SAMPLE], trees.rows[TARGET]
    end = seconds_now(space.clock, counters[MOMENT:]) + seconds
    diagonal = _diagonal(space)
    spare = step_count(diagonal, space.reach) + 2
    while counters[ITERATIONS] < iterations:
        interruption = _interruption(space, trees, end, spare)
        if interruption != GOING_ON:
            return interruption

        side = _choose_tree(counters)
        _draw(space, trees, key)
        counters[ITERATIONS] += 1
        counters[TRIED + side] += 1

        near = _choose_node(space, trees, side, sample, key)
        if near < 0:
            continue
        extended = _step_towards(space, trees.states[side, near], sample, state, counters)
        _adapt_domain(trees.values[RADIUS, side], near, extended, diagonal)
        if not extended:
            continue
        parent = _better_parent(space, trees, side, near, key)
        new = _add(space, trees, side, parent, state)
        counters[GREW + side] += 1

        meeting, goal = _connect(space, trees, side, new)
        if meeting >= 0:
            counters[START_NODE + side], counters[GOAL_NODE - side] = meeting, goal
            return FOUND
    return GOING_ON


class PathEnds(NamedTuple):
    """Start and goals of a path.

    Attributes:
        start: Start state, shape (n,).
        goals: Goal states, shape (k, n).
        order: Indices of the goals in the order in which they are tried, shape (k,).
    """

    start: Floats1
    goals: Floats2
    order: Ints1


@compiled(
    "int64(SearchSpace, Trees, float64, PathEnds, float64[:, ::1], float64[::1], uint64, int64)", lean=True
)
def first_round(
    space: SearchSpace,
    trees: Trees,
    seconds: float,
    ends: PathEnds,
    points: Floats2,
    lengths: Floats1,
    key: np.uint64,
    iterations: int,
) -> int:
    """Plant both trees, and grow them in the space's box unless it is far wider than the ends' distance.

    Args:
        space: Box, metric and validity.
        trees: The trees, without nodes; counters[WAY_POINTS] and counters[GOAL] receive the number of
            waypoints that were written and the index of the goal.
        seconds: Time budget [s]; the trees grow for a time slice at most.
        ends: Start and goals.
        points: Receives the waypoints of the path if they fit, shape (m, n).
        lengths: Receives the arc length at each waypoint, shape (m,) [length unit of the metric].
        key: Key of the stream of random numbers.
        iterations: Maximum number of samples, and at most the number of a round.

    Returns:
        A status of `plant` or `grow`.  GOING_ON without any samples: no goal is valid, or searches near the
        ends come first.
    """
    counters = trees.counters
    ended = _grow_first(space, trees, seconds, ends, key, iterations)
    if ended == FOUND:
        count = write_path(space, trees, points, lengths)
        counters[WAY_POINTS] = count if count <= lengths.size else 0
    return ended


@compiled("int64(SearchSpace, Trees, float64[:, ::1], float64[::1])", lean=True)
def write_path(space: SearchSpace, trees: Trees, points: Floats2, lengths: Floats1) -> int:
    """Write the path along which the trees have met if it fits; return its number of waypoints.

    Args:
        space: Supplies the metric.
        trees: The trees; counters[GOAL] receives the goal.
        points: Waypoints from the start to the goal, written, shape (m, n).
        lengths: Arc length at each waypoint, written, shape (m,) [length unit of the metric].
    """
    count = way_point_count(trees)
    if count <= lengths.size:
        trees.counters[GOAL] = trace(trees, points[:count])
        measure(points, count, space.weights, lengths)
    return count


@compiled(lean=True)
def _grow_first(
    space: SearchSpace, trees: Trees, seconds: float, ends: PathEnds, key: np.uint64, iterations: int
) -> int:
    """Plant both trees and grow them; see `first_round`."""
    place = trees.counters[MOMENT:]
    end = seconds_now(space.clock, place) + seconds
    ended = plant(space, trees, seconds, ends.start, ends.goals, ends.order, 0)
    if ended != GOING_ON or trees.counters[GOAL_SIZE] == 0:
        return ended
    region = trees.rows[SHIFTED:]
    for i in range(ends.start.size):
        region[0, i], region[1, i] = space.lower[i], space.lower[i] + space.extent[i]
    narrower = narrow(space, trees, WIDTH, 0.0, region)
    if narrower and distance(region[0], region[1], space.weights) < SMALL * _diagonal(space):
        return GOING_ON
    left = end - seconds_now(space.clock, place)
    return grow(space, trees, min(left, TIME_SLICE), key, min(iterations, ROUND))
