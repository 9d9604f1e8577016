"""Replacement of a path's goal by another goal that the path passes near."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2, Ints1

from .deadline import Deadline, load_code
from .motion_validator import machine_code_of
from .path import Path
from .problem import Problem
from .search_space import STOP, SearchSpace, distance, edge_valid, space_of, step_count


class PathTable(NamedTuple):
    """A path for machine code.

    Attributes:
        points: Waypoints, shape (k, n).
        lengths: Arc length at each waypoint, shape (k,).
    """

    points: Floats2
    lengths: Floats1


def rejoin(problem: Problem, path: Path, goal: int, *, gain: float = 0.01) -> tuple[Path, int]:
    """End a path at another goal if a straight edge from one of its waypoints makes it shorter.

    All goals but the path's own are tried from all waypoints but the last.  A search from the start to each
    goal would compare more paths, but each takes as long as the first search.

    Args:
        problem: The problem that was solved; with one goal nothing is tried.
        path: A valid path to one of the goals.
        goal: Index of the path's goal.
        gain: Minimum ratio of the length that has to be saved.

    Returns:
        The path, its new edge valid at the problem's resolution, and the index of its goal; the path and goal
        given if no other is shorter.
    """
    others = [k for k in range(len(problem.goals)) if k != goal]
    if not others:
        return path, goal
    load_code(shortest_end)
    counters, order = np.zeros(STOP + 1, dtype=np.int64), np.array(others, dtype=np.int64)
    with machine_code_of(problem, Deadline(), counters=counters) as code:
        space, route = space_of(problem, code, problem.spacing), PathTable(path.points, path.arc_lengths)
        least = gain * path.length
        last = shortest_end(space, route, problem.goals, order, least, np.empty((2, problem.n)), counters)
    if last < 0:
        return path, goal
    met = int(order[0])
    return Path.trusted(np.vstack([path.points[: last + 1], problem.goals[met]]), problem.metric), met


@compiled("int64(SearchSpace, PathTable, float64[:, ::1], int64[::1], float64, float64[:, ::1], int64[::1])")
def shortest_end(
    space: SearchSpace,
    route: PathTable,
    goals: Floats2,
    order: Ints1,
    gain: float,
    rows: Floats2,
    counters: Ints1,
) -> int:
    """Return the waypoint from which a straight edge to a goal makes the shortest path; -1 for none.

    Args:
        space: Box, metric and validity.
        route: The path.
        goals: Goals, shape (m, n).
        order: Indices of the goals that are tried, in order; order[0] becomes the goal that is reached.
        gain: Minimum length that has to be saved [length unit of the metric].
        rows: Scratch space, shape (2, n).
        counters: Counters of the planner, see `search_space.STATES`.
    """
    points, lengths = route.points, route.lengths
    best, found, met = lengths[-1] - gain, -1, -1
    for k in range(points.shape[0] - 1):
        for place in range(order.size):
            goal = goals[order[place]]
            way = distance(points[k], goal, space.weights)
            if not (lengths[k] + way < best and way < math.inf):
                continue
            steps = step_count(way, space.resolution)
            if counters[STOP] == 0 and edge_valid(space, points[k], goal, steps, rows, counters, True):
                best, found, met = lengths[k] + way, k, order[place]
    if found >= 0:
        order[0] = met
    return found
