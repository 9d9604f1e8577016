"""Second stage of a search, when the nearest solution collides or the targets are out of reach."""

from __future__ import annotations

import math

import numpy as np

from pepper_kin.core.inverse_kinematics.local_solver import (
    CAUTIOUS_STEPS,
    SMALL_GAIN,
    CollisionTests,
    SolverProblem,
    Workspace,
    descend,
    evaluate,
    fraction_of_tolerance,
    is_free,
    is_over,
    keep_near,
    look_around,
    make_workspace,
)
from pepper_kin.core.inverse_kinematics.search import (
    CANDIDATES,
    CLEARING,
    COLLISION,
    ITERATIONS,
    LIMITS,
    RESTARTS,
    SEARCH_GAIN,
    SOLVED,
    STATUS,
    STOP,
    UNREACHABLE,
    MultiStartSearch,
    SearchOptions,
    TaskTables,
    is_held,
    is_met,
    keep,
    make_problem,
    make_search,
    motion,
    set_bounds,
    set_row,
    status_of,
    write_shifted,
    write_start,
    write_straightened,
    write_way_start,
)
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2

FIRM_CLEARING = 10.0, 100.0
"""Weights of clearance shortfalls, tried in order, where the tasks cannot be met without collisions and must
not pull anything into contact."""

FEW_STARTS, STARTS, WIDE_STARTS = 3, 12, 32
"""Numbers of starts: of rounds with the joints of the tasks, before and after a descent with all joints, and
of each round with all joints; the starts of a round lie ever farther from q0."""

ALONG_STEPS, ALONG_TURNS = 12, 2
"""Maximum number of steps with linearized distances, and of measurements of the distances, each of which
costs as much as some steps."""

WIDE_ROUNDS = 12
"""Maximum number of rounds with all joints."""

STARTS_FOR_TORQUE, STRAIGHTENED = 4, (1.0, 1.5)
"""Number of starts spent on a solution that the motors cannot hold, and how far the first starts move its
heavily loaded joints back towards q0, as a ratio: all the way, or beyond."""

CLOSEST_STARTS = 24
"""Maximum number of starts of the search for the closest collision-free configuration."""

SHIFTS, VAIN_SHIFTS = 96, 32
"""Maximum number of random shifts of the closest configuration so far, each followed by a descent, and of
successive shifts without a gain (iterated local search: Lourenco, Martin and Stutzle, 2003)."""

GAINED = 1e-3
"""Minimum gain relative to the cost that counts: half of it relative to the weighted distance."""

STEPS_CLEAR = 12
"""Maximum number of steps that move a configuration clear when the closest one is not required."""

STARTS_WITHOUT_LIMITS, STEPS_WITHOUT_LIMITS = 3, 60
"""Maximum number of further starts, and of steps from each, to test whether the target is in reach without
joint limits."""

FREE, MET, HELD, NEARNESS = range(4)
"""Indices in a judgment; the better of two configurations is greater in the first entry in which they
differ."""


@compiled
def _judge(search: MultiStartSearch, workspace: Workspace, judgment: Floats1) -> None:
    """Judge `inputs`: whether it is collision-free, meets the tasks, can be held, and how near it is.

    NEARNESS refers to q0 if the tasks are met, else to the target.  The judgment is output, shape (4,).
    """
    met, cost = is_met(search.problem, workspace), workspace.result[search.problem.tolerance.size]
    free = is_free(search.tests, workspace.inputs)
    judgment[FREE] = free
    judgment[MET] = met
    judgment[HELD] = free and met and is_held(search, workspace.inputs)
    judgment[NEARNESS] = -motion(search.problem, workspace.inputs) if met else -cost


@compiled(lean=True)
def _is_better(judgment: Floats1, best: Floats1) -> bool:
    """Return whether a judgment is better than another, both of shape (4,)."""
    for i in range(judgment.size):
        if judgment[i] != best[i]:
            return judgment[i] > best[i]
    return False


@compiled
def _take_better(search: MultiStartSearch, workspace: Workspace, best: Floats1, answer: Floats1) -> None:
    """Keep `inputs` as the answer if it is the best so far, and its judgment, shape (4,), in `best`."""
    judgment = np.empty(4)
    _judge(search, workspace, judgment)
    if _is_better(judgment, best):
        best[:] = judgment
        keep(workspace, answer, search.problem.reference.size, search.problem.tolerance.size)


