"""Multi-start search for many targets: descents from q0 and from further starts."""

from __future__ import annotations

import math

from pepper_kin.core.inverse_kinematics.local_solver import (
    CAUTIOUS_STEPS,
    REFLECTIONS,
    SMALL_GAIN,
    CollisionTests,
    Workspace,
    descend,
    evaluate,
    is_free,
    is_over,
    keep_near,
    look_around,
    make_workspace,
    reflect,
)
from pepper_kin.core.inverse_kinematics.search import (
    CLEARING,
    COLLISION,
    ITERATIONS,
    RESTARTS,
    SEARCH_GAIN,
    SOLVED,
    STATUS,
    STOP,
    UNREACHABLE,
    MultiStartSearch,
    SearchOptions,
    TaskTables,
    agree,
    is_held,
    is_met,
    keep,
    make_search,
    motion,
    set_row,
    status_of,
    write_start,
    write_straightened,
)
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2

DESCENTS_PER_JOINT = 5
"""Minimum number of descents per joint before agreement of their costs ends the search."""

NEAR_MISS, DESCENTS_PER_JOINT_NEAR = 0.1, 2
"""Weighted distance below which agreeing descents may have missed a target that is hard to enter, and minimum
number of descents per joint there.  After them, all starts are used, and instead of reflections, which lead
from the same minimum to the same end, further points of the unit cube."""

STRAIGHTENED, STARTS_FOR_TORQUE = (1.0, 1.5), 3
"""Ratios by which heavily loaded joints of a solution that the motors cannot hold are moved back towards q0,
and total number of starts spent on such a solution: another solution nearby can mostly be held."""


@compiled(lean=True)
def _descend_aside(search: MultiStartSearch, workspace: Workspace, steps: int) -> int:
    """Descend from q0, away from nearby bodies as far as the tasks permit; return the number of steps.

    Bodies in which a first solution collides are mostly near at q0 already: in Stand, wrists are 3 mm from
    the pelvis.  Distances are measured once and linearized in q, which takes as long as four steps; of hand
    positions in reach, 15 % then need the second stage, and 64 % without it.
    """
    problem, tests, start = search.problem, search.tests, search.start
    same, taken = True, 0
    for i in range(start.size):
        same = same and start[i] == workspace.inputs[i]
        start[i] = workspace.inputs[i]
    if not same:  # else the nearby pairs are those of the row before
        look_around(tests, workspace, start, CLEARING)
    keep_near(workspace)
    if workspace.near_count[0] > 0:
        taken = descend(problem, tests, workspace, steps, SEARCH_GAIN, CAUTIOUS_STEPS, CLEARING, True)
        if is_met(problem, workspace):
            return taken
    return taken + descend(problem, tests, workspace, steps - taken, SEARCH_GAIN, CAUTIOUS_STEPS, 0.0, False)


