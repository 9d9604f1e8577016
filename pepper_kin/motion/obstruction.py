"""What is in the way where no path is found."""

from __future__ import annotations

from collections import Counter

from pepper_kin import planners
from pepper_kin.motion.plan_result import PlanStatus
from pepper_kin.motion.problem import Array, PathProblem

_STATES = 40  # motions; where they end is looked at by coal, one to two milliseconds each

_SHUT_IN = {
    planners.Status.START_SHUT_IN: PlanStatus.START_SHUT_IN,
    planners.Status.GOAL_SHUT_IN: PlanStatus.GOAL_SHUT_IN,
}


def why_no_path(room: PathProblem, result: planners.Result, seed: int) -> tuple[PlanStatus, str]:
    """Return the status of a search without a path, and a sentence that names what was most often in the way.

    Args:
        room: What was planned.
        result: What the planner returned.
        seed: Seed of the motions that are tried to find out.
    """
    message = f"No path: {result.states_checked} configurations were checked in {result.time:.2f} s"
    status = _SHUT_IN.get(result.status, PlanStatus.NO_PATH_IN_TIME)
    if result.tree_sizes is None:
        return status, f"{message}."
    start, goal = result.tree_sizes
    message += f"; the tree of the start grew to {start} of them, that of the goal to {goal}."
    if result.frontier is None:
        return status, message
    states = planners.first_invalid_states(room.problem, result.frontier, _STATES, seed=seed)
    return status, message + _in_the_way(room, room.embed(states))


def _in_the_way(room: PathProblem, states: Array) -> str:
    """Return a sentence that names what stops the robot most often at configurations, shape (m, n)."""
    checker, counts = room.checks.exact.with_margins(*room.margins), Counter[str]()
    links = Counter[tuple[str, str]]()
    objects = set(checker.scene.objects)
    for q in states:
        named = set()
        for pair in checker.contacts(q):
            things = [name for name in pair if name in objects]
            others = " and ".join(name for name in pair if name not in objects)
            named.add(things[0] if things else others)
            if things:
                links[things[0], others] += 1
        if not named and not room.checks.holds(q[None])[0]:
            named.add("a joint's torque")
        counts.update(named)
    if not counts:
        return ""
    name, count = counts.most_common(1)[0]
    touched = [(number, link) for (thing, link), number in links.items() if thing == name]
    link = f", mostly of {max(touched)[1]}" if touched else ""
    return f" Most often in the way there: {name}{link} ({count} of {len(states)} motions)."
