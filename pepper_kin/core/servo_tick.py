"""One tick of a servo: the best joint velocity for all demands that every limit allows.

    min over v' of  sum_i w_i^2 |J_i v' - rate_i|^2 + lambda^2 |D v'|^2 + eps^2 |v' - k (q_rest - q)|^2
    subject to      velocity bounds (always satisfied), clearance rows (unless even braking or balance
                    violates them), balance rows (as far as bounds allow)

A velocity is accepted if braking from it at the maximum deceleration is collision-free.  With balance
constraints, the maximum deceleration would tip the robot: then braking at a reduced deceleration that keeps
the balance must be collision-free, too, and if no velocity is known to stop without collision, the robot
brakes as hard as the balance constraints allow if that is known to be collision-free.
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
"""Weight and gain [1/s] of the pull towards the rest posture, noticeable only where the demands leave
freedom."""

BRAKE_SHARE = 0.7
LEAST_BRAKE = 0.1
"""Ratio of the deceleration allowed by the balance constraints that is assumed to be usable, and minimum
ratio to the maximum deceleration."""

ATTEMPTS = 3
"""Maximum number of attempts in which the colliding joints are made to brake, before all joints are."""

HARD = 0.5
"""Ratio of the clearance that pairs keep while braking."""

PARTING = 10.0
"""Weight, relative to the tasks, of separating pairs nearer than the clearance."""

NOTICEABLE = 1e-6
TINY = 1e-7
"""Tolerance of an active or violated constraint row, and of an active bound [rad/s or m/s]."""

FREE, BRAKING, STOPPING, FAILED = 0, 1, 2, 3
"""Outcomes: a velocity; a velocity for which some joints brake; all joints brake; a call-back failed."""

SOLVER, ALL, BALANCE, KINDS = 0, 1, 2, 3
"""Ids of limiting constraints: solver, all clearance, balance, then the number of these ids.  From KINDS on
follow the bounds of all joints of one kind after another (acceleration, velocity, position), the curves of
joint ranges, and the pairs."""

SIZE, WEIGHT, IS_TASK, IS_CURVED, HEAD = 0, 1, 2, 3, 4
"""Columns of a demand: its number of rows, its weight, whether `wanted` is a residual (1) or a rate (0), and
whether its Jacobian changes as joints move; and the number of columns."""


class Demands(NamedTuple):
    """Demands on the next velocity, one after the other, m rows in all.

    Attributes:
        heads: Columns SIZE, ... of each demand, shape (k, HEAD).
        jacobian: J, shape (m, n).
        wanted: Residuals [m or rad] and rates [m/s or rad/s], shape (m,).
        drift: Rates of the residuals due to moving targets [m/s or rad/s], shape (m,).
    """

    heads: Floats2
    jacobian: Floats2
    wanted: Floats1
    drift: Floats1


class ServoTable(NamedTuple):
    """Constants of a robot under a servo.

    Attributes:
        limits: Limits of the joints.
        scale: Diagonal of D, greater for joints that carry more, shape (n,).
        rest: q_rest [rad or m], shape (n,).
        ranges: Joint ranges that stand for pairs of adjacent bodies.
        dt: Length of a tick [s].
        gain: Maximum ratio of an error that is removed per second [1/s].
        singularity: Singular value [m/rad] below which motion slows down.
        clearance: Distance that pairs keep [m].
        approach: Maximum ratio of the free distance that is used up per second [1/s].
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
    """Output of `decide`.

    Attributes:
        v: Next velocity [rad/s or m/s], shape (n,).
        shares: Factor by which singularities reduce each demand's speed, shape (k,).
        nearest: Minimum distances before the tick, to itself and to obstacles [m], inf if nothing is near,
            shape (2,).
        names: Ids of the constraints active at v, then of those that v violates, see SOLVER, ....
    """

    v: Floats1
    shares: Floats1
    nearest: Floats1
    names: Ints1


class _Rows(NamedTuple):
    """Rows matrix @ v' >= least - slack: clearance rows, from `balance` on balance rows; ids in `names`."""

    matrix: Floats2
    least: Floats1
    slack: Floats1
    names: Ints1
    balance: int


class _Moment(NamedTuple):
    """State of a tick before the decision: rows, nearby pairs, and the deceleration assumed to be usable."""

    rows: _Rows
    near: NearState
    braking: Floats1


@compiled
def _bound(row: Floats1, bounds: VelocityInterval, sign: float) -> float:
    """Return the maximum (sign 1) or minimum (sign -1) of a row, shape (n,), times v within bounds."""
    total = 0.0
    for i in range(row.size):
        a, b = row[i] * bounds.low[i], row[i] * bounds.high[i]
        total += max(a, b) if sign > 0.0 else min(a, b)
    return total


@compiled
def _share_kept(matrix: Floats2, least: Floats1, start: Floats1, end: Floats1) -> float:
    """Return the fraction of the way from one velocity to another at which a row is violated, at most 1."""
    share = 1.0
    for k in range(least.size):
        slack = dot(matrix[k], start) - least[k]
        change = dot(matrix[k], end) - dot(matrix[k], start)
        if change < 0.0:
            share = min(share, slack / -change)
    return max(share, 0.0)


@compiled
def _look(table: ServoTable, world: NearWorld, q: Floats1, bounds: VelocityInterval, a: Floats1) -> NearState:
    """Return the pairs that matter at q for any velocity within bounds and braking at a, shape (n,)."""
    fastest = np.empty(q.size)
    for i in range(q.size):
        fastest[i] = max(abs(bounds.low[i]), abs(bounds.high[i]))
    shifts, hard = brake_path(fastest, a, table.dt), HARD * table.clearance
    damped = table.clearance + dot(world.motion_bounds, fastest) / table.approach
    stopped = hard + dot(world.motion_bounds, shifts[shifts.shape[0] - 1])
    return near_at(world, q, min(max(damped, stopped), FARTHEST))