@compiled(lean=True)
def _search(search: MultiStartSearch, workspace: Workspace, answer: Floats1) -> bool:
    """Descend from `inputs` and further starts until a good solution; collisions are mostly ignored.

    Only the first descent moves away from bodies near q0.

    Args:
        search: The search.
        workspace: Workspace of the search; `inputs` holds the start.
        answer: Output, see `solve_rows`, shape (n + t + EXTRA,).

    Returns:
        Whether the tasks are met.
    """
    problem, tests, options = search.problem, search.tests, search.options
    n, t = problem.reference.size, problem.tolerance.size
    evaluate(problem, workspace.inputs, workspace.result)
    best_met = is_met(problem, workspace)
    best_held = best_met and is_held(search, workspace.inputs)
    best_value = 0.0 if best_met else workspace.result[t]
    keep(workspace, answer, n, t)
    iterations, first_met, used, tries, agreed, ended = 0, 0, 0, 0, False, False
    timed = problem.deadline < math.inf
    for number in range(options.restarts + 2):
        if number <= options.restarts and not ended:
            used, ended = number, (number > 0 or timed) and is_over(problem, workspace)
        else:
            ended = True
        if ended:  # one more descent, which converges fully, from the best so far
            if (best_met and problem.stop_when_met) or workspace.stop[0] != 0:
                break
            for i in range(n):
                workspace.inputs[i] = answer[i]
        elif first_met > 0 and used - first_met < len(STRAIGHTENED):
            write_straightened(search, workspace, STRAIGHTENED[used - first_met], answer)
        elif used > 0:
            write_start(search, workspace, used - 1, 0 if agreed else -1)
        gain, cautious_steps = (SMALL_GAIN, 0) if ended else (SEARCH_GAIN, CAUTIOUS_STEPS)
        steps_left = options.max_iterations
        for turn in range(REFLECTIONS + 1):
            if turn > 0 and agreed:
                write_start(search, workspace, used - 1, turn)
            elif turn > 0:
                reflect(problem, workspace.inputs)
            if tests.near != 0 and number == 0 and turn == 0 and not ended:
                steps = _descend_aside(search, workspace, steps_left)
            else:
                steps = descend(problem, tests, workspace, steps_left, gain, cautious_steps, 0.0, False)
            iterations, steps_left = iterations + steps, steps_left - steps
            met = is_met(problem, workspace)
            if ended:
                best_met = met
                keep(workspace, answer, n, t)
                break
            held = met and is_held(search, workspace.inputs)
            value = motion(problem, workspace.inputs) if met else workspace.result[t]
            search.costs[tries] = workspace.result[t]
            tries += 1
            better = met and not best_met
            if met == best_met:
                better = (held and not best_held) or (held == best_held and value < best_value)
            if better:
                best_met, best_held, best_value = met, held, value
                keep(workspace, answer, n, t)
            near = not best_met and best_value < 0.5 * NEAR_MISS**2
            enough = (DESCENTS_PER_JOINT_NEAR if near else DESCENTS_PER_JOINT) * problem.joints.size
            agreed = agree(search.costs, tries, enough)
            settled = agreed and not near
            if met or steps_left <= 0 or settled or workspace.stop[0] != 0:
                break
        if ended:
            break
        if best_met and first_met == 0:
            first_met = used + 1
        tried_for_torque = first_met > 0 and used + 1 - first_met >= STARTS_FOR_TORQUE
        ended = (best_met and best_held) or tried_for_torque or settled
    answer[n + t + ITERATIONS] += iterations
    answer[n + t + RESTARTS] += used
    return best_met


@compiled(
    "void(TaskTables, float64[:, ::1], SearchOptions, CollisionTests, float64[:, ::1], float64[:, ::1], "
    "int64, int64)"
)
def solve_rows(
    tables: TaskTables,
    bounds: Floats2,
    options: SearchOptions,
    tests: CollisionTests,
    inputs: Floats2,
    answers: Floats2,
    begin: int,
    end: int,
) -> None:
    """Solve for each row of `inputs` from `begin` to `end`.

    `finish_rows` continues with rows that end UNREACHABLE or in a COLLISION.

    Args:
        tables: The robot and tasks.
        bounds: Lower and upper bounds of `tables.joints` [rad or m], and whether they move, shape (3, n).
        options: Options of the search.
        tests: Collision tests; all zero if collisions are not considered.
        inputs: q0 [rad or m], weights and targets, see `Workspace.inputs`, shape (N, n + t + ...).
        answers: Output: q [rad or m], squared errors, and EXTRA numbers, shape (N, n + t + EXTRA).
        begin: Index of the first row.
        end: Index after the last row.
    """
    n, t = tables.effort.size, options.tolerance.size
    search = make_search(tables, options, tests)
    workspace = make_workspace(inputs[begin], search.problem, tests)
    search.start[:] = math.nan
    for row in range(begin, end):
        answer = answers[row]
        answer[n + t :] = 0.0
        set_row(search, workspace, bounds, inputs[row])
        status = SOLVED if _search(search, workspace, answer) else UNREACHABLE
        if not is_free(tests, answer):
            status = COLLISION
        status = status_of(workspace, status)
        answer[n + t + STATUS] = status
        if status == STOP:
            break
