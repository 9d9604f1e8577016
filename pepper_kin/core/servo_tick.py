"""One tick of a servo: from demands to the best velocity that every limit allows.

    min over v' of  sum_i w_i^2 |J_i v' - rate_i|^2 + lambda^2 |D v'|^2 + eps^2 |v' - k (q_rest - q)|^2
    subject to      velocity bounds (always kept), clearance rows (kept unless even braking or balance
                    breaks them), balance rows (kept as far as bounds allow)

A velocity is taken if the hardest brake after it stays clear.  With balance, the hardest brake would tip the
robot: then a brake of so small a share of it that balance is kept has to stay clear too, and where nothing is
known to stop clear, the robot brakes as hard as balance allows if that is known to be clear.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pepper_kin.core.balance_rows import BalanceTable, write_balance_rows
from pepper_kin.core.brake_check import EVERYTHING, FARTHEST, NOTHING, UNKNOWN, obstacle
from pepper_kin.core.braking import (
    DAMPING,
    LOCKED,
    JointLimits,
    VelocityInterval,
    approach_rate,
    bound_velocities,
    brake_joints,
    brake_path,
)
from pepper_kin.core.linear_algebra import dot
from pepper_kin.core.near_state import NearState, NearWorld, moved, near_at
from pepper_kin.core.quadratic_program import QuadraticProgram, solve
from pepper_kin.core.velocity_dampers import PairTable, RangeTable, write_range_rows
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Flags1, Floats1, Floats2, Ints1

REST_WEIGHT = 5e-3
REST_GAIN = 0.5
"""Weight and gain [1/s] of the pull towards the rest posture: seen only where the demands leave freedom."""

BRAKE_SHARE = 0.7
LEAST_BRAKE = 0.1
"""Share that balance leaves of the hardest brake which is counted on, and the least that is."""

ATTEMPTS = 3
"""Times that joints which could not stop clear are made to brake, before all of them are."""

HARD = 0.5
"""Share of the clearance that braking may use up."""

PARTING = 10.0
"""Weight of the separation of pairs nearer than the clearance, over the tasks."""

NOTICEABLE = 1e-6
TINY = 1e-7
"""An excess over a row smaller than the first is rounding, and one over a bound smaller than the second."""

FREE, BRAKING, STOPPING, FAILED = 0, 1, 2, 3
"""Outcomes: a velocity, one for which some joints brake, all of them braking, a call-back that
has failed."""

SOLVER, ALL, BALANCE, KINDS = 0, 1, 2, 3
"""Numbers of names: the solver, clearance, balance, then the bounds of all joints of one kind after another
(acceleration, velocity, position), the curves of ranges, and the pairs."""

SIZE, WEIGHT, IS_TASK, IS_CURVED, HEAD = 0, 1, 2, 3, 4
"""Columns of a demand: its rows, its weight, whether `wanted` is a residual (1) or a rate (0), and whether
its Jacobian changes as joints move; and their number."""


class Demands(NamedTuple):
    """What is wanted of the next velocity, one demand after the other, m rows in all.

    Attributes:
        heads: See SIZE, ..., shape (k, HEAD).
        jacobian: J, shape (m, n).
        wanted: Residuals [m or rad] and rates [m/s or rad/s], shape (m,).
        drift: How fast moving targets change the residuals by themselves [m/s or rad/s], shape (m,).
    """

    heads: Floats2
    jacobian: Floats2
    wanted: Floats1
    drift: Floats1


class ServoTable(NamedTuple):
    """A robot under a servo.

    Attributes:
        limits: Of the joints.
        scale: The diagonal of D, greater for joints that carry more, shape (n,).
        rest: q_rest [rad or m], shape (n,).
        ranges: Joint ranges that stand for pairs of neighbors.
        dt: Length of a tick [s].
        gain: Greatest share of an error that is removed per second [1/s].
        singularity: Slope [m/rad] under which motion slows down.
        clearance: Distance that pairs keep [m].
        approach: Share of the free distance that may be used up per second [1/s].
    """

    limits: JointLimits
    scale: Floats1
    rest: Floats1
    ranges: RangeTable
    dt: float
    gain: float
    singularity: float
    clearance: float
    approach: float


class TickResult(NamedTuple):
    """What `decide` writes.

    Attributes:
        v: The next velocity [rad/s or m/s], shape (n,).
        shares: Share of each demand's speed that singularities leave, shape (k,).
        nearest: The smallest distances before the tick, to itself and to obstacles [m], inf where nothing is
            near, shape (2,).
        names: Numbers of what v touches, then of what it breaks, see SOLVER, ....
    """

    v: Floats1
    shares: Floats1
    nearest: Floats1
    names: Ints1


class _Rows(NamedTuple):
    """matrix @ v' >= least - slack: the dampers, from `balance` on those of balance; names by number."""

    matrix: Floats2
    least: Floats1
    slack: Floats1
    names: Ints1
    balance: int


