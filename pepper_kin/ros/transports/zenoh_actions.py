"""Actions through Zenoh: three services and two topics, with the names of rcl_action."""

from __future__ import annotations

import contextlib
import logging
import threading
import time
import uuid
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from pepper_kin.ros.errors import TransportError
from pepper_kin.ros.qos import RELIABLE, QoS
from pepper_kin.ros.transport import SERVER_WAIT, ActionServer, Closable, GoalHandle, GoalResult, GoalStatus
from pepper_kin.ros.transports.graph import OpenPart
from pepper_kin.ros.transports.local_actions import Action, LocalGoal
from pepper_kin.ros_messages import message_type
from pepper_kin.ros_messages.messages import check_message

if TYPE_CHECKING:
    from pepper_kin.ros.transports.zenoh import ZenohTransport

logger = logging.getLogger(__name__)

_CANCEL = "action_msgs/srv/CancelGoal"
_STATUS = "action_msgs/msg/GoalStatusArray"
_NONE, _REJECTED, _UNKNOWN, _TERMINATED = range(4)  # return codes of CancelGoal
_MOST_ENDED = 100  # maximum number of ended goals whose results are kept
_LOOK_EVERY = 0.5  # interval between checks for clients [s]
_LAST_ANSWERS = 0.2  # time to send results before the services end [s]
_LONGEST = 1e6  # default of the maximum time to wait for a result [s]


class OfferedAction(OpenPart):
    """An action on the graph; its goals are goals of an `Action`.

    Goals are canceled if no client is left on the graph; Zenoh detects the end of a client at once.

    Args:
        transport: Transport of the node.
        name: Name of the action.
        type_name: Type of the action.
        server: Server that executes goals.
    """

    def __init__(self, transport: ZenohTransport, name: str, type_name: str, server: ActionServer) -> None:
        super().__init__(transport, self._end)
        self._node, self._type, self._lock = transport, type_name, threading.Lock()
        self._goals: dict[bytes, LocalGoal] = {}
        self._action = Action(lambda _: None, name, type_name, server)
        self._statuses = transport.advertise(f"{name}/_action/status", _STATUS, QoS(depth=1, latched=True))
        self._feedback = transport.advertise(f"{name}/_action/feedback", f"{type_name}_FeedbackMessage")
        self._services = [
            transport.offer_service(f"{name}/_action/send_goal", f"{type_name}_SendGoal", self._accept),
            transport.offer_service(f"{name}/_action/get_result", f"{type_name}_GetResult", self._result),
            transport.offer_service(f"{name}/_action/cancel_goal", _CANCEL, self._cancel),
        ]
        self._closed = threading.Event()
        threading.Thread(target=self._look_for_clients, name=f"ros {name} clients", daemon=True).start()

    def _end(self) -> None:
        """Abort active goals and withdraw the action."""
        self._closed.set()
        under_way = bool(self._action.goals)
        self._action.close()
        if under_way:
            time.sleep(_LAST_ANSWERS)
        for part in (*self._services, self._statuses, self._feedback):
            part.close()

    def _accept(self, request: Any) -> Any:
        identifier = bytes(request.goal_id.uuid)
        response = message_type(f"{self._type}_SendGoal_Response")(accepted=False)
        with self._lock:
            if identifier in self._goals:
                return response
            made = self._action.send(
                request.goal,
                on_feedback=lambda feedback: self._send_feedback(request.goal_id, feedback),
                on_end=lambda _: self._publish_status(),
                goal_id=identifier,
            )
            if made.accepted:
                ended = [one for one, goal in self._goals.items() if goal.done]
                for old in ended[: max(0, len(ended) - _MOST_ENDED)]:
                    del self._goals[old]
                self._goals[identifier] = made
        response.accepted = made.accepted
        self._publish_status()
        return response

    def _send_feedback(self, goal_id: Any, feedback: Any) -> None:
        kind = message_type(f"{self._type}_FeedbackMessage")
        self._feedback.publish(kind(goal_id=goal_id, feedback=feedback))

    def _result(self, request: Any) -> Any:
        response = message_type(f"{self._type}_GetResult_Response")()
        goal = self._goals.get(bytes(request.goal_id.uuid))
        if goal is not None:
            status, response.result = goal.result()
            response.status = int(status)
        return response

    def _cancel(self, request: Any) -> Any:
        response = message_type(f"{_CANCEL}_Response")()
        wanted = bytes(request.goal_info.goal_id.uuid)
        with self._lock:
            chosen = [goal for one, goal in self._goals.items() if not any(wanted) or one == wanted]
        under_way = [goal for goal in chosen if not goal.done]
        if not under_way:
            response.return_code = _TERMINATED if chosen else _UNKNOWN
            return response
        canceled = [goal for goal in under_way if goal.request_cancel()]
        response.return_code = _NONE if canceled else _REJECTED
        response.goals_canceling = [self._info(goal) for goal in canceled]
        self._publish_status()
        return response

    def _info(self, goal: LocalGoal) -> Any:
        info = message_type("action_msgs/msg/GoalInfo")()
        info.goal_id.uuid = goal.goal_id
        return info

    def _publish_status(self) -> None:
        if self._closed.is_set():
            return
        one = message_type("action_msgs/msg/GoalStatus")
        with self._lock:
            goals = list(self._goals.values())
        listed = [one(goal_info=self._info(goal), status=int(goal.status)) for goal in goals]
        self._statuses.publish(message_type(_STATUS)(status_list=listed))

    def _look_for_clients(self) -> None:
        """Cancel active goals if two successive checks find no subscription to their feedback."""
        missed, topic = 0, f"{self._action.name}/_action/feedback"
        while not self._closed.wait(_LOOK_EVERY):
            goals = [goal for goal in tuple(self._goals.values()) if not goal.done]
            try:
                missed = 0 if not goals or self._node.subscribers(topic) else missed + 1
            except Exception:
                if not self._closed.is_set():
                    logger.exception("%s: the graph cannot be asked", topic)
                continue
            if missed == 2:
                for goal in goals:
                    logger.warning("connection lost, goal of %s canceled", self._action.name)
                    goal.request_cancel()


