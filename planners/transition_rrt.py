"""T-RRT: a bidirectional search that prefers states of low price."""

from __future__ import annotations

import math

import numpy as np

from pepper_kin.core.clock import seconds_now
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Ints1

from .constraint_manifold import BoxedManifold, OnSurface
from .cost_descent import StateCost, price_at
from .deadline import Deadline, load_code
from .motion_validator import machine_code_of
from .path import Path
from .problem import Problem
from .result import Result, Status
from .sampling import random_state, stream_key, uniform
from .search_space import (
    ITERATIONS,
    STOP,
    SearchSpace,
    distance,
    last_valid_step,
    space_of,
    step_count,
)
from .tree import (
    BY_EDGE,
    FOUND,
    FULL,
    GOAL_NODE,
    GOING_ON,
    OWN_ROWS,
    SAMPLE,
    START_NODE,
    TARGET,
    TIME_UP,
    Trees,
    add_node,
    leave_trees,
    nearest_node,
    room,
    take_trees,
    trace,
    traced,
    with_room,
)
from .vectors import FloatArray, seed_number, whole_number

_STEP = 0.03  # maximum length of an extension relative to the box's diagonal
_NEAR = 10.0  # distance in steps below which joining the trees is tried
_PRICED = 4.0  # distance of states whose price is evaluated, relative to the resolution
_FIRST_HEAT = 1e-3  # initial temperature relative to the higher price of the ends, or to 1 if that is lower
_HOTTER = 2.0**0.1  # factor on the temperature after a refused rise
_RANGE = 0.1  # rise that halves the temperature, relative to the range of prices met
_STREAM = 11

_BETWEEN = OWN_ROWS  # row of a state on an edge
_PRICE = 0  # index of a node's price in `values`
_HEAT, _LEAST, _MOST = range(3)  # indices into `numbers`: temperature, minimum and maximum price met


def transition_rrt(
    problem: Problem,
    cost: StateCost,
    *,
    seed: int = 0,
    timeout: float = 5.0,
    max_iterations: int = 1_000_000,
) -> Result:
    """Search a path through states of low price c(x).

    Two trees grow in turns, from their nodes nearest to uniform samples towards the samples, by short steps.
    A rise from price a to b > a is taken with probability exp(-(b - a) / T).  The temperature T falls after a
    rise that was taken and grows by 7 % after one that was refused, so that the trees fill valleys of the
    price and cross passes at their lowest point.  Trees that come near are joined by a straight edge on which
    the price does not exceed the prices of both ends by more than T.

    Source: L. Jaillet, J. Cortes and T. Simeon, Sampling-based path planning on configuration-space costmaps,
    IEEE Trans. Robotics 26(4), 2010; two trees as in D. Devaurs, T. Simeon and J. Cortes, Enhancing the
    transition-based RRT to deal with complex cost spaces, ICRA 2013.

    Args:
        problem: The problem; with goals, not with a sampler of goals.
        cost: The price.
        seed: Seed of the samples; the same seed gives the same result unless time runs out.
        timeout: Time budget [s].
        max_iterations: Maximum number of samples.

    Returns:
        The result; its path has many corners, which `descend_cost` removes.  `cost` is the integral of 1 + c.

    Raises:
        InvalidValueError: An option is not allowed, the problem draws its goals, or the price has another
            number of coordinates.
    """
    load_code(grow, price_at, last_valid_step, trace)
    if problem.goal_sampler is not None:
        raise InvalidValueError("goals", "a sampler", "goal states, for a search with a price")
    problem.require_same("cost", cost.n)
    seed, max_iterations = seed_number(seed), whole_number("max_iterations", max_iterations)
    deadline, trees = Deadline(timeout), take_trees(problem.n)
    counters = trees.counters
    box, path, goal = (problem.lower, problem.upper, problem.metric.weights), None, None
    with (
        machine_code_of(problem, deadline, counters=counters) as code,
        OnSurface(cost.manifold, *box) as price,
    ):
        reach = max(_STEP * problem.diagonal, 2.0 * problem.spacing)
        space = space_of(problem, code, problem.spacing, reach)
        ends = [_valid(space, states, counters) for states in (problem.start[None], problem.goals)]
        if not ends[0].size or not ends[1].size:
            status = Status.GOAL_INVALID if ends[0].size else Status.START_INVALID
        else:
            trees = with_room(trees, ends[1].size)
            _plant(space, price, trees, problem, ends[1])
            key = stream_key(seed, _STREAM)
            while True:
                ended = grow(space, price, trees, deadline.time_slice, key, max_iterations)
                if ended == FULL:
                    trees = with_room(trees, 1)
                elif ended != TIME_UP or deadline.expired or counters[STOP] or price.stop[0]:
                    break
            status = {FOUND: Status.SOLVED, GOING_ON: Status.OUT_OF_ITERATIONS}.get(
                ended, Status.NO_PATH_IN_TIME
            )
            if ended == FOUND:
                points, goal = traced(trees)
                path = Path.trusted(points, problem.metric)
    leave_trees(trees)
    integral = math.inf if path is None else cost.along(path.resample(_PRICED * problem.spacing))
    return Result.of_run(status, counters, deadline, seed, path, goal, cost=integral)


