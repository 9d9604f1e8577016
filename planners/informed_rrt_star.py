"""Informed RRT*: a first path quickly, and then a better and better one."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from pepper_kin.core.clock import seconds_now
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2, Floats3, Ints1, Ints2

from .deadline import Deadline, load_code
from .motion_validator import machine_code_of
from .path import Path
from .problem import Problem
from .result import Improvement, Result, Status
from .rrt_connect import grow, rrt_connect
from .sampling import near_edge, random_state, stream_key, uniform, within_ellipsoid
from .search_space import (
    CALLS,
    STATES,
    STOP,
    SearchSpace,
    distance,
    distance_to_nearest,
    is_free,
    last_valid_step,
    space_of,
    step_count,
)
from .shortcut import shortcut, shorten
from .tree import LANES, grown, k_nearest, neighbor_count, set_lane, whole_blocks
from .vectors import FloatArray, whole_number

_REACH = 0.2  # of the box's diagonal: greatest length of an extension
_MOST_NODES = (
    200_000  # at which the improvement ends: the time of an iteration grows with the number of nodes
)
_MOST_NEIGHBORS = 128
_UNLIMITED = 2**62
_SHORTCUT_SHARE = 0.1  # of the time budget
_LEAST_TIME = 1e-9  # [s]; a budget is above zero
_STREAM = 2
_FIRST_CAPACITY = 1024
_RECORDS = 2048
_HISTORY_STEP = 1e-4  # part of the cost: smaller gains share an entry of the history
_SHORT_CUTS, _NEAR_PATH = 0.1, 0.5  # shares of the iterations
_SHORTER = 1.0 - 1e-12  # factor below which a cost is lower for other reasons than rounding
_SAME = 1e-9  # of the greatest extension: nearer states are one

# How a call ends.
DONE, TIME_UP, FULL = range(3)

# Places in `counters`, after those of the validity function.
ITERATIONS, SIZE, GOAL, RECORDS, BRANCH, DRAWN = range(STOP + 1, STOP + 7)
_COUNTERS = DRAWN + 1

# Rows of `family` and of `costs`.
PARENT, CHILD, NEXT, BEFORE, STACK = range(5)
COST, EDGE = 0, 1


class Tree(NamedTuple):
    """A tree in arrays with room for m nodes.

    Attributes:
        states: Shape (m, n).
        lanes: Scaled states, shape (m / 8, n, 8).
        family: Parent, first child, next and previous sibling, and room for a stack, shape (5, m); -1: none.
        costs: Length from the start and of the edge to the parent, shape (2, m).
        goals: Shape (k, n).
        goal_nodes: Node of each goal, -1 if it is not in the tree, shape (k,).
        branch: Nodes of the best path, goal first; counters[BRANCH] of them, shape (m,).
        near: Indices of neighbors, shape (128,).
        squares: Squares of their distances, then costs through them, shape (2, 128).
        rows: Room, shape (6, n).
        room: Eight numbers.
        history: Times [s], costs and iterations of better paths; counters[RECORDS] of them, shape (h, 3).
        counters: See the places above.
    """

    states: Floats2
    lanes: Floats3
    family: Ints2
    costs: Floats2
    goals: Floats2
    goal_nodes: Ints1
    branch: Ints1
    near: Ints1
    squares: Floats2
    rows: Floats2
    room: Floats1
    history: Floats2
    counters: Ints1


def rrt_star(
    problem: Problem,
    *,
    seed: int = 0,
    timeout: float = 1.0,
    max_iterations: int | None = None,
    target: float = 0.0,
    resolution: float | None = None,
) -> Result:
    """Search a path, then keep shortening it until the time budget is used up.

    `rrt_connect` finds a path, `shortcut` takes out its detours (in a tenth of the time at most), and
    `informed_rrt_star` does the rest; where goals are drawn by a sampler, the one that was reached is kept.

    Args:
        problem: What to plan.
        seed: Seed of all random choices.
        timeout: Time budget [s]; all of it is used unless the path is as short as the target, or as the
            straight line to the nearest goal.
        max_iterations: Greatest number of samples of the search, and again of the improvement.  Without it
            the time budget decides, and the result depends on the speed of the machine.
        target: Length that is good enough [length unit of the metric].
        resolution: Greatest distance between checked states of short-cuts and improvements [length unit of
            the metric]; the problem's if omitted.

    Returns:
        The result, with the history of costs; without a path its status tells why.

    Raises:
        InvalidValueError: An option is not allowed, or the checker answers in a wrong shape.
    """
    load_code(grow, shorten, improve)
    deadline = Deadline(timeout)
    limit = {} if max_iterations is None else {"max_iterations": max_iterations}
    first = rrt_connect(problem, seed=seed, timeout=timeout, **limit)
    if first.path is None or deadline.expired:
        return first
    spacing = problem.spacing if resolution is None else resolution
    brief = max(min(_SHORTCUT_SHARE * timeout, deadline.left), _LEAST_TIME)
    path = shortcut(problem, first.path, seed=seed, timeout=brief, resolution=spacing)
    begun = deadline.elapsed
    if deadline.expired:
        return replace(first, path=path, cost=path.length, time=begun)
    better = informed_rrt_star(
        problem,
        path,
        seed=seed,
        timeout=max(deadline.left, _LEAST_TIME),
        max_iterations=max_iterations,
        target=target,
        resolution=spacing,
    )
    later = (entry._replace(time=entry.time + begun) for entry in better.history)
    return replace(
        better,
        goal_index=first.goal_index if better.goal_index is None else better.goal_index,
        iterations=first.iterations + better.iterations,
        states_checked=first.states_checked + better.states_checked,
        validity_calls=first.validity_calls + better.validity_calls,
        time=deadline.elapsed,
        history=(Improvement(first.time, first.cost, 0), *later),
    )


def informed_rrt_star(
    problem: Problem,
    path: Path,
    *,
    seed: int = 0,
    timeout: float = 1.0,
    max_iterations: int | None = None,
    target: float = 0.0,
    resolution: float | None = None,
) -> Result:
    """Keep shortening a valid path until the time budget is used up; the result is never longer.

    The path is the first branch of a tree that is grown by informed RRT*.  A sample is drawn where a path
    through it can be shorter than the best one, half of the time near that path; the tree is extended towards
    it, the new node takes the parent through which it is nearest to the start, its neighbours are led through
    it where that is shorter, and each goal is reached for straight away.  Now and then a node of the best
    path is led straight to one of its ancestors.  With time, the cost tends to that of the shortest path, not
    only of those around obstacles in the same way.

    Source: S. Karaman and E. Frazzoli, Sampling-based algorithms for optimal motion planning, Int. J. of
    Robotics Research 30(7), 2011; J. D. Gammell, S. S. Srinivasa and T. D. Barfoot, Informed RRT*, IROS 2014.

    It runs as machine code.  A validity checker that is a Python callable is called back from there, which
    gives the same result, later.

    Args:
        problem: Supplies the box, the metric, the validity and the goals: the path may end at any of them, or
            where it ended.  Its start is not used.
        path: A valid path, which is not checked again.
        seed: Seed of the samples.
        timeout: Time budget [s]; all of it is used unless the path becomes as short as the target, or as the
            straight line to the nearest goal.
        max_iterations: Greatest number of samples.  Without it the time budget decides, and the result
            depends on the speed of the machine.
        target: Length that is good enough [length unit of the metric].
        resolution: Greatest distance between checked states of an edge [length unit of the metric]; the
            problem's if omitted.  Short paths graze obstacles: let the checker keep a margin.

    Returns:
        The result, with the history of costs; its status is always SOLVED.

    Raises:
        InvalidValueError: The path has another number of coordinates, or an option is not allowed.
    """
    load_code(plant, improve)
    deadline = Deadline(timeout)
    if path.n != problem.n:
        raise InvalidValueError(
            "path", f"{path.n} coordinates", f"{problem.n} coordinates, as in the problem"
        )
    seed = whole_number("seed", seed)
    iterations = _UNLIMITED if max_iterations is None else whole_number("max_iterations", max_iterations)
    goals, goal = _goals_of(problem, path)
    least = _least_length(problem, path, goals, target)
    spacing = problem.validator(resolution=resolution).resolution
    tree = _new_tree(problem.n, goals, max(_FIRST_CAPACITY, len(path) + len(goals) + LANES))
    counters, key = tree.counters, stream_key(seed, _STREAM)
    with machine_code_of(problem, deadline, spacing, counters) as code:
        space = space_of(problem, code, spacing, _REACH * problem.diagonal)
        plant(space, tree, path.points.copy(), goal, deadline.elapsed)
        while not (deadline.expired or counters[STOP]):
            ended = improve(space, tree, deadline.time_slice, deadline.elapsed, least, key, iterations)
            if ended == FULL and len(tree.states) < _MOST_NODES:
                tree = _with_room(tree, 2 * len(tree.states))
            elif ended != TIME_UP:
                break
    points, reached = _path_of(tree)
    better = Path.trusted(points, problem.metric)
    records = tree.history[: counters[RECORDS]].tolist()
    return Result(
        status=Status.SOLVED,
        path=better,
        goal_index=reached if reached < len(problem.goals) else None,
        cost=better.length,
        iterations=int(counters[ITERATIONS]),
        states_checked=int(counters[STATES]),
        validity_calls=int(counters[CALLS]),
        time=deadline.elapsed,
        seed=seed,
        history=tuple(Improvement(time, cost, int(iteration)) for time, cost, iteration in records),
    )


def _goals_of(problem: Problem, path: Path) -> tuple[FloatArray, int]:
    """Return the goals, the end of the path among them, and its place."""
    same = np.flatnonzero((problem.goals == path.points[-1]).all(axis=1))
    if same.size:
        return problem.goals.copy(), int(same[0])
    return np.concatenate((problem.goals, path.points[-1:])), len(problem.goals)


def _least_length(problem: Problem, path: Path, goals: FloatArray, target: float) -> float:
    """Return the length at which to stop: the target, or what no path can be shorter than."""
    if not (isinstance(target, int | float) and 0.0 <= target < math.inf):
        raise InvalidValueError("target", target, "a finite length of 0 or more")
    straight = float(problem.metric.distance(path.points[0], goals).min())
    return max(float(target), straight * (1.0 + 1e-9))


def _new_tree(n: int, goals: FloatArray, capacity: int) -> Tree:
    """Return an empty tree."""
    tree = Tree(
        states=np.empty((0, n)),
        lanes=np.empty((0, n, LANES)),
        family=np.empty((STACK + 1, 0), dtype=np.int64),
        costs=np.empty((2, 0)),
        goals=goals,
        goal_nodes=np.full(len(goals), -1, dtype=np.int64),
        branch=np.empty(0, dtype=np.int64),
        near=np.empty(_MOST_NEIGHBORS, dtype=np.int64),
        squares=np.empty((2, _MOST_NEIGHBORS)),
        rows=np.empty((6, n)),
        room=np.empty(LANES),
        history=np.empty((_RECORDS, 3)),
        counters=np.zeros(_COUNTERS, dtype=np.int64),
    )
    return _with_room(tree, capacity)


def _with_room(tree: Tree, capacity: int) -> Tree:
    """Return a tree with room for a number of nodes."""
    capacity = whole_blocks(capacity)
    return tree._replace(
        states=grown(tree.states, capacity),
        lanes=grown(tree.lanes, capacity // LANES),
        family=grown(tree.family, capacity, axis=1),
        costs=grown(tree.costs, capacity, axis=1),
        branch=grown(tree.branch, capacity),
    )


def _path_of(tree: Tree) -> tuple[FloatArray, int]:
    """Return the best path and its goal."""
    goal = int(tree.counters[GOAL])
    nodes, node = [], int(tree.goal_nodes[goal])
    while node >= 0:
        nodes.append(node)
        node = int(tree.family[PARENT, node])
    points = tree.states[nodes[::-1]]
    points[-1] = tree.goals[goal]
    return points, goal


@compiled
def _part(tree: Tree, node: int) -> None:
    family = tree.family
    before, after = family[BEFORE, node], family[NEXT, node]
    if before >= 0:
        family[NEXT, before] = after
    else:
        family[CHILD, family[PARENT, node]] = after
    if after >= 0:
        family[BEFORE, after] = before


@compiled
def _adopt(tree: Tree, node: int, parent: int, length: float) -> None:
    family = tree.family
    first = family[CHILD, parent]
    family[PARENT, node], family[BEFORE, node], family[NEXT, node] = parent, -1, first
    if first >= 0:
        family[BEFORE, first] = node
    family[CHILD, parent] = node
    tree.costs[EDGE, node] = length
    tree.costs[COST, node] = tree.costs[COST, parent] + length


@compiled
def _move(tree: Tree, node: int, parent: int, length: float) -> None:
    """Give a node another parent, and lower the costs of all below it."""
    _part(tree, node)
    _adopt(tree, node, parent, length)
    family, costs = tree.family, tree.costs
    family[STACK, 0] = node
    height = 1
    while height > 0:
        height -= 1
        above = family[STACK, height]
        child = family[CHILD, above]
        while child >= 0:
            costs[COST, child] = costs[COST, above] + costs[EDGE, child]
            family[STACK, height] = child
            height += 1
            child = family[NEXT, child]


@compiled
def _add(space: SearchSpace, tree: Tree, state: FloatArray, parent: int, length: float) -> int:
    """Add a state as a node below a parent (-1: none), on an edge of a length; return its number."""
    node = tree.counters[SIZE]
    tree.counters[SIZE] += 1
    for i in range(state.size):
        tree.states[node, i] = state[i]
    set_lane(tree.lanes, node, state, space.weights)
    tree.family[PARENT, node] = tree.family[CHILD, node] = -1
    tree.family[NEXT, node] = tree.family[BEFORE, node] = -1
    tree.costs[COST, node] = tree.costs[EDGE, node] = 0.0
    if parent >= 0:
        _adopt(tree, node, parent, length)
    return node


@compiled
def _neighbors(space: SearchSpace, tree: Tree, state: FloatArray) -> int:
    """Find the nodes nearest to a state, nearest first; return how many."""
    n, size = state.size, tree.counters[SIZE]
    scaled = tree.rows[2]
    for i in range(n):
        scaled[i] = state[i] * space.weights[i]
    wanted = neighbor_count(n, size, _MOST_NEIGHBORS)
    return k_nearest(tree.lanes, size, scaled, wanted, tree.near, tree.squares[0], tree.room)


@compiled
def _join_branch(space: SearchSpace, tree: Tree, state: FloatArray, count: int) -> int:
    """Add the nodes of the best path to a state's neighbors; return how many there are then.

    Near the best path samples are so dense that its own nodes are not among the nearest.
    """
    nearest = count
    for j in range(tree.counters[BRANCH]):
        node, known = tree.branch[j], False
        for k in range(nearest):
            known = known or tree.near[k] == node
        if not known and count < _MOST_NEIGHBORS:
            tree.near[count] = node
            tree.squares[0, count] = distance(state, tree.states[node], space.weights) ** 2
            count += 1
    return count


@compiled
def _note_best(tree: Tree, best: float) -> float:
    """Return the cost of the best goal, and renew the list of its branch if it is better than before."""
    least, counters = best, tree.counters
    for g in range(tree.goal_nodes.size):
        if tree.goal_nodes[g] >= 0 and tree.costs[COST, tree.goal_nodes[g]] < least:
            least, counters[GOAL] = tree.costs[COST, tree.goal_nodes[g]], g
    if least < best:
        count, node = 0, tree.goal_nodes[counters[GOAL]]
        while node >= 0:
            tree.branch[count] = node
            count += 1
            node = tree.family[PARENT, node]
        counters[BRANCH] = count
    return least


@compiled
def _best_parent(
    space: SearchSpace, tree: Tree, state: FloatArray, count: int, limit: float, known: int
) -> int:
    """Return the place among the neighbors of the best parent that can be reached; -1 if there is none.

    `limit` is a cost at which a node is of no use, `known` the place of a neighbor whose edge is valid (-1:
    none is known).
    """
    through = tree.squares[1]
    for k in range(count):
        through[k] = tree.costs[COST, tree.near[k]] + math.sqrt(tree.squares[0, k])
    for _ in range(count):
        best = 0
        for k in range(1, count):
            if through[k] < through[best]:
                best = k
        if through[best] >= limit:
            return -1
        length = math.sqrt(tree.squares[0, best])
        if best == known or is_free(
            space, tree.states[tree.near[best]], state, length, tree.rows, tree.counters
        ):
            return best
        through[best] = math.inf
    return -1


@compiled
def _rewire(space: SearchSpace, tree: Tree, node: int, count: int) -> None:
    """Lead neighbors through a new node where that is shorter."""
    for k in range(count):
        other, length = tree.near[k], math.sqrt(tree.squares[0, k])
        shorter = tree.costs[COST, node] + length < tree.costs[COST, other] * _SHORTER
        if shorter and is_free(
            space, tree.states[node], tree.states[other], length, tree.rows, tree.counters
        ):
            _move(tree, other, node, length)


@compiled
def _try_goals(space: SearchSpace, tree: Tree, node: int, best: float) -> None:
    """Reach for each goal straight from a new node where that is shorter."""
    for g in range(tree.goals.shape[0]):
        length = distance(tree.states[node], tree.goals[g], space.weights)
        cost, goal_node = tree.costs[COST, node] + length, tree.goal_nodes[g]
        if goal_node >= 0:
            best = min(best, tree.costs[COST, goal_node])
        if goal_node == node or cost >= best:
            continue
        if not is_free(space, tree.states[node], tree.goals[g], length, tree.rows, tree.counters):
            continue
        if goal_node < 0:
            tree.goal_nodes[g] = _add(space, tree, tree.goals[g], node, length)
        else:
            _move(tree, goal_node, node, length)


@compiled
def _cut_branch(space: SearchSpace, tree: Tree, key: np.uint64) -> None:
    """Lead a node of the best path straight to one of its ancestors, if that is valid and shorter."""
    count = tree.counters[BRANCH]
    lower = int(uniform(key, tree.counters[DRAWN]) * (count - 2))
    upper = lower + 2 + int(uniform(key, tree.counters[DRAWN] + 1) * (count - lower - 2))
    tree.counters[DRAWN] += 2
    node, above = tree.branch[lower], tree.branch[min(upper, count - 1)]
    length = distance(tree.states[node], tree.states[above], space.weights)
    shorter = tree.costs[COST, above] + length < tree.costs[COST, node] * _SHORTER
    if shorter and is_free(space, tree.states[above], tree.states[node], length, tree.rows, tree.counters):
        _move(tree, node, above, length)


@compiled
def _draw(space: SearchSpace, tree: Tree, key: np.uint64, best: float) -> None:
    """Write a sample into rows[3]: near the best path, or anywhere where it may shorten the path."""
    counters, sample = tree.counters, tree.rows[3]
    place = counters[DRAWN]
    counters[DRAWN] += 1
    if best < math.inf and uniform(key, place) < _NEAR_PATH:
        edge = 1 + int(uniform(key, place + 1) * (counters[BRANCH] - 1))
        a, b = tree.states[tree.branch[edge - 1]], tree.states[tree.branch[edge]]
        counters[DRAWN] += 1
        counters[DRAWN] += near_edge(space, key, counters[DRAWN], a, b, best, sample)
        return
    for _ in range(8 if best < math.inf else 0):
        goal = tree.goals[int(uniform(key, counters[DRAWN]) * tree.goals.shape[0])]
        inside = within_ellipsoid(
            space, key, counters[DRAWN] + 1, tree.states[0], goal, best, tree.rows[4], sample
        )
        counters[DRAWN] += 2 * sample.size + 4
        if inside:
            return
    counters[DRAWN] += random_state(space, key, counters[DRAWN], sample)


@compiled
def _step(space: SearchSpace, tree: Tree, best: float) -> None:
    """Grow the tree towards the sample in rows[3] by one node, and rewire around it."""
    sample, new = tree.rows[3], tree.rows[5]
    n = sample.size
    count = _neighbors(space, tree, sample)
    near, length = tree.near[0], math.sqrt(tree.squares[0, 0])
    for i in range(n):
        new[i] = sample[i]
        if length > space.reach:
            new[i] = tree.states[near, i] + (sample[i] - tree.states[near, i]) * space.reach / length
    if length <= space.reach * _SAME:
        return
    moved = length > space.reach
    length = min(length, space.reach)
    if (
        distance(tree.states[0], new, space.weights) + distance_to_nearest(new, tree.goals, space.weights)
        >= best
    ):
        return
    steps = step_count(length, space.resolution)
    if last_valid_step(space, tree.states[near], new, steps, tree.counters) < steps:
        return
    known = 0
    if moved:
        count, known = _neighbors(space, tree, new), -1
        for k in range(count):
            if tree.near[k] == near:
                known = k
    count = _join_branch(space, tree, new, count)
    limit = best - distance_to_nearest(new, tree.goals, space.weights)
    parent = _best_parent(space, tree, new, count, limit, known)
    if parent >= 0 and tree.squares[0, 0] > (space.reach * _SAME) ** 2:
        node = _add(space, tree, new, tree.near[parent], math.sqrt(tree.squares[0, parent]))
        _rewire(space, tree, node, count)
        _try_goals(space, tree, node, best)


@compiled
def _record(tree: Tree, seconds: float, cost: float) -> None:
    """Note a better path; small gains, and all when the list is full, renew its last entry."""
    count, history = tree.counters[RECORDS], tree.history
    complete = count < 2 or history[count - 1, 1] < history[count - 2, 1] * (1.0 - _HISTORY_STEP)
    if complete and count < history.shape[0]:
        count += 1
    tree.counters[RECORDS] = count
    history[count - 1, 0] = seconds
    history[count - 1, 1] = cost
    history[count - 1, 2] = tree.counters[ITERATIONS]


@compiled("void(SearchSpace, Tree, float64[:, ::1], int64, float64)")
def plant(space: SearchSpace, tree: Tree, path: Floats2, goal: int, seconds: float) -> None:
    """Make a valid path, shape (k, n), to one of the goals the first branch of the tree."""
    for k in range(path.shape[0]):
        length = distance(path[k - 1], path[k], space.weights) if k else 0.0
        _add(space, tree, path[k], k - 1, length)
    tree.goal_nodes[goal] = path.shape[0] - 1
    _record(tree, seconds, _note_best(tree, math.inf))


@compiled("int64(SearchSpace, Tree, float64, float64, float64, uint64, int64)")
def improve(
    space: SearchSpace,
    tree: Tree,
    seconds: float,
    begun: float,
    target: float,
    key: np.uint64,
    iterations: int,
) -> int:
    """Shorten a path by informed RRT* until it is no longer than a target, or time or iterations run out.

    Args:
        space: Box, metric and validity.
        tree: The tree, with its first branch.
        seconds: Time budget [s].
        begun: Time used before, for the history [s].
        target: Length at which to stop.
        key: Of the stream of random numbers.
        iterations: Samples in all, those of earlier calls included.

    Returns:
        DONE, TIME_UP, or FULL if there may be no room for the nodes of one more iteration.
    """
    counters, place = tree.counters, np.empty(2, np.int64)
    entered = seconds_now(space.clock, place)
    best = tree.costs[COST, tree.goal_nodes[counters[GOAL]]]
    while counters[ITERATIONS] < iterations and best > target:
        if counters[STOP] != 0 or seconds_now(space.clock, place) >= entered + seconds:
            return TIME_UP
        if counters[SIZE] + 1 + tree.goals.shape[0] > tree.states.shape[0]:
            return FULL
        counters[ITERATIONS] += 1
        counters[DRAWN] += 1
        if counters[BRANCH] > 2 and uniform(key, counters[DRAWN] - 1) < _SHORT_CUTS:
            _cut_branch(space, tree, key)
        else:
            _draw(space, tree, key, best)
            _step(space, tree, best)
        better = _note_best(tree, best)
        if better < best:
            best = better
            _record(tree, begun + seconds_now(space.clock, place) - entered, best)
    return DONE
