"""Channels of a motion's commands to ALMotion: through the watchdog on the robot, or directly."""

from __future__ import annotations

import contextlib
import math
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Generator, Iterator, Sequence
from typing import Any, NamedTuple

from pepper_kin.naoqi import on_robot
from pepper_kin.naoqi.errors import NaoqiError, RobotConnectionError
from pepper_kin.naoqi.link import RobotLink
from pepper_kin.supervision import Clock, MotionEndedError, RobotMotionStatus

BEAT = 0.1
"""Time between two heartbeats [s]."""

UNANSWERED = 100
"""Maximum number of unanswered calls."""

UNHEARD = 0.3
"""Time without an answer from the watchdog after which the client itself holds the robot [s]."""

AGAIN, MOST_HOLDS = 0.1, 60
"""Time between two attempts to hold the robot [s], and the maximum number of unanswered attempts."""

PART = 25
"""Number of keys of each joint that one call hands over, so that heartbeats are sent in between."""

SILENT = "no beat"
"""Prefix of the watchdog's reason when it stopped the motion because heartbeats were missing."""


class Moved(NamedTuple):
    """Parts that a motion moves.

    Attributes:
        joints: Names of the joints.
        base: Whether it moves the base.
    """

    joints: Sequence[str]
    base: bool


class Channel(ABC):
    """Channel of one motion's commands; no method blocks.

    Args:
        link: The connection.
        clock: Clock of the client.
        moved: Parts that the motion moves.

    Attributes:
        state: State of the motion, in the words of `on_robot.MotionWatchdog`.
    """

    def __init__(self, link: RobotLink, clock: Clock, moved: Moved) -> None:
        self._link, self._clock, self._moved = link, clock, moved
        self._calls: deque[tuple[float, str, Any]] = deque()
        self.state = "armed"

    @abstractmethod
    def open(self) -> bool:
        """Start to be watched; called until it returns True."""

    @abstractmethod
    def send(self, calls: Sequence[tuple[str, Sequence[Any]]]) -> None:
        """Send calls of ALMotion that return at once."""

    @abstractmethod
    def start(self, method: str, *arguments: Any) -> None:
        """Start a long call of ALMotion; `state` says when it has ended."""

    @abstractmethod
    def start_curves(self, times: list[list[float]], keys: list[list[Any]]) -> Iterator[None]:
        """Start `angleInterpolationBezier` of the joints, in steps between which time may pass."""

    def look(self) -> None:
        """Process the answers that have arrived, and send a heartbeat if one is due.

        Raises:
            MotionEndedError: if the watchdog has ended the motion.
            RobotConnectionError: if an answer is overdue.
            NaoqiError: if the robot returned an error.
        """
        while self._calls and self._calls[0][2].isFinished():
            _, what, future = self._calls.popleft()
            self._take(self._link.value(future, what))
        if self._calls and self._clock.now() > self._calls[0][0] + self._link.timeout:
            raise RobotConnectionError(self._link.url, f"{self._calls[0][1]}: no answer in time")
        if len(self._calls) > UNANSWERED:
            raise RobotConnectionError(self._link.url, f"{len(self._calls)} calls are unanswered")

    @property
    def idle(self) -> bool:
        """Whether all calls are answered."""
        return not self._calls

    @abstractmethod
    def close(self) -> bool:
        """Close a motion that is complete; called until it returns True."""

    @abstractmethod
    def hold(self, moving: bool) -> str:
        """Hold the robot and end its queued tasks; called until it returns "", else what is not done yet.

        Args:
            moving: Whether the robot moves, so that it is held again even if a hold was answered.
        """

    def _begin(self, module: str, method: str, *arguments: Any) -> None:
        future = self._link.start(module, method, *arguments)
        self._calls.append((self._clock.now(), f"{module}.{method}", future))

    @abstractmethod
    def _take(self, value: Any) -> None:
        """Process the answer of a call."""