class _Moment(NamedTuple):
    """What a tick knows before it decides: rows, near pairs, and the acceleration of the brake counted on."""

    rows: _Rows
    near: NearState
    braking: Floats1


@compiled
def _bound(row: Floats1, bounds: VelocityInterval, sign: float) -> float:
    """Return the greatest (sign 1) or the least (-1) value of a row within bounds."""
    total = 0.0
    for i in range(row.size):
        a, b = row[i] * bounds.low[i], row[i] * bounds.high[i]
        total += max(a, b) if sign > 0.0 else min(a, b)
    return total


@compiled
def _share_kept(matrix: Floats2, least: Floats1, start: Floats1, end: Floats1) -> float:
    """Return how far v may go from one velocity to another before it breaks a row, 0 to 1."""
    share = 1.0
    for k in range(least.size):
        slack = dot(matrix[k], start) - least[k]
        change = dot(matrix[k], end) - dot(matrix[k], start)
        if change < 0.0:
            share = min(share, slack / -change)
    return max(share, 0.0)


@compiled
def _look(table: ServoTable, world: NearWorld, q: Floats1, bounds: VelocityInterval, a: Floats1) -> NearState:
    """Return the pairs that matter at q for any velocity within bounds and a brake at a, shape (n,)."""
    fastest = np.empty(q.size)
    for i in range(q.size):
        fastest[i] = max(abs(bounds.low[i]), abs(bounds.high[i]))
    shifts, hard = brake_path(fastest, a, table.dt), HARD * table.clearance
    damped = table.clearance + dot(world.motion_bounds, fastest) / table.approach
    stopped = hard + dot(world.motion_bounds, shifts[shifts.shape[0] - 1])
    return near_at(world, q, min(max(damped, stopped), FARTHEST))


@compiled
def _nobody(n: int) -> NearState:
    """Return a state of no pairs."""
    table = PairTable(
        np.empty((0, n)), np.empty((0, n), dtype=np.bool_), np.empty(0), np.empty(n), np.empty(0)
    )
    return NearState(True, 0.0, np.empty(0, dtype=np.int64), np.empty(0), table)


@compiled
def _all_rows(
    table: ServoTable, world: NearWorld, q: Floats1, moment: tuple[NearState, Floats1, float], balance: _Rows
) -> _Rows:
    """Return the dampers at q, shape (n,), and the rows of balance.

    Args:
        table: The robot.
        world: The pairs.
        q: Joint positions [rad or m], shape (n,).
        moment: The near pairs, where the hardest brake would end, shape (n,), and caution.
        balance: The rows of balance.
    """
    near, stop, caution = moment
    n, gain, pairs = q.size, table.approach * caution, near.distances.size
    curves = 2 * table.ranges.heads.shape[0] if world.examined else 0
    dampers, first = pairs + curves, KINDS + 3 * n
    size = dampers + balance.least.size
    matrix, least, names = np.zeros((size, n)), np.empty(size), np.empty(size, dtype=np.int64)
    slack = np.zeros(size)
    for k in range(pairs):
        matrix[k] = near.table.gradients[k]
        least[k] = -gain * max(near.distances[k] - table.clearance, 0.0)
        names[k] = first + table.ranges.heads.shape[0] + near.indices[k]
    if curves > 0:
        write_range_rows(table.ranges, q, stop, gain, matrix[pairs:dampers], least[pairs:dampers])
    for k in range(curves):
        names[pairs + k] = first + k // 2
    for k in range(balance.least.size):
        matrix[dampers + k], least[dampers + k] = balance.matrix[k], balance.least[k]
        slack[dampers + k], names[dampers + k] = balance.slack[k], BALANCE
    return _Rows(matrix, least, slack, names, dampers)


