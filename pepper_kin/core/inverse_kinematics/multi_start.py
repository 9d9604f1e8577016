"""Multi-start search: descents from q0 and from further starts, for many targets."""

from __future__ import annotations

import math

import numpy as np

from pepper_kin.core.inverse_kinematics.collision_free_search import (
    FIRM_CLEARING,
    clear_solution,
    search_among_obstacles,
)
from pepper_kin.core.inverse_kinematics.local_solver import (
    CAUTIOUS_STEPS,
    REFLECTIONS,
    SMALL_GAIN,
    TIMED_OUT,
    CollisionTests,
    SolverProblem,
    Workspace,
    descend,
    evaluate,
    is_free,
    is_over,
    make_workspace,
    reflect,
)
from pepper_kin.core.inverse_kinematics.search import (
    COLLISION,
    ITERATIONS,
    LIMITS,
    RESTARTS,
    SEARCH_GAIN,
    SOLVED,
    STATUS,
    STOP,
    TIME,
    UNREACHABLE,
    Search,
    SearchOptions,
    TaskTables,
    agree,
    is_held,
    is_met,
    keep,
    make_problem,
    motion,
    set_bounds,
    write_start,
    write_straightened,
)
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2

STARTS_WITHOUT_LIMITS, STEPS_WITHOUT_LIMITS = 3, 60
"""Starts and steps for the question whether the joints without limits would reach the target."""

DESCENTS_PER_JOINT = 5
"""Descents for each joint before their agreement counts."""

NEAR_MISS, DESCENTS_PER_JOINT_NEAR = 0.1, 2
"""Below this weighted distance, what descents agree on may be a near miss of a target whose way in is narrow.
After so many for each joint starts are taken as they come, until none is left, and in place of reflections,
which lead from the same minimum to the same end, further points of their numbers."""

STRAIGHTENED, STARTS_FOR_TORQUE = (1.0, 1.5), 3
"""A solution that the motors cannot hold leans too far.  With the joints that carry much put back to where q0
has them, or beyond, it is near another that mostly can be held; then further starts are tried, so many in
all."""


