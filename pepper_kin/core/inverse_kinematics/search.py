"""Parts of all searches: tables and options, starts, and the judgment of configurations."""

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
"""How far from q0 the first restarts lie, as a fraction of the way to a point of the joint box; the others go
all the way."""
NEAR, FAR = REACH
NEAR_STARTS = len(REACH)

CANDIDATES = 4
"""Every second pair of the other restarts takes the best of so many points: a target beyond reach has many
local minima, and a start near the target finds the least of them more often.  The pairs between take points
as they come: the best points may all lie in the basin of one near miss."""

HEAVY = 1.5
"""Joints with d_i above this carry much (hip and knee); every other restart keeps them at q0, where gravity
is easiest to bear."""

SPREADS = (0.1, 0.25, 0.6)
"""Standard deviations of the shifts that look for a way around an obstacle [rad or m]."""

CLEARING = 0.3
"""Weight of shortages of distance beside tasks that can be met, where they only have to point the way."""

STATUS, ITERATIONS, RESTARTS, EXTRA = 0, 1, 2, 3
"""What an answer holds after q and the squared errors, and how many numbers these are."""

SOLVED, UNREACHABLE, LIMITS, COLLISION, TIME, STOP = range(6)
"""Values of STATUS: all tasks met; not even without joint limits; only without them; only while something
touches; the deadline has passed; a signal or the kernel ended the search."""

SEARCH_GAIN = 3e-3
"""Descents end sooner than elsewhere, when a step gains less than this part of the cost; only the best of
them is brought to its very end."""

AGREEING_STARTS, AGREEMENT = 4, 1e-3
"""The search for the closest point ends when so many descents agree this well on the weighted distance."""


class TaskTables(NamedTuple):
    """What is fixed for a robot and tasks of one structure.

    Attributes:
        kernel: Address of the tasks' kernel; see `SolverProblem`.
        gravity: Address of the kernel of the gravity torque.
        work_size: Numbers of workspace that both need.
        task_joints: k, how many joints the tasks depend on.
        joints: Places of all joints in q, those of the tasks first, shape (n,).
        scale: d_i^2 of `joints`, shape (n,).
        effort: 1 / effort limit in the order of q, 0 where there is none, shape (n,) [1/(N m) or 1/N].
    """

    kernel: int
    gravity: int
    work_size: int
    task_joints: int
    joints: Ints1
    scale: Floats1
    effort: Floats1


class SearchOptions(NamedTuple):
    """How much to search.

    Attributes:
        tolerance: Squared tolerances of the t tasks, shape (t,).
        first: x_0 of the points of the unit cube that restarts are made from, in the order of `joints`,
            shape (n,).
        advance: alpha of these points x_j = frac(x_0 + j alpha), shape (n,).
        restarts: Further starts.
        max_iterations: Steps from each start.
        thorough: Whether to continue the search where what was found touches something, and to test whether
            joint limits are in the way; else it is only moved clear.
        closest: Whether to search for the closest configuration where the tasks are not met.
        stop_when_met: Whether a descent ends once all tasks are well met.
        clock: Address of `clock_gettime`.
        deadline: When to stop [s], infinite for never.
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
    """A search at work.

    Attributes:
        tables: The robot and tasks.
        options: How much to search.
        tests: Of collisions with the scene and the robot itself.
        problem: The problem of one row.
        torque: Gravity torque, shape (n,) [N m or N].
        costs: Costs of the descents so far, shape (number of descents at most,).
        start: Where descents among obstacles start from, and before these the q0 at which `near_trial` of the
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
    """Return coordinate i of a point of the unit cube.

    The points x_j = frac(x_0 + j alpha) of Roberts (The unreasonable effectiveness of quasirandom
    sequences, 2018), with alpha_i = phi^-i and phi the real root of phi^(m+1) = phi + 1, are even in all m
    dimensions.
    """
    x = options.first[i] + (number + 1.0) * options.advance[i]
    return x - math.floor(x)


