"""Levenberg-Marquardt descents to the nearest minimum, within joint limits and without collisions."""

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
"""Maximum change of one joint in one step [rad or m]: beyond it the linear model is inaccurate."""

SMALL_STEP, SMALL_GAIN = 1e-6, 1e-7
"""Size of a step [rad or m], and gain relative to the cost, below which a minimum counts as reached."""

CLOSE = 0.1
"""Fraction of its tolerance at which every error is small enough to end a descent."""

POSTURE_WEIGHT = 1e-4
"""Weight of |q - q_ref|: it only decides where the tasks leave freedom, and is negligible near the goal."""

CAUTION, CAUTIOUS_STEPS = 0.4, 10
"""Fraction of the way to a bound that a step may go, in this number of first steps: it avoids many local
minima on the bounds."""

REFLECTION, REFLECTIONS = 0.3, 2
"""Ratio of the distance to the middle of a joint range by which a reflected start lies beyond the middle, and
number of reflections after a descent that ends in a local minimum.  Such minima lie on the bounds, and the
solutions that they hide lie in the other half of the range: nine in ten descents from there succeed."""

MOST_NEAR = 32
"""Maximum number of pairs of bodies that a step considers."""

TIMED_OUT = 2
"""Value of `Workspace.stop` when the deadline has passed."""


class SolverProblem(NamedTuple):
    """One problem: min sum_i s_i^2 |r_i(q)|^2 / 2 + eps^2 |q - q_ref|^2 / 2  within  low <= q <= high.

    Attributes:
        kernel: Address of `void f(const double* input, double* result, double* work)`, which writes the
            squared errors of the t tasks, the cost, its gradient by the first k joints, and the upper
            triangle of the Gauss-Newton matrix, row by row; see
            `pepper_kin.ik.fast.expression.task_function`.
        work: Workspace of the kernel, shape (work_size,).
        task_joints: k, number of joints on which the kernel depends.
        joints: Indices in q of the joints that move, shape (m,), m >= k; the kernel depends on the first k.
        low: Lower bounds of the moving joints [rad or m], shape (m,).
        high: Upper bounds of the moving joints [rad or m], shape (m,).
        scale: d_i^2, the weights of the damping lambda |diag(d) dq|^2, shape (m,).
        reference: q_ref, shape (n,) [rad or m].
        tolerance: Squared tolerances of the tasks, shape (t,).
        stop_when_met: Whether a descent ends once all tasks are well met.
        clock: Address of `clock_gettime`.
        deadline: Time at which to stop [s], infinite for never.
        signals: See `pepper_kin.kernels.interrupts`, shape (8,); the kernel may also set the word STOPPED.
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
        verdict: Address of `pepper_kin.core.inverse_kinematics.verdict`.
        memory: Address of the block of `verdict`.
        size: Number of doubles of that block.
        is_free: (q, 0, 0, 0) -> whether q is collision-free; called if `verdict` is 0 or returns TIE; if
            `is_free` is 0 itself, ties count as contacts.
        near: Address of `near_rows` of `pepper_kin.core.inverse_kinematics.proximity`; 0 if collisions are
            not considered.
        near_memory: Address of the block of `near`.
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
        trial: The kernel's input at the trial configuration, shape (n + t + ...,).
        result: The kernel's output at q, see `SolverProblem`, shape (t + 1 + k + k (k + 1) / 2,).
        other: The kernel's output at the trial configuration, of the same shape.
        matrix: Matrix of the step's quadratic program, shape (m, m).
        factor: Factor of `matrix`, see `solve_box`, shape (m, m + 1).
        gradient: Gradient of the quadratic program, shape (m,).
        step: Solution of the quadratic program [rad or m], shape (m,).
        least: Lower bounds of the step [rad or m], shape (m,).
        most: Upper bounds of the step [rad or m], shape (m,).
        state: Active bounds, shape (m,).
        near: Nearby pairs at q, see `near_rows`, shape (MOST_NEAR, n + 2); empty if collisions are not
            considered.
        near_trial: Nearby pairs at the trial configuration, of the same shape.
        near_count: Number of rows written in `near` and `near_trial`, shape (2,).
        shortages: Linearized shortfalls of `near` at the trial configuration, shape (MOST_NEAR,).
        clock: Workspace of `seconds_now`, shape (2,).
        watch: Time at which signals are checked next [s], shape (1,).
        stop: 1 or TIMED_OUT if the search has to end, else 0, shape (1,).
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
    """Return whether the search has to end: deadline passed, signal received, or kernel has set STOPPED."""
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
    """Return whether q, shape (>= n,), is collision-free; True if collisions are not considered."""
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
    """Return the maximum error^2 / tolerance^2, from arrays of the shapes (>= t,) and (t,)."""
    worst = 0.0
    for i in range(tolerance.size):
        worst = max(worst, result[i] / tolerance[i])
    return worst


@compiled(lean=True, inline=True)
def evaluate(problem: SolverProblem, inputs: Floats1, result: Floats1) -> None:
    """Call the kernel; `inputs` and `result`, and their shapes, are those of `Workspace`."""
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
    """Minimize the cost by Levenberg-Marquardt steps within the bounds; return the number of steps.

    A step is accepted only if it lowers the cost; otherwise the damping grows and the next step is shorter.
    With `clearing`, c, the cost has a term c^2 s_k^2 / 2 for each pair of bodies that is nearer than its
    required distance, by s_k; such a descent ends as soon as the tasks are well met and no pair touches.

    Args:
        problem: The problem.
        tests: Collision tests, used with `clearing`.
        workspace: `inputs` holds the start, and afterwards the result; `result` the kernel's output there.
        max_iterations: Maximum number of steps, accepted or not.
        small_gain: Gain relative to the cost below which a step is the last; with more than SMALL_GAIN, the
            minimum is found less accurately.
        cautious_steps: Number of first steps that keep away from the bounds.
        clearing: Weight of the shortfalls of distance; 0 to ignore collisions.
        frozen: Whether nearby pairs and their gradients are those of `workspace.near` in all steps, with the
            shortfalls that they have at the start, instead of being measured in each step.
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
    """Copy the first `count` numbers of an array, shape (>= count,), to another."""
    for i in range(count):
        target[i] = source[i]


