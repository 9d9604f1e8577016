"""Search for a configuration that touches nothing, where the nearest solution does."""

from __future__ import annotations

import math

import numpy as np

from pepper_kin.core.inverse_kinematics.local_solver import (
    CAUTIOUS_STEPS,
    REFLECTIONS,
    SMALL_GAIN,
    Workspace,
    descend,
    is_free,
    is_over,
    make_workspace,
    reflect,
)
from pepper_kin.core.inverse_kinematics.search import (
    CANDIDATES,
    COLLISION,
    ITERATIONS,
    RESTARTS,
    SEARCH_GAIN,
    SOLVED,
    UNREACHABLE,
    Search,
    agree,
    is_held,
    is_met,
    keep,
    make_problem,
    motion,
    set_bounds,
    write_shifted,
    write_start,
    write_way_start,
)
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2

ROUNDS = (32, 96, 256, 512)
"""Starts of one round after the other of the search among many solutions."""

DESCENTS, STARTS_FOR_TORQUE = 10, 6
"""Descents before their agreement counts; starts that are spent on a solution that the motors cannot hold."""


@compiled
def _search_free_solution(search: Search, workspace: Workspace, answer: Floats1) -> bool:
    """Look through many solutions for one that touches nothing; the starts lie ever farther from q0.

    Of the solutions of one round the nearest to q0 is taken that the motors can hold or, where all that are
    free ask too much of them, the nearest of these.  Further rounds follow only after a full one.
    """
    problem, tests, options = search.problem, search.tests, search.options
    n, t, number = problem.reference.size, problem.tolerance.size, CANDIDATES * options.restarts
    for turn in range(len(ROUNDS)):
        count = min(ROUNDS[turn], options.restarts) if turn == 0 else ROUNDS[turn]
        found, best_held, best_value = False, False, math.inf
        for i in range(count):
            if is_over(problem, workspace):
                return found
            write_way_start(search, workspace, number + i, (i + 1) / count)
            steps_left = options.max_iterations
            for reflection in range(REFLECTIONS + 1):
                if reflection > 0:
                    reflect(problem, workspace.given)
                steps = descend(problem, tests, workspace, steps_left, SEARCH_GAIN, CAUTIOUS_STEPS, False)
                answer[n + t + ITERATIONS] += steps
                steps_left -= steps
                if is_met(problem, workspace) or steps_left <= 0 or workspace.stop[0] != 0:
                    break
            if is_met(problem, workspace) and not problem.stop_when_met:
                answer[n + t + ITERATIONS] += descend(
                    problem, tests, workspace, options.max_iterations, SMALL_GAIN, 0, False
                )
            if not is_met(problem, workspace):
                continue
            held, value = is_held(search, workspace.given), motion(problem, workspace.given)
            better = held and not best_held
            if held == best_held:
                better = value < best_value
            if better and is_free(tests, workspace.given):
                found, best_held, best_value = True, held, value
                keep(workspace, answer, n, t)
        answer[n + t + RESTARTS] += count
        number += count
        if found or count < ROUNDS[0]:
            return found
    return False


FREE, MET, HELD, NEARNESS = range(4)
"""Places in a judgment; of two configurations the better is larger in the first of these in which they
differ."""


@compiled
def _judge(search: Search, workspace: Workspace, judgment: Floats1) -> None:
    """Judge `given`: whether it is free, meets the tasks, can be held, and how near it is.

    It is near to q0 where the tasks are met, else to the target.
    """
    met, cost = is_met(search.problem, workspace), workspace.result[search.problem.tolerance.size]
    judgment[FREE] = is_free(search.tests, workspace.given)
    judgment[MET] = met
    judgment[HELD] = met and is_held(search, workspace.given)
    judgment[NEARNESS] = -motion(search.problem, workspace.given) if met else -cost


@compiled(lean=True)
def _is_better(judgment: Floats1, best: Floats1) -> bool:
    for i in range(judgment.size):
        if judgment[i] != best[i]:
            return judgment[i] > best[i]
    return False


@compiled
def _search_clear(search: Search, workspace: Workspace, met_in_collision: bool, answer: Floats1) -> int:
    """Descend from q0 and further starts; where that ends in collision, once more keeping clear all the way.

    All joints move that may, also those that the tasks do not depend on: they may be in the way.

    Returns:
        SOLVED, COLLISION where the tasks are met only while something touches, else UNREACHABLE.
    """
    problem, tests, options = search.problem, search.tests, search.options
    n, t = problem.reference.size, problem.tolerance.size
    first_met, tries, used, best, judgment = 0, 0, 0, np.full(4, -math.inf), np.empty(4)
    for used in range(-1, options.restarts + 1):  # q0 itself, then descents
        if used > 0 and used % 3 > 0 and met_in_collision and best[FREE] > 0 and best[MET] == 0:
            write_shifted(search, workspace, used, answer)
        elif used > 0:
            write_start(search, workspace, used - 1, -1)
        else:
            workspace.given[:n] = problem.reference
        search.start[:] = workspace.given[:n]
        for clear in (False, True):
            if used >= 0 and is_over(problem, workspace):
                break
            if clear:
                workspace.given[:n] = search.start
            steps, caution = options.max_iterations if used >= 0 else 0, 0 if clear else CAUTIOUS_STEPS
            steps = descend(problem, tests, workspace, steps, SMALL_GAIN, caution, clear)
            answer[n + t + ITERATIONS] += steps
            _judge(search, workspace, judgment)
            if _is_better(judgment, best):
                best[:] = judgment
                keep(workspace, answer, n, t)
            met_in_collision |= judgment[MET] > judgment[FREE]
            search.costs[tries] = workspace.result[t]
            tries += 1 if used >= 0 else 0
            if judgment[FREE] > 0 or used < 0 or not is_free(tests, search.start):
                break
        solved = best[MET] > 0 and best[FREE] > 0
        if solved and first_met == 0 and used >= 0:
            first_met = used + 1
        tried_for_torque = first_met > 0 and used + 1 - first_met >= STARTS_FOR_TORQUE
        agreed = not met_in_collision and agree(search.costs, tries, DESCENTS)
        if (solved and best[HELD] > 0) or tried_for_torque or agreed or workspace.stop[0] != 0:
            break
    answer[n + t + RESTARTS] += max(used, 0)
    if best[MET] > 0 and best[FREE] > 0:
        return SOLVED
    return COLLISION if met_in_collision else UNREACHABLE


@compiled
def search_among_obstacles(
    search: Search, workspace: Workspace, bounds: Floats2, met: bool, answer: Floats1
) -> int:
    """Search on where the configuration that was found touches something; returns the status."""
    if met and _search_free_solution(search, workspace, answer):
        return SOLVED
    if workspace.stop[0] != 0:
        return COLLISION
    tables, options, n = search.tables, search.options, search.start.size
    problem = make_problem(tables, options, n, search.problem.work, search.problem.reference)
    set_bounds(problem, bounds)
    wide = Search(tables, options, search.tests, problem, search.torque, search.costs, search.start)
    larger = make_workspace(workspace.given, problem, search.tests)
    larger.watch[0] = workspace.watch[0]
    status = _search_clear(wide, larger, met, answer)
    workspace.stop[0] = larger.stop[0]
    return status
