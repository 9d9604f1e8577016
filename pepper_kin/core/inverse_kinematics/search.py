"""Common parts of all searches: tables and options, starts, and tests of configurations."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pepper_kin.core.inverse_kinematics.local_solver import (
    REFLECTIONS,
    TIMED_OUT,
    CollisionTests,
    SolverProblem,
    Workspace,
    evaluate,
    fraction_of_tolerance,
)
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.intrinsics import call_kernel
from pepper_kin.kernels.signatures import Floats1, Floats2, Ints1

REACH = (0.3, 0.6)
"""Distance of the first restarts from q0, as a fraction of the way to a point of the joint box; later
restarts go all the way."""
NEAR, FAR = REACH
NEAR_STARTS = len(REACH)

CANDIDATES = 4
"""Number of points of which every second pair of later restarts takes the best: a target beyond reach has
many local minima, and a start near the target finds the lowest more often.  The other pairs take points in
order: the best points may all lie in the basin of one near miss."""

HEAVY = 1.5
"""d_i above which a joint counts as heavily loaded (hip and knee); every other restart keeps such joints at
q0, where gravity is easiest to bear."""

SPREADS = (0.1, 0.25, 0.6)
"""Standard deviations of the random shifts that search for a way around an obstacle [rad or m]."""

CLEARING = 0.3
"""Weight of clearance shortfalls where the tasks can be met: they only have to indicate a direction."""

STATUS, ITERATIONS, RESTARTS, EXTRA = 0, 1, 2, 3
"""Offsets in an answer after q and the squared errors, and their number."""

SOLVED, UNREACHABLE, LIMITS, COLLISION, TIME, STOP = range(6)
"""Values of STATUS: all tasks met; not met even without joint limits; met only without them; met only in
collision; the deadline has passed; a signal or the kernel ended the search."""

SEARCH_GAIN = 3e-3
"""Gain relative to the cost below which a search's descents end; only the best of them converges fully."""

AGREEING_STARTS, AGREEMENT = 4, 1e-3
"""Number of descents that must agree, and tolerance of the weighted distance, to end the search for the
closest point."""


class TaskTables(NamedTuple):
    """Constants of a robot and of tasks of one structure.

    Attributes:
        kernel: Address of the tasks' kernel; see `SolverProblem`.
        gravity: Address of the kernel of the gravity torque.
        work_size: Size of the workspace for both kernels.
        task_joints: k, number of joints the tasks depend on.
        joints: Indices of all joints in q, the joints of the tasks first, shape (n,).
        scale: d_i^2 of `joints`, shape (n,).
        effort: 1 / effort limit in the order of q, 0 without limit, shape (n,) [1/(N m) or 1/N].
    """

    kernel: int
    gravity: int
    work_size: int
    task_joints: int
    joints: Ints1
    scale: Floats1
    effort: Floats1


class SearchOptions(NamedTuple):
    """Options that limit a search.

    Attributes:
        tolerance: Squared tolerances of the t tasks, shape (t,).
        first: x_0 of the points of the unit cube that restarts use, in the order of `joints`, shape (n,).
        advance: alpha of the points x_j = frac(x_0 + j alpha), shape (n,).
        restarts: Number of further starts.
        max_iterations: Maximum number of steps from each start.
        thorough: Whether to continue the search after a solution in collision, and to test whether joint
            limits are the obstacle; otherwise the solution is only moved clear.
        closest: Whether to search for the closest configuration if the tasks are not met.
        stop_when_met: Whether a descent ends once all tasks are well met.
        clock: Address of `clock_gettime`.
        deadline: Time at which to stop [s], infinite for never.
        signals: See `pepper_kin.kernels.interrupts`, shape (8,).
    """

    tolerance: Floats1
    first: Floats1
    advance: Floats1
    restarts: int
    max_iterations: int
    thorough: bool
    closest: bool
    stop_when_met: bool
    clock: int
    deadline: float
    signals: Ints1


class MultiStartSearch(NamedTuple):
    """State of a search.

    Attributes:
        tables: The robot and tasks.
        options: Options of the search.
        tests: Collision tests with the scene and the robot itself.
        problem: The problem of one row.
        torque: Gravity torque, shape (n,) [N m or N].
        costs: Costs of the descents so far, shape (maximum number of descents,).
        start: Start of descents among obstacles; in the first stage, the q0 at which `near_trial` of the
            workspace was written, shape (n,) [rad or m].
    """

    tables: TaskTables
    options: SearchOptions
    tests: CollisionTests
    problem: SolverProblem
    torque: Floats1
    costs: Floats1
    start: Floats1