@compiled
def _write_demands(
    table: ServoTable, v: Floats1, demands: Demands, rows: tuple[Floats2, Floats1], shares: Floats1
) -> float:
    """Write weighted rows of demands and the shares that singularities leave; return the sum of dampings.

    A task asks for dr/dt = -s r.  With dq the damped Gauss-Newton step to the target, every joint covers its
    part of it at the speed s |dq_i|.  s is the greatest rate up to the gain at which no joint exceeds its
    velocity limit or the speed from which it can stop within |dq_i|; singularities lower it further, see
    `approach_rate`.

    Damping keeps a robot from trembling that is pulled in vain.  Where a direction is lost, at a stretched
    arm or at an obstacle, its slope is about R x, with x how far a joint is from there and R a lever arm.
    Pulled at a speed p without yielding, the joint obeys dx/dt = -R p x / lambda^2, which in steps of dt
    swings unless lambda^2 > R p dt / 2.  This is 2 p dt, for an R of a meter, with p the part of the wanted
    rate that the last velocity failed to deliver.

    Args:
        table: The robot.
        v: The last velocity [rad/s or m/s], shape (n,).
        demands: What is wanted.
        rows: Written: w J, shape (>= m, n), and w rate, shape (>= m,).
        shares: Written, shape (k,).
    """
    matrix, rate = rows
    begin, damping = 0, 0.0
    for d in range(demands.heads.shape[0]):
        end, weight = begin + int(demands.heads[d, SIZE]), demands.heads[d, WEIGHT]
        jacobian, wanted = demands.jacobian[begin:end], demands.wanted[begin:end]
        pull, share = approach_rate(
            jacobian, wanted, table.scale, table.limits, table.dt, table.gain, table.singularity
        )
        factor = -pull * share if demands.heads[d, IS_TASK] > 0.0 else share
        shares[d] = share
        missing, whole = 0.0, 0.0
        for k in range(begin, end):
            rate[k] = factor * demands.wanted[k] - demands.drift[k]
            missing += (rate[k] - dot(demands.jacobian[k], v)) ** 2
            whole += rate[k] * rate[k]
            for i in range(v.size):
                matrix[k, i] = weight * demands.jacobian[k, i]
            rate[k] *= weight
        if demands.heads[d, IS_CURVED] > 0.0:
            damping += weight * weight * 2.0 * min(math.sqrt(missing), math.sqrt(whole)) * table.dt
        begin = end
    return damping


@compiled
def _write_objective(
    table: ServoTable,
    q: Floats1,
    rows: tuple[Floats2, Floats1, float],
    hessian: Floats2,
    gradient: Floats1,
) -> None:
    """Write the objective of weighted rows; without any, the joints go to rest, each as hard as it is dear.

    Args:
        table: The robot.
        q: Joint positions [rad or m], shape (n,).
        rows: w J, shape (m, n), w rate, shape (m,), and what is added to lambda^2.
        hessian: Written, shape (n, n).
        gradient: Written, shape (n,).
    """
    matrix, rate, damping = rows
    n = q.size
    hessian[:] = 0.0
    gradient[:] = 0.0
    if rate.size == 0:
        for i in range(n):
            hessian[i, i] = table.scale[i] * table.scale[i]
        return
    for k in range(rate.size):
        row = matrix[k]
        for i in range(n):
            gradient[i] -= rate[k] * row[i]
            for j in range(i + 1):
                hessian[i, j] += row[i] * row[j]
    for i in range(n):
        gradient[i] -= REST_WEIGHT * REST_WEIGHT * REST_GAIN * (table.rest[i] - q[i])
        cost = DAMPING * DAMPING + damping
        hessian[i, i] += cost * table.scale[i] * table.scale[i] + REST_WEIGHT * REST_WEIGHT
        for j in range(i):
            hessian[j, i] = hessian[i, j]


@compiled
def _minimum(
    hessian: Floats2, gradient: Floats1, bounds: VelocityInterval, rows: _Rows, first: int, v: Floats1
) -> bool:
    """Write the best velocity within bounds and rows; return whether there is one.

    Dampers are relaxed so far that the hardest brake keeps them, rows of balance so far that some velocity
    within the bounds does.

    Args:
        hessian: Shape (n, n).
        gradient: Shape (n,).
        bounds: Of the velocity.
        rows: Of clearance and of balance.
        first: The first row that counts.
        v: Written, shape (n,) [rad/s or m/s].
    """
    n, count = v.size, 0
    matrix, least = np.empty((rows.least.size, n)), np.empty(rows.least.size)
    for k in range(first, rows.least.size):
        kept = rows.least[k] - rows.slack[k]
        if k < rows.balance:
            kept = min(kept, dot(rows.matrix[k], bounds.brake))
        else:
            kept = min(kept, _bound(rows.matrix[k], bounds, 1.0))
        if _bound(rows.matrix[k], bounds, -1.0) < kept:
            matrix[count], least[count] = rows.matrix[k], kept
            count += 1
    program = QuadraticProgram(hessian, gradient, bounds.low, bounds.high, matrix[:count], least[:count])
    if not solve(program, v):
        return False
    for i in range(n):
        if not math.isfinite(v[i]):
            return False
        v[i] = min(max(v[i], bounds.low[i]), bounds.high[i])
    return True


