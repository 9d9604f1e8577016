"""Actions within one program: goals on threads, with the interfaces of servers and clients."""

from __future__ import annotations

import logging
import threading
import uuid
from collections.abc import Callable
from typing import Any

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ros.errors import TransportError
from pepper_kin.ros.transport import (
    SERVER_WAIT,
    ActionServer,
    Closable,
    GoalHandle,
    GoalResult,
    GoalStatus,
    ServerGoal,
)
from pepper_kin.ros_messages import message_type

logger = logging.getLogger(__name__)

Callback = Callable[[Any], None]


class Action(Closable):
    """An action and its goals.

    Args:
        withdraw: Function that is called when the action is closed.
        name: Name of the action.
        type_name: Type of the action.
        server: Server that executes goals.
    """

    def __init__(
        self, withdraw: Callable[[Action], None], name: str, type_name: str, server: ActionServer
    ) -> None:
        self._withdraw, self.name, self.type_name, self.server = withdraw, name, type_name, server
        self.goal_type = message_type(f"{type_name}_Goal")
        self.result_type = message_type(f"{type_name}_Result")
        self.feedback_type = message_type(f"{type_name}_Feedback")
        self.goals: set[LocalGoal] = set()

    def send(
        self,
        goal: Any,
        on_feedback: Callback | None = None,
        on_end: Callable[[GoalResult], None] | None = None,
        goal_id: bytes | None = None,
    ) -> LocalGoal:
        """Send a goal; its feedback and its end are called back on the server's threads.

        Args:
            goal: The Goal message.
            on_feedback: Function that is called with each Feedback message.
            on_end: Function that is called with the result.
            goal_id: Identifier of the goal by its client, 16 bytes; made if omitted.

        Raises:
            InvalidValueError: for a goal of another type.
        """
        if not isinstance(goal, self.goal_type):
            raise InvalidValueError(f"goal of {self.name}", type(goal).__name__, self.type_name)
        made = LocalGoal(self, goal, on_feedback, on_end)
        made.goal_id = made.goal_id if goal_id is None else goal_id
        if self.server.on_goal(goal):
            made.begin()
        return made

    def close(self) -> None:
        """Withdraw the action, and abort its goals."""
        self._withdraw(self)
        for goal in tuple(self.goals):
            goal.request_cancel()
            goal.end(GoalStatus.ABORTED, self.result_type())


class LocalGoal(ServerGoal, GoalHandle):
    """A goal, with the interfaces of its server and of its client."""

    def __init__(
        self,
        action: Action,
        goal: Any,
        on_feedback: Callback | None,
        on_end: Callable[[GoalResult], None] | None,
    ) -> None:
        self.action, self.goal = action, goal
        self.goal_id, self.accepted = uuid.uuid4().bytes, False
        self._on_feedback, self._on_end = on_feedback, on_end
        self._status, self._cancel = GoalStatus.UNKNOWN, False
        self._lock, self._ended = threading.Lock(), threading.Event()
        self._result: GoalResult | None = None

    def begin(self) -> None:
        """Execute the goal on a thread."""
        self.accepted, self._status = True, GoalStatus.EXECUTING
        self.action.goals.add(self)
        threading.Thread(target=self._run, name=f"ros {self.action.name}", daemon=True).start()

    def _run(self) -> None:
        try:
            self.action.server.execute(self)
        except Exception:
            logger.exception("%s: a goal failed", self.action.name)
        finally:
            self.end(GoalStatus.ABORTED, self.action.result_type())

    @property
    def status(self) -> GoalStatus:
        """State of the goal."""
        return self._status

    @property
    def cancel_requested(self) -> bool:
        """Whether a cancel request was accepted."""
        return self._cancel

    @property
    def done(self) -> bool:
        """Whether the goal has a result, or was not accepted."""
        return self._ended.is_set() or not self.accepted

    def publish_feedback(self, feedback: Any) -> None:
        """Send feedback to the client."""
        if self._on_feedback is not None and not self._status.terminal:
            self._on_feedback(feedback)

    def succeed(self, result: Any) -> None:
        """End the goal as reached."""
        self._finish(GoalStatus.SUCCEEDED, result)

    def abort(self, result: Any) -> None:
        """End the goal as failed."""
        self._finish(GoalStatus.ABORTED, result)

    def canceled(self, result: Any) -> None:
        """End the goal as canceled."""
        if not self._cancel:
            raise TransportError(self.action.name, "no cancel request was accepted; end the goal otherwise")
        self._finish(GoalStatus.CANCELED, result)

    def _finish(self, status: GoalStatus, result: Any) -> None:
        if not self.end(status, result):
            raise TransportError(self.action.name, f"the goal has ended already: {self._status.name}")

    def end(self, status: GoalStatus, result: Any) -> bool:
        """End the goal if it has not ended; return whether this was its end."""
        with self._lock:
            if self._status.terminal:
                return False
            self._status, self._result = status, GoalResult(status, result)
        self.action.goals.discard(self)
        self._ended.set()
        if self._on_end is not None:
            self._on_end(self._result)
        return True

    def request_cancel(self) -> bool:
        """Request to cancel the goal; return whether the server accepts the request."""
        if self.done:
            return False
        self._cancel = True  # before the server is notified, which may end the goal at once
        self._cancel = bool(self.action.server.on_cancel(self))
        with self._lock:
            if self._cancel and not self._status.terminal:
                self._status = GoalStatus.CANCELING
        return self._cancel

    def cancel(self, timeout: float = SERVER_WAIT) -> bool:
        """Request to cancel the goal; return whether the server accepts the request."""
        return self.request_cancel()

    def result(self, timeout: float | None = None) -> GoalResult:
        """Wait for the result."""
        if not self.accepted:
            raise TransportError(self.action.name, "the goal was not accepted")
        if not self._ended.wait(timeout) or self._result is None:
            raise TransportError(self.action.name, f"no result within {timeout:g} s")
        return self._result
