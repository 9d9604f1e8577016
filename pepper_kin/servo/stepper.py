"""One tick: from demands to the best velocity that every limit allows."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from pepper_kin.collision import NearPairs
from pepper_kin.core.braking import DAMPING, LOCKED, JointLimits, VelocityInterval, stopping_place
from pepper_kin.core.quadratic_program import solve_program
from pepper_kin.ik.tasks.task import Array
from pepper_kin.model import PepperModel
from pepper_kin.servo.balance_rows import BalanceRows
from pepper_kin.servo.braking import KINDS, braked, velocity_bounds
from pepper_kin.servo.clearance_guard import ClearanceGuard
from pepper_kin.servo.demand import Demand
from pepper_kin.servo.half_spaces import VelocityRows, stacked

# Weight and gain [1/s] of the pull towards the rest posture: seen only where the demands leave freedom.
REST_WEIGHT = 5e-3
REST_GAIN = 0.5

# Times that joints which could not stop clear are made to brake, before all of them are.
ATTEMPTS = 3


@dataclass(frozen=True, eq=False)
class Tick:
    """What one tick decides.

    Attributes:
        v: The next velocity [rad/s or m/s], shape (n,).
        limited_by: What v touches, in words.
        relaxed: What had to give way so that limits of position, velocity and acceleration hold, in words.
        blocked: Whether joints brake because nothing else is known to stop clear.
        clearance: Smallest distance before the tick [m]; inf where nothing is near, None where unchecked.
    """

    v: Array
    limited_by: tuple[str, ...]
    relaxed: tuple[str, ...]
    blocked: bool
    clearance: float | None


class Stepper:
    """Solves the ticks of one robot; keeps the program warm.

        min over v' of  sum_i w_i^2 |J_i v' - rate_i|^2 + lambda^2 |D v'|^2 + eps^2 |v' - k (q_rest - q)|^2
        subject to      velocity bounds (always kept), clearance rows (kept unless even braking breaks them),
                        balance rows (kept as far as the others allow); what gives way is said

    Args:
        pepper: The robot.
        limits: Of the joints.
        dt: Length of a tick [s].
        rest: q_rest [rad or m], shape (n,).
        dearness: The diagonal of D, shape (n,).
        guard: Keeps clear; None checks no collisions.
        balance: Keeps the balance; None leaves it out.
    """

    def __init__(
        self,
        pepper: PepperModel,
        limits: JointLimits,
        dt: float,
        rest: Array,
        dearness: Array,
        guard: ClearanceGuard | None,
        balance: BalanceRows | None,
    ) -> None:
        self._pepper, self._limits, self._dt = pepper, limits, dt
        self._squares = dearness**2
        self._rest, self._cost = rest, DAMPING**2 * self._squares + REST_WEIGHT**2
        self.guard = guard
        self._balance = balance

    def step(self, q: Array, v: Array, demands: Sequence[Demand], caution: float = 1.0) -> Tick:
        """Return the next velocity.

        Args:
            q: Joint positions [rad or m], shape (n,).
            v: The last velocity [rad/s or m/s], shape (n,).
            demands: What is wanted; nothing brakes: as hard as can be, or as balance allows.
            caution: Factor on the speed of approach to obstacles, up to 1.
        """
        limits, dt = self._limits, self._dt
        q, v = np.array(q), np.array(v)  # writeable: the compiled functions have one form, not two
        bounds = velocity_bounds(q, v, limits, dt)
        near = self.guard.look(q, bounds, limits.acceleration, dt) if self.guard is not None else None
        clearance = None if near is None else float(near.distances[0]) if len(near) else float("inf")
        rows = self._rows(q, v, bounds, near, caution)
        if not demands and self._balance is None:
            return Tick(bounds.brake, (), (), False, clearance)
        parting = None if self.guard is None or near is None else self.guard.parting(near)
        objective = self._objective(q, [*demands, parting] if parting is not None else demands)
        names: tuple[str, ...] = ()
        for _ in range(ATTEMPTS):
            wanted = self._solve(objective, bounds, rows)
            if wanted is None:
                names = (*names, "the solver")
                break
            obstacle = None
            if self.guard is not None and near is not None:
                obstacle = self.guard.obstacle(q, wanted, near, limits.acceleration, dt)
            if obstacle is None:
                touched = [*names, *self._at_bounds(wanted, bounds)]
                for part in rows:
                    touched += part.active(wanted)
                return Tick(wanted, _once(touched), _broken(rows, wanted), bool(names), clearance)
            names = (*names, obstacle.name)
            bounds = braked(bounds, obstacle.joints)
        return Tick(bounds.brake, _once(names), _broken(rows, bounds.brake), True, clearance)

    def _rows(
        self, q: Array, v: Array, bounds: VelocityInterval, near: NearPairs | None, caution: float
    ) -> tuple[VelocityRows, VelocityRows]:
        """Return the rows of clearance and of balance; none where they are not asked for."""
        limits, dt, nothing = self._limits, self._dt, VelocityRows(np.empty((0, q.size)), np.empty(0), ())
        clearance = balance = nothing
        if self.guard is not None and near is not None:
            stop = stopping_place(q, bounds.brake, limits.acceleration, dt)
            clearance = self.guard.rows(q, stop, near, caution)
        if self._balance is not None:
            balance = self._balance.rows(q, v, dt)
        return clearance, balance

    def _solve(
        self,
        objective: tuple[Array, Array],
        bounds: VelocityInterval,
        rows: tuple[VelocityRows, VelocityRows],
    ) -> Array | None:
        """Return the best velocity; balance is kept as bounds allow, or if need be as braking does."""
        clearance, balance = rows[0].admitting(bounds.brake), rows[1].attainable(bounds.low, bounds.high)
        found = self._minimum(objective, bounds, (clearance, balance))
        if found is None and len(balance.least):
            found = self._minimum(objective, bounds, (clearance, rows[1].admitting(bounds.brake)))
        return found

    def _minimum(
        self,
        objective: tuple[Array, Array],
        bounds: VelocityInterval,
        rows: tuple[VelocityRows, VelocityRows],
    ) -> Array | None:
        felt = stacked(rows, bounds.low.size).within(bounds.low, bounds.high)
        return solve_program(*objective, bounds.low, bounds.high, felt.matrix, felt.least)

    def _objective(self, q: Array, demands: Sequence[Demand]) -> tuple[Array, Array]:
        if not demands:  # the joints to rest, each as hard as it is dear
            return np.diag(self._squares), np.zeros(q.size)
        jacobian = np.concatenate([demand.weight * demand.jacobian for demand in demands])
        rate = np.concatenate([demand.weight * demand.rate for demand in demands])
        hessian = jacobian.T @ jacobian
        extra = sum(demand.damping for demand in demands)
        hessian.reshape(-1)[:: q.size + 1] += self._cost + extra * self._squares
        return hessian, -(rate @ jacobian) - REST_WEIGHT**2 * REST_GAIN * (self._rest - q)

    def _at_bounds(self, v: Array, bounds: VelocityInterval) -> tuple[str, ...]:
        names, tiny = self._pepper.joint_names, 1e-7
        found = []
        for hit, kinds in (
            (v >= bounds.high - tiny, bounds.high_kind),
            (v <= bounds.low + tiny, bounds.low_kind),
        ):
            for i in hit.nonzero()[0].tolist():
                if kinds[i] != LOCKED:
                    found.append(f"{KINDS[kinds[i]]} of {names[i]}")
        return tuple(found)


def _once(names: Iterable[str]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(names))


def _broken(rows: tuple[VelocityRows, VelocityRows], v: Array) -> tuple[str, ...]:
    return _once([*rows[0].broken(v), *rows[1].broken(v)])