class ZenohGoal(GoalHandle):
    """A goal that was sent to an action.

    Args:
        transport: Transport of the node.
        name: Name of the action.
        type_name: Type of the action.
        on_feedback: Function that is called with the goal's feedback.
    """

    def __init__(
        self, transport: ZenohTransport, name: str, type_name: str, on_feedback: Callable[[Any], None] | None
    ) -> None:
        self._transport, self._name, self._type = transport, name, type_name
        self.goal_id, self.accepted = uuid.uuid4().bytes, False
        self._on_feedback = on_feedback
        self._ended, self._result = threading.Event(), GoalResult(GoalStatus.UNKNOWN, None)
        self._listening: Closable | None = None

    def send(self, goal: Any, timeout: float) -> ZenohGoal:
        """Send the goal; see `Transport.send_goal`."""
        check_message(goal, message_type(f"{self._type}_Goal"))
        end = time.monotonic() + timeout
        kind = f"{self._type}_FeedbackMessage"
        topic = f"{self._name}/_action/feedback"
        self._listening = self._transport.subscribe(topic, kind, RELIABLE, self._take_feedback)
        try:
            request = message_type(f"{self._type}_SendGoal_Request")(goal=goal)
            request.goal_id.uuid = self.goal_id
            response = self._call("send_goal", f"{self._type}_SendGoal", request, end - time.monotonic())
            self.accepted = bool(response.accepted)
        except TransportError:
            self._cancel_late()
            raise
        finally:
            if not self.accepted:
                self._listening.close()
        if self.accepted:
            threading.Thread(target=self._wait, name=f"ros {self._name} result", daemon=True).start()
        return self

    def _cancel_late(self) -> None:
        """Cancel the goal, which may have been accepted after the wait for it ended."""

        def cancel() -> None:
            with contextlib.suppress(TransportError):
                self.cancel()

        threading.Thread(target=cancel, daemon=True).start()

    def _take_feedback(self, message: Any) -> None:
        if self._on_feedback is not None and bytes(message.goal_id.uuid) == self.goal_id:
            self._on_feedback(message.feedback)

    def _wait(self) -> None:
        request = message_type(f"{self._type}_GetResult_Request")()
        request.goal_id.uuid = self.goal_id
        self._result = GoalResult(GoalStatus.UNKNOWN, message_type(f"{self._type}_Result")())
        with contextlib.suppress(TransportError):  # without an answer the connection was lost
            service, kind = f"{self._name}/_action/get_result", f"{self._type}_GetResult"
            response = self._transport.ask(service, kind, request, _LONGEST)
            if response is not None:
                self._result = GoalResult(GoalStatus(response.status), response.result)
        self._ended.set()
        if self._listening is not None:
            self._listening.close()

    @property
    def done(self) -> bool:
        """Whether the goal has a result, or was not accepted."""
        return self._ended.is_set() or not self.accepted

    def cancel(self, timeout: float = SERVER_WAIT) -> bool:
        """Request to cancel the goal; return whether the server accepts the request."""
        if self.accepted and self._ended.is_set():
            return False
        request = message_type(f"{_CANCEL}_Request")()
        request.goal_info.goal_id.uuid = self.goal_id
        response = self._call("cancel_goal", _CANCEL, request, timeout)
        return any(bytes(one.goal_id.uuid) == self.goal_id for one in response.goals_canceling)

    def result(self, timeout: float | None = None) -> GoalResult:
        """Wait for the result."""
        if not self.accepted:
            raise TransportError(self._name, "the goal was not accepted")
        if not self._ended.wait(timeout):
            raise TransportError(self._name, f"no result within {timeout:g} s")
        return self._result

    def _call(self, service: str, type_name: str, request: Any, timeout: float) -> Any:
        return self._transport.call_service(f"{self._name}/_action/{service}", type_name, request, timeout)
