"""Plans to any of several goals that are given as tasks, such as the grasps of one object."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import chain
from typing import NamedTuple, TypeAlias, TypeGuard

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.ik import IKResult, Task, TaskGroup
from pepper_kin.ik.problem import flatten_tasks
from pepper_kin.kernels.working_time import working_time
from pepper_kin.motion.goal_search import TaskGoals, clear_goals
from pepper_kin.motion.goals import ends_of
from pepper_kin.motion.plan_request import CheckedRequest, PlanRequest, are_known_to_fast, are_tasks
from pepper_kin.motion.plan_result import Plan, PlanStatus

TOGETHER = 2
"""Alternatives that one search may end at."""

_SOON, _LEAST_TIME = 1e-3, 2e-3  # [s]

Alternatives: TypeAlias = Sequence[Sequence[Task | TaskGroup]]


class _Goal(NamedTuple):
    """Configurations, shape (m, n), that meet one of the alternatives, and its number."""

    number: int
    configurations: Array
    ik: IKResult | None


def are_alternatives(goal: object) -> TypeGuard[Alternatives]:
    """Return whether a goal is lists of IK tasks, any of which will do."""
    return isinstance(goal, Sequence) and len(goal) > 0 and all(are_tasks(one) for one in goal)


def plan_to_any(asked: PlanRequest, search: Callable[[PlanRequest], Plan]) -> Plan:
    """Plan to the alternative to which a path is found first.

    The alternatives are tried from that on which the start is nearest to meeting, each for a millisecond,
    since one that cannot be met takes a hundred.  Where two of them are met, or all were tried, a path to any
    of the configurations is searched.  Where there is none, the others are tried for longer.

    Args:
        asked: What was asked for, whose goal is lists of IK tasks, each a goal by itself.
        search: Plans to configurations.

    Returns:
        The plan, with the number of its alternative; where there is none, the last that failed, one whose
        tasks were met if there is any.
    """
    still, alternatives, timeout = asked.with_options(start_velocity=None), asked.goal, asked.options.timeout
    requests = [replace(still, goal=list(tasks)).checked() for tasks in alternatives]
    order = np.argsort([_farness(request) for request in requests], kind="stable").tolist()
    begin, failed, hard = requests[0].ended.begin, list[Plan](), list[int]()

    def left() -> float:
        return begin + timeout - working_time()

    def soon() -> Iterator[_Goal]:
        for number in order:
            found = _at_once(requests[number])
            if found is None:
                hard.append(number)
            else:
                yield _Goal(number, found.goals, found.ik)

    def later() -> Iterator[_Goal]:
        for count, number in enumerate(hard):
            if left() <= _LEAST_TIME:
                return
            share = still.with_options(timeout=left() / (2 * (len(hard) - count)))
            ends = ends_of(replace(share, goal=list(alternatives[number])).checked())
            if not isinstance(ends, Plan):
                yield _Goal(number, ends.goals, ends.ik)
            elif ends.success:  # the start is this goal
                yield _Goal(number, requests[number].start[None], ends.ik)
            else:
                failed.append(ends)

    for goals in chain(_together(soon()), _together(later())):
        rows = np.concatenate([goal.configurations for goal in goals])
        found = search(replace(asked.with_options(timeout=max(left(), _LEAST_TIME)), goal=rows))
        if found.success:
            return _named(replace(found, time=working_time() - begin), goals, len(alternatives))
        failed.append(found)
    if not failed:  # the time was up before any was tried to the end
        failed.append(requests[0].ended(PlanStatus.NO_PATH_IN_TIME, "The time was up."))
    last = ([plan for plan in failed if plan.status is not PlanStatus.NO_IK] or failed)[-1]
    message = f"None of {len(alternatives)} goals; of the last: {last.message}"
    return replace(last, message=message, time=working_time() - begin)


def _farness(request: CheckedRequest) -> float:
    """Return how far the start is from meeting an alternative, in its tasks' own units."""
    parts = flatten_tasks(request.checks.pepper, request.goal)
    errors = [part.residual(request.checks.pepper, request.start) for part in parts]
    return float(np.linalg.norm(np.concatenate(errors)))


def _at_once(request: CheckedRequest) -> TaskGoals | None:
    """Return what meets an alternative, if that is found soon."""
    options = request.options
    if options.least_margin > 0.0 or not are_known_to_fast(request.checks.pepper, request.goal):
        return None
    return clear_goals(
        request.checks, request.start, request.goal, options.joints, options.margin, request.seed, _SOON,
        nearby=True,
    )  # fmt: skip


def _together(goals: Iterator[_Goal]) -> Iterator[list[_Goal]]:
    """Yield goals by twos, the last of them fewer."""
    some: list[_Goal] = []
    for goal in goals:
        some.append(goal)
        if len(some) == TOGETHER:
            yield some
            some = []
    if some:
        yield some


def _named(plan: Plan, goals: list[_Goal], count: int) -> Plan:
    """Return a plan with the alternative that it ends at."""
    assert plan.goal is not None
    end = plan.goal
    reached = min(goals, key=lambda goal: float(np.abs(goal.configurations - end).max(axis=1).min()))
    message = f"{plan.message.rstrip()} It ends at goal {reached.number} of {count}, counted from 0."
    return replace(plan, message=message, ik=reached.ik, alternative=reached.number)