@compiled(lean=True, inline=True)
def _distance(index: Ints1, a: Floats1, b: Floats1) -> float:
    """Return the maximum change of a joint from b to a [rad or m]; joints: `index`, shape (m,)."""
    size = 0.0
    for i in range(index.size):
        size = max(size, abs(a[index[i]] - b[index[i]]))
    return size


@compiled(lean=True)
def reflect(problem: SolverProblem, inputs: Floats1) -> None:
    """Move each joint from q to c - REFLECTION (q - c), with c the middle of its range; see `REFLECTION`.

    q is at the start of `inputs`, see `Workspace`, shape (n + t + ...,).  A joint without bounds stays.
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

    A cautious step has a term |g_i| / (distance to the bound that joint i approaches) on the diagonal
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
    """Write the trial configuration; return whether the step could be solved."""
    matrix, gradient, step = workspace.matrix, workspace.gradient, workspace.step
    least, most, state, factor = workspace.least, workspace.most, workspace.state, workspace.factor
    good = solve_box(matrix, gradient, least, most, step, state, factor, cautious)
    for i in range(step.size):
        q = workspace.inputs[problem.joints[i]] + min(max(step[i], least[i]), most[i])
        workspace.trial[problem.joints[i]] = min(max(q, problem.low[i]), problem.high[i])
    return good


@compiled(lean=True, inline=True)
def _posture_cost(problem: SolverProblem, inputs: Floats1) -> float:
    """Return eps^2 |q - q_ref|^2 / 2, with q at the start of `inputs`, shape (>= n,)."""
    total = 0.0
    for i in range(problem.joints.size):
        shift = inputs[problem.joints[i]] - problem.reference[problem.joints[i]]
        total += shift * shift
    return 0.5 * POSTURE_WEIGHT**2 * total


@compiled(lean=True)
def look_around(tests: CollisionTests, workspace: Workspace, q: Floats1, clearing: float) -> float:
    """Write the nearby pairs at q, shape (>= n,), into `near_trial`; return the cost of their shortfalls."""
    rows = workspace.near_trial
    count = call_four(tests.near, q.ctypes.data, rows.ctypes.data, MOST_NEAR, tests.near_memory)
    workspace.near_count[1] = count
    total, n = 0.0, rows.shape[1] - 2
    for r in range(count):
        total += rows[r, n] * rows[r, n]
    return 0.5 * clearing**2 * total


@compiled(lean=True, inline=True)
def _look_along(problem: SolverProblem, workspace: Workspace, q: Floats1, clearing: float) -> float:
    """Write the shortfalls of `near` at q, linearized at `inputs`, into `shortages`; return their cost."""
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
    """Update `near` by the shortfalls that `_look_along` has written."""
    n = workspace.near.shape[1] - 2
    for r in range(workspace.near_count[0]):
        row, shortage = workspace.near[r], workspace.shortages[r]
        row[n + 1] += shortage - row[n]
        row[n] = shortage


@compiled(lean=True)
def keep_near(workspace: Workspace) -> None:
    """Copy the nearby pairs of the trial configuration to those of q."""
    workspace.near_count[0] = workspace.near_count[1]
    for r in range(workspace.near_count[0]):
        for i in range(workspace.near.shape[1]):
            workspace.near[r, i] = workspace.near_trial[r, i]


@compiled(lean=True)
def _touches(workspace: Workspace) -> bool:
    """Return whether a nearby pair seems to touch at q."""
    last, deepest = workspace.near.shape[1] - 1, -1.0
    for r in range(workspace.near_count[0]):
        deepest = max(deepest, workspace.near[r, last])
    return deepest >= 0.0
