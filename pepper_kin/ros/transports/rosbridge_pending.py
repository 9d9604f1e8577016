"""Pending answers and goals, until the other side of a rosbridge connection ends them."""

from __future__ import annotations

import threading
import uuid
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from pepper_kin.ros.errors import TransportError
from pepper_kin.ros.transport import (
    SERVER_WAIT,
    ActionServer,
    GoalHandle,
    GoalResult,
    GoalStatus,
    ServerGoal,
)
from pepper_kin.ros.transports.rosbridge_json import ProtocolError
from pepper_kin.ros_messages import action_type

if TYPE_CHECKING:
    from pepper_kin.ros.transports.rosbridge_client import RosbridgeClient
    from pepper_kin.ros.transports.rosbridge_session import RosbridgeSession


class PendingAnswer:
    """An answer that somebody waits for.

    Args:
        identifier: Of the call.
    """

    def __init__(self, identifier: str) -> None:
        self.identifier = identifier
        self._done, self._error = threading.Event(), ""
        self._values: dict[str, Any] = {}

    def succeed(self, values: dict[str, Any]) -> None:
        """Take the answer."""
        self._values = values
        self._done.set()

    def fail(self, reason: str) -> None:
        """Take the reason for which there is none."""
        self._error = reason
        self._done.set()

    def wait(self, name: str, timeout: float) -> dict[str, Any]:
        """Return the answer.

        Args:
            name: Of the service, for the message.
            timeout: Time to wait [s].

        Raises:
            TransportError: without an answer within the time.
        """
        if not self._done.wait(timeout) or self._error:
            raise TransportError(name, self._error or f"no answer within {timeout:g} s")
        return self._values


class RosbridgeGoal(GoalHandle):
    """A goal that was sent."""

    def __init__(
        self, client: RosbridgeClient, name: str, type_name: str, on_feedback: Callable[[Any], None] | None
    ) -> None:
        self._client, self.name, self.kind = client, name, action_type(type_name)
        self.goal_id, self.accepted, self.on_feedback = uuid.uuid4().bytes, True, on_feedback
        self.identifier = f"goal:{self.goal_id.hex()}"
        self._ended = threading.Event()
        self._result: GoalResult | None = None
        self._reason = ""

    def end(self, status: GoalStatus, result: Any) -> None:
        """Take the result."""
        self._result = GoalResult(status, result)
        self._ended.set()

    def refuse(self, reason: str) -> None:
        """Take the reason for which the goal did not begin."""
        self.accepted, self._reason = False, reason
        self._ended.set()

    @property
    def done(self) -> bool:
        """Whether the result is there."""
        return self._ended.is_set()

    def cancel(self, timeout: float = SERVER_WAIT) -> bool:
        """Request the end of the goal; the protocol has no answer to that but the result."""
        if self.done:
            return False
        self._client.send({"op": "cancel_action_goal", "action": self.name, "id": self.identifier})
        return True

    def result(self, timeout: float | None = None) -> GoalResult:
        """Wait for the result."""
        if not self._ended.wait(timeout):
            raise TransportError(self.name, f"no result within {timeout:g} s")
        if self._result is None:
            raise TransportError(self.name, f"the goal was not accepted: {self._reason}")
        return self._result


class RemoteAction(ActionServer):
    """An action that a client offers."""

    def __init__(self, session: RosbridgeSession, name: str, type_name: str) -> None:
        self._session, self._name = session, name
        self._kind, self._type_name = action_type(type_name), type_name
        self._goals: dict[str, tuple[ServerGoal, threading.Event]] = {}

    def on_goal(self, goal: Any) -> bool:
        """Accept: the client cannot refuse before it begins."""
        return not self._session.ended

    def on_cancel(self, goal: ServerGoal) -> bool:
        """Pass the request on."""
        request = {"op": "cancel_action_goal", "action": self._name, "id": goal.goal_id.hex()}
        self._session.send(request)
        return True

    def execute(self, goal: ServerGoal) -> None:
        """Pass the goal on, and wait for its result."""
        ended = threading.Event()
        key = goal.goal_id.hex()
        self._goals[key] = goal, ended
        request = {"op": "send_action_goal", "action": self._name, "id": key, "feedback": True}
        request |= {"action_type": self._type_name, "args": goal.goal.to_dict()}
        self._session.send(request)
        while not ended.wait(1.0) and not self._session.ended:
            continue
        self._goals.pop(key, None)

    def feedback(self, key: str, values: dict[str, Any]) -> None:
        """Take feedback of the client."""
        if key in self._goals:
            self._goals[key][0].publish_feedback(self._kind.feedback.from_dict(values))

    def end(self, key: str, status: int, values: dict[str, Any]) -> None:
        """Take a result of the client."""
        if key not in self._goals:
            raise ProtocolError("action_result: no goal with this id is under way")
        goal, ended = self._goals[key]
        result = self._kind.result.from_dict(values)
        if status == GoalStatus.SUCCEEDED:
            goal.succeed(result)
        elif status == GoalStatus.CANCELED and goal.cancel_requested:
            goal.canceled(result)
        else:
            goal.abort(result)
        ended.set()

    def lose(self) -> None:
        """End all goals: the client has gone; they are aborted."""
        for _, ended in tuple(self._goals.values()):
            ended.set()