@compiled(lean=True, inline=True)
def _point(options: SearchOptions, i: int, number: int) -> float:
    """Return coordinate i of point `number` of the unit cube.

    The points x_j = frac(x_0 + j alpha) of Roberts (The unreasonable effectiveness of quasirandom
    sequences, 2018), with alpha_i = phi^-i and phi the real root of phi^(m+1) = phi + 1, are even in all m
    dimensions.
    """
    x = options.first[i] + (number + 1.0) * options.advance[i]
    return x - math.floor(x)


@compiled(lean=True)
def write_start(search: MultiStartSearch, workspace: Workspace, number: int, only: int) -> None:
    """Write the start of a restart, counted from 0, into `inputs`.

    If `only` is not negative, it selects one of the restart's points, which is then used unchanged.
    """
    problem, options, trial = search.problem, search.options, workspace.trial
    index, low, high = problem.joints, problem.low, problem.high
    reach = 1.0
    if number < NEAR_STARTS:
        reach = NEAR if number == 0 else FAR
    first, candidates = max(only, 0), 1
    if number >= NEAR_STARTS and number % 4 < 2 and only < 0:
        candidates = CANDIDATES
    least = math.inf
    for c in range(first, first + candidates):
        for i in range(index.size):
            q0 = problem.reference[index[i]]
            if low[i] == high[i] or (number % 2 == 1 and problem.scale[i] > HEAVY**2 and only < 0):
                trial[index[i]] = q0
                continue
            bottom, top = max(low[i], q0 - math.pi), min(high[i], q0 + math.pi)
            way = reach * (bottom + _point(options, i, CANDIDATES * number + c) * (top - bottom) - q0)
            trial[index[i]] = min(max(q0 + way, low[i]), high[i])
        cost = 0.0
        if candidates > 1:
            evaluate(problem, trial, workspace.other)
            cost = workspace.other[problem.tolerance.size]
        if cost < least or c == first:
            least = cost
            for i in range(index.size):
                workspace.inputs[index[i]] = trial[index[i]]


@compiled(lean=True)
def write_way_start(search: MultiStartSearch, workspace: Workspace, number: int, reach: float) -> None:
    """Write into `inputs` a start at the fraction `reach` of the way from q0 to a point of the joint box."""
    problem = search.problem
    for i in range(problem.joints.size):
        q0 = problem.reference[problem.joints[i]]
        bottom, top = max(problem.low[i], q0 - math.pi), min(problem.high[i], q0 + math.pi)
        q = q0 + reach * (bottom + _point(search.options, i, number) * (top - bottom) - q0)
        workspace.inputs[problem.joints[i]] = min(max(q, problem.low[i]), problem.high[i])


@compiled(lean=True)
def write_straightened(search: MultiStartSearch, workspace: Workspace, part: float, answer: Floats1) -> None:
    """Write the best solution so far into `inputs`, with heavily loaded joints moved towards q0 by a ratio.

    The solution is at the start of `answer`, see `keep`, shape (n + t + EXTRA,).
    """
    problem = search.problem
    for i in range(problem.joints.size):
        j = problem.joints[i]
        back = part if problem.scale[i] > HEAVY**2 else 0.0
        q = answer[j] + back * (problem.reference[j] - answer[j])
        workspace.inputs[j] = min(max(q, problem.low[i]), problem.high[i])


@compiled(lean=True)
def write_shifted(search: MultiStartSearch, workspace: Workspace, number: int, answer: Floats1) -> None:
    """Write the best configuration so far into `inputs`, with every joint shifted randomly.

    The configuration is at the start of `answer`, see `keep`, shape (n + t + EXTRA,).
    """
    problem, spread = search.problem, SPREADS[number % 3] * math.sqrt(12.0)
    for i in range(problem.joints.size):
        j = problem.joints[i]
        shift = spread * (_point(search.options, i, CANDIDATES * number) - 0.5)
        workspace.inputs[j] = min(max(answer[j] + shift, problem.low[i]), problem.high[i])


@compiled(lean=True, inline=True)
def is_held(search: MultiStartSearch, q: Floats1) -> bool:
    """Return whether the motors hold q, shape (>= n,): |g_i| <= effort limit for every joint."""
    tables = search.tables
    call_kernel(tables.gravity, q.ctypes.data, search.torque.ctypes.data, search.problem.work.ctypes.data)
    worst = 0.0
    for i in range(tables.effort.size):
        worst = max(worst, abs(search.torque[i]) * tables.effort[i])
    return worst <= 1.0


