"""Improvement of a path towards the shortest one, for as long as there is time."""

from __future__ import annotations

import math

import numpy as np

from pepper_kin.exceptions import InvalidValueError

from .deadline import Deadline
from .path import Path
from .problem import Problem
from .result import Result, Status
from .vectors import FloatArray, whole_number

_UNLIMITED = 2**62


def improve(
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

    It runs as machine code.  An oracle that is a Python callable is called back from there, which gives the
    same result, later.

    Args:
        problem: Supplies the box, the metric, the oracle and the goals: the path may end at any of them, or
            where it ended.  Its start is not used.
        path: A valid path, which is not checked again.
        seed: Seed of the samples.
        timeout: Time budget [s]; all of it is used unless the path becomes as short as the target, or as the
            straight line to the nearest goal.
        max_iterations: Greatest number of samples.  Without it the time budget decides, and the result
            depends on the speed of the machine.
        target: Length that is good enough [length unit of the metric].
        resolution: Greatest distance between checked states of an edge [length unit of the metric]; the
            problem's if omitted.  Short paths graze obstacles: let the oracle keep a margin.

    Returns:
        The result, with the history of costs; its status is always SOLVED.

    Raises:
        InvalidValueError: The path has another number of coordinates, or an option is not allowed.
    """
    from . import compiled_star  # noqa: F401  (loads machine code, which is not this run's time)

    deadline = Deadline(timeout)
    if path.n != problem.n:
        raise InvalidValueError(
            "path", f"{path.n} coordinates", f"{problem.n} coordinates, as in the problem"
        )
    seed = whole_number("seed", seed)
    iterations = _UNLIMITED if max_iterations is None else whole_number("max_iterations", max_iterations)
    return _improved(problem, path, deadline, seed, iterations, target, resolution)


def _improved(
    problem: Problem,
    path: Path,
    deadline: Deadline,
    seed: int,
    iterations: int,
    target: float,
    resolution: float | None,
) -> Result:
    from .compiled_star import improve_compiled

    goals, goal = _goals_of(problem, path)
    least = _least_length(problem, path, goals, target)
    spacing = problem.counting_oracle(resolution=resolution).resolution
    found = improve_compiled(
        problem, path.points.copy(), goals, goal, deadline, seed, iterations, least, spacing
    )
    better = Path.trusted(found.points, problem.metric)
    return Result(
        status=Status.SOLVED,
        path=better,
        goal_index=found.goal if found.goal < len(problem.goals) else None,
        cost=better.length,
        iterations=found.iterations,
        states_checked=found.states,
        oracle_calls=found.calls,
        time=deadline.elapsed,
        seed=seed,
        history=found.history,
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
