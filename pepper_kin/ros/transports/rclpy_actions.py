"""Actions through rclpy: servers and clients."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from pepper_kin.ros.errors import TransportError
from pepper_kin.ros.transport import SERVER_WAIT, ActionServer, GoalHandle, GoalResult, GoalStatus, ServerGoal
from pepper_kin.ros.transports.rclpy_types import converter, ros_class, uuid_bytes
from pepper_kin.ros_messages import action_type
from pepper_kin.ros_messages.messages import check_message

if TYPE_CHECKING:
    from pepper_kin.ros.transports.rclpy import RclpyTransport

logger = logging.getLogger(__name__)

_LAST_ANSWERS = 0.5
"""Time to receive requests for results and send results before a server is destroyed [s]."""

_LOOK_EVERY = 0.5
"""Interval between checks for clients [s]."""

_FEEDBACK = "/_action/feedback"


class _Types:
    """Classes of an action and their converters."""

    def __init__(self, type_name: str) -> None:
        kinds = action_type(type_name)
        self.ros = ros_class(kinds.goal.type_name.removesuffix("_Goal"))
        self.goal, self.result, self.feedback = (converter(kind.type_name) for kind in kinds)


class Server:
    """Server of an action on the graph.

    Args:
        transport: Transport of the node.
        name: Name of the action.
        type_name: Type of the action.
        server: Server that executes goals.
    """

    def __init__(self, transport: RclpyTransport, name: str, type_name: str, server: ActionServer) -> None:
        import rclpy.action

        self.name, self.types, self._server = name, _Types(type_name), server
        self._goals: dict[bytes, ExecutedGoal] = {}
        self._lock, self.closed, self._node = threading.Lock(), False, transport.node
        self._missed = 0
        self._made = rclpy.action.ActionServer(
            transport.node,
            self.types.ros,
            name,
            execute_callback=self._execute,
            goal_callback=self._accept,
            handle_accepted_callback=self._begin,
            cancel_callback=self._cancel,
            callback_group=transport.group(reentrant=True),
        )
        group = transport.group()
        self._timer = transport.node.create_timer(_LOOK_EVERY, self._look_for_clients, callback_group=group)

    def _look_for_clients(self) -> None:
        """Cancel active goals if two successive checks find no client of the action in the graph.

        Each client of an action subscribes to its feedback.  DDS detects the regular end of a node at once,
        and its loss after its lease (Fast DDS: 20 s).
        """
        with self._lock:
            goals = [goal for goal in self._goals.values() if not goal.status.terminal]
        there = not goals or self._node.count_subscribers(self.name + _FEEDBACK)
        self._missed = 0 if there else self._missed + 1
        if self._missed == 2:
            for goal in goals:
                logger.warning("connection lost, goal of %s canceled", self.name)
                goal.lost = True
                self._server.on_cancel(goal)

    def close(self) -> None:
        """Abort active goals and withdraw the action."""
        self.closed = True
        with self._lock:
            goals = list(self._goals.values())
        for goal in goals:
            goal.close()
        for goal in goals:
            goal.returned.wait(SERVER_WAIT)
        if goals:
            time.sleep(_LAST_ANSWERS)
        self._node.destroy_timer(self._timer)
        self._made.destroy()

    def _accept(self, message: Any) -> Any:
        from rclpy.action import GoalResponse

        try:
            if not self.closed and self._server.on_goal(self.types.goal.from_ros(message)):
                return GoalResponse.ACCEPT
        except Exception:
            logger.exception("%s: a goal could not be examined", self.name)
        return GoalResponse.REJECT

    def _begin(self, handle: Any) -> None:
        self._goal(handle).begin()  # `close` also ends accepted goals whose execution has not begun

    def _cancel(self, handle: Any) -> Any:
        from rclpy.action import CancelResponse

        goal = self._goal(handle)
        goal.announced = True  # before the server is notified, which may end the goal at once
        try:
            if not goal.status.terminal and self._server.on_cancel(goal):
                return CancelResponse.ACCEPT
        except Exception:
            logger.exception("%s: a cancel request could not be examined", self.name)
        goal.announced = False
        return CancelResponse.REJECT

    def _goal(self, handle: Any) -> ExecutedGoal:
        goal_id = uuid_bytes(handle.goal_id)
        with self._lock:
            if goal_id not in self._goals:
                self._goals[goal_id] = ExecutedGoal(self, goal_id, handle)
            return self._goals[goal_id]

    def _execute(self, handle: Any) -> Any:
        goal = self._goal(handle)
        try:
            self._server.execute(goal)
        except Exception:
            if not goal.status.terminal:
                logger.exception("%s: a goal failed", self.name)
        finally:
            with self._lock:
                self._goals.pop(goal.goal_id, None)
            goal.close()
            goal.returned.set()
        return goal.ros_result


class ExecutedGoal(ServerGoal):
    """A goal of a `Server`.

    Attributes:
        announced: Whether the server is examining a cancel request, or has accepted one.
        lost: Whether its client is gone, which cancels the goal.
        returned: Event that is set when the execution has returned.
        ros_result: Result as an rclpy message.
    """

    def __init__(self, server: Server, goal_id: bytes, handle: Any) -> None:
        self.goal_id, self.goal = goal_id, server.types.goal.from_ros(handle.request)
        self.announced, self.lost, self.returned = False, False, threading.Event()
        self._server, self._handle, self._lock = server, handle, threading.Lock()
        self._begun, self._closing, self._ended = False, server.closed, GoalStatus.UNKNOWN
        self.ros_result: Any = server.types.result.ros()

    @property
    def status(self) -> GoalStatus:
        """State of the goal."""
        return self._ended if self._ended.terminal else GoalStatus(self._handle.status)

    @property
    def cancel_requested(self) -> bool:
        """Whether a cancel request was accepted, the client is gone, or the action is being closed."""
        return self._closing or self.lost or bool(self._handle.is_cancel_requested)

    def publish_feedback(self, feedback: Any) -> None:
        """Send feedback to the client, unless the goal has ended."""
        types = self._server.types
        check_message(feedback, types.feedback.kind)
        if self._ended.terminal:
            return
        self._handle.publish_feedback(types.feedback.to_ros(feedback))

    def succeed(self, result: Any) -> None:
        """End the goal as reached."""
        self._end(GoalStatus.SUCCEEDED, result)

    def abort(self, result: Any) -> None:
        """End the goal as failed."""
        self._end(GoalStatus.ABORTED, result)

    def canceled(self, result: Any) -> None:
        """End the goal as canceled; a goal without a client as failed, which needs no request in rclpy."""
        if self.lost:
            self._end(GoalStatus.ABORTED, result)
            return
        until = time.monotonic() + SERVER_WAIT
        while self.announced and not self._handle.is_cancel_requested and time.monotonic() < until:
            time.sleep(0.001)  # the request was accepted; rclpy records it after the callback
        self._end(GoalStatus.CANCELED, result)

    def begin(self) -> None:
        """Start the execution of the goal; ROS cannot abort a goal before that."""
        with self._lock:
            self._begun = True
            self._handle.execute()
        if self._closing:
            self.close()

    def close(self) -> None:
        """Abort the goal if it is active, or when it begins."""
        with self._lock:
            self._closing = True
            if self._begun and not self._ended.terminal:
                self._ended = GoalStatus.ABORTED
                self._handle.abort()

    def _end(self, status: GoalStatus, result: Any) -> None:
        check_message(result, self._server.types.result.kind)
        message = self._server.types.result.to_ros(result)
        ends: dict[GoalStatus, Callable[[], None]] = {
            GoalStatus.SUCCEEDED: self._handle.succeed,
            GoalStatus.ABORTED: self._handle.abort,
            GoalStatus.CANCELED: self._handle.canceled,
        }
        with self._lock:
            if self._ended.terminal:
                raise TransportError(self._server.name, f"the goal has ended already: {self._ended.name}")
            if status is GoalStatus.CANCELED and not self._handle.is_cancel_requested:
                raise TransportError(
                    self._server.name, "no cancel request was accepted; end the goal otherwise"
                )
            ends[status]()
            self._ended, self.ros_result = status, message


class Client:
    """Client that sends goals to an action.

    Args:
        transport: Transport of the node.
        name: Name of the action.
        type_name: Type of the action.
    """

    def __init__(self, transport: RclpyTransport, name: str, type_name: str) -> None:
        import rclpy.action

        self.name, self.types = name, _Types(type_name)
        group = transport.group()
        self._made = rclpy.action.ActionClient(transport.node, self.types.ros, name, callback_group=group)
        self._goals: list[RclpyGoal] = []

    def send(self, goal: Any, feedback_callback: Callable[[Any], None] | None, timeout: float) -> RclpyGoal:
        """Send a goal; see `Transport.send_goal`."""
        check_message(goal, self.types.goal.kind)
        message = self.types.goal.to_ros(goal)
        if not self._made.wait_for_server(timeout):
            raise TransportError(self.name, f"nobody offers this action within {timeout:g} s")

        def receive(received: Any) -> None:
            try:
                if feedback_callback is not None:
                    feedback_callback(self.types.feedback.from_ros(received.feedback))
            except Exception:
                logger.exception("%s: the callback of a goal failed", self.name)

        future = self._made.send_goal_async(message, None if feedback_callback is None else receive)
        try:
            answered = wait(future, timeout)
        except BaseException:
            future.add_done_callback(_cancel_late)
            raise
        if not answered:
            future.add_done_callback(_cancel_late)
            raise TransportError(self.name, f"no answer within {timeout:g} s; it is canceled if one comes")
        sent = RclpyGoal(self, future.result())
        self._goals = [*(other for other in self._goals if not other.done), sent]
        return sent

    def close(self) -> None:
        """End the client; active goals get no result."""
        for goal in self._goals:
            goal.lose()
        self._made.destroy()


def _cancel_late(future: Any) -> None:
    """Cancel a goal that is accepted after its client has given up."""
    handle = future.result()
    if handle is not None and handle.accepted:
        handle.cancel_goal_async()


class RclpyGoal(GoalHandle):
    """A goal of a `Client`."""

    def __init__(self, client: Client, handle: Any) -> None:
        self._client, self._handle = client, handle
        self.goal_id, self.accepted = uuid_bytes(handle.goal_id), bool(handle.accepted)
        self._ended = threading.Event()
        self._result: GoalResult | None = None
        if self.accepted:
            handle.get_result_async().add_done_callback(self._finish)

    @property
    def done(self) -> bool:
        """Whether the goal has a result, or was not accepted."""
        return self._ended.is_set() or not self.accepted

    def cancel(self, timeout: float = SERVER_WAIT) -> bool:
        """Request to cancel the goal; return whether the server accepts the request."""
        if self.done:
            return False
        future = self._handle.cancel_goal_async()
        if not wait(future, timeout):
            raise TransportError(self._client.name, f"no answer to the cancel request within {timeout:g} s")
        return bool(future.result().goals_canceling)

    def result(self, timeout: float | None = None) -> GoalResult:
        """Wait for the result."""
        if not self.accepted:
            raise TransportError(self._client.name, "the goal was not accepted")
        if not self._ended.wait(timeout):
            raise TransportError(self._client.name, f"no result within {timeout:g} s")
        if self._result is None:
            raise TransportError(self._client.name, "the transport was closed before the result came")
        return self._result

    def lose(self) -> None:
        """End the goal without a result."""
        self._ended.set()

    def _finish(self, future: Any) -> None:
        answer = future.result()
        if answer is not None and not self._ended.is_set():
            result = self._client.types.result.from_ros(answer.result)
            self._result = GoalResult(GoalStatus(answer.status), result)
        self._ended.set()


def wait(future: Any, timeout: float | None) -> bool:
    """Wait for an rclpy future on a thread other than its executor's; return whether it is done.

    Args:
        future: The future.
        timeout: Maximum time [s]; unlimited if None.
    """
    done = threading.Event()
    future.add_done_callback(lambda _: done.set())
    return done.wait(timeout)
