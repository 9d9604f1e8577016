"""Supervision of motions on robots, from the check to measured rest.

State machine of all functions that move a robot:

    CHECKING -> HANDED_OVER -> MOVING -> AT_REST      completed
    CHECKING, HANDED_OVER, MOVING -> STOPPING         any other end: the robot is held
    STOPPING -> AT_REST                               measured positions are constant, nothing is queued
"""

from __future__ import annotations

import signal
import threading
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from enum import Enum
from typing import Any, ClassVar, Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.exceptions import PepperKinError
from pepper_kin.status import ResultStatus

CYCLE = 0.02
"""Time between two steps of a motion [s]."""

REST_WINDOW = 0.2
"""Time for which measured positions have to be constant at rest [s]."""

REST_TOLERANCE, BASE_REST_TOLERANCE = 2e-3, 1e-3
"""Maximum range of positions within `REST_WINDOW`: joints, which may creep [rad, m or fraction], and a base
[m, rad]."""


class RobotMotionStatus(ResultStatus):
    """How a motion on a robot ended."""

    COMPLETED = "completed", "The motion went to its end, and the robot stands there."
    STOPPED = "stopped", "`stop` was called, here or by somebody else: read the state, and plan from there."
    DEVIATED = "deviated", "The robot was too far from the motion and was stopped: look for what holds it."
    STALLED = "stalled", "The watchdog stopped the robot, as this process was silent: give it more time."
    REFUSED = "refused", "The robot answered a call by an error, which the message quotes."
    ABORTED = "aborted", "The robot ended the motion: read the message, and plan again from where it is."
    NOT_AT_START = "not_at_start", "Move the robot to the start of the motion, or plan from where it is."
    STATE_UNUSABLE = (
        "state_unusable",
        "States of the robot were late or no numbers, and it was stopped: look at it and its network.",
    )
    CONNECTION_LOST = "connection_lost", "Look at the robot, and connect again."


class MotionState(Enum):
    """State of a supervised motion."""

    CHECKING = "checking"
    HANDED_OVER = "handed over"
    MOVING = "moving"
    STOPPING = "stopping"
    AT_REST = "at rest"


_TRANSITIONS = {
    MotionState.CHECKING: (MotionState.HANDED_OVER, MotionState.STOPPING),
    MotionState.HANDED_OVER: (MotionState.MOVING, MotionState.STOPPING),
    MotionState.MOVING: (MotionState.AT_REST, MotionState.STOPPING),
    MotionState.STOPPING: (MotionState.AT_REST,),
    MotionState.AT_REST: (),
}


def allowed_transitions() -> tuple[tuple[MotionState, MotionState], ...]:
    """Return the transitions of the state machine as pairs (from, to)."""
    return tuple((a, b) for a, after in _TRANSITIONS.items() for b in after)


class MotionEndedError(Exception):
    """A motion ends early; the supervisor converts the error to a `MotionEnd`.

    Args:
        status: Status of the motion.
        message: Reason of the end.
    """

    def __init__(self, status: RobotMotionStatus, message: str) -> None:
        self.status, self.message = status, message
        super().__init__(f"{status.value}: {message}")


class UnusableStateError(PepperKinError):
    """A robot reported an unusable state: of another shape, not finite, too old or missing.

    Attributes:
        reason: Fault of the state, with the value.
    """

    def __init__(self, reason: str) -> None:
        self.reason = reason
        super().__init__(f"state of the robot: {reason}")


class MotionEnd(NamedTuple):
    """Result of a supervised motion.

    Attributes:
        status: Status of the motion.
        message: Reason of the end, and of missing confirmation of rest.
        at_rest: Whether the robot was measured at rest, with nothing left that could move it.
    """

    status: RobotMotionStatus
    message: str
    at_rest: bool


class Clock:
    """Clock of this machine; tests replace it by a simulated one."""

    def now(self) -> float:
        """Return the monotonic time [s]."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Wait for a time [s]."""
        time.sleep(seconds)