@compiled(lean=True)
def agree(costs: Floats1, count: int, least_count: int) -> bool:
    """Return whether the minimum weighted distance was found often enough to be accepted.

    Args:
        costs: Costs of descents, half the squares of weighted distances, shape (>= count,).
        count: Number of descents.
        least_count: Minimum number of descents.
    """
    if count < least_count:
        return False
    least = costs[0]
    for i in range(1, count):
        least = min(least, costs[i])
    least, agreeing = math.sqrt(2 * least), 0
    for i in range(count):
        if math.sqrt(2 * costs[i]) < least + AGREEMENT:
            agreeing += 1
    return agreeing >= AGREEING_STARTS


@compiled(lean=True, inline=True)
def motion(problem: SolverProblem, q: Floats1) -> float:
    """Return |diag(d) (q - q0)|^2, with q at the start of an array of shape (>= n,)."""
    total = 0.0
    for i in range(problem.joints.size):
        shift = q[problem.joints[i]] - problem.reference[problem.joints[i]]
        total += problem.scale[i] * shift * shift
    return total


@compiled(lean=True, inline=True)
def keep(workspace: Workspace, answer: Floats1, n: int, t: int) -> None:
    """Write q and the t squared errors into an answer, shape (n + t + EXTRA,)."""
    for i in range(n):
        answer[i] = workspace.inputs[i]
    for i in range(t):
        answer[n + i] = workspace.result[i]


@compiled(lean=True, inline=True)
def is_met(problem: SolverProblem, workspace: Workspace) -> bool:
    """Return whether every task is met at `inputs`."""
    return fraction_of_tolerance(workspace.result, problem.tolerance) <= 1.0


@compiled
def make_problem(
    tables: TaskTables, options: SearchOptions, count: int, work: Floats1, reference: Floats1
) -> SolverProblem:
    """Return the problem in which the first `count` joints move; `set_bounds` sets its bounds.

    Args:
        tables: The robot and tasks.
        options: How much to search.
        count: m, number of joints that move.
        work: Workspace of the kernel, shape (tables.work_size,).
        reference: q_ref, shape (n,) [rad or m].
    """
    return SolverProblem(
        tables.kernel, work, tables.task_joints, tables.joints[:count], np.empty(count), np.empty(count),
        tables.scale[:count], reference, options.tolerance, options.stop_when_met, options.clock,
        options.deadline, options.signals,
    )  # fmt: skip


@compiled(lean=True)
def set_bounds(problem: SolverProblem, bounds: Floats2) -> None:
    """Set the bounds of a problem whose reference is set; joints that may not move are bounded to it.

    `bounds` has the rows of `solve_rows`, shape (3, n).
    """
    for i in range(problem.joints.size):
        fixed, q0 = bounds[2, i] == 0.0, problem.reference[problem.joints[i]]
        problem.low[i] = q0 if fixed else bounds[0, i]
        problem.high[i] = q0 if fixed else bounds[1, i]


@compiled
def make_search(tables: TaskTables, options: SearchOptions, tests: CollisionTests) -> MultiStartSearch:
    """Return a search that moves the joints of the tasks; `set_row` sets its problem."""
    n = tables.effort.size
    problem = make_problem(tables, options, tables.task_joints, np.empty(tables.work_size), np.empty(n))
    costs = np.empty((options.restarts + 2) * (REFLECTIONS + 1))
    return MultiStartSearch(tables, options, tests, problem, np.empty(n), costs, np.empty(n))


@compiled
def set_row(search: MultiStartSearch, workspace: Workspace, bounds: Floats2, row: Floats1) -> None:
    """Set the problem of a row of input, shape (n + t + ...,), within bounds, shape (3, n)."""
    search.problem.reference[:] = row[: search.start.size]
    workspace.inputs[:] = row
    workspace.trial[:] = row
    set_bounds(search.problem, bounds)


@compiled(lean=True)
def status_of(workspace: Workspace, status: int) -> int:
    """Return the status, or TIME or STOP if the search was cut short before it was SOLVED."""
    if workspace.stop[0] == 0 or status == SOLVED:
        return status
    return TIME if workspace.stop[0] == TIMED_OUT else STOP