@compiled
def _descend_clear(search: MultiStartSearch, workspace: Workspace, best: Floats1, answer: Floats1) -> None:
    """Descend from `inputs`, measuring distances in each step; shapes as in `_search_round`."""
    problem, options = search.problem, search.options
    answer[problem.reference.size + problem.tolerance.size + ITERATIONS] += descend(
        problem, search.tests, workspace, options.max_iterations, SEARCH_GAIN, 0, CLEARING, False
    )
    _take_better(search, workspace, best, answer)


@compiled
def _move_along(search: MultiStartSearch, workspace: Workspace, best: Floats1, answer: Floats1) -> None:
    """Move `inputs`, which meets the tasks, clear of collisions; shapes as in `_search_round`.

    Distances to nearby bodies are measured once for several steps and linearized in q: most solutions are
    clear after a shift that is small enough for this.
    """
    problem, tests = search.problem, search.tests
    for _ in range(ALONG_TURNS):
        if is_free(tests, workspace.inputs):
            break
        look_around(tests, workspace, workspace.inputs, CLEARING)
        keep_near(workspace)
        answer[problem.reference.size + problem.tolerance.size + ITERATIONS] += descend(
            problem, tests, workspace, ALONG_STEPS, SEARCH_GAIN, 0, CLEARING, True
        )
    _take_better(search, workspace, best, answer)


@compiled
def _descend_and_move(search: MultiStartSearch, workspace: Workspace, best: Floats1, answer: Floats1) -> None:
    """Descend from `inputs` without regard to collisions, then move a solution clear of collisions.

    This takes a third of the time of `_descend_clear`, which succeeds slightly more often.  Shapes are those
    of `_search_round`.
    """
    problem, steps = search.problem, search.options.max_iterations
    answer[problem.reference.size + problem.tolerance.size + ITERATIONS] += descend(
        problem, search.tests, workspace, steps, SEARCH_GAIN, CAUTIOUS_STEPS, 0.0, False
    )
    if is_met(problem, workspace):
        _move_along(search, workspace, best, answer)


@compiled
def _clear_start(
    search: MultiStartSearch, workspace: Workspace, exact: bool, best: Floats1, answer: Floats1
) -> None:
    """Move `search.start`, which meets the tasks, clear of collisions; shapes as in `_search_round`.

    With `exact`, a second attempt measures the distances in each step.
    """
    n = search.start.size
    workspace.inputs[:n] = search.start
    evaluate(search.problem, workspace.inputs, workspace.result)
    _move_along(search, workspace, best, answer)
    if not _is_solved(best) and exact:
        workspace.inputs[:n] = search.start
        _descend_clear(search, workspace, best, answer)


@compiled
def _is_solved(best: Floats1) -> bool:
    """Return whether a judgment, shape (4,), is of a collision-free configuration that meets the tasks."""
    return best[FREE] > 0 and best[MET] > 0


@compiled
def _search_round(
    search: MultiStartSearch,
    workspace: Workspace,
    count: int,
    number: int,
    wide: bool,
    best: Floats1,
    answer: Floats1,
) -> None:
    """Descend from `count` starts ever farther from q0, until one solves the problem.

    If its solution exceeds the motors' limits, a few more starts search for another.

    Args:
        search: The search.
        workspace: Workspace of the search.
        count: Number of starts.
        number: Index of the first start among the points of the unit cube.
        wide: Whether every other descent measures the distances in each step, as a last resort.
        best: Judgment of the answer, shape (4,), changed.
        answer: The best configuration so far, shape (n + t + EXTRA,), changed.
    """
    problem, tried = search.problem, 0
    for i in range(count + STARTS_FOR_TORQUE):
        solved = _is_solved(best)
        if best[HELD] > 0 or tried == STARTS_FOR_TORQUE or (i >= count and not solved):
            return
        if is_over(problem, workspace):
            return
        if solved and tried < len(STRAIGHTENED):
            write_straightened(search, workspace, STRAIGHTENED[tried], answer)
        else:
            write_way_start(search, workspace, number + i, (i % max(count, 1) + 1) / max(count, 1))
        tried += 1 if solved else 0
        if wide and i % 2 == 1:
            _descend_clear(search, workspace, best, answer)
        else:
            _descend_and_move(search, workspace, best, answer)
        answer[problem.reference.size + problem.tolerance.size + RESTARTS] += 1


