"""Base class of motions on a robot with NAOqi, and motions of the base alone."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections import deque
from collections.abc import Callable, Iterator
from typing import Any, ClassVar, NamedTuple

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.model import PepperModel
from pepper_kin.naoqi.channel import BEAT, Channel, DirectChannel, GuardedChannel, Moved
from pepper_kin.naoqi.errors import NaoqiError, RobotConnectionError
from pepper_kin.naoqi.following import FollowOptions, RobotMotionResult
from pepper_kin.naoqi.link import RobotLink
from pepper_kin.naoqi.robot_state import BASE, RobotReading, RobotState, StateReader, run_of_states
from pepper_kin.supervision import (
    REST_WINDOW,
    Clock,
    MotionEnd,
    MotionEndedError,
    RestMeter,
    RobotMotionStatus,
    SupervisedMotion,
    UnusableStateError,
)
from pepper_kin.twin import Run

MOST_READINGS, NEXT_READING = 20, 0.1
"""Maximum number of pending state requests, and time between two requests [s]."""


class CommandedMotion(SupervisedMotion):
    """A motion on a robot: commands through a channel, measured states, and detection of rest.

    Args:
        link: The connection.
        pepper: Model with the joints whose states are read.
        moved: Parts that the motion moves.
        options: Tolerances and times.
        guarded: Whether the robot has a watchdog.
        clock: Clock of the client.
        check: Raises if the motion must not start.
    """

    method = ""
    ending_errors: ClassVar = (
        (RobotConnectionError, RobotMotionStatus.CONNECTION_LOST),
        (NaoqiError, RobotMotionStatus.REFUSED),
        (UnusableStateError, RobotMotionStatus.STATE_UNUSABLE),
    )

    def __init__(
        self,
        link: RobotLink,
        pepper: PepperModel,
        moved: Moved,
        options: FollowOptions,
        guarded: bool,
        clock: Clock,
        check: Callable[[], object],
    ) -> None:
        self._link, self._pepper, self._options, self._guarded = link, pepper, options, guarded
        self._clock, self._check, self.moved = clock, check, moved
        self._reader = StateReader(link, pepper, clock)
        self._base = [pepper.joint_index(name) for name in BASE if name in pepper.joint_names]
        self._channel: Channel = (
            GuardedChannel(link, clock, moved, options.silence)
            if guarded
            else DirectChannel(link, clock, moved)
        )
        self._readings: deque[RobotReading] = deque()
        self._heard = self._stepped = clock.now()
        self._states: list[tuple[float, RobotState, Array]] = []
        names = [*moved.joints, *(BASE if moved.base else ())]
        self._rest, self._rows = RestMeter(names), [pepper.joint_index(name) for name in names]
        self._begun = clock.now()
        self._held: float | None = None
        self._handing: Iterator[None] | None = None
        self._until: float | None = None
        self._answered_at: float | None = None
        self._finishing = self._worded = self._closing = False
        self.stop_time = link.timeout

    @property
    def connected(self) -> bool:
        """Whether the session is connected, as far as libqi knows."""
        return self._link.alive

    def check(self) -> None:
        """Raise if the motion must not start."""
        self._check()

    def hand_over(self) -> bool:
        """Arm the watchdog, and hand the motion to the robot; see `SupervisedMotion.hand_over`."""
        if self._handing is None:
            self._handing = self._hand_over()
            self._begun = self._heard = self._stepped = self._clock.now()
        self._channel.look()
        self._take_states()
        self._check_age()
        return next(self._handing, True) is True

    def _hand_over(self) -> Iterator[None]:
        while not self._channel.open():
            yield
        yield from self._begin()

    @abstractmethod
    def _begin(self) -> Iterator[None]:
        """Send the calls before the first step, in steps between which time may pass."""

    def step(self) -> bool:
        """Do one cycle: process answers and measured states, then send commands."""
        self._channel.look()
        self._take_states()
        self._check_age()
        return self._advance()

    @abstractmethod
    def _advance(self) -> bool:
        """Advance the motion by one cycle; return whether it is complete and closed."""

    def stop(self) -> str:
        """Hold the robot until it is measured at rest; see `SupervisedMotion.stop`."""
        trouble = ""
        try:
            self._take_states()
        except (UnusableStateError, NaoqiError) as error:
            trouble = str(error)
        now = self._clock.now()
        moving = "nothing was measured" if self._held is None else self._rest.moving(self._held, now)
        again = bool(moving) and self._held is not None and now > self._held + 2.0 * REST_WINDOW
        missing = self._channel.hold(again)
        if missing:
            self._held = None
            return missing
        self._held = now if self._held is None else self._held
        return f"{moving} ({trouble})" if moving and trouble else moving

    def result(self, end: MotionEnd) -> RobotMotionResult:
        """Return the outcome of the motion."""
        stamps = np.array([stamp for stamp, _, _ in self._states])
        run = self._as_run()
        return RobotMotionResult(
            end.status, end.message, end.at_rest, self.method, run, stamps, self._guarded
        )

    def _take_states(self) -> None:
        """Process the states that have arrived, and request the next one."""
        while self._readings and self._readings[0].is_there:
            self._take(self._reader.finish(self._readings.popleft()))
        now = self._clock.now()
        last = self._readings[-1].asked_at if self._readings else -math.inf
        if len(self._readings) < MOST_READINGS and now >= last + NEXT_READING:
            self._readings.append(self._reader.begin())

    def _take(self, state: RobotState) -> None:
        self._heard = state.time
        self._rest.add(state.time, state.q[self._rows])
        self._states.append((state.time - self._begun, state, self._wanted(state)))

    def _wanted(self, state: RobotState) -> Array:
        """Return the desired positions at a state [rad, m or fraction], shape (n,)."""
        return np.array(state.q)

    def _check_age(self) -> None:
        """End the motion if the last state is older than the allowed silence.

        After a pause of this process itself, states get the allowed silence anew.
        """
        now = self._clock.now()
        if now > self._stepped + self._options.silence / 2.0:
            self._heard = now
        self._stepped = now
        age = now - self._heard
        if age > self._options.silence:
            text = f"the last state is {age:.2f} s old, {self._options.silence:g} s are allowed"
            raise MotionEndedError(RobotMotionStatus.STATE_UNUSABLE, text)

    def _is_late(self) -> bool:
        """Return whether the time to come to rest after the end of the motion is over."""
        now = self._clock.now()
        self._until = now + self._options.hold_time if self._until is None else self._until
        return now > self._until

    def _closed(self) -> bool:
        """Return whether the robot is at rest at the end, all calls are answered and the channel is closed.

        Raises:
            MotionEndedError: if it is not at rest there in time.
        """
        if self._closing:
            return self._channel.close()
        moving = "calls are unanswered"
        if self._channel.idle and not self._worded:
            self._worded = True
            calls = self._last_calls()
            if calls:  # in one message, when no earlier call is pending that could arrive later
                self._channel.send(calls)
        elif self._channel.idle:
            self._answered_at = self._clock.now() if self._answered_at is None else self._answered_at
            moving = self._rest.moving(self._answered_at, self._clock.now())
            self._closing = self._arrived() and not moving
            if not moving and not self._closing:
                self._correct()
        if not self._closing and self._is_late():
            raise MotionEndedError(RobotMotionStatus.DEVIATED, self._why_late(moving))
        return False

    def _arrived(self) -> bool:
        """Return whether the robot is at the end of the motion."""
        return True

    def _correct(self) -> None:
        """Resume the motion if the robot came to rest away from its end, where a subclass can."""

    def _why_late(self, moving: str) -> str:
        return f"it is not at rest {self._options.hold_time:g} s after the end: {moving}"

    def _last_calls(self) -> list[tuple[str, list[Any]]]:
        """Return the calls that keep the robot at the end of the motion."""
        return [("move", [0.0, 0.0, 0.0])] if self.moved.base else []

    def _as_run(self) -> Run | None:
        """Return the states as a run in steps of 20 ms."""
        if len(self._states) < 2:
            return None
        stamps = np.array([stamp for stamp, _, _ in self._states])
        stamps, kept = np.unique(stamps - stamps[0], return_index=True)
        states, wanted = [self._states[k][1] for k in kept], [self._states[k][2] for k in kept]
        return run_of_states(self._pepper, stamps, states, wanted)


class BaseOptions(NamedTuple):
    """Common arguments of motions.

    Attributes:
        options: Tolerances and times.
        guarded: Whether the robot has a watchdog.
        clock: Time.
    """

    options: FollowOptions
    guarded: bool
    clock: Clock


class DriveMotion(CommandedMotion):
    """A velocity of the base for a duration, without a certificate.

    Args:
        link: The connection.
        pepper: Model of the robot's states.
        base: Options, watchdog and clock.
        twist: Velocity v_x, v_y [m/s], omega [rad/s] in the robot's axes, shape (3,).
        seconds: Duration [s].
    """

    method = "drive"

    def __init__(
        self, link: RobotLink, pepper: PepperModel, base: BaseOptions, twist: list[float], seconds: float
    ) -> None:
        super().__init__(link, pepper, Moved((), True), *base, lambda: None)
        self._twist, self._seconds = twist, seconds
        self._sent = -math.inf

    def _begin(self) -> Iterator[None]:
        self._ends = self._clock.now() + self._seconds
        return iter(())

    def _advance(self) -> bool:
        if self._finishing:
            return self._closed()
        now = self._clock.now()
        if now >= self._ends:
            self._finishing = True
        elif now >= self._sent + BEAT / 2.0:
            self._sent = now
            self._channel.send([("move", self._twist)])
        return False


class MoveToMotion(CommandedMotion):
    """A motion of the base by the robot's own `moveTo`.

    Args:
        link: The connection.
        pepper: Model of the robot's states.
        base: Options, watchdog and clock.
        goal: Pose x, y [m], yaw [rad] in the robot's axes, shape (3,).
        timeout: Maximum time of the motion [s].
    """

    method = "move_to"

    def __init__(
        self, link: RobotLink, pepper: PepperModel, base: BaseOptions, goal: list[float], timeout: float
    ) -> None:
        super().__init__(link, pepper, Moved((), True), *base, lambda: None)
        self._goal, self._timeout = goal, timeout

    def _begin(self) -> Iterator[None]:
        self._ends = self._clock.now() + self._timeout
        self._channel.start("moveTo", *self._goal)
        while self._channel.state == "armed":
            yield

    def _advance(self) -> bool:
        if self._finishing:
            return self._closed()
        state = self._channel.state
        if state.startswith("finished"):
            if state == "finished: False":
                raise MotionEndedError(RobotMotionStatus.STOPPED, "the robot ended moveTo before its goal")
            self._finishing = True
        elif self._clock.now() > self._ends:
            text = f"the robot is not there within {self._timeout:g} s"
            raise MotionEndedError(RobotMotionStatus.STOPPED, text)
        return False
