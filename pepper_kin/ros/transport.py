"""Interface of transports: topics, services and actions by name, over any protocol.

Message classes are from `pepper_kin.ros_messages.message_type`.  Callbacks run on threads of the transport,
one at a time for each subscription; they must return soon.  An action's `execute` runs on a separate thread.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from enum import IntEnum
from typing import Any, NamedTuple, Self

from pepper_kin.ros.qos import RELIABLE, QoS

__all__ = [
    "ActionServer",
    "Closable",
    "GoalHandle",
    "GoalResult",
    "GoalStatus",
    "NoPublisher",
    "Publisher",
    "ServerGoal",
    "Transport",
]

SERVER_WAIT = 5.0
"""Default time to wait for a service or an action server [s]."""


class GoalStatus(IntEnum):
    """State of a goal, as numbered by `action_msgs/msg/GoalStatus`."""

    UNKNOWN = 0
    ACCEPTED = 1
    EXECUTING = 2
    CANCELING = 3
    SUCCEEDED = 4
    CANCELED = 5
    ABORTED = 6

    @property
    def terminal(self) -> bool:
        """Whether the goal has ended."""
        return self >= GoalStatus.SUCCEEDED


class GoalResult(NamedTuple):
    """Outcome of a goal.

    Attributes:
        status: SUCCEEDED, CANCELED or ABORTED; UNKNOWN if the connection was lost.
        result: The action's Result message.
    """

    status: GoalStatus
    result: Any


class Closable(ABC):
    """Something that is open until `close`; a context manager."""

    @abstractmethod
    def close(self) -> None:
        """Close it; a second call does nothing."""

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close."""
        self.close()


class Publisher(Closable):
    """Publisher of a topic."""

    @abstractmethod
    def publish(self, message: Any) -> None:
        """Send a message of the topic's type.

        Raises:
            InvalidValueError: for another type, or a value that the type cannot hold, with the field's name.
            TransportError: after `close`.
        """

    @property
    @abstractmethod
    def subscription_count(self) -> int:
        """Number of matching subscriptions, so that images without a receiver need not be rendered."""


class NoPublisher(Publisher):
    """Publisher of a topic that cannot be published; it does nothing."""

    def publish(self, message: Any) -> None:
        """Do nothing."""

    @property
    def subscription_count(self) -> int:
        """Always 0."""
        return 0

    def close(self) -> None:
        """Do nothing."""


class ServerGoal(ABC):
    """Server side of an accepted goal.

    Attributes:
        goal: The action's Goal message.
        goal_id: Identifier of the goal, 16 bytes.
    """

    goal: Any
    goal_id: bytes

    @property
    @abstractmethod
    def status(self) -> GoalStatus:
        """State of the goal."""

    @property
    @abstractmethod
    def cancel_requested(self) -> bool:
        """Whether a cancel request was accepted: `execute` should end soon with `canceled`."""

    @abstractmethod
    def publish_feedback(self, feedback: Any) -> None:
        """Send a Feedback message to the client."""

    @abstractmethod
    def succeed(self, result: Any) -> None:
        """End the goal as reached, with a Result message.

        Raises:
            TransportError: if it has ended already.
        """

    @abstractmethod
    def abort(self, result: Any) -> None:
        """End the goal as failed, with a Result message; TransportError if it has ended already."""

    @abstractmethod
    def canceled(self, result: Any) -> None:
        """End the goal as canceled, with a Result message.

        Raises:
            TransportError: if it has ended already, or no cancel request was accepted.
        """


class ActionServer(ABC):
    """Base class of an action's implementation, for `Transport.offer_action`."""

    @abstractmethod
    def on_goal(self, goal: Any) -> bool:
        """Return whether a Goal message is accepted; called on a transport's thread, must return soon."""

    @abstractmethod
    def on_cancel(self, goal: ServerGoal) -> bool:
        """Return whether a cancel request is accepted; called on a transport's thread, must return soon."""

    @abstractmethod
    def execute(self, goal: ServerGoal) -> None:
        """Execute a goal on its thread, and end it by `succeed`, `abort` or `canceled`.

        A goal that has not ended when this returns or raises is aborted with a default Result.
        """


class GoalHandle(ABC):
    """Client side of a goal that was sent.

    Attributes:
        goal_id: Identifier of the goal, 16 bytes.
        accepted: Whether the server accepted it.
    """

    goal_id: bytes
    accepted: bool

    @property
    @abstractmethod
    def done(self) -> bool:
        """Whether the result has arrived; True for a goal that was not accepted."""

    @abstractmethod
    def cancel(self, timeout: float = SERVER_WAIT) -> bool:
        """Request to cancel the goal; return whether the server accepts, False if the goal has ended.

        Raises:
            TransportError: without an answer within the time [s].
        """

    @abstractmethod
    def result(self, timeout: float | None = None) -> GoalResult:
        """Wait for the result, without a limit or for at most `timeout` [s], and return it.

        Raises:
            TransportError: without a result within the time, or for a goal that was not accepted.
        """


class Transport(Closable):
    """Transport of messages to other programs, or within this one.

    Names of topics, services and actions are absolute: "/joint_states".
    """

    @abstractmethod
    def advertise(self, topic: str, type_name: str, qos: QoS = RELIABLE) -> Publisher:
        """Return a publisher.

        Args:
            topic: Name of the topic.
            type_name: Message type, such as "sensor_msgs/msg/JointState".
            qos: Quality of service.

        Raises:
            UnknownNameError: for an unknown type.
            TransportError: if the transport is closed or cannot carry the topic.
        """

    @abstractmethod
    def subscribe(self, topic: str, type_name: str, qos: QoS, callback: Callable[[Any], None]) -> Closable:
        """Subscribe a callback to every message of a topic, until the returned subscription is closed.

        Messages that cannot be read, and errors of the callback, are logged and end nothing; raises the
        errors of `advertise`.
        """

    def second_type(self, topic: str, type_name: str) -> str | None:
        """Return the name for subscribing to a topic of one type in a second type.

        None if topics can have one type only.
        """
        return None

    @abstractmethod
    def offer_service(self, name: str, type_name: str, callback: Callable[[Any], Any]) -> Closable:
        """Offer a service until closed; raises the errors of `advertise`.

        Args:
            name: Name of the service.
            type_name: Service type, such as "std_srvs/srv/Trigger".
            callback: Returns the Response message for a Request message.
        """

    @abstractmethod
    def call_service(self, name: str, type_name: str, request: Any, timeout: float = SERVER_WAIT) -> Any:
        """Call a service and return its Response message.

        Raises:
            TransportError: without a server or an answer in time [s]; otherwise the errors of `advertise`.
        """

    @abstractmethod
    def offer_action(self, name: str, type_name: str, server: ActionServer) -> Closable:
        """Offer an action until closed, which aborts running goals; raises the errors of `advertise`.

        Args:
            name: Name of the action.
            type_name: Action type, such as "control_msgs/action/FollowJointTrajectory".
            server: Implementation of the action.
        """

    @abstractmethod
    def send_goal(
        self,
        name: str,
        type_name: str,
        goal: Any,
        feedback_callback: Callable[[Any], None] | None = None,
        timeout: float = SERVER_WAIT,
    ) -> GoalHandle:
        """Send a Goal message to an action and return when the server has accepted or refused it.

        A goal that is accepted after this call has raised is canceled.

        Args:
            name: Name of the action.
            type_name: Action type.
            goal: The Goal message.
            feedback_callback: Called with every Feedback message.
            timeout: Time to wait for the server and its answer [s].

        Raises:
            TransportError: without a server or an answer in time; otherwise the errors of `advertise`.
        """
