"""Compiled feasible interior-point search: steps of Newton's method on cost + mu * barrier."""

from __future__ import annotations

import math

from pepper_kin.core.clock import seconds_now
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats2

from .compiled_term import FAILED, RAISED
from .merit import add_costs, measure, sample, tighten
from .system import fill_system, solve_system
from .tables import (
    BEND,
    COST,
    DAMPING,
    DURATION,
    FALL,
    FIXED,
    MU,
    QUIET,
    SHARE,
    STEP,
    WALLS,
    SplineTables,
    SplineWorkspace,
)

ARMIJO = 1e-4
SHORTEST = 1e-5  # minimum step length of the line search
FIRST_MU, LAST_MU = 2e-3, 1e-4  # first and last mu relative to the cost
SHRINK = 0.4  # factor on mu after a step of good length or near the minimum for mu
LONG = 0.5
LIGHT, MOST_DAMPING = 1e-3, 1e6
LITTLE = 1.0
NEAR, NEAR_ENOUGH = 0.3, 10.0

GOING_ON, CONVERGED, STALLED, TIME_UP, SHORT_ENOUGH, BROKEN = range(6)
"""Statuses of a call; BROKEN if a term failed."""


@compiled("boolean(SplineTables, SplineWorkspace, float64[:, ::1], float64)", lean=True)
def measure_motion(tables: SplineTables, work: SplineWorkspace, control: Floats2, duration: float) -> bool:
    """Write cost and barrier of a motion into `numbers`; see `measure`."""
    return measure(tables, work, control, duration)


@compiled("boolean(SplineTables, SplineWorkspace, float64[:, ::1], float64)", lean=True)
def measure_cost(tables: SplineTables, work: SplineWorkspace, control: Floats2, duration: float) -> bool:
    """Write the cost of a motion into `numbers`; the motion may violate limits."""
    sample(tables, work, control, duration)
    return add_costs(tables, work, control, duration)


@compiled(lean=True)
def _try_lengths(tables: SplineTables, work: SplineWorkspace, value: float) -> float:
    """Move by the first of the ratios 1, 1/2, 1/4 ... of the step that keeps limits and lowers the merit.

    Returns:
        The ratio; 0 for none, and -1 if a term failed.
    """
    numbers, control, trial, step = work.numbers, work.control, work.trial, work.step
    n, t, t_step = control.shape[1], numbers[DURATION], numbers[STEP]
    mu, fall = numbers[MU], numbers[FALL]
    length = 1.0 if t_step >= 0.0 else min(1.0, 0.5 * t / -t_step)
    while length > SHORTEST:
        for i in range(control.shape[0] - 2 * FIXED):
            for j in range(n):
                trial[FIXED + i, j] = control[FIXED + i, j] + length * step[i * n + j]
        duration = t + length * t_step
        if not measure(tables, work, trial, duration):
            return -1.0
        if numbers[WALLS] < math.inf:
            new = numbers[COST] + mu * numbers[WALLS]
            if new <= value + ARMIJO * length * fall + 1e-12 * abs(value):
                for i in range(FIXED, control.shape[0] - FIXED):
                    for j in range(n):
                        control[i, j] = trial[i, j]
                numbers[DURATION] = duration
                return length
        length *= 0.5
    return 0.0


@compiled(lean=True)
def _step(
    tables: SplineTables, work: SplineWorkspace, free_duration: bool, tolerance: float
) -> tuple[int, bool]:
    """Make a step and lower mu where due; return the status, and whether the motion moved."""
    numbers = work.numbers
    # Slacks s shrink with mu while mu / s stays constant: the curvature mu / s^2 belongs to the mu before.
    bend = max(numbers[MU], numbers[BEND])
    if not fill_system(tables, work, work.control, numbers[DURATION], (numbers[MU], bend)):
        return BROKEN, False
    cost, value, damping = numbers[COST], numbers[COST] + numbers[MU] * numbers[WALLS], numbers[DAMPING]
    if not solve_system(work, damping, free_duration):
        numbers[DAMPING] = 10.0 * damping
        return (GOING_ON if numbers[DAMPING] < MOST_DAMPING else STALLED), False
    fall = numbers[FALL]
    numbers[BEND] = numbers[MU]
    length = _try_lengths(tables, work, value)
    if length < 0.0:
        return BROKEN, False
    if length == 0.0:
        numbers[DAMPING] = 100.0 * damping
    elif length >= LONG:
        numbers[DAMPING] = max(damping / 5.0, 1e-9)
    else:
        numbers[DAMPING] = min(4.0 * damping, 1e3)
    stuck = numbers[DAMPING] > MOST_DAMPING
    # A damped step promises little wherever it is made.
    light = length > 0.0 and damping <= LIGHT
    near = stuck or (light and -fall < NEAR * numbers[MU])
    if length > 0.0:
        # A change of the nearest body from step to step would prolong a damped search.
        gain = value - numbers[COST] - numbers[MU] * numbers[WALLS]
        numbers[QUIET] = numbers[QUIET] + 1.0 if gain < LITTLE * numbers[MU] else 0.0
    ended = near or (light and -fall < NEAR_ENOUGH * numbers[MU]) or numbers[QUIET] >= 2.0
    if numbers[SHARE] <= tolerance and ended:
        return (STALLED if stuck else CONVERGED), length > 0.0
    if near or length >= LONG:
        numbers[SHARE] = max(SHRINK * numbers[SHARE], tolerance)
        numbers[MU] = min(numbers[MU], numbers[SHARE] * cost)
        numbers[DAMPING] = min(numbers[DAMPING], 1.0)
    return GOING_ON, length > 0.0


@compiled(
    "Tuple(int64, int64)(SplineTables, SplineWorkspace, boolean, int64, float64, float64, float64, int64)",
    lean=True,
)
def search(
    tables: SplineTables, work: SplineWorkspace, free_duration: bool, steps: int, tolerance: float,
    until: float, stop_below: float, clock: int,
) -> tuple[int, int]:  # fmt: skip
    """Make steps from the motion in the workspace, which keeps all limits.

    Args:
        tables: Costs and constraints.
        work: Workspace; holds the motion, mu, the ratio of mu to the cost, and the damping.
        free_duration: Whether the duration may change.
        steps: Maximum number of steps.
        tolerance: Last mu relative to the cost.
        until: Time of the clock after which no step begins [s].
        stop_below: Duration below which the search ends.
        clock: See `seconds_now`.

    Returns:
        Status, GOING_ON if all steps are made, and the number of steps made.
    """
    for done in range(steps):
        if seconds_now(clock, work.clock) > until:
            return TIME_UP, done
        ended, moved = _step(tables, work, free_duration, tolerance)
        if ended == BROKEN:
            return BROKEN, done
        if moved:
            said = tighten(tables, work, work.control, work.numbers[DURATION])
            if said == FAILED:
                return BROKEN, done
            if said == RAISED and ended == CONVERGED:
                ended = GOING_ON  # the motion still gets out of what it began in
            if work.numbers[DURATION] < stop_below:
                return SHORT_ENOUGH, done + 1
        if ended != GOING_ON:
            return ended, done + 1
    return GOING_ON, steps