@compiled
def _search_closest(
    search: MultiStartSearch, workspace: Workspace, number: int, best: Floats1, answer: Floats1
) -> None:
    """Search for the collision-free configuration that comes closest to the targets, q0 if none is better.

    The search uses starts of several kinds, then the best configuration so far with its joints shifted, as
    long as shifts lead closer.  Arguments and shapes are those of `_search_round`.
    """
    problem, n, restarts = search.problem, search.problem.reference.size, search.options.restarts
    workspace.inputs[:n] = problem.reference
    evaluate(problem, workspace.inputs, workspace.result)
    _take_better(search, workspace, best, answer)
    starts = min(CLOSEST_STARTS, restarts + 2)
    for i in range(starts):
        if i == 0:
            workspace.inputs[:n] = search.start
        elif i == 1:
            workspace.inputs[:n] = problem.reference
        elif i % 2 == 0:
            write_way_start(search, workspace, number + i, i / starts)
        else:
            write_start(search, workspace, 4 * (restarts + i), -1)
        if not _descend_firmly(search, workspace, best, answer):
            return
    vain = 0
    for i in range(min(SHIFTS, 3 * restarts)):
        if vain >= min(VAIN_SHIFTS, restarts):
            break
        least = best[NEARNESS]
        write_shifted(search, workspace, number + i, answer)
        if not _descend_firmly(search, workspace, best, answer):
            return
        vain = vain + 1 if best[NEARNESS] <= least + GAINED * abs(least) else 0


@compiled
def _move_clear(search: MultiStartSearch, workspace: Workspace, best: Floats1, answer: Floats1) -> None:
    """Move `search.start` clear of collisions, or go back to q0; arguments and shapes: `_search_round`."""
    problem, n = search.problem, search.problem.reference.size
    workspace.inputs[:n] = problem.reference
    evaluate(problem, workspace.inputs, workspace.result)
    _take_better(search, workspace, best, answer)
    workspace.inputs[:n] = search.start
    answer[n + problem.tolerance.size + ITERATIONS] += descend(
        problem, search.tests, workspace, STEPS_CLEAR, SEARCH_GAIN, 0, FIRM_CLEARING[0], False
    )
    _take_better(search, workspace, best, answer)


@compiled
def _descend_firmly(search: MultiStartSearch, workspace: Workspace, best: Floats1, answer: Floats1) -> bool:
    """Descend from `inputs`, with an increased weight of distances if it ends in contact.

    Returns whether the search may continue.  Arguments and shapes are those of `_search_round`.
    """
    problem, n, t = search.problem, search.problem.reference.size, search.problem.tolerance.size
    answer[n + t + RESTARTS] += 1
    for weight in FIRM_CLEARING:
        if is_over(problem, workspace):
            return False
        answer[n + t + ITERATIONS] += descend(
            problem, search.tests, workspace, search.options.max_iterations, SMALL_GAIN, 0, weight, False
        )
        _take_better(search, workspace, best, answer)
        if is_free(search.tests, workspace.inputs):
            break
    return True