def _valid(space: SearchSpace, states: FloatArray, counters: Ints1) -> np.ndarray:
    """Return the indices of the valid states among states of shape (m, n)."""
    rows = np.array(states, order="C")
    return np.array([k for k, x in enumerate(rows) if last_valid_step(space, x, x, 1, counters)], np.int64)


def _plant(
    space: SearchSpace, price: BoxedManifold, trees: Trees, problem: Problem, goals: np.ndarray
) -> None:
    """Make the start and some goals the roots of trees.

    Args:
        space: The box and its metric.
        price: The price of states as machine code.
        trees: The trees, without nodes.
        problem: The problem.
        goals: Indices of the goals, integers, shape (g,).
    """
    trees.numbers[_MOST] = -math.inf
    roots = [(0, -1, problem.start)] + [(1, -1 - k, problem.goals[k]) for k in goals.tolist()]
    for side, parent, root in roots:
        state = np.array(root)
        add_priced_node(space, trees, side, parent, state, price_at(price, state))
    highest = np.nan_to_num(trees.numbers[_MOST], posinf=1.0)
    trees.numbers[_HEAT] = _FIRST_HEAT * max(1.0, float(highest))


@compiled("int64(SearchSpace, Trees, int64, int64, float64[::1], float64)")
def add_priced_node(
    space: SearchSpace, trees: Trees, side: int, parent: int, state: Floats1, price: float
) -> int:
    """Add a node with its price to a tree; return its index, see `add_node`."""
    node, numbers = add_node(space, trees, side, parent, state), trees.numbers
    trees.values[_PRICE, side, node] = price
    numbers[_LEAST], numbers[_MOST] = min(numbers[_LEAST], price), max(numbers[_MOST], price)
    return node


@compiled
def _highest_price(
    space: SearchSpace, cost: BoxedManifold, trees: Trees, a: FloatArray, b: FloatArray
) -> float:
    """Return the maximum price on an edge without its start."""
    count = step_count(distance(a, b, space.weights), _PRICED * space.resolution)
    between, highest = trees.rows[_BETWEEN], 0.0
    for k in range(1, count + 1):
        for i in range(between.size):
            between[i] = a[i] + (b[i] - a[i]) * k / count
        highest = max(highest, price_at(cost, between))
    return highest


@compiled("int64(SearchSpace, BoxedManifold, Trees, float64, uint64, int64)")
def grow(
    space: SearchSpace, cost: BoxedManifold, trees: Trees, seconds: float, key: np.uint64, iterations: int
) -> int:
    """Grow both trees until they meet; see `transition_rrt` for the method.

    Args:
        space: Box, metric and validity.
        cost: The price.
        trees: The trees.
        seconds: Time budget [s].
        key: Key of the stream of random numbers.
        iterations: Number of samples in all, earlier calls included.

    Returns:
        FOUND, GOING_ON if the iterations are used up, TIME_UP, or FULL if there is no space for a node.
    """
    place, counters, rows, heat = np.empty(2, np.int64), trees.counters, trees.rows, trees.numbers
    end, n = seconds_now(space.clock, place) + seconds, space.lower.size
    while counters[ITERATIONS] < iterations:
        if counters[STOP] != 0 or cost.stop[0] != 0 or seconds_now(space.clock, place) >= end:
            return TIME_UP
        if room(trees) < 1:
            return FULL
        side, first = counters[ITERATIONS] % 2, counters[ITERATIONS] * (n + 1)
        counters[ITERATIONS] += 1
        random_state(space, key, first, rows[SAMPLE])
        near = nearest_node(space, trees, side, rows[SAMPLE])
        origin, state = trees.states[side, near], rows[TARGET]
        apart = distance(origin, rows[SAMPLE], space.weights)
        share = 1.0 if apart < space.reach else space.reach / apart
        for i in range(n):
            state[i] = origin[i] + (rows[SAMPLE, i] - origin[i]) * share
        highest = _highest_price(space, cost, trees, origin, state)
        rise = highest - trees.values[_PRICE, side, near]
        if rise > 0.0:
            if not uniform(key, first + n) < math.exp(-rise / heat[_HEAT]):
                heat[_HEAT] *= _HOTTER
                continue
            width = max(heat[_MOST] - heat[_LEAST], rise)
            heat[_HEAT] *= 2.0 ** (-rise / (_RANGE * width))
        steps = step_count(apart * share, space.resolution)
        if last_valid_step(space, origin, state, steps, counters) < steps:
            continue
        new = add_priced_node(space, trees, side, near, state, price_at(cost, state))
        goal = nearest_node(space, trees, 1 - side, state)
        target = trees.states[1 - side, goal]
        apart = distance(state, target, space.weights)
        if apart > _NEAR * space.reach:
            continue
        allowed = max(trees.values[_PRICE, side, new], trees.values[_PRICE, 1 - side, goal]) + heat[_HEAT]
        if _highest_price(space, cost, trees, state, target) > allowed:
            continue
        steps = step_count(apart, space.resolution)
        if last_valid_step(space, state, target, steps, counters) == steps:
            counters[START_NODE + side], counters[GOAL_NODE - side] = new, goal
            counters[BY_EDGE] = 1
            return FOUND
    return GOING_ON
