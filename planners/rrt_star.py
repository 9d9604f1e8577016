"""A first path quickly, and then a better and better one."""

from __future__ import annotations

from dataclasses import replace

from .deadline import Deadline
from .improve import improve
from .problem import Problem
from .result import Improvement, Result
from .rrt_connect import rrt_connect
from .shortcut import shortcut

_SHORTCUT_SHARE = 0.1  # of the time budget
_LEAST = 1e-9  # [s]; a budget is above zero


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
    `improve` does the rest; where goals are drawn by a sampler, the one that was reached is kept.

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
        InvalidValueError: An option is not allowed, or the oracle answers in a wrong shape.
    """
    from . import compiled_star  # noqa: F401  (loads machine code, which is not the search's time)

    deadline = Deadline(timeout)
    limit = {} if max_iterations is None else {"max_iterations": max_iterations}
    first = rrt_connect(problem, seed=seed, timeout=timeout, **limit)
    if first.path is None or deadline.expired:
        return first
    spacing = problem.spacing if resolution is None else resolution
    brief = max(min(_SHORTCUT_SHARE * timeout, deadline.left), _LEAST)
    path = shortcut(problem, first.path, seed=seed, timeout=brief, resolution=spacing)
    begun = deadline.elapsed
    if deadline.expired:
        return replace(first, path=path, cost=path.length, time=begun)
    better = improve(
        problem,
        path,
        seed=seed,
        timeout=max(deadline.left, _LEAST),
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
        oracle_calls=first.oracle_calls + better.oracle_calls,
        time=deadline.elapsed,
        history=(Improvement(first.time, first.cost, 0), *later),
    )