@compiled
def search_among_obstacles(
    search: MultiStartSearch, workspace: Workspace, bounds: Floats2, met: bool, answer: Floats1
) -> int:
    """Continue the search after a colliding or unreachable result; return the status.

    The joints on which the tasks depend move first, then all joints that may move, as others may be in the
    way.  A search that is not thorough is one descent.

    Args:
        search: The search; `start` is overwritten.
        workspace: Workspace of the search.
        bounds: Bounds of the joints, see `solve_rows`, shape (3, n).
        met: Whether the given configuration meets the tasks.
        answer: The given configuration, see `solve_rows`, shape (n + t + EXTRA,); overwritten.
    """
    tables, options, n, best = search.tables, search.options, search.start.size, np.full(4, -math.inf)
    number, few = CANDIDATES * options.restarts, options.restarts < WIDE_STARTS
    search.start[:] = answer[:n]
    if met:
        _clear_start(search, workspace, not options.thorough, best, answer)
        if options.thorough:
            _search_round(search, workspace, min(FEW_STARTS, options.restarts), number, False, best, answer)
        if _is_solved(best):
            return SOLVED
    if not options.thorough:
        return COLLISION
    problem = make_problem(tables, options, n, search.problem.work, search.problem.reference)
    set_bounds(problem, bounds)
    wide = MultiStartSearch(tables, options, search.tests, problem, search.torque, search.costs, search.start)
    larger = make_workspace(workspace.inputs, problem, search.tests)
    larger.watch[0], larger.stop[0] = workspace.watch[0], workspace.stop[0]
    if met and larger.stop[0] == 0:
        _clear_start(wide, larger, True, best, answer)
        number += FEW_STARTS
        if not _is_solved(best):
            _search_round(search, workspace, min(STARTS, options.restarts), number, False, best, answer)
            larger.stop[0] = workspace.stop[0]
        number += STARTS
        for _ in range(1 if few or not options.closest else WIDE_ROUNDS):
            _search_round(wide, larger, min(WIDE_STARTS, options.restarts), number, True, best, answer)
            if _is_solved(best) or larger.stop[0] != 0:
                break
            number += WIDE_STARTS
    if not _is_solved(best):
        if options.closest:
            _search_closest(wide, larger, number + WIDE_STARTS, best, answer)
        else:
            _move_clear(wide, larger, best, answer)
    workspace.stop[0] = larger.stop[0]
    if _is_solved(best):
        return SOLVED
    return COLLISION if met else UNREACHABLE


@compiled
def _is_met_without_limits(
    search: MultiStartSearch, workspace: Workspace, moves: Floats1, answer: Floats1
) -> bool:
    """Return whether the same joints meet the tasks without their limits.

    Args:
        search: The search with limits.
        workspace: Workspace of the search, overwritten.
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
    free = MultiStartSearch(search.tables, options, tests, problem, search.torque, search.costs, search.start)
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
        descend(problem, tests, workspace, steps, SMALL_GAIN, 0, 0.0, False)
        if is_met(problem, workspace):
            return True
    return False


@compiled(
    "void(TaskTables, float64[:, ::1], SearchOptions, CollisionTests, float64[:, ::1], float64[:, ::1], "
    "int64, int64)"
)
def finish_rows(
    tables: TaskTables,
    bounds: Floats2,
    options: SearchOptions,
    tests: CollisionTests,
    inputs: Floats2,
    answers: Floats2,
    begin: int,
    end: int,
) -> None:
    """Continue with the rows that `solve_rows` left in collision or out of reach.

    The arguments are those of `solve_rows`, which has written `answers`.
    """
    n, t = tables.effort.size, options.tolerance.size
    search = make_search(tables, options, tests)
    workspace = make_workspace(inputs[begin], search.problem, tests)
    for row in range(begin, end):
        answer = answers[row]
        status = int(answer[n + t + STATUS])
        if status != COLLISION and not (status == UNREACHABLE and options.thorough):
            continue
        set_row(search, workspace, bounds, inputs[row])
        if status == COLLISION:
            met = fraction_of_tolerance(answer[n:], options.tolerance) <= 1.0
            status = search_among_obstacles(search, workspace, bounds, met, answer)
        if (
            status == UNREACHABLE
            and options.thorough
            and _is_met_without_limits(search, workspace, bounds[2], answer)
        ):
            status = LIMITS
        status = status_of(workspace, status)
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
    """Descend from the start in a row of input, which becomes the result; return the number of steps.

    Args:
        tables: The robot and tasks.
        bounds: Bounds of the joints, see `solve_rows`, shape (3, n).
        options: Options, of which tolerances and number of steps are used.
        tests: Collision tests.
        inputs: A row of input, see `Workspace.inputs`, shape (n + t + ...,).
        reference: q_ref of the posture term, and positions of the joints that may not move, shape (n,).
        clear: Whether to avoid collisions; then joints that no task depends on move, too.
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
        False,
    )
    inputs[:] = workspace.inputs
    return steps