@compiled
def _best(hessian: Floats2, gradient: Floats1, bounds: VelocityInterval, rows: _Rows, v: Floats1) -> bool:
    """Write the best velocity that keeps the balance, and the dampers too if both can be kept.

    Without rows of clearance it is the look along the brake path that keeps the robot clear.  Arguments and
    result are those of `_minimum`.
    """
    if _minimum(hessian, gradient, bounds, rows, 0, v):
        return True
    return rows.balance < rows.least.size and _minimum(hessian, gradient, bounds, rows, rows.balance, v)


@compiled
def _stands_in_the_way(
    table: ServoTable, world: NearWorld, q: Floats1, v: Floats1, moment: _Moment, joints: Flags1
) -> int:
    """Return what a velocity and a brake run into, see `obstacle`; with balance the hardest brake as well."""
    if not world.examined:
        return NOTHING
    hard, limit = HARD * table.clearance, table.limits.acceleration
    shifts = brake_path(v, limit, table.dt)
    found = obstacle(world, table.ranges, q, shifts, moment.near, hard, joints)
    if found == NOTHING and moment.rows.balance < moment.rows.least.size:
        shifts = brake_path(v, moment.braking, table.dt)
        found = obstacle(world, table.ranges, q, shifts, moment.near, hard, joints)
    return int(found)


@compiled
def _name_bounds(v: Floats1, bounds: VelocityInterval, names: Ints1, count: int) -> int:
    """Write the numbers of the bounds that v touches after `count` others; return how many there are then."""
    n = v.size
    for side in range(2):
        for i in range(n):
            kind = bounds.low_kind[i] if side else bounds.high_kind[i]
            touched = v[i] <= bounds.low[i] + TINY if side else v[i] >= bounds.high[i] - TINY
            if touched and kind != LOCKED:
                names[count] = KINDS + n * kind + i
                count += 1
    return count


@compiled
def _name_rows(v: Floats1, rows: _Rows, broken: bool, names: Ints1, count: int) -> int:
    """The same for the rows that v touches or, if `broken`, breaks."""
    for k in range(rows.least.size):
        excess = dot(rows.matrix[k], v) - rows.least[k]
        if (-excess > NOTICEABLE) if broken else (excess < NOTICEABLE):
            names[count] = rows.names[k]
            count += 1
    return count


@compiled
def _parting(table: ServoTable, near: NearState, rows: tuple[Floats2, Floats1], count: int) -> int:
    """Append rows that separate pairs nearer than the clearance c, at gain (c - d); return how many then."""
    matrix, rate = rows
    for k in range(near.distances.size):
        if near.distances[k] < table.clearance:
            for i in range(matrix.shape[1]):
                matrix[count, i] = PARTING * near.table.gradients[k, i]
            rate[count] = PARTING * table.approach * (table.clearance - near.distances[k])
            count += 1
    return count


@compiled
def _stopping(
    table: ServoTable, world: NearWorld, q: Floats1, bounds: VelocityInterval, moment: _Moment, v: Floats1
) -> bool:
    """Write the hardest brake, or with balance one that keeps it and is as clear; return False if failed."""
    v[:] = bounds.brake
    if moment.rows.balance == moment.rows.least.size:
        return True
    n = v.size
    hessian, gradient, found = np.empty((n, n)), np.empty(n), np.empty(n)
    nothing = np.empty((0, n)), np.empty(0), 0.0
    _write_objective(table, q, nothing, hessian, gradient)
    if not _best(hessian, gradient, bounds, moment.rows, found):
        return True
    joints, hard = np.empty(n, dtype=np.bool_), HARD * table.clearance
    if world.examined:
        shifts = brake_path(found, table.limits.acceleration, table.dt)
        hit = obstacle(world, table.ranges, q, shifts, moment.near, hard, joints)
        if hit != NOTHING:
            return hit != UNKNOWN
    v[:] = found
    return True