class DirectChannel(Channel):
    """Calls of ALMotion, for robots without a watchdog."""

    def __init__(self, link: RobotLink, clock: Clock, moved: Moved) -> None:
        super().__init__(link, clock, moved)
        self._lasting: Any = None
        self._holds: list[tuple[bool, Iterator[None]]] = []
        self._held, self._tried, self._failed = False, -math.inf, ""
        self._since: float | None = None
        self._target: Any = None

    def open(self) -> bool:
        """Return True: there is no watchdog."""
        return True

    def send(self, calls: Sequence[tuple[str, Sequence[Any]]]) -> None:
        """Call each method of ALMotion."""
        for method, arguments in calls:
            self._begin("ALMotion", method, *arguments)

    def start(self, method: str, *arguments: Any) -> None:
        """Start the call, and keep its future."""
        self.state = "running"
        self._lasting = (f"ALMotion.{method}", self._link.start("ALMotion", method, *arguments))

    def start_curves(self, times: list[list[float]], keys: list[list[Any]]) -> Iterator[None]:
        """Start the call at once: ALMotion takes a motion in one call."""
        self.start("angleInterpolationBezier", list(self._moved.joints), times, keys)
        return iter(())

    def look(self) -> None:
        """Process answers; see `Channel.look`."""
        super().look()
        if self._lasting is not None and self._lasting[1].isFinished():
            what, future = self._lasting
            self._lasting = None
            self.state = f"finished: {self._link.value(future, what)}"

    def close(self) -> bool:
        """Return whether all calls are answered."""
        return self.idle

    def hold(self, moving: bool) -> str:
        """Hold repeatedly, until all calls and a hold that started after them are answered."""
        now = self._clock.now()
        while self._calls and self._calls[0][2].isFinished():
            _, what, future = self._calls.popleft()
            with contextlib.suppress(NaoqiError):  # the motion has ended: errors of its calls do not matter
                self._link.value(future, what)
            self._held = False
        if self._lasting is not None and self._lasting[1].isFinished():
            self._lasting, self._held = None, False  # the robot has ended the call, with a value or an error
        if (moving or not self._held) and now >= self._tried + AGAIN and len(self._holds) < MOST_HOLDS:
            self._tried = now
            self._since = now if self._since is None else self._since
            last = self.idle and self._lasting is None
            anew = now <= self._since + on_robot.BRAKING or (last and not self._holds)
            self._holds.append((last, self._hold_once(anew)))
        for entry in tuple(self._holds):
            last, hold = entry
            try:
                next(hold)
            except StopIteration:
                self._holds.remove(entry)
                self._held, self._failed = self._held or last, ""
            except NaoqiError as error:
                self._holds.remove(entry)
                self._failed = str(error)
        left = [what for _, what, _ in self._calls] + ([self._lasting[0]] if self._lasting else [])
        if left:
            return f"{left[-1]} is not answered"
        if self._failed:
            return f"the robot refuses to be held: {self._failed}"
        return "" if self._held and not self._holds else "the robot has not answered to being held"

    def _hold_once(self, anew: bool) -> Iterator[None]:
        """Hold the robot at its present command if `anew`, else at the last target; no step blocks."""
        joints = list(self._moved.joints)
        brake = self._link.start("ALMotion", "stopMove") if self._moved.base else None
        if joints:  # in this order: tasks killed after `setAngles` would include its new target
            yield from self._answer("killTasksUsingResources", joints)
            if self._target is None or anew:
                self._target = yield from self._answer("getAngles", joints, False)
            yield from self._answer("setAngles", joints, self._target, on_robot.HOLD)
        while brake is not None and not brake.isFinished():
            yield
        if brake is not None:
            self._link.value(brake, "ALMotion.stopMove")

    def _answer(self, method: str, *arguments: Any) -> Generator[None, None, Any]:
        future = self._link.start("ALMotion", method, *arguments)
        while not future.isFinished():
            yield
        return self._link.value(future, f"ALMotion.{method}")

    def _take(self, value: Any) -> None:
        """Do nothing: the calls return no value."""


