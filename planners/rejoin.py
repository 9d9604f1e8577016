"""Other goals that a path to one of them passes near."""

from __future__ import annotations

import numpy as np

from .compiled_validity import CompiledValidity
from .path import Path
from .problem import Problem


def rejoin(problem: Problem, path: Path, goal: int, *, gain: float = 0.01) -> tuple[Path, int]:
    """End a path at another goal where a straight edge from one of its way-points makes it shorter.

    All goals but the path's own are tried from all way-points but the last.  A search from the start to each
    goal would compare more, and takes as long as the first search each time.

    Args:
        problem: What was planned; several goals, and an oracle that is machine code, or nothing is tried.
        path: A valid path to one of the goals.
        goal: Number of that goal.
        gain: Part of the length that has to be saved.

    Returns:
        The path, its new edge valid at the problem's resolution, and the number of its goal; those given
        where no other is shorter.
    """
    oracle, others = problem.oracle, [k for k in range(len(problem.goals)) if k != goal]
    if not others or not isinstance(oracle, CompiledValidity):
        return path, goal
    from .compiled_world import world_of
    from .native_rejoin import shortest_end

    world, order = world_of(problem, oracle, problem.spacing), np.array(others, dtype=np.int64)
    points, lengths = np.array(path.points), np.array(path.arc_lengths)
    rows, counters = np.empty((2, problem.n)), np.zeros(2, dtype=np.int64)
    goals, least = np.array(problem.goals), gain * path.length
    last = shortest_end(world, points, lengths, goals, order, least, rows, counters)
    if last < 0:
        return path, goal
    met = int(order[0])
    return Path.trusted(np.vstack([points[: last + 1], goals[met]]), problem.metric), met