@compiled(
    "Tuple(int64, int64, int64)(ServoTable, NearWorld, BalanceTable, float64[::1], float64[::1], float64, "
    "Demands, TickResult)"
)
def decide(
    table: ServoTable,
    world: NearWorld,
    standing: BalanceTable,
    q: Floats1,
    v: Floats1,
    caution: float,
    demands: Demands,
    result: TickResult,
) -> tuple[int, int, int]:
    """Decide a tick.

    Args:
        table: The robot.
        world: What it keeps clear of.
        standing: Its balance; without corners, none is kept.
        q: Joint positions [rad or m], shape (n,).
        v: The last velocity [rad/s or m/s], shape (n,).
        caution: Factor on the speed of approach to obstacles, up to 1.
        demands: What is wanted; nothing brakes: as hard as can be, or as balance allows.
        result: Written.

    Returns:
        The outcome, see FREE; the numbers of names that v touches and breaks.
    """
    n, dt, hardest, edges = q.size, table.dt, table.limits.acceleration, 2 * standing.corners.shape[0]
    low, high, brake = np.empty(n), np.empty(n), np.empty(n)
    low_kind, high_kind = np.empty(n, dtype=np.int64), np.empty(n, dtype=np.int64)
    bounds = VelocityInterval(low, high, brake, low_kind, high_kind)
    bound_velocities(q, v, table.limits, dt, bounds)
    names = np.empty(edges, dtype=np.int64)
    kept = _Rows(np.empty((edges, n)), np.empty(edges), np.empty(edges), names, 0)
    share = 1.0
    if edges > 0:
        write_balance_rows(standing, q, v, dt, kept.matrix, kept.least, kept.slack)
        share = max(BRAKE_SHARE * _share_kept(kept.matrix, kept.least, v, brake), LEAST_BRAKE)
    braking = np.empty(n)
    for i in range(n):
        braking[i] = share * hardest[i]
    near = _look(table, world, q, bounds, braking) if world.examined else _nobody(n)
    if not near.known:
        return FAILED, 0, 0
    result.nearest[:] = math.inf
    for k in range(near.distances.size):
        kind = 1 if world.to_world[near.indices[k]] else 0
        result.nearest[kind] = min(result.nearest[kind], near.distances[k])
    count = demands.wanted.size
    if count == 0 and edges == 0:
        result.v[:] = brake
        return FREE, 0, 0
    stops = brake_path(brake, braking, dt)
    rows = _all_rows(table, world, q, (near, moved(q, stops[stops.shape[0] - 1]), caution), kept)
    moment = _Moment(rows, near, braking)
    matrix, rate = np.empty((count + near.distances.size, n)), np.empty(count + near.distances.size)
    damping = _write_demands(table, v, demands, (matrix, rate), result.shares)
    count = _parting(table, near, (matrix, rate), count)
    hessian, gradient = np.empty((n, n)), np.empty(n)
    _write_objective(table, q, (matrix[:count], rate[:count], damping), hessian, gradient)
    outcome, named = _attempt(table, world, q, v, (hessian, gradient), bounds, moment, result)
    if outcome == STOPPING:
        bound_velocities(q, v, table.limits, dt, bounds)
        if not _stopping(table, world, q, bounds, moment, result.v):
            outcome = FAILED
    broken = _name_rows(result.v, rows, True, result.names, named) - named
    return outcome, named, broken


@compiled
def _attempt(
    table: ServoTable,
    world: NearWorld,
    q: Floats1,
    v: Floats1,
    objective: tuple[Floats2, Floats1],
    bounds: VelocityInterval,
    moment: _Moment,
    result: TickResult,
) -> tuple[int, int]:
    """Look for a velocity that is known to stop clear, with more and more joints braking.

    Args:
        table: The robot.
        world: What it keeps clear of.
        q: Joint positions [rad or m], shape (n,).
        v: The last velocity [rad/s or m/s], shape (n,).
        objective: Hessian, shape (n, n), and gradient, shape (n,).
        bounds: Of the velocity, changed.
        moment: Rows and near pairs.
        result: Its velocity and names are written.

    Returns:
        The outcome, STOPPING where none was found, and the number of names.
    """
    hessian, gradient = objective
    joints, named = np.empty(q.size, dtype=np.bool_), 0
    gentle = np.empty(q.size)
    for i in range(q.size):
        gentle[i] = math.copysign(max(abs(v[i]) - moment.braking[i] * table.dt, 0.0), v[i])
    for _ in range(ATTEMPTS):
        if not _best(hessian, gradient, bounds, moment.rows, result.v):
            result.names[named] = SOLVER
            return STOPPING, named + 1
        found = _stands_in_the_way(table, world, q, result.v, moment, joints)
        if found == UNKNOWN:
            return FAILED, 0
        if found == NOTHING:
            touched = _name_bounds(result.v, bounds, result.names, named)
            return min(named, BRAKING), _name_rows(result.v, moment.rows, False, result.names, touched)
        result.names[named] = ALL if found == EVERYTHING else KINDS + 3 * q.size + found - 1
        named += 1
        brake_joints(bounds, joints, gentle)
    return STOPPING, named