class GuardedChannel(Channel):
    """Channel through the watchdog on the robot, which passes on commands that carry the motion's token.

    Args:
        link: The connection.
        clock: Clock of the client.
        moved: Parts that the motion moves.
        silence: Maximum time between two heartbeats [s].
    """

    def __init__(self, link: RobotLink, clock: Clock, moved: Moved, silence: float) -> None:
        super().__init__(link, clock, moved)
        self._silence = silence
        self._token: int | None = None
        self._arming: Any = None
        self._number = 0
        self._beaten = 0.0
        self._stop: list[tuple[float, Any]] = []
        self._direct: DirectChannel | None = None
        self._since: float | None = None
        self._asked = -math.inf

    def open(self) -> bool:
        """Get a token; see `Channel.open`."""
        if self._arming is None:
            now = self._clock.now()
            joints = list(self._moved.joints)
            future = self._link.start(on_robot.NAME, "arm", self._silence, joints, self._moved.base)
            self._arming = (now, future)
        since, future = self._arming
        if not future.isFinished():
            if self._clock.now() > since + self._link.timeout:
                raise RobotConnectionError(self._link.url, f"{on_robot.NAME}.arm: no answer in time")
            return False
        self._token = int(self._link.value(future, f"{on_robot.NAME}.arm"))
        self._beaten = self._clock.now()
        return True

    def send(self, calls: Sequence[tuple[str, Sequence[Any]]]) -> None:
        """Send a command, which counts as a heartbeat."""
        self._ask("command", [[method, list(arguments)] for method, arguments in calls])

    def start(self, method: str, *arguments: Any) -> None:
        """Start a long call; see `Channel.start`."""
        self._ask("start", method, list(arguments))

    def start_curves(self, times: list[list[float]], keys: list[list[Any]]) -> Iterator[None]:
        """Hand over the keys in parts, each after the answer to the previous part."""
        for k in range(0, len(times[0]), PART):
            self._ask("add", [[row[k : k + PART] for row in rows] for rows in (times, keys)])
            while not self.idle:
                yield
        self.start("angleInterpolationBezier", list(self._moved.joints))

    def look(self) -> None:
        """Process answers, and send a heartbeat if one is due; see `Channel.look`."""
        super().look()
        now = self._clock.now()
        if self._token is not None and now >= self._beaten + BEAT:
            self._beaten = now
            self._begin(on_robot.NAME, "beat", self._token)

    def close(self) -> bool:
        """Release the motion from the watchdog; see `Channel.close`."""
        if self.state == "released":
            return True
        if self.idle:
            self._begin(on_robot.NAME, "release", self._token)
        return False

    def hold(self, moving: bool) -> str:
        """Let the watchdog hold the robot; hold it directly as well if the watchdog does not answer."""
        now = self._clock.now()
        if self._since is None:
            self._since = now
        if self._token is None and self._arming is None:
            return self._hold_directly(moving)  # the watchdog was never asked
        if self._token is None:
            if not self._arming[1].isFinished():
                return "the watchdog has not answered"  # without heartbeats it ends the motion by itself
            try:
                self._token = int(self._link.value(self._arming[1], f"{on_robot.NAME}.arm"))
            except NaoqiError:
                return ""  # refused: nothing was sent
        for asked, future in [pair for pair in self._stop if pair[1].isFinished()]:
            self._stop.remove((asked, future))
            try:
                self.state = str(self._link.value(future, f"{on_robot.NAME}.halt"))
                self._since = now
            except NaoqiError as error:
                self.state = f"failed: {error}"
        if self.state.startswith("at rest"):
            return ""
        if self.state.startswith("not at rest"):
            return f"the watchdog could not bring it to rest ({self.state})"
        if now >= self._asked + AGAIN:
            self._asked = now
            self._stop.append(
                (now, self._link.start(on_robot.NAME, "halt", self._token, "stopped by its client"))
            )
        if now > self._since + UNHEARD or self.state.startswith(("failed", "unknown")):
            left = [what for _, what, future in self._calls if not future.isFinished()]
            return self._hold_directly(moving) or (f"{left[-1]} is not answered" if left else "")
        return "the watchdog is stopping it"

    def _hold_directly(self, moving: bool) -> str:
        if self._direct is None:
            self._direct = DirectChannel(self._link, self._clock, self._moved)
        return self._direct.hold(moving)

    def _ask(self, method: str, *arguments: Any) -> None:
        self._number += 1
        self._beaten = self._clock.now()
        self._begin(on_robot.NAME, method, self._token, self._number, *arguments)

    def _take(self, value: Any) -> None:
        """Set the state of the motion; raise MotionEndedError if the watchdog ended it or a call failed."""
        self.state = str(value)
        word, _, why = self.state.partition(": ")
        if word in ("stopping", "at rest", "not at rest", "unknown"):
            silent = why.startswith(SILENT)
            status = RobotMotionStatus.STALLED if silent else RobotMotionStatus.STOPPED
            raise MotionEndedError(
                status, f"the watchdog stopped it: {why or 'it does not know this motion'}"
            )
        if word == "failed":
            raise MotionEndedError(RobotMotionStatus.REFUSED, why)
