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
    """Pending answer to a call.

    Args:
        identifier: Identifier of the call.
    """

    def __init__(self, identifier: str) -> None:
        self.identifier = identifier
        self._done, self._error = threading.Event(), ""
        self._values: dict[str, Any] = {}

    def succeed(self, values: dict[str, Any]) -> None:
        """Store the answer."""
        self._values = values
        self._done.set()

    def fail(self, reason: str) -> None:
        """Store the reason for which there is no answer."""
        self._error = reason
        self._done.set()

    def wait(self, name: str, timeout: float) -> dict[str, Any]:
        """Return the answer.

        Args:
            name: Name of the service, for the message.
            timeout: Maximum time to wait [s].

        Raises:
            TransportError: without an answer within the time.
        """
        if not self._done.wait(timeout) or self._error:
            raise TransportError(name, self._error or f"no answer within {timeout:g} s")
        return self._values


class RosbridgeGoal(GoalHandle):
    """A goal that was sent to a rosbridge server."""

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
        """Store the result."""
        self._result = GoalResult(status, result)
        self._ended.set()

    def refuse(self, reason: str) -> None:
        """Store the reason for which the goal did not begin."""
        self.accepted, self._reason = False, reason
        self._ended.set()

    @property
    def done(self) -> bool:
        """Whether the goal has a result, or was refused."""
        return self._ended.is_set()

    def cancel(self, timeout: float = SERVER_WAIT) -> bool:
        """Request to cancel the goal; the protocol answers only with the result."""
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
        """Accept a goal: the client cannot refuse before the goal begins."""
        return not self._session.ended

    def on_cancel(self, goal: ServerGoal) -> bool:
        """Pass the request to the client."""
        request = {"op": "cancel_action_goal", "action": self._name, "id": goal.goal_id.hex()}
        self._session.send(request)
        return True

    def execute(self, goal: ServerGoal) -> None:
        """Pass the goal to the client, and wait for its result."""
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
        """Publish feedback of the client."""
        if key in self._goals:
            self._goals[key][0].publish_feedback(self._kind.feedback.from_dict(values))

    def end(self, key: str, status: int, values: dict[str, Any]) -> None:
        """End a goal with a result of the client."""
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
        """Abort all goals after the loss of the client."""
        for _, ended in tuple(self._goals.values()):
            ended.set()