@compiled
def _nobody(n: int) -> NearState:
    """Return a state without pairs for n joints."""
    table = PairTable(
        np.empty((0, n)), np.empty((0, n), dtype=np.bool_), np.empty(0), np.empty(n), np.empty(0)
    )
    return NearState(True, 0.0, np.empty(0, dtype=np.int64), np.empty(0), table)


@compiled
def _all_rows(
    table: ServoTable, world: NearWorld, q: Floats1, moment: tuple[NearState, Floats1, float], balance: _Rows
) -> _Rows:
    """Return the clearance rows at q, shape (n,), followed by the balance rows.

    Args:
        table: The robot.
        world: The pairs.
        q: Joint positions [rad or m], shape (n,).
        moment: Nearby pairs, configuration at the end of braking, shape (n,), and caution.
        balance: The balance rows.
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
    """Write the weighted rows of the demands and their singularity factors; return the added damping.

    A task requires dr/dt = -s r.  With dq the damped Gauss-Newton step to the target, every joint covers its
    part of it at the speed s |dq_i|.  s is the maximum rate up to the gain at which no joint exceeds its
    velocity limit or the speed from which it can stop within |dq_i|; singularities lower it further, see
    `approach_rate`.

    Damping keeps a robot that is pulled without success from trembling.  Where a direction is lost, at a
    stretched arm or at an obstacle, its Jacobian is about R x, with x the joint's distance from there and R a
    lever arm.  Pulled at a speed p without yielding, the joint obeys dx/dt = -R p x / lambda^2, which in
    steps of dt oscillates unless lambda^2 > R p dt / 2.  lambda^2 is 2 p dt, for an R of one meter, with p
    the part of the required rate that the last velocity failed to deliver.

    Args:
        table: The robot.
        v: Last velocity [rad/s or m/s], shape (n,).
        demands: The demands.
        rows: Output: w J, shape (>= m, n), and w rate, shape (>= m,).
        shares: Output: singularity factors, shape (k,).
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
    """Write the objective of weighted rows; without rows, of the minimum velocity weighted by `scale`.

    Args:
        table: The robot.
        q: Joint positions [rad or m], shape (n,).
        rows: w J, shape (m, n), w rate, shape (m,), and the damping added to lambda^2.
        hessian: Output, shape (n, n).
        gradient: Output, shape (n,).
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
    """Write the optimal velocity within bounds and rows; return whether one exists.

    Clearance rows are relaxed until braking at maximum deceleration satisfies them, balance rows until some
    velocity within the bounds does.

    Args:
        hessian: Hessian of the objective, shape (n, n).
        gradient: Gradient of the objective, shape (n,).
        bounds: Bounds of the velocity.
        rows: Clearance and balance rows.
        first: Index of the first row that is used.
        v: Output, shape (n,) [rad/s or m/s].
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
    """Write the optimal velocity that keeps the balance and, if both are feasible, the clearance rows.

    Without clearance rows, the check of the braking path alone avoids collisions.  Arguments and result are
    those of `_minimum`.
    """
    if _minimum(hessian, gradient, bounds, rows, 0, v):
        return True
    return rows.balance < rows.least.size and _minimum(hessian, gradient, bounds, rows, rows.balance, v)


@compiled
def _stands_in_the_way(
    table: ServoTable, world: NearWorld, q: Floats1, v: Floats1, moment: _Moment, joints: Flags1
) -> int:
    """Return what the braking path of a velocity collides with, see `obstacle`; two paths with balance."""
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
    """Append the ids of the bounds active at v, shape (n,), to `count` others; return the new count."""
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
    """Append the ids of the rows active at v, shape (n,), or violated if `broken`; return the new count."""
    for k in range(rows.least.size):
        excess = dot(rows.matrix[k], v) - rows.least[k]
        if (-excess > NOTICEABLE) if broken else (excess < NOTICEABLE):
            names[count] = rows.names[k]
            count += 1
    return count


@compiled
def _parting(table: ServoTable, near: NearState, rows: tuple[Floats2, Floats1], count: int) -> int:
    """Append rows that separate pairs nearer than the clearance c at gain (c - d); return the new count."""
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
    """Write the velocity at maximum deceleration or, if collision-free, the best one that keeps the balance.

    Returns False if the call-back failed; v has shape (n,) [rad/s or m/s].
    """
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
    """Decide the next velocity of one tick.

    Args:
        table: The robot.
        world: The pairs of bodies that must not collide.
        standing: Constants of the balance; without corners, balance is not constrained.
        q: Joint positions [rad or m], shape (n,).
        v: Last velocity [rad/s or m/s], shape (n,).
        caution: Factor on the speed of approach to obstacles, up to 1.
        demands: The demands; without any, the robot brakes as hard as limits and balance allow.
        result: Output.

    Returns:
        The outcome, see FREE; the number of constraints active at v; the number violated by v.
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
    """Search for a velocity that is known to stop without collision, with more and more joints braking.

    Args:
        table: The robot.
        world: The pairs of bodies that must not collide.
        q: Joint positions [rad or m], shape (n,).
        v: Last velocity [rad/s or m/s], shape (n,).
        objective: Hessian, shape (n, n), and gradient, shape (n,).
        bounds: Bounds of the velocity, changed.
        moment: Rows and nearby pairs.
        result: Output: velocity and names.

    Returns:
        The outcome, STOPPING if no velocity was found, and the number of names.
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
