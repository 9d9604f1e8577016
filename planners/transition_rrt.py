"""T-RRT: a bidirectional search that prefers valleys of a price of being at a state."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pepper_kin.core.clock import seconds_now
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2, Floats3, Floats4, Ints1, Ints2

from .constraint_manifold import OnSurface, Surface
from .cost_descent import StateCost, price_at
from .deadline import Deadline, load_code
from .motion_validator import machine_code_of
from .path import Path
from .problem import Problem
from .result import Result, Status
from .sampling import random_state, stream_key, uniform
from .search_space import STOP, SearchSpace, distance, last_valid_step, space_of, step_count
from .tree import LANES, grown, nearest, set_lane, whole_blocks
from .vectors import FloatArray, seed_number, whole_number

_STEP = 0.03  # of the diagonal: longest extension
_NEAR = 10.0  # steps: trees that are nearer are tried to be joined
_PRICED = 4.0  # of the resolution: distance of states whose price is looked at
_FIRST_HEAT = 1e-3  # of the price of the dearer end, at least of 1
_HOTTER = 2.0**0.1
_RANGE = 0.1  # of the prices met: a rise by as much halves the temperature
_FIRST_CAPACITY = 1024
_STREAM = 11

# How growth ends.
_GOING_ON, _FOUND, _TIME_UP, _FULL = range(4)

# Places in `counters`, after those of the validity function.
_ITERATIONS, _SIZE, _OTHER_SIZE, _START_NODE, _GOAL_NODE = range(STOP + 1, STOP + 6)

# Rows of `rows`.
_SAMPLE, _SCALED, _TARGET, _BETWEEN = range(4)

# Places in `heat`.
_HEAT, _LEAST, _MOST = range(3)


class Forest(NamedTuple):
    """The tree of the start (0) and that of the goals (1), in arrays with space for m nodes each.

    Attributes:
        states: Shape (2, m, n).
        lanes: Scaled states, shape (2, m / 8, n, 8).
        parents: -1 less the number of its goal of a root, shape (2, m).
        prices: Of the nodes, shape (2, m).
        heat: Temperature, least and greatest price met, shape (3,).
        rows: Scratch space, shape (4, n).
        spare: Eight numbers.
        counters: See the places above.
    """

    states: Floats3
    lanes: Floats4
    parents: Ints2
    prices: Floats2
    heat: Floats1
    rows: Floats2
    spare: Floats1
    counters: Ints1


def transition_rrt(
    problem: Problem,
    cost: StateCost,
    *,
    seed: int = 0,
    timeout: float = 5.0,
    max_iterations: int = 1_000_000,
) -> Result:
    """Search a path that keeps to where the price c(x) is low.

    Two trees grow in turns, from their nodes nearest to uniform samples towards them, by short steps.  A step
    from price a to b > a is taken with probability exp(-(b - a) / T).  The temperature T falls where a rise
    was taken and grows by 7 % where one was refused, so that the trees fill valleys and cross passes at their
    lowest.  Trees that come near are joined by a straight edge on which the price does not exceed that of
    both its ends by more than T.

    Source: L. Jaillet, J. Cortes and T. Simeon, Sampling-based path planning on configuration-space costmaps,
    IEEE Trans. Robotics 26(4), 2010; two trees as in D. Devaurs, T. Simeon and J. Cortes, Enhancing the
    transition-based RRT to deal with complex cost spaces, ICRA 2013.

    Args:
        problem: What to plan; with goals, not with a sampler of them.
        cost: The price.
        seed: Seed of the samples; the same seed gives the same result unless time runs out.
        timeout: Time budget [s].
        max_iterations: Greatest number of samples.

    Returns:
        The result; its path has many corners, which `descend_cost` removes.  `cost` is the integral of 1 + c.

    Raises:
        InvalidValueError: An option is not allowed, the problem draws its goals, or the price has another
            number of coordinates.
    """
    load_code(grow, price_at, last_valid_step)
    if problem.goal_sampler is not None:
        raise InvalidValueError("goals", "a sampler", "goal states, for a search with a price")
    if cost.n != problem.n:
        raise InvalidValueError("cost", f"{cost.n} coordinates", f"{problem.n} coordinates, as the problem")
    seed, max_iterations = seed_number(seed), whole_number("max_iterations", max_iterations)
    deadline, counters = Deadline(timeout), np.zeros(_GOAL_NODE + 1, dtype=np.int64)
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
            forest = _planted(space, price, problem, ends[1], counters)
            ended, key = _FULL, stream_key(seed, _STREAM)
            while ended == _FULL or (ended == _TIME_UP and not (deadline.expired or counters[STOP])):
                forest = _with_capacity(forest) if ended == _FULL else forest
                ended = grow(space, price, forest, deadline.time_slice, key, max_iterations)
            status = {_FOUND: Status.SOLVED, _GOING_ON: Status.OUT_OF_ITERATIONS}.get(
                ended, Status.NO_PATH_IN_TIME
            )
            if ended == _FOUND:
                points, goal = _points(forest)
                path = Path.trusted(points, problem.metric)
    states, calls = counters[:STOP].tolist()
    return Result(
        status=status,
        path=path,
        goal_index=goal,
        cost=math.inf if path is None else cost.along(path.resample(_PRICED * problem.spacing)),
        iterations=int(counters[_ITERATIONS]),
        states_checked=states,
        validity_calls=calls,
        time=deadline.elapsed,
        seed=seed,
    )


def _valid(space: SearchSpace, states: FloatArray, counters: Ints1) -> np.ndarray:
    """Return the numbers of the valid ones of some states, shape (m, n)."""
    rows = np.array(states, order="C")
    return np.array([k for k, x in enumerate(rows) if last_valid_step(space, x, x, 1, counters)], np.int64)


def _planted(
    space: SearchSpace, price: Surface, problem: Problem, goals: np.ndarray, counters: Ints1
) -> Forest:
    """Return the trees of the start and of some goals.

    Args:
        space: The box and its metric.
        price: The price of states as machine code.
        problem: The problem.
        goals: Numbers of the goals, integers, shape (g,).
        counters: Of the planner.
    """
    n, capacity = problem.n, whole_blocks(max(_FIRST_CAPACITY, goals.size))
    forest = Forest(
        np.empty((2, capacity, n)),
        np.empty((2, capacity // LANES, n, LANES)),
        np.empty((2, capacity), dtype=np.int64),
        np.empty((2, capacity)),
        np.array([0.0, math.inf, -math.inf]),
        np.empty((4, n)),
        np.empty(LANES),
        counters,
    )
    for side, states in ((0, problem.start[None]), (1, problem.goals[goals])):
        for k, state in enumerate(np.array(states, order="C")):
            parent = -1 - int(goals[k]) if side else -1
            add_node(space, forest, side, parent, state, price_at(price, state))
    forest.heat[_HEAT] = _FIRST_HEAT * max(1.0, float(np.nan_to_num(forest.heat[_MOST], posinf=1.0)))
    return forest


def _with_capacity(forest: Forest) -> Forest:
    """Return the trees with twice the capacity."""
    capacity = whole_blocks(2 * forest.states.shape[1])
    return forest._replace(
        states=grown(forest.states, capacity, axis=1),
        lanes=grown(forest.lanes, capacity // LANES, axis=1),
        parents=grown(forest.parents, capacity, axis=1),
        prices=grown(forest.prices, capacity, axis=1),
    )


def _points(forest: Forest) -> tuple[FloatArray, int]:
    """Return the way-points of the path along which the trees have met, and its goal."""
    branches, root = [], -1
    for side in range(2):
        node, states = int(forest.counters[_START_NODE + side]), []
        while node >= 0:
            states.append(forest.states[side, node])
            node = root = int(forest.parents[side, node])
        branches.append(np.array(states))
    return np.concatenate([branches[0][::-1], branches[1]]), -1 - root


@compiled("int64(SearchSpace, Forest, int64, int64, float64[::1], float64)")
def add_node(space: SearchSpace, forest: Forest, side: int, parent: int, state: Floats1, price: float) -> int:
    """Add a node to a tree; return its number."""
    node = forest.counters[_SIZE + side]
    forest.counters[_SIZE + side] += 1
    for i in range(state.size):
        forest.states[side, node, i] = state[i]
    set_lane(forest.lanes[side], node, state, space.weights)
    forest.parents[side, node], forest.prices[side, node] = parent, price
    forest.heat[_LEAST] = min(forest.heat[_LEAST], price)
    forest.heat[_MOST] = max(forest.heat[_MOST], price)
    return node


@compiled
def _nearest(space: SearchSpace, forest: Forest, side: int, state: FloatArray) -> int:
    scaled = forest.rows[_SCALED]
    for i in range(state.size):
        scaled[i] = state[i] * space.weights[i]
    return nearest(forest.lanes[side], forest.counters[_SIZE + side], scaled, forest.spare)


@compiled
def _highest_price(space: SearchSpace, cost: Surface, forest: Forest, a: FloatArray, b: FloatArray) -> float:
    """Return the highest price on an edge, its start left out."""
    count = step_count(distance(a, b, space.weights), _PRICED * space.resolution)
    between, highest = forest.rows[_BETWEEN], 0.0
    for k in range(1, count + 1):
        for i in range(between.size):
            between[i] = a[i] + (b[i] - a[i]) * k / count
        highest = max(highest, price_at(cost, between))
    return highest


@compiled("int64(SearchSpace, Surface, Forest, float64, uint64, int64)")
def grow(
    space: SearchSpace, cost: Surface, forest: Forest, seconds: float, key: np.uint64, iterations: int
) -> int:
    """Grow both trees until they meet; see `transition_rrt` for the method.

    Args:
        space: Box, metric and validity.
        cost: The price.
        forest: The trees.
        seconds: Time budget [s].
        key: Of the stream of random numbers.
        iterations: Number of samples in all, those of earlier calls included.

    Returns:
        _FOUND, _GOING_ON if the iterations are used up, _TIME_UP, or _FULL if there is no space for a node.
    """
    place, counters, rows, heat = np.empty(2, np.int64), forest.counters, forest.rows, forest.heat
    end, n = seconds_now(space.clock, place) + seconds, space.lower.size
    while counters[_ITERATIONS] < iterations:
        if counters[STOP] != 0 or cost.stop[0] != 0 or seconds_now(space.clock, place) >= end:
            return _TIME_UP
        if max(counters[_SIZE], counters[_OTHER_SIZE]) >= forest.states.shape[1]:
            return _FULL
        side, first = counters[_ITERATIONS] % 2, counters[_ITERATIONS] * (n + 1)
        counters[_ITERATIONS] += 1
        random_state(space, key, first, rows[_SAMPLE])
        near = _nearest(space, forest, side, rows[_SAMPLE])
        origin, state = forest.states[side, near], rows[_TARGET]
        apart = distance(origin, rows[_SAMPLE], space.weights)
        share = 1.0 if apart < space.reach else space.reach / apart
        for i in range(n):
            state[i] = origin[i] + (rows[_SAMPLE, i] - origin[i]) * share
        highest = _highest_price(space, cost, forest, origin, state)
        rise = highest - forest.prices[side, near]
        if rise > 0.0:
            if not uniform(key, first + n) < math.exp(-rise / heat[_HEAT]):
                heat[_HEAT] *= _HOTTER
                continue
            width = max(heat[_MOST] - heat[_LEAST], rise)
            heat[_HEAT] *= 2.0 ** (-rise / (_RANGE * width))
        steps = step_count(apart * share, space.resolution)
        if last_valid_step(space, origin, state, steps, counters) < steps:
            continue
        new = add_node(space, forest, side, near, state, price_at(cost, state))
        goal = _nearest(space, forest, 1 - side, state)
        target = forest.states[1 - side, goal]
        apart = distance(state, target, space.weights)
        if apart > _NEAR * space.reach:
            continue
        allowed = max(forest.prices[side, new], forest.prices[1 - side, goal]) + heat[_HEAT]
        if _highest_price(space, cost, forest, state, target) > allowed:
            continue
        steps = step_count(apart, space.resolution)
        if last_valid_step(space, state, target, steps, counters) == steps:
            counters[_START_NODE + side], counters[_GOAL_NODE - side] = new, goal
            return _FOUND
    return _GOING_ON