@compiled(lean=True)
def write_start(search: MultiStartSearch, workspace: Workspace, number: int, only: int) -> None:
    """Write the start of a restart, counted from 0, into `inputs`.

    Where `only` is not negative, it is this one of the number's points as it stands.
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
    """Write a start into `inputs` that lies part of the way, `reach`, from q0 to a point of the joint box."""
    problem = search.problem
    for i in range(problem.joints.size):
        q0 = problem.reference[problem.joints[i]]
        bottom, top = max(problem.low[i], q0 - math.pi), min(problem.high[i], q0 + math.pi)
        q = q0 + reach * (bottom + _point(search.options, i, number) * (top - bottom) - q0)
        workspace.inputs[problem.joints[i]] = min(max(q, problem.low[i]), problem.high[i])


@compiled(lean=True)
def write_straightened(search: MultiStartSearch, workspace: Workspace, part: float, answer: Floats1) -> None:
    """Write the best solution so far into `inputs`, the joints that carry much moved back by a part to q0.

    The solution begins `answer`, see `keep`, shape (n + t + EXTRA,).
    """
    problem = search.problem
    for i in range(problem.joints.size):
        j = problem.joints[i]
        back = part if problem.scale[i] > HEAVY**2 else 0.0
        q = answer[j] + back * (problem.reference[j] - answer[j])
        workspace.inputs[j] = min(max(q, problem.low[i]), problem.high[i])


@compiled(lean=True)
def write_shifted(search: MultiStartSearch, workspace: Workspace, number: int, answer: Floats1) -> None:
    """Write the best configuration so far into `inputs`, each joint shifted a little.

    The configuration begins `answer`, see `keep`, shape (n + t + EXTRA,).
    """
    problem, spread = search.problem, SPREADS[number % 3] * math.sqrt(12.0)
    for i in range(problem.joints.size):
        j = problem.joints[i]
        shift = spread * (_point(search.options, i, CANDIDATES * number) - 0.5)
        workspace.inputs[j] = min(max(answer[j] + shift, problem.low[i]), problem.high[i])


@compiled(lean=True, inline=True)
def is_held(search: MultiStartSearch, q: Floats1) -> bool:
    """Whether the motors hold q, shape (n,) or longer: |g_i| <= effort limit for every joint."""
    tables = search.tables
    call_kernel(tables.gravity, q.ctypes.data, search.torque.ctypes.data, search.problem.work.ctypes.data)
    worst = 0.0
    for i in range(tables.effort.size):
        worst = max(worst, abs(search.torque[i]) * tables.effort[i])
    return worst <= 1.0


@compiled(lean=True)
def agree(costs: Floats1, count: int, least_count: int) -> bool:
    """Whether the least weighted distance was found often enough to be accepted.

    Args:
        costs: Costs of descents, half the squares of weighted distances, shape (>= count,).
        count: How many of them there are.
        least_count: How many there have to be.
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
    """Return |diag(d) (q - q0)|^2, where q begins an array of shape (>= n,)."""
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
    """Whether every task is met at `inputs`."""
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
        work: The kernel's workspace, shape (tables.work_size,).
        reference: q_ref, shape (n,) [rad or m].
    """
    return SolverProblem(
        tables.kernel, work, tables.task_joints, tables.joints[:count], np.empty(count), np.empty(count),
        tables.scale[:count], reference, options.tolerance, options.stop_when_met, options.clock,
        options.deadline, options.signals,
    )  # fmt: skip


@compiled(lean=True)
def set_bounds(problem: SolverProblem, bounds: Floats2) -> None:
    """Set the bounds of a problem whose reference is set; joints that may not move stay there.

    `bounds` are those of `solve_rows`, shape (3, n).
    """
    for i in range(problem.joints.size):
        fixed, q0 = bounds[2, i] == 0.0, problem.reference[problem.joints[i]]
        problem.low[i] = q0 if fixed else bounds[0, i]
        problem.high[i] = q0 if fixed else bounds[1, i]


@compiled
def make_search(tables: TaskTables, options: SearchOptions, tests: CollisionTests) -> MultiStartSearch:
    """Return a search in which the joints of the tasks move; `set_row` sets its problem."""
    n = tables.effort.size
    problem = make_problem(tables, options, tables.task_joints, np.empty(tables.work_size), np.empty(n))
    costs = np.empty((options.restarts + 2) * (REFLECTIONS + 1))
    return MultiStartSearch(tables, options, tests, problem, np.empty(n), costs, np.empty(n))


@compiled
def set_row(search: MultiStartSearch, workspace: Workspace, bounds: Floats2, row: Floats1) -> None:
    """Set the problem of a row of input, see `Workspace.inputs`; `bounds` are those of `solve_rows`."""
    search.problem.reference[:] = row[: search.start.size]
    workspace.inputs[:] = row
    workspace.trial[:] = row
    set_bounds(search.problem, bounds)


@compiled(lean=True)
def status_of(workspace: Workspace, status: int) -> int:
    """Return a status, or which of TIME and STOP has kept it from being SOLVED."""
    if workspace.stop[0] == 0 or status == SOLVED:
        return status
    return TIME if workspace.stop[0] == TIMED_OUT else STOP
