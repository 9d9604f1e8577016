"""Commands of a servo: targets and twists, each with the tick at which it was set."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from pepper_kin.arrays import Array, FrozenArrays
from pepper_kin.ik.tasks.task import Task
from pepper_kin.kinematics import frame_jacobian, frame_pose
from pepper_kin.model import PepperModel
from pepper_kin.servo.demand import Demand, task_demand

# Speed above which a target counts as having jumped [m/s or rad/s]; pause after which it counts as resting
# [s].
FASTEST_DRIFT = 2.0
LONGEST_PAUSE = 0.1


@dataclass(frozen=True, eq=False)
class Twist(FrozenArrays):
    """A commanded velocity of a hand.

    Attributes:
        frame: Frame of the hand.
        label: Name of the hand in words.
        linear: Velocity of the palm [m/s], shape (3,).
        angular: Angular velocity [rad/s], shape (3,); None leaves the orientation free.
        in_hand_axes: Whether both velocities are in the hand's axes, else in the world's.
        tick: Tick at which it was set.
    """

    frame: str
    label: str
    linear: Array
    angular: Array | None
    in_hand_axes: bool
    tick: int

    def demand(self, pepper: PepperModel, q: Array) -> Demand:
        """Return the demand at q, shape (n,) [rad or m]."""
        jacobian = frame_jacobian(pepper, q, self.frame)
        parts = [self.linear] if self.angular is None else [self.linear, self.angular]
        if self.in_hand_axes:
            rotation = frame_pose(pepper, q, self.frame)[:3, :3]
            parts = [rotation @ part for part in parts]
        rate = np.concatenate(parts)
        return Demand(jacobian[: rate.size], rate, None, 1.0, self.label, False, True, 0.0)


@dataclass(eq=False)
class Targets:
    """Target tasks that may be replaced from tick to tick, and their rates of motion.

    With r_old, r_new the residuals of the old and the new target at one configuration, set dt apart, the
    target's own motion changes the residual at the rate (r_new - r_old) / dt.  A servo that adds it follows a
    moving target without lag.  After jumps, pauses or other kinds of tasks the target counts as resting.

    Attributes:
        tasks: The tasks, with groups expanded.
        tick: Tick at which they were set.
    """

    tasks: tuple[Task, ...] = ()
    tick: int = 0
    _drifts: tuple[Array | None, ...] = field(default=(), repr=False)
    _residuals: tuple[Array | None, ...] = field(default=(), repr=False)
    _lasting: int = field(default=0, repr=False)

    def replace(self, pepper: PepperModel, q: Array, tasks: Sequence[Task], tick: int, dt: float) -> None:
        """Set new tasks at configuration q, shape (n,) [rad or m]."""
        ticks = tick - self.tick
        alike = [(type(t), t.frame, t.label) for t in tasks] == [
            (type(t), t.frame, t.label) for t in self.tasks
        ]
        if ticks == 0 and alike:
            # Set twice within a tick: the last target counts, with the rate observed so far.
            self.tasks, self._residuals = tuple(tasks), tuple(task.residual(pepper, q) for task in tasks)
            return
        moving = alike and 0 < ticks * dt <= LONGEST_PAUSE
        residuals = tuple(task.residual(pepper, q) for task in tasks)
        self._residuals = residuals
        self._drifts = tuple(
            _drift(now - old.residual(pepper, q), ticks * dt) if moving else None
            for old, now in zip(self.tasks if moving else tasks, residuals, strict=True)
        )
        self.tasks, self.tick, self._lasting = tuple(tasks), tick, ticks

    def demands(self, pepper: PepperModel, q: Array, tick: int) -> list[Demand]:
        """Return the demands of the tasks; a target that was not updated as expected counts as resting.

        Args:
            pepper: The robot.
            q: Joint positions [rad or m], shape (n,).
            tick: Index of the tick.
        """
        moving = tick - self.tick < self._lasting
        known = self._residuals if tick == self.tick else (None,) * len(self.tasks)
        return [
            task_demand(pepper, task, q, drift if moving else None, residual)
            for task, drift, residual in zip(self.tasks, self._drifts, known, strict=True)
        ]


def _drift(change: Array, time: float) -> Array | None:
    """Return change / time [m/s or rad/s] of a change [m or rad], shape (m,); None if it is too fast."""
    drift: Array = change / time
    return drift if float(np.sqrt(drift @ drift)) <= FASTEST_DRIFT else None