@compiled(lean=True)
def _search(search: Search, workspace: Workspace, answer: Floats1) -> bool:
    """Descend from `inputs` and, until a good solution, from further starts; collisions are left out.

    Args:
        search: The search.
        workspace: Its workspace; `inputs` holds the start.
        answer: Written, see `solve_rows`, shape (n + t + EXTRA,).

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
    iterations, first_met, used, tries, agreed, near = 0, 0, 0, 0, False, False
    timed = problem.deadline < math.inf
    for used in range(options.restarts + 1):
        if (used > 0 or timed) and is_over(problem, workspace):
            break
        if first_met > 0 and used - first_met < len(STRAIGHTENED):
            write_straightened(search, workspace, STRAIGHTENED[used - first_met], answer)
        elif used > 0:
            write_start(search, workspace, used - 1, 0 if agreed else -1)
        steps_left = options.max_iterations
        for turn in range(REFLECTIONS + 1):
            if turn > 0 and agreed:
                write_start(search, workspace, used - 1, turn)
            elif turn > 0:
                reflect(problem, workspace.inputs)
            steps = descend(problem, tests, workspace, steps_left, SEARCH_GAIN, CAUTIOUS_STEPS, 0.0)
            iterations, steps_left = iterations + steps, steps_left - steps
            met = is_met(problem, workspace)
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
            if met or steps_left <= 0 or (agreed and not near) or workspace.stop[0] != 0:
                break
        if best_met and first_met == 0:
            first_met = used + 1
        tried_for_torque = first_met > 0 and used + 1 - first_met >= STARTS_FOR_TORQUE
        if (best_met and best_held) or tried_for_torque or (agreed and not near):
            break
    if not (best_met and problem.stop_when_met) and workspace.stop[0] == 0:
        for i in range(n):
            workspace.inputs[i] = answer[i]
        iterations += descend(problem, tests, workspace, options.max_iterations, SMALL_GAIN, 0, 0.0)
        best_met = is_met(problem, workspace)
        keep(workspace, answer, n, t)
    answer[n + t + ITERATIONS] += iterations
    answer[n + t + RESTARTS] += used
    return best_met


@compiled
def _is_met_without_limits(search: Search, workspace: Workspace, moves: Floats1, answer: Floats1) -> bool:
    """Whether the same joints meet the tasks once their limits are taken away.

    Args:
        search: The search with limits.
        workspace: Its workspace, overwritten.
        moves: Whether each joint of `tables.joints` moves (0 or 1), shape (n,).
        answer: The best configuration so far, see `solve_rows`, shape (n + t + EXTRA,).
    """
    bounded, tests, options = search.problem, search.tests, search.options
    m, n = bounded.joints.size, bounded.reference.size
    low, high = np.empty(m), np.empty(m)
    for i in range(m):
        low[i] = -math.inf if moves[i] > 0 else bounded.low[i]
        high[i] = math.inf if moves[i] > 0 else bounded.high[i]
    problem = SolverProblem(
        bounded.kernel, bounded.work, bounded.task_joints, bounded.joints, low, high, bounded.scale,
        bounded.reference, bounded.tolerance, bounded.stop_when_met, bounded.clock, bounded.deadline,
        bounded.signals,
    )  # fmt: skip
    free = Search(search.tables, options, tests, problem, search.torque, search.costs, search.start)
    for number in range(min(STARTS_WITHOUT_LIMITS, options.restarts) + 2):
        if workspace.stop[0] != 0 or is_over(problem, workspace):
            return False
        if number == 0:
            workspace.inputs[:n] = answer[:n]
        elif number == 1:
            workspace.inputs[:n] = problem.reference
        else:
            write_start(free, workspace, number - 2, -1)
        steps = min(STEPS_WITHOUT_LIMITS, options.max_iterations)
        descend(problem, tests, workspace, steps, SMALL_GAIN, 0, 0.0)
        if is_met(problem, workspace):
            return True
    return False


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

    Args:
        tables: The robot and tasks.
        bounds: Lower and upper bounds of `tables.joints` [rad or m], and whether they move, shape (3, n).
        options: How much to search.
        tests: Of collisions; only zeros where these are not considered.
        inputs: q0 [rad or m], weights and targets, see `Workspace.inputs`, shape (N, n + t + ...).
        answers: q [rad or m], squared errors, and EXTRA numbers, shape (N, n + t + EXTRA), written.
        begin: First row.
        end: One after the last row.
    """
    n, t, work = tables.effort.size, options.tolerance.size, np.empty(tables.work_size)
    problem = make_problem(tables, options, tables.task_joints, work, np.empty(n))
    costs = np.empty((options.restarts + 2) * (REFLECTIONS + 1))
    search = Search(tables, options, tests, problem, np.empty(n), costs, np.empty(n))
    workspace = make_workspace(inputs[begin], problem, tests)
    for row in range(begin, end):
        answer = answers[row]
        answer[n + t :] = 0.0
        problem.reference[:] = inputs[row, :n]
        workspace.inputs[:] = inputs[row]
        workspace.trial[:] = inputs[row]
        set_bounds(problem, bounds)
        met = _search(search, workspace, answer)
        status = SOLVED if met else UNREACHABLE
        if not is_free(tests, answer):
            status = COLLISION
            if workspace.stop[0] == 0 and options.thorough:
                status = search_among_obstacles(search, workspace, bounds, met, answer)
            elif workspace.stop[0] == 0:
                status = clear_solution(search, workspace, met, answer)
        if (
            status == UNREACHABLE
            and options.thorough
            and _is_met_without_limits(search, workspace, bounds[2], answer)
        ):
            status = LIMITS
        if workspace.stop[0] != 0 and status != SOLVED:
            status = TIME if workspace.stop[0] == TIMED_OUT else STOP
        answer[n + t + STATUS] = status
        if status == STOP:
            break


@compiled(
    "int64(TaskTables, float64[:, ::1], SearchOptions, CollisionTests, float64[::1], float64[::1], boolean)"
)
def descend_row(
    tables: TaskTables,
    bounds: Floats2,
    options: SearchOptions,
    tests: CollisionTests,
    inputs: Floats1,
    reference: Floats1,
    clear: bool,
) -> int:
    """Descend from the start in a row of input, which becomes the result; returns the steps proposed.

    Args:
        tables: The robot and tasks.
        bounds: See `solve_rows`, shape (3, n).
        options: Its tolerances and number of steps count.
        tests: Of collisions.
        inputs: A row of input, see `Workspace.inputs`, shape (n + t + ...,).
        reference: q_ref of the posture term, and positions of the joints that may not move, shape (n,).
        clear: Whether to keep clear of collisions; then joints move that no task depends on, too.
    """
    n, work = tables.effort.size, np.empty(tables.work_size)
    problem = make_problem(tables, options, n if clear else tables.task_joints, work, reference)
    set_bounds(problem, bounds)
    workspace = make_workspace(inputs, problem, tests)
    steps = descend(
        problem,
        tests,
        workspace,
        options.max_iterations,
        SMALL_GAIN,
        0 if clear else CAUTIOUS_STEPS,
        FIRM_CLEARING[0] if clear else 0.0,
    )
    inputs[:] = workspace.inputs
    return steps