class RestMeter:
    """Detector of rest from recently measured positions.

    Args:
        names: Names of the coordinates; names of a base's coordinates begin with "Base".
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._names = tuple(names)
        base = np.array([name.startswith("Base") for name in names], dtype=bool)
        self._most = np.where(base, BASE_REST_TOLERANCE, REST_TOLERANCE)
        self._rows: deque[tuple[float, NDArray[np.float64]]] = deque(maxlen=1000)

    def add(self, at: float, positions: ArrayLike) -> None:
        """Add positions, shape (n,) [rad, m or fraction], measured at a time [s]."""
        self._rows.append((at, np.array(positions, dtype=float)))

    def moving(self, since: float, now: float) -> str:
        """Return the reason why rest is not confirmed; "" at rest.

        Rest means that positions were measured for `REST_WINDOW` after `since`, that the positions of the
        last window differ by no more than the tolerance, and that the last measurement is not older than
        twice the window.

        Args:
            since: Time from which measurements count [s].
            now: Present time [s].
        """
        rows = [row for row in self._rows if row[0] >= since]
        if not rows or now - rows[-1][0] > 2.0 * REST_WINDOW:
            return "no new state was measured"
        last = rows[-1][0]
        near = [q for at, q in rows if at >= last - REST_WINDOW - CYCLE]
        if last - rows[0][0] < REST_WINDOW or len(near) < 3:
            return f"states were measured for {last - rows[0][0]:.2f} s, {REST_WINDOW:g} s are needed"
        spread = np.ptp(np.array(near), axis=0)
        if np.all(spread <= self._most):
            return ""
        k = int(np.argmax(np.nan_to_num(spread / self._most, nan=np.inf)))
        return f"{self._names[k]} moved by {spread[k]:.3f} within {REST_WINDOW:g} s"


class SupervisedMotion(ABC):
    """Interface of a motion on a robot for a `Supervisor`; its methods return quickly.

    Attributes:
        stop_time: Maximum time of waiting for rest [s].
        ending_errors: Errors that end the motion, with their status.
    """

    stop_time: float = 5.0
    ending_errors: ClassVar[Sequence[tuple[type[Exception], RobotMotionStatus]]] = ()

    @abstractmethod
    def check(self) -> None:
        """Raise an error if the motion must not start; nothing is sent yet."""

    @abstractmethod
    def hand_over(self) -> bool:
        """Send the motion to the robot in one or more calls; return whether it is complete there."""

    @abstractmethod
    def step(self) -> bool:
        """Do one cycle; return whether the motion is complete, the robot at rest and nothing queued."""

    @abstractmethod
    def stop(self) -> str:
        """Hold the robot and cancel queued motions, in one or more calls; return "" at rest, else why not."""

    @property
    @abstractmethod
    def connected(self) -> bool:
        """Whether the robot can be reached."""


Motion = TypeVar("Motion", bound=SupervisedMotion)


class Supervisor(Generic[Motion]):
    """Supervisor of one motion through its states; every end but COMPLETED holds the robot and measures rest.

    Args:
        motion: The supervised motion.
        clock: Clock; None for this machine's.
        on_state: Function that is called with each state when it begins.

    Attributes:
        state: State of the motion.
    """

    def __init__(
        self,
        motion: Motion,
        clock: Clock | None = None,
        on_state: Callable[[MotionState], object] | None = None,
    ) -> None:
        self.motion = motion
        self.state = MotionState.CHECKING
        self._clock = Clock() if clock is None else clock
        self._on_state = on_state
        self._requested = ""

    def request_stop(self, why: str = "stop() was called") -> None:
        """End the motion with STOPPED in any state; may be called from any thread."""
        self._requested = why

    def run(self) -> MotionEnd:
        """Run the motion and return its end.

        Unless the program has other handlers, Ctrl-C and SIGTERM are deferred until the robot is at rest;
        they and all other errors are raised then.

        Raises:
            Exception: errors of `check`, before anything is sent, and of callbacks.
        """
        if self._on_state is not None:
            self._on_state(self.state)
        try:
            self.motion.check()
        except MotionEndedError as error:
            if error.status is RobotMotionStatus.NOT_AT_START:
                return MotionEnd(error.status, error.message, True)
            return self._stop(error.status, error.message)[0]
        with _deferred_signals() as deferred:
            raised: BaseException | None = None
            try:
                self._look(deferred)
                self._enter(MotionState.HANDED_OVER)
                self._repeat(self.motion.hand_over, deferred)
                self._enter(MotionState.MOVING)
                self._repeat(self.motion.step, deferred)
                self._enter(MotionState.AT_REST)
                end = MotionEnd(RobotMotionStatus.COMPLETED, "", True)
            except MotionEndedError as error:
                end, raised = self._stop(error.status, error.message)
            except BaseException as error:
                status = self._status_of(error)
                end, late = self._stop(status or RobotMotionStatus.STOPPED, str(error))
                raised = late if status is not None else error
        deferred.act()
        if raised is not None:
            raise raised
        return end

    def _status_of(self, error: BaseException) -> RobotMotionStatus | None:
        """Return the status of an error that ends the motion; None for other errors."""
        return next((s for kind, s in self.motion.ending_errors if isinstance(error, kind)), None)

    def _repeat(self, step: Callable[[], bool], deferred: _DeferredSignals) -> None:
        """Call a step in every cycle until it returns True."""
        due = self._clock.now()
        while True:
            self._look(deferred)
            if step():
                return
            due = max(due + CYCLE, self._clock.now() - CYCLE)
            self._clock.sleep(max(due - self._clock.now(), 0.0))

    def _look(self, deferred: _DeferredSignals) -> None:
        """Raise the end of the motion if a stop was requested or a signal arrived."""
        if self._requested:
            raise MotionEndedError(RobotMotionStatus.STOPPED, self._requested)
        if deferred.number:
            name = signal.Signals(deferred.number).name
            raise MotionEndedError(RobotMotionStatus.STOPPED, f"interrupted by {name}")

    def _stop(self, status: RobotMotionStatus, message: str) -> tuple[MotionEnd, BaseException | None]:
        """Hold the robot until it is measured at rest or `stop_time` is over; return errors with the end."""
        self._enter(MotionState.STOPPING)
        end = self._clock.now() + self.motion.stop_time
        raised: BaseException | None = None
        missing = "nothing was measured"
        pause = 0.0
        while True:
            try:
                self._clock.sleep(pause)  # inside `try`, so that the loop also pauses after an error
                pause = CYCLE
                missing = self.motion.stop()
                if not missing or not self.motion.connected or self._clock.now() >= end:
                    break
            except BaseException as error:
                missing = str(error)
                if self._status_of(error) is None:
                    raised = error if raised is None else raised
                if not self.motion.connected or self._clock.now() >= end:
                    break
        if not missing:
            self._enter(MotionState.AT_REST)
            return MotionEnd(status, message, True), raised
        text = f"{message}; that the robot is at rest is not confirmed: {missing}".lstrip("; ")
        return MotionEnd(status, text, False), raised

    def _enter(self, state: MotionState) -> None:
        """Change the state and report it."""
        if state not in _TRANSITIONS[self.state]:
            raise RuntimeError(f"no arrow leads from {self.state.value} to {state.value}")
        self.state = state
        if self._on_state is not None:
            self._on_state(state)


class _DeferredSignals:
    """Signal that is deferred until the robot is at rest; number 0 without one."""

    def __init__(self) -> None:
        self.number = 0

    def take(self, number: int, _: object) -> None:
        """Store a signal, as the handler."""
        self.number = number

    def act(self) -> None:
        """Raise the error of the deferred signal, if any.

        Raises:
            KeyboardInterrupt: for Ctrl-C.
            SystemExit: for SIGTERM.
        """
        if self.number == signal.SIGINT:
            raise KeyboardInterrupt
        if self.number:
            raise SystemExit(128 + self.number)


@contextmanager
def _deferred_signals() -> Iterator[_DeferredSignals]:
    """Defer Ctrl-C and SIGTERM, in the main thread and if the program has no other handlers."""
    deferred = _DeferredSignals()
    ordinary: dict[int, Any] = {signal.SIGINT: signal.default_int_handler, signal.SIGTERM: signal.SIG_DFL}
    kept = []
    if threading.current_thread() is threading.main_thread():
        kept = [number for number, handler in ordinary.items() if signal.getsignal(number) == handler]
    try:
        for number in kept:
            signal.signal(number, deferred.take)
        yield deferred
    finally:
        for number in kept:
            signal.signal(number, ordinary[number])
