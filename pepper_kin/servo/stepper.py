"""One tick: from demands to the best velocity that every limit allows."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.collision import NearPairs
from pepper_kin.core.braking import DAMPING, LOCKED, JointLimits, VelocityInterval, stopping_place
from pepper_kin.core.quadratic_program import solve_program
from pepper_kin.model import PepperModel
from pepper_kin.servo.balance_rows import BalanceRows
from pepper_kin.servo.braking import KINDS, braked, velocity_bounds
from pepper_kin.servo.clearance_guard import ClearanceGuard, Obstacle
from pepper_kin.servo.demand import Demand
from pepper_kin.servo.half_spaces import VelocityRows, stacked

# Weight and gain [1/s] of the pull towards the rest posture: seen only where the demands leave freedom.
REST_WEIGHT = 5e-3
REST_GAIN = 0.5

# Share that balance leaves of the hardest brake which is counted on, and the least that is [of the limits].
BRAKE_SHARE = 0.7
LEAST_BRAKE = 0.1

# Times that joints which could not stop clear are made to brake, before all of them are.
ATTEMPTS = 3


@dataclass(frozen=True, eq=False)
class Tick:
    """What one tick decides.

    Attributes:
        v: The next velocity [rad/s or m/s], shape (n,).
        limited_by: What v touches, in words.
        relaxed: Limits that were relaxed to keep those of position, velocity and acceleration, in words.
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
        subject to      velocity bounds (always kept), clearance rows (kept unless even braking or balance
                        breaks them), balance rows (kept as far as bounds allow); relaxed rows are named

    A velocity is taken if the hardest brake after it stays clear.  With balance, the hardest brake would tip
    the robot: then a brake of so small a share of it that balance is kept has to stay clear too, and where
    nothing is known to stop clear, the robot brakes as hard as balance allows if that is known to be clear.

    Args:
        pepper: The robot.
        limits: Of the joints.
        dt: Length of a tick [s].
        rest: q_rest [rad or m], shape (n,).
        joint_scale: The diagonal of D, shape (n,).
        guard: Keeps clear; None checks no collisions.
        balance: Keeps the balance; None leaves it out.
    """

    def __init__(
        self,
        pepper: PepperModel,
        limits: JointLimits,
        dt: float,
        rest: Array,
        joint_scale: Array,
        guard: ClearanceGuard | None,
        balance: BalanceRows | None,
    ) -> None:
        self._pepper, self._limits, self._dt = pepper, limits, dt
        self._squares = joint_scale**2
        self._rest, self._cost = rest, DAMPING**2 * self._squares + REST_WEIGHT**2
        self.guard = guard
        self._balance = balance
        self._nothing = VelocityRows(np.empty((0, rest.size)), np.empty(0), ())

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
        first = bounds = velocity_bounds(q, v, limits, dt)
        balance, braking = self._nothing, limits.acceleration
        if self._balance is not None:
            balance = self._balance.rows(q, v, dt)
            braking = braking * max(BRAKE_SHARE * balance.share(v, bounds.brake), LEAST_BRAKE)
        gentle = np.copysign(np.maximum(np.abs(v) - braking * dt, 0.0), v)
        near = self.guard.look(q, bounds, braking, dt) if self.guard is not None else None
        clearance = None if near is None else float(near.distances[0]) if len(near) else float("inf")
        rows = (self._clearance_rows(q, bounds, near, braking, caution), balance)
        if not demands and self._balance is None:
            return Tick(bounds.brake, (), (), False, clearance)
        parting = None if self.guard is None or near is None else self.guard.parting(near)
        objective = self._objective(q, [*demands, parting] if parting is not None else demands)
        names: tuple[str, ...] = ()
        for _ in range(ATTEMPTS):
            wanted = self._solve(objective, bounds, rows[0], balance.attainable(bounds.low, bounds.high))
            if wanted is None:
                names = (*names, "the solver")
                break
            obstacle = self._obstacle(q, wanted, near, braking)
            if obstacle is None:
                touched = [*names, *self._at_bounds(wanted, bounds)]
                for part in rows:
                    touched += part.active(wanted)
                return Tick(wanted, _once(touched), _broken(rows, wanted), bool(names), clearance)
            names = (*names, obstacle.name)
            bounds = braked(bounds, obstacle.joints, gentle)
        stopping = self._stopping(q, first, rows, near)
        return Tick(stopping, _once(names), _broken(rows, stopping), True, clearance)

    def _clearance_rows(
        self, q: Array, bounds: VelocityInterval, near: NearPairs | None, braking: Array, caution: float
    ) -> VelocityRows:
        """Return the dampers at q [rad or m], shape (n,), for a brake [rad/s^2 or m/s^2], shape (n,)."""
        if self.guard is None or near is None:
            return self._nothing
        return self.guard.rows(q, stopping_place(q, bounds.brake, braking, self._dt), near, caution)

    def _solve(
        self,
        objective: tuple[Array, Array],
        bounds: VelocityInterval,
        clearance: VelocityRows,
        balance: VelocityRows,
    ) -> Array | None:
        """Return the best velocity that keeps the balance, and the dampers too if both can be kept.

        Without rows of clearance it is the look along the brake path that keeps the robot clear.

        Args:
            objective: Hessian, shape (n, n), and gradient, shape (n,).
            bounds: Of the velocity.
            clearance: Dampers.
            balance: Rows that keep the balance.

        Returns:
            The velocity [rad/s or m/s], shape (n,); None where none was found.
        """
        found = self._minimum(objective, bounds, (clearance.admitting(bounds.brake), balance))
        if found is None and balance.names:
            found = self._minimum(objective, bounds, (self._nothing, balance))
        return found

    def _stopping(
        self,
        q: Array,
        bounds: VelocityInterval,
        rows: tuple[VelocityRows, VelocityRows],
        near: NearPairs | None,
    ) -> Array:
        """Return the hardest brake, or with balance one that keeps it and that is known to be as clear.

        Args:
            q: Joint positions [rad or m], shape (n,).
            bounds: Of the velocity.
            rows: Of clearance and of balance.
            near: Pairs that are near; None where none are looked for.

        Returns:
            The velocity [rad/s or m/s], shape (n,).
        """
        if not rows[1].names:
            return bounds.brake
        balance = rows[1].attainable(bounds.low, bounds.high)
        found = self._solve(self._objective(q, ()), bounds, rows[0], balance)
        if found is None or self._obstacle(q, found, near, self._limits.acceleration) is not None:
            return bounds.brake
        return found

    def _obstacle(self, q: Array, v: Array, near: NearPairs | None, braking: Array) -> Obstacle | None:
        """Return what a velocity and a brake run into; with balance, also the hardest brake is examined.

        Args:
            q: Joint positions [rad or m], shape (n,).
            v: The velocity [rad/s or m/s], shape (n,).
            near: Pairs that are near; None where none are looked for.
            braking: Acceleration of the brake [rad/s^2 or m/s^2], shape (n,).
        """
        if self.guard is None or near is None:
            return None
        found = self.guard.obstacle(q, v, near, self._limits.acceleration, self._dt)
        if found is None and braking is not self._limits.acceleration:
            found = self.guard.obstacle(q, v, near, braking, self._dt)
        return found

    def _minimum(
        self,
        objective: tuple[Array, Array],
        bounds: VelocityInterval,
        rows: tuple[VelocityRows, VelocityRows],
    ) -> Array | None:
        """Return the best velocity [rad/s or m/s], shape (n,), within bounds and rows, or None.

        Args:
            objective: Hessian, shape (n, n), and gradient, shape (n,).
            bounds: Of the velocity.
            rows: Of clearance and of balance.
        """
        felt = stacked(rows, bounds.low.size).within(bounds.low, bounds.high)
        return solve_program(*objective, bounds.low, bounds.high, felt.matrix, felt.least)

    def _objective(self, q: Array, demands: Sequence[Demand]) -> tuple[Array, Array]:
        """Return Hessian, shape (n, n), and gradient, shape (n,), at q [rad or m], shape (n,)."""
        if not demands:  # the joints to rest, each as hard as it is dear
            return np.diag(self._squares), np.zeros(q.size)
        jacobian = np.concatenate([demand.weight * demand.jacobian for demand in demands])
        rate = np.concatenate([demand.weight * demand.rate for demand in demands])
        hessian = jacobian.T @ jacobian
        extra = sum(demand.damping for demand in demands)
        hessian.reshape(-1)[:: q.size + 1] += self._cost + extra * self._squares
        return hessian, -(rate @ jacobian) - REST_WEIGHT**2 * REST_GAIN * (self._rest - q)

    def _at_bounds(self, v: Array, bounds: VelocityInterval) -> tuple[str, ...]:
        """Return the names of the bounds that v [rad/s or m/s], shape (n,), touches."""
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
    """Return the names of the rows that v [rad/s or m/s], shape (n,), breaks, each once."""
    return _once([*rows[0].broken(v), *rows[1].broken(v)])
