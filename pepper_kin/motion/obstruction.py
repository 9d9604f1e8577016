"""Obstructions: the bodies that block a path that was not found."""

from __future__ import annotations

from collections import Counter

from pepper_kin import planners
from pepper_kin.arrays import Array
from pepper_kin.motion.plan_result import PlanStatus
from pepper_kin.motion.problem import PathProblem

_STATES = 40  # number of motions whose ends are examined by coal, one to two milliseconds each

_SHUT_IN = {
    planners.Status.START_SHUT_IN: PlanStatus.START_SHUT_IN,
    planners.Status.GOAL_SHUT_IN: PlanStatus.GOAL_SHUT_IN,
}


def why_no_path(
    problem: PathProblem,
    result: planners.Result,
    seed: int,
    manifold: planners.ConstraintManifold | None = None,
) -> tuple[PlanStatus, str]:
    """Return the status of a search without a path, and a sentence that names the most frequent obstruction.

    Args:
        problem: The planning problem, at the smallest margin that was tried.
        result: Result of the planner.
        seed: Seed of the trial motions that find the obstruction.
        manifold: Constraints that the trial motions have to keep; None for none.
    """
    message = f"No path: {result.states_checked} configurations were checked in {result.time:.2f} s"
    status = _SHUT_IN.get(result.status, PlanStatus.NO_PATH_IN_TIME)
    if problem.margins_relaxed:
        message += f" with a margin relaxed to {1000 * problem.margins[0]:.2g} mm"
    names, free = problem.checks.pepper.joint_names, problem.free.tolist()
    moved = ", ".join(names[j] for j in free)
    only = "" if len(free) == len(names) else f" Only {moved} may move; `joints=` frees others."
    if result.tree_sizes is None:
        return status, f"{message}.{only}"
    start, goal = result.tree_sizes
    message += f"; the tree of the start grew to {start} of them, that of the goal to {goal}."
    message += only
    if result.frontier is None:
        return status, message
    if manifold is None:
        states = planners.first_invalid_states(problem.search_problem, result.frontier, _STATES, seed=seed)
        return status, message + in_the_way(problem, problem.embed(states))
    states, ended = planners.first_blocked_states(
        problem.search_problem, manifold, result.frontier, _STATES, seed=seed
    )
    return status, message + in_the_way(problem, problem.embed(states), ended)


def in_the_way(problem: PathProblem, states: Array, others: Counter[str] | None = None) -> str:
    """Return a sentence that names the most frequent obstruction of motions; empty if there is none.

    Args:
        problem: The planning problem.
        states: Configurations at which motions were stopped [rad or m], shape (m, n).
        others: Other reason, such as a constraint -> number of further motions that it stopped.
    """
    checker, counts = problem.checks.exact.with_margins(*problem.margins), Counter(others or {})
    links = Counter[tuple[str, str]]()
    objects = set(checker.scene.objects)
    for q in states:
        named = set()
        for pair in checker.contacts(q):
            things = [name for name in pair if name in objects]
            rest = " and ".join(name for name in pair if name not in objects)
            named.add(things[0] if things else rest)
            if things:
                links[things[0], rest] += 1
        if not named and not problem.checks.holds(q[None])[0]:
            named.add(problem.checks.statics.short_of(q))
        counts.update(named)
    if not counts:
        return ""
    name, count = counts.most_common(1)[0]
    touched = [(number, link) for (thing, link), number in links.items() if thing == name]
    link = f", mostly of {max(touched)[1]}" if touched else ""
    total = len(states) + sum((others or {}).values())
    return f" Most often in the way there: {name}{link} ({count} of {total} motions)."
