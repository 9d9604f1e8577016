"""Loop that follows moving targets and twists, tick by tick."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, read_only
from pepper_kin.collision import Scene
from pepper_kin.collision.checked_world import checked_world
from pepper_kin.collision.loads import loads_of
from pepper_kin.core.balance_rows import BalanceTable
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik.priorities import balanced
from pepper_kin.ik.problem import flatten_tasks, motion_scale, moved_aside
from pepper_kin.ik.tasks.carrying import with_loads
from pepper_kin.ik.tasks.hands import hand_frame
from pepper_kin.ik.tasks.task import Task, TaskGroup
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_finite, as_joint_vectors, check_choice, check_positive
from pepper_kin.model.joint_vectors import check_within_limits as check_limits
from pepper_kin.servo.balance_table import balance_table
from pepper_kin.servo.clearance_guard import ClearanceGuard
from pepper_kin.servo.commands import Targets, Twist
from pepper_kin.servo.demand import Demand, Pace
from pepper_kin.servo.motion_limits import motion_limits
from pepper_kin.servo.state import ServoState, ServoStatus
from pepper_kin.servo.stepper import Stepper, Tick

# Maximum ratio of an error that is removed per second, and maximum ratio that is removed in one tick.
GAIN = 30.0
GAIN_PER_TICK = 0.3

# Factors on the speed of approach to obstacles: after a tick that had to brake, and for recovery per other
# tick.
CAUTION = 0.5
RECOVERY = 1.05


class Servo:
    """Follows hands, gaze and postures that move while it runs.

    At every tick differential inverse kinematics finds the joint velocity that best moves towards the
    targets; see `differential_step`.  Limits of position, velocity and acceleration hold at every tick, also
    while it stops: no joint is ever too fast to brake before its limit.  Time is counted in ticks; the caller
    calls `step` once every 1 / rate seconds and sends `q` to the robot.

        servo = Servo(pepper, pepper.posture("Stand"))
        servo.set_target([HandPosition("left", (0.3, 0.2, 0.9)), LookAt((0.3, 0.2, 0.9))])
        state = servo.step()

    The same calls give the same results.  A servo belongs to one thread.

    Args:
        pepper: The robot.
        start: Joint positions at rest, where it starts and which it prefers [rad or m], shape (n,).
        rate: Ticks per second [Hz].
        scene: The world around the robot, which avoids self-collision in any case; None for none.
        collisions: Whether collisions are checked; False ignores them, and every state says so.
        margin: Distance kept to the scene and between parts of the robot [m]; pairs that are nearer at the
            start may only separate.
        command_timeout: Age from which a command no longer counts, and the robot brakes [s]; infinite for
            never.
        gain: Maximum ratio of an error removed per second [1/s]; None: 30, or less at low rates.
        locked: Joints and groups that do not move.
        balance: Distance that the zero-moment point keeps inside the wheels' triangle [m], whose edges the
            center of mass approaches ever more slowly; None for no balance.
        velocity_scale: Ratio of the velocity limits to use, up to 1.
        acceleration_scale: Ratio of the acceleration limits to use, up to 1.
        singularity: Hand (or gaze) motion per radian of joint motion below which motion slows down
            [m or rad].
        approach: Maximum ratio of the distance to an obstacle that is used up per second [1/s].

    Raises:
        InvalidValueError: for a number that is not allowed, or a start of wrong shape, or with NaN.
        LimitError: for a start outside the joint limits.
        UnknownNameError: for an unknown joint or group.
    """

    def __init__(
        self,
        pepper: PepperModel,
        start: ArrayLike,
        rate: float = 100.0,
        scene: Scene | None = None,
        *,
        collisions: bool = True,
        margin: float = 0.005,
        command_timeout: float = 0.5,
        gain: float | None = None,
        locked: str | Iterable[str] = (),
        balance: float | None = None,
        velocity_scale: float = 1.0,
        acceleration_scale: float = 1.0,
        singularity: float = 0.05,
        approach: float = 4.0,
    ) -> None:
        self.pepper = pepper
        self._q = read_only(checked_configuration(pepper, start, "start"))
        self.rate = check_positive("rate", rate, "[Hz]")
        dt = self._dt = 1.0 / self.rate
        self.command_timeout = (
            math.inf
            if command_timeout == math.inf
            else check_positive("command_timeout", command_timeout, "[s]")
        )
        self._margin = check_positive("margin", margin, "[m]")
        self._approach = check_positive("approach", approach, "[1/s]")
        gain = min(GAIN, GAIN_PER_TICK * self.rate) if gain is None else check_positive("gain", gain, "[1/s]")
        limits = motion_limits(pepper, locked, velocity_scale, acceleration_scale)
        joint_scale = motion_scale(pepper, self._q)
        pace = Pace(
            min(gain, self.rate), check_positive("singularity", singularity, "[m]"), dt, limits, joint_scale
        )
        self._collisions = collisions
        guard = self._guard(scene)
        self._balance = None if balance is None else float(as_finite(balance, "balance", ()))
        self._loads = loads_of(pepper, scene)
        self._stepper = Stepper(pepper, pace, self._q, guard, self._standing())
        self._v = read_only(np.zeros(pepper.n))
        self._rest, self._idle_from, self._idle = self._q, self._q, np.zeros(pepper.n, dtype=bool)
        # Compile all machine code before the first tick.
        still = Demand(np.eye(6, pepper.n), np.zeros(6), None, 1.0, "", False, True, 0.0)
        self._stepper.step(self._q, self._v, [still])
        self._tick, self._caution = 0, 1.0
        self._targets = Targets()
        self._twists: dict[str, Twist] = {}

    @property
    def q(self) -> Array:
        """Present joint positions [rad or m], shape (n,), read-only."""
        return self._q

    @property
    def v(self) -> Array:
        """Velocities of the last tick [rad/s or m/s], shape (n,), read-only."""
        return self._v

    @property
    def time(self) -> float:
        """Number of ticks done / rate [s]."""
        return self._tick * self._dt

    def set_target(self, tasks: Task | TaskGroup | Iterable[Task | TaskGroup]) -> None:
        """Replace the target tasks.

        Targets that are set repeatedly, such as a moving point, are followed without lag: the servo derives
        their velocity from one call to the next.

        Args:
            tasks: Tasks such as `HandPosition` or `LookAt`, any number of them.

        Raises:
            InvalidValueError: for no task, an object that is not a task, or several targets in one task.
            UnknownNameError: for a frame or joint that the robot lacks.
        """
        flat = balanced(with_loads(flatten_tasks(self.pepper, tasks), self._loads))
        self._targets.replace(self.pepper, self._q, flat, self._tick, self._dt)

    def set_twist(
        self, hand: str, linear: ArrayLike, angular: ArrayLike | None = None, axes: str = "world"
    ) -> None:
        """Command a velocity of a hand, which replaces the last one.

        Args:
            hand: "left" or "right".
            linear: Velocity of the palm [m/s], shape (3,).
            angular: Angular velocity [rad/s], shape (3,); None leaves the orientation free.
            axes: Axes of both velocities, "world" or "hand".

        Raises:
            UnknownNameError: for another hand.
            InvalidValueError: for other axes, a wrong shape, NaN or infinity.
        """
        frame = hand_frame(hand)
        self.pepper.frame_id(frame)
        self._twists[hand] = Twist(
            frame=frame,
            label=f"{hand} hand",
            linear=read_only(as_finite(linear, "linear", (3,))),
            angular=None if angular is None else read_only(as_finite(angular, "angular", (3,))),
            in_hand_axes=check_choice("axes", axes, ("world", "hand")) == "hand",
            tick=self._tick,
        )

    def set_scene(self, scene: Scene | None) -> None:
        """Replace the world, which may have moved; None leaves only the robot itself.

        The mass of attached objects counts from the next tick on; for targets, from the next `set_target` on.

        Raises:
            InvalidValueError: for anything but a scene, and for a scene if collisions are ignored.
        """
        self._stepper.guard = self._guard(scene)
        self._loads = loads_of(self.pepper, scene)
        standing = self._standing()
        if standing is not None:
            self._stepper.balance = standing

    def stop(self) -> None:
        """Discard all commands, so that the next ticks brake."""
        self._targets, self._twists = Targets(), {}

    def step(self) -> ServoState:
        """Do one tick and return the state that the robot should have after it."""
        demands = self._demands()
        tick = self._stepper.step(self._q, self._v, demands, self._caution)
        self._caution = (
            max(self._caution * CAUTION, 0.05) if tick.blocked else min(self._caution * RECOVERY, 1)
        )
        self._idle_from, self._idle = np.where(self._idle & tick.idle, self._idle_from, self._q), tick.idle
        self._v = read_only(tick.v)
        self._q = read_only(self._q + self._dt * tick.v)
        self._tick += 1
        return self._state(tick, demands)

    @property
    def _aside(self) -> tuple[str, ...]:
        """Idle joints that are far beyond the position where they became idle and their rest position."""
        low, high = np.minimum(self._idle_from, self._rest), np.maximum(self._idle_from, self._rest)
        way = np.maximum(low - self._q, self._q - high)
        return moved_aside(self.pepper, self._idle, way)

    def _guard(self, scene: Scene | None) -> ClearanceGuard | None:
        """Return the guard for a scene; None if collisions are ignored."""
        world = checked_world(scene, self._collisions)
        return None if world is None else ClearanceGuard(self.pepper, world, self._margin, self._approach)

    def _standing(self) -> BalanceTable | None:
        """Return the balance table with all loads; None if balance is not required."""
        return None if self._balance is None else balance_table(self.pepper, self._balance, self._loads)

    def _fresh(self, set_at: int) -> bool:
        """Return whether a command set at a tick still counts."""
        # Half a tick of tolerance, so that a timeout of whole ticks does not depend on rounding.
        return (self._tick - set_at + 0.5) * self._dt < self.command_timeout

    def _demands(self) -> list[Demand]:
        """Return the demands of all commands that still count, and discard the others."""
        if self._targets.tasks and not self._fresh(self._targets.tick):
            self._targets = Targets()
        self._twists = {hand: twist for hand, twist in self._twists.items() if self._fresh(twist.tick)}
        demands = self._targets.demands(self.pepper, self._q, self._tick)
        return demands + [twist.demand(self.pepper, self._q) for twist in self._twists.values()]

    def _state(self, tick: Tick, demands: list[Demand]) -> ServoState:
        """Return the state after a tick."""
        tasks = self._targets.tasks
        errors = tuple([demand.error for demand in demands[: len(tasks)]])
        if not demands:
            status = ServoStatus.STOPPING if tick.v.any() else ServoStatus.RESTING
        elif tick.blocked:
            status = ServoStatus.BLOCKED
        elif tasks and not self._twists and all(e <= t.tolerance for e, t in zip(errors, tasks, strict=True)):
            status = ServoStatus.ARRIVED
        else:
            status = ServoStatus.LIMITED if tick.limited_by or tick.relaxed else ServoStatus.FOLLOWING
        return ServoState(
            tick=self._tick,
            time=self.time,
            q=self._q,
            v=self._v,
            status=status,
            scale=tick.scale,
            limited_by=tick.limited_by,
            relaxed=tick.relaxed,
            errors=errors,
            aside=self._aside,
            clearance=tick.clearance,
        )


def checked_configuration(pepper: PepperModel, q: ArrayLike, quantity: str) -> Array:
    """Return one configuration within the joint limits, shape (n,).

    Raises:
        InvalidValueError: for a wrong shape, NaN or infinity.
        LimitError: naming the worst joint outside its limits.
    """
    state = as_joint_vectors(pepper, q, quantity)
    if state.ndim != 1:
        raise InvalidValueError(quantity, f"shape {state.shape}", f"one configuration, shape ({pepper.n},)")
    check_limits(pepper, state, quantity)
    return state
