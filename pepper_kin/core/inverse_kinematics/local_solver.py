"""Levenberg-Marquardt descents to the nearest minimum, within joint limits and clear of collisions."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pepper_kin.core.clock import seconds_now
from pepper_kin.core.collision.gjk import FREE as SURELY_FREE
from pepper_kin.core.collision.gjk import TIE
from pepper_kin.core.inverse_kinematics.box_step import FREE, HIGH, LOW, solve_box
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.interrupts import PULSE, STOPPED, interrupted
from pepper_kin.kernels.intrinsics import call_four, call_kernel
from pepper_kin.kernels.signatures import Floats1, Floats2, Ints1

FIRST_DAMPING = 1e-3
LEAST_DAMPING = 1e-9
MOST_DAMPING = 1e4
RAISE = 4.0
LOWER = 5.0

STEP_BOUND = 0.6
"""Largest change of one joint in one step [rad or m]: beyond it the linear model is inaccurate."""

SMALL_STEP, SMALL_GAIN = 1e-6, 1e-7
"""A minimum is reached when a step, or what it gains relative to the cost, is smaller than this."""

CLOSE = 0.1
"""Steps go on until every error is this fraction of its tolerance."""

POSTURE_WEIGHT = 1e-4
"""Weight of |q - q_ref|: it only decides where the tasks leave freedom, and costs no step near the goal."""

CAUTION, CAUTIOUS_STEPS = 0.4, 10
"""In its first steps a descent goes only this part of the way to a bound: it so avoids many a local minimum
on the bounds."""

REFLECTION, REFLECTIONS = 0.3, 2
"""A descent that ends in a local minimum is started again beyond the middle of the joint ranges, by this much
of the distance to the middle.  Such minima lie on the bounds, and what they hide lies in the other half of
the range: nine in ten descents from there succeed."""

MOST_NEAR = 32
"""Pairs of bodies that a step considers at most."""

TIMED_OUT = 2
"""Written to `Workspace.stop` when the deadline has passed."""


class SolverProblem(NamedTuple):
    """One problem: min sum_i s_i^2 |r_i(q)|^2 / 2 + eps^2 |q - q_ref|^2 / 2  within  low <= q <= high.

    Attributes:
        kernel: Address of `void f(const double* input, double* result, double* work)`, which writes the
            squared errors of the t tasks, the cost, its gradient by the first k joints, and the upper
            triangle of the Gauss-Newton matrix, row by row; see
            `pepper_kin.ik.fast.expression.task_function`.
        work: The kernel's workspace, shape (work_size,).
        task_joints: k.
        joints: Places in q of the joints that move, shape (m,), m >= k; the kernel depends on the first k.
        low: Their lower bounds [rad or m], shape (m,).
        high: Their upper bounds [rad or m], shape (m,).
        scale: d_i^2, the weights of the damping lambda |diag(d) dq|^2, shape (m,).
        reference: q_ref, shape (n,) [rad or m].
        tolerance: Squared tolerances of the tasks, shape (t,).
        stop_when_met: Whether a descent ends once all tasks are well met.
        clock: Address of `clock_gettime`.
        deadline: When to stop [s], infinite for never.
        signals: See `pepper_kin.kernels.interrupts`, shape (8,); the kernel may set the word STOPPED too.
    """

    kernel: int
    work: Floats1
    task_joints: int
    joints: Ints1
    low: Floats1
    high: Floats1
    scale: Floats1
    reference: Floats1
    tolerance: Floats1
    stop_when_met: bool
    clock: int
    deadline: float
    signals: Ints1


class CollisionTests(NamedTuple):
    """Addresses of collision tests, each `int64 f(int64, int64, int64, int64)`; 0 for none.

    Attributes:
        verdict: Of `pepper_kin.core.inverse_kinematics.verdict`.
        memory: Address of its block.
        size: Doubles in the block.
        is_free: (q, 0, 0, 0) -> whether nothing touches; called where `verdict` is 0 or returns TIE; where it
            is 0 itself, ties count as contacts.
        near: Of `near_rows` of `pepper_kin.core.inverse_kinematics.proximity`; 0 where collisions are not
            considered.
        near_memory: Address of its block.
    """

    verdict: int
    memory: int
    size: int
    is_free: int
    near: int
    near_memory: int


class Workspace(NamedTuple):
    """Arrays that descents write to; m joints, t tasks.

    Attributes:
        inputs: The kernel's input at q: q [rad or m], squared weights and targets, shape (n + t + ...,).
        trial: The same at the configuration to try, shape (n + t + ...,).
        result: The kernel's output at q, see `SolverProblem`, shape (t + 1 + k + k (k + 1) / 2,).
        other: The same at the configuration to try, of the same shape.
        matrix: Matrix of the step's quadratic program, shape (m, m).
        factor: Its factor, see `solve_box`, shape (m, m + 1).
        gradient: Gradient of that program, shape (m,).
        step: Its solution [rad or m], shape (m,).
        least: Lower bounds of the step [rad or m], shape (m,).
        most: Upper bounds of the step [rad or m], shape (m,).
        state: Active bounds, shape (m,).
        near: What is near at q, see `near_rows`, shape (MOST_NEAR, n + 2); empty where collisions are not
            considered.
        near_trial: The same at the configuration to try, of the same shape.
        near_count: Rows of both that are written, shape (2,).
        shortages: Of `near` at the configuration to try, where they are taken for linear, shape (MOST_NEAR,).
        clock: For `seconds_now`, shape (2,).
        watch: When signals are checked next [s], shape (1,).
        stop: 1 or TIMED_OUT where the search has to end, shape (1,).
    """

    inputs: Floats1
    trial: Floats1
    result: Floats1
    other: Floats1
    matrix: Floats2
    factor: Floats2
    gradient: Floats1
    step: Floats1
    least: Floats1
    most: Floats1
    state: Ints1
    near: Floats2
    near_trial: Floats2
    near_count: Ints1
    shortages: Floats1
    clock: Ints1
    watch: Floats1
    stop: Ints1


@compiled
def make_workspace(row: Floats1, problem: SolverProblem, tests: CollisionTests) -> Workspace:
    """Return a workspace for a row of input, see `Workspace.inputs`, shape (n + t + ...,)."""
    m, k, n = problem.joints.size, problem.task_joints, problem.reference.size
    outputs = problem.tolerance.size + 1 + k + k * (k + 1) // 2
    return Workspace(
        row.copy(),
        row.copy(),
        np.empty(outputs),
        np.empty(outputs),
        np.empty((m, m)),
        np.empty((m, m + 1)),
        np.empty(m),
        np.empty(m),
        np.empty(m),
        np.empty(m),
        np.empty(m, np.int64),
        np.empty((MOST_NEAR if tests.near != 0 else 0, n + 2)),
        np.empty((MOST_NEAR if tests.near != 0 else 0, n + 2)),
        np.zeros(2, np.int64),
        np.empty(MOST_NEAR),
        np.empty(2, np.int64),
        np.zeros(1),
        np.zeros(1, np.int64),
    )


@compiled(lean=True)
def is_over(problem: SolverProblem, workspace: Workspace) -> bool:
    """Whether the search has to end: time has run out, a signal has come, or the kernel has set STOPPED."""
    if problem.signals[STOPPED] != 0:
        workspace.stop[0] = 1
        return True
    now = seconds_now(problem.clock, workspace.clock)
    if now > problem.deadline:
        workspace.stop[0] = TIMED_OUT
        return True
    if workspace.watch[0] == 0.0:
        workspace.watch[0] = now + PULSE
    elif now > workspace.watch[0]:
        workspace.watch[0] = now + PULSE
        if interrupted(problem.signals):
            workspace.stop[0] = 1
            return True
    return False


@compiled(lean=True)
def is_free(tests: CollisionTests, q: Floats1) -> bool:
    """Whether nothing touches at q, shape (n,) or longer; true where collisions are not considered."""
    if tests.near == 0:
        return True
    place = q.ctypes.data
    if tests.verdict != 0:
        found = call_four(tests.verdict, place, tests.memory, tests.size, 0)
        if found != TIE:
            return found == SURELY_FREE
    return tests.is_free != 0 and call_four(tests.is_free, place, 0, 0, 0) == 1


@compiled(lean=True, inline=True)
def fraction_of_tolerance(result: Floats1, tolerance: Floats1) -> float:
    """Return the largest of error^2 / tolerance^2, from arrays of the shapes (>= t,) and (t,)."""
    worst = 0.0
    for i in range(tolerance.size):
        worst = max(worst, result[i] / tolerance[i])
    return worst


@compiled(lean=True, inline=True)
def evaluate(problem: SolverProblem, inputs: Floats1, result: Floats1) -> None:
    """Call the kernel; inputs and result, and their shapes, as of `Workspace`."""
    call_kernel(problem.kernel, inputs.ctypes.data, result.ctypes.data, problem.work.ctypes.data)


@compiled(lean=True)
def descend(
    problem: SolverProblem,
    tests: CollisionTests,
    workspace: Workspace,
    max_iterations: int,
    small_gain: float,
    cautious_steps: int,
    clearing: float,
    frozen: bool,
) -> int:
    """Search from a start by Levenberg-Marquardt steps within the bounds; return how many were proposed.

    A step is taken only if it lowers the cost; otherwise the damping grows and the next step is shorter.
    With `clearing`, c, the cost has a term c^2 s_k^2 / 2 for each pair of bodies that is nearer than it shall
    be, by s_k; such a descent ends as soon as the tasks are well met and nothing seems to touch.

    Args:
        problem: The problem.
        tests: Used where the descent has to clear contacts.
        workspace: `inputs` holds the start, and afterwards the result; `result` the kernel's output there.
        max_iterations: Number of steps proposed at most.
        small_gain: A step that gains less than this part of the cost is the last; where it is more than
            SMALL_GAIN, the minimum is not looked for to its very end.
        cautious_steps: How many steps keep away from the bounds.
        clearing: Weight of the shortages of distance; 0 to leave collisions out.
        frozen: Whether the pairs that are near and their slopes are not looked for again in each step: they
            are those of `workspace.near`, whose shortages are at the start.
    """
    inputs, trial, result, other = workspace.inputs, workspace.trial, workspace.result, workspace.other
    index, t, to_the_end = problem.joints, problem.tolerance.size, small_gain <= SMALL_GAIN
    _copy(inputs, trial, problem.reference.size)
    evaluate(problem, inputs, result)
    cost = result[t] + _posture_cost(problem, inputs)
    damping, backed, cautious, iterations = FIRST_DAMPING, False, cautious_steps > 0, 0
    timed = problem.deadline < np.inf
    if frozen:
        cost += _look_along(problem, workspace, inputs, clearing)
    elif clearing > 0.0:
        cost += look_around(tests, workspace, inputs, clearing)
        keep_near(workspace)
    else:
        workspace.near_count[0] = 0
    while iterations < max_iterations and damping < MOST_DAMPING:
        if (
            problem.stop_when_met
            and fraction_of_tolerance(result, problem.tolerance) <= CLOSE**2
            and (clearing == 0.0 or not _touches(workspace))
        ):
            break
        if problem.signals[STOPPED] != 0 or (timed and is_over(problem, workspace)):
            break
        iterations += 1
        cautious = cautious and iterations <= cautious_steps
        _linearize(problem, workspace, damping, cautious, clearing)
        if not _propose(problem, workspace, cautious):
            damping *= 10
            continue
        size = _distance(index, trial, inputs)
        evaluate(problem, trial, other)
        new_cost = other[t] + _posture_cost(problem, trial)
        if frozen:
            new_cost += _look_along(problem, workspace, trial, clearing)
        elif clearing > 0.0 and new_cost < cost:
            new_cost += look_around(tests, workspace, trial, clearing)
        gain = cost - new_cost
        if gain > 0:
            _copy(trial, inputs, problem.reference.size)
            _copy(other, result, result.size)
            if frozen:
                _keep_along(workspace)
            elif clearing > 0.0:
                keep_near(workspace)
            cost = new_cost
            damping, backed = (damping if backed else max(damping / LOWER, LEAST_DAMPING)), False
        elif size >= SMALL_STEP:
            damping, backed = max(RAISE * damping, FIRST_DAMPING), True
            continue
        if size < SMALL_STEP or gain < small_gain * cost:
            if not (cautious and to_the_end):
                break
            cautious = False
    return iterations


@compiled(lean=True, inline=True)
def _copy(source: Floats1, target: Floats1, count: int) -> None:
    """Copy the first numbers of an array, shape (>= count,), to another."""
    for i in range(count):
        target[i] = source[i]


@compiled(lean=True, inline=True)
def _distance(index: Ints1, a: Floats1, b: Floats1) -> float:
    """Return the largest change of one joint [rad or m]; they are at `index`, shape (m,), in a and b."""
    size = 0.0
    for i in range(index.size):
        size = max(size, abs(a[index[i]] - b[index[i]]))
    return size


@compiled(lean=True)
def reflect(problem: SolverProblem, inputs: Floats1) -> None:
    """Put each joint from q to c - REFLECTION (q - c), c the middle of its range; see `REFLECTION`.

    q begins `inputs`, see `Workspace`, shape (n + t + ...,).  A joint without bounds stays where it is.
    """
    for i in range(problem.joints.size):
        middle = 0.5 * (problem.low[i] + problem.high[i])
        if abs(middle) < np.inf:
            inputs[problem.joints[i]] = middle - REFLECTION * (inputs[problem.joints[i]] - middle)


@compiled(lean=True, inline=True)
def _linearize(
    problem: SolverProblem, workspace: Workspace, damping: float, cautious: bool, clearing: float
) -> None:
    """Write the step's quadratic program: H + lambda diag(d)^2 + eps^2, g, and the bounds of the step.

    A cautious step has a term |g_i| / (distance to the bound that joint i moves towards) on the diagonal
    (Coleman and Li, An interior trust region approach for nonlinear minimization subject to bounds, 1996).
    """
    index, low, high, result = problem.joints, problem.low, problem.high, workspace.result
    matrix, gradient, least, most = workspace.matrix, workspace.gradient, workspace.least, workspace.most
    m, k = index.size, problem.task_joints
    share = CAUTION if cautious else 1.0
    start = problem.tolerance.size + 1
    place = start + k
    for i in range(m):
        q = workspace.inputs[index[i]]
        slope = POSTURE_WEIGHT**2 * (q - problem.reference[index[i]])
        if i < k:
            slope = result[start + i] + slope
            for j in range(i, k):
                matrix[i, j] = result[place]
                place += 1
        for j in range(k if i < k else i, m):
            matrix[i, j] = 0.0
        gradient[i] = slope
    for r in range(workspace.near_count[0]):
        row, own = workspace.near[r], workspace.step
        if row[problem.reference.size] <= 0.0:
            continue
        for i in range(m):
            own[i] = row[index[i]]
        for i in range(m):
            part = clearing**2 * own[i]
            gradient[i] -= part * row[problem.reference.size]
            for j in range(i if part != 0.0 else m, m):
                matrix[i, j] += part * own[j]
    for i in range(m):
        q, slope = workspace.inputs[index[i]], gradient[i]
        matrix[i, i] += POSTURE_WEIGHT**2 + damping * problem.scale[i]
        if cautious and low[i] < high[i]:
            matrix[i, i] += slope / max(q - low[i], 1e-9) if slope > 0 else -slope / max(high[i] - q, 1e-9)
        least[i] = max(share * (low[i] - q), -STEP_BOUND)
        most[i] = min(share * (high[i] - q), STEP_BOUND)
        workspace.state[i] = FREE
        if cautious:
            workspace.state[i] = FREE if low[i] < high[i] else LOW
        elif least[i] > -1e-12 and slope > 0:
            workspace.state[i] = LOW
        elif most[i] < 1e-12 and slope < 0:
            workspace.state[i] = HIGH


@compiled(lean=True, inline=True)
def _propose(problem: SolverProblem, workspace: Workspace, cautious: bool) -> bool:
    """Write the configuration to try; return whether there is one."""
    matrix, gradient, step = workspace.matrix, workspace.gradient, workspace.step
    least, most, state, factor = workspace.least, workspace.most, workspace.state, workspace.factor
    good = solve_box(matrix, gradient, least, most, step, state, factor, cautious)
    for i in range(step.size):
        q = workspace.inputs[problem.joints[i]] + min(max(step[i], least[i]), most[i])
        workspace.trial[problem.joints[i]] = min(max(q, problem.low[i]), problem.high[i])
    return good


@compiled(lean=True, inline=True)
def _posture_cost(problem: SolverProblem, inputs: Floats1) -> float:
    """Return eps^2 |q - q_ref|^2 / 2, where q begins `inputs`, shape (>= n,)."""
    total = 0.0
    for i in range(problem.joints.size):
        shift = inputs[problem.joints[i]] - problem.reference[problem.joints[i]]
        total += shift * shift
    return 0.5 * POSTURE_WEIGHT**2 * total


@compiled(lean=True)
def look_around(tests: CollisionTests, workspace: Workspace, q: Floats1, clearing: float) -> float:
    """Write what is near at q, shape (n,) or longer, into `near_trial`; return the cost of it."""
    rows = workspace.near_trial
    count = call_four(tests.near, q.ctypes.data, rows.ctypes.data, MOST_NEAR, tests.near_memory)
    workspace.near_count[1] = count
    total, n = 0.0, rows.shape[1] - 2
    for r in range(count):
        total += rows[r, n] * rows[r, n]
    return 0.5 * clearing**2 * total


@compiled(lean=True, inline=True)
def _look_along(problem: SolverProblem, workspace: Workspace, q: Floats1, clearing: float) -> float:
    """Write the shortages of `near` at q, linear from `inputs`, into `shortages`; return their cost."""
    index, n, total = problem.joints, problem.reference.size, 0.0
    for r in range(workspace.near_count[0]):
        row = workspace.near[r]
        shortage = row[n]
        for i in range(index.size):
            shortage -= row[index[i]] * (q[index[i]] - workspace.inputs[index[i]])
        workspace.shortages[r] = shortage
        if shortage > 0.0:
            total += shortage * shortage
    return 0.5 * clearing**2 * total


@compiled(lean=True, inline=True)
def _keep_along(workspace: Workspace) -> None:
    """Take the shortages that `_look_along` has written."""
    n = workspace.near.shape[1] - 2
    for r in range(workspace.near_count[0]):
        row, shortage = workspace.near[r], workspace.shortages[r]
        row[n + 1] += shortage - row[n]
        row[n] = shortage


@compiled(lean=True)
def keep_near(workspace: Workspace) -> None:
    """Copy what is near at the configuration to try to what is near at q."""
    workspace.near_count[0] = workspace.near_count[1]
    for r in range(workspace.near_count[0]):
        for i in range(workspace.near.shape[1]):
            workspace.near[r, i] = workspace.near_trial[r, i]


@compiled(lean=True)
def _touches(workspace: Workspace) -> bool:
    """Whether something seems to touch at q."""
    last, deepest = workspace.near.shape[1] - 1, -1.0
    for r in range(workspace.near_count[0]):
        deepest = max(deepest, workspace.near[r, last])
    return deepest >= 0.0
