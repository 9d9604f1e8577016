"""One tick: from demands to the best velocity that every limit allows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array
from pepper_kin.collision import Clearance
from pepper_kin.core.balance_rows import BalanceTable
from pepper_kin.core.servo_tick import ATTEMPTS, FAILED, FREE, HEAD, Demands, ServoTable, TickResult, decide
from pepper_kin.model import PepperModel
from pepper_kin.servo.balance_table import no_balance
from pepper_kin.servo.clearance_guard import ClearanceGuard, unexamined
from pepper_kin.servo.demand import Demand, Pace
from pepper_kin.servo.range_curves import range_curves

# Constraint names by id, see `core.servo_tick`: those of no joint, and the kinds of joint bounds.
NAMES = ("the solver", "clearance", "balance")
BOUNDS = ("acceleration", "velocity", "position")

IDLE_SPEED, IDLE_SCALE = 0.3, 10.0
"""Maximum speed of joints without a demand [rad/s or m/s], and factor on their weight in D."""


@dataclass(frozen=True, eq=False)
class Tick:
    """Decision of one tick.

    Attributes:
        v: Next velocity [rad/s or m/s], shape (n,).
        scale: Factor by which singularities reduce the speed, of the demand that is reduced most, 0 to 1.
        limited_by: Constraints active at v, and demands that singularities slow down, in words.
        relaxed: Constraints relaxed to keep the limits of position, velocity and acceleration, in words.
        blocked: Whether joints brake because no other velocity is known to stop without collision.
        idle: Which joints have no demand while others have, shape (n,).
        clearance: Minimum distances before the tick; inf if nothing is near, None if unchecked.
    """

    v: Array
    scale: float
    limited_by: tuple[str, ...]
    relaxed: tuple[str, ...]
    blocked: bool
    idle: NDArray[np.bool_]
    clearance: Clearance | None


class Stepper:
    """Decides the ticks of one robot by machine code, `core.servo_tick`, which calls coal if necessary.

    Args:
        pepper: The robot.
        pace: Parameters that convert demands to velocities.
        rest: Positions to which redundant joints return [rad or m], shape (n,).
        guard: Data to avoid collisions; None checks no collisions.
        balance: Balance table; None for no balance.

    Attributes:
        balance: Balance table; may be replaced between ticks.
    """

    def __init__(
        self,
        pepper: PepperModel,
        pace: Pace,
        rest: Array,
        guard: ClearanceGuard | None,
        balance: BalanceTable | None,
    ) -> None:
        curves, n = range_curves(pepper), pepper.n
        self._table = ServoTable(
            pace.limits, pace.joint_scale, rest, curves.table, pace.dt, pace.gain, pace.singularity, 0.0, 1.0
        )
        bounds = [f"{kind} of {joint}" for kind in BOUNDS for joint in pepper.joint_names]
        self._names, self._n = (*NAMES, *bounds, *curves.names), n
        self._nothing = Demands(np.empty((0, HEAD)), np.empty((0, n)), np.empty(0), np.empty(0))
        self._unexamined = unexamined()
        self.balance, self.guard = balance or no_balance(), guard

    @property
    def guard(self) -> ClearanceGuard | None:
        """Data to avoid collisions; may be replaced between ticks."""
        return self._guard

    @guard.setter
    def guard(self, guard: ClearanceGuard | None) -> None:
        self._guard, pairs = guard, 0
        if guard is not None:
            self._table = self._table._replace(clearance=guard.clearance, approach=guard.gain)
            pairs = len(guard.world.cores)
        rows = pairs + 2 * len(self._table.ranges.heads) + 2 * len(self.balance.corners)
        # Each bound, row and attempt at a velocity may be named once, and rows once more as violated.
        self._numbers = np.empty(2 * self._n + 2 * rows + ATTEMPTS, np.int64)

    def step(self, q: Array, v: Array, demands: Sequence[Demand], caution: float = 1.0) -> Tick:
        """Return the next velocity.

        Args:
            q: Joint positions [rad or m], shape (n,).
            v: The last velocity [rad/s or m/s], shape (n,).
            demands: Demands; without any, the robot brakes as hard as limits and balance allow.
            caution: Factor on the speed of approach to obstacles, up to 1.
        """
        guard, wanted = self._guard, _packed(demands) if demands else self._nothing
        moved = wanted.jacobian.any(axis=0) if demands else np.ones(self._n)
        idle = np.asarray(moved) == 0.0
        table = self._resting(idle, v) if idle.any() else self._table
        result = TickResult(np.empty(self._n), np.empty(len(demands)), np.empty(2), self._numbers)
        world = self._unexamined if guard is None else guard.world
        outcome, touched, broken = decide.native(table, world, self.balance, q, v, caution, wanted, result)
        if guard is not None and outcome == FAILED:
            guard.check()
        shares, numbers = result.shares.tolist(), self._numbers[: touched + broken].tolist()
        names = [self._name(number) for number in numbers]
        lost = [f"singularity of {d.label}" for d, share in zip(demands, shares, strict=True) if share < 1]
        return Tick(
            v=result.v,
            scale=min(shares, default=1.0),
            limited_by=(*dict.fromkeys(names[:touched]), *lost),
            relaxed=tuple(dict.fromkeys(names[touched:])),
            blocked=outcome != FREE,
            idle=idle,
            clearance=None if guard is None else Clearance(*result.nearest.tolist()),
        )

    def _resting(self, idle: NDArray[np.bool_], v: Array) -> ServoTable:
        """Return the table by which joints without a demand, `idle` of shape (n,), move slowly."""
        table, limits = self._table, self._table.limits
        slow = np.maximum(IDLE_SPEED, np.abs(v) - limits.acceleration * table.dt)
        velocity = np.where(idle, np.minimum(limits.velocity, slow), limits.velocity)
        scale = np.where(idle, IDLE_SCALE * table.scale, table.scale)
        return table._replace(limits=limits._replace(velocity=velocity), scale=scale)

    def _name(self, number: int) -> str:
        """Return the constraint with an id in words, see `core.servo_tick.KINDS`."""
        place = number - len(self._names)
        return self._names[number] if place < 0 or self._guard is None else self._guard.name(place)


def _packed(demands: Sequence[Demand]) -> Demands:
    """Return demands as tables for machine code."""
    rest = [np.zeros(d.wanted.size) if d.drift is None else d.drift for d in demands]
    heads = [[d.wanted.size, d.weight, d.is_task, d.is_curved] for d in demands]
    return Demands(
        np.array(heads, dtype=float),
        np.concatenate([d.jacobian for d in demands]),
        np.concatenate([d.wanted for d in demands]),
        np.concatenate(rest),
    )
