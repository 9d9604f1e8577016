"""Interface of transports: topics, services and actions by name, independent of how they travel.

Messages are those of `pepper_kin.ros_messages.message_type`.  Callbacks arrive on threads of the transport,
one after the other for each subscription; they must return soon.  An action's `execute` runs on a separate
thread.
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
"""Time to wait for a service or an action server [s], where no other is set."""


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
    """How a goal ended.

    Attributes:
        status: SUCCEEDED, CANCELED or ABORTED; UNKNOWN where the connection was lost.
        result: The action's Result message.
    """

    status: GoalStatus
    result: Any


class Closable(ABC):
    """Something that is open until `close`; a context manager."""

    @abstractmethod
    def close(self) -> None:
        """End it; a second call does nothing."""

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close."""
        self.close()


class Publisher(Closable):
    """Sends messages to a topic."""

    @abstractmethod
    def publish(self, message: Any) -> None:
        """Send a message of the topic's type.

        Raises:
            InvalidValueError: naming the field, for a value that the type cannot hold, or another type.
            TransportError: after `close`.
        """

    @property
    @abstractmethod
    def subscription_count(self) -> int:
        """Number of subscriptions that match, so that pictures without a receiver need not be drawn."""


class NoPublisher(Publisher):
    """Stands for a topic that cannot be published: nobody listens."""

    def publish(self, message: Any) -> None:
        """Do nothing."""

    @property
    def subscription_count(self) -> int:
        """Always 0."""
        return 0

    def close(self) -> None:
        """Do nothing."""


class ServerGoal(ABC):
    """A goal that was accepted, as its server sees it.

    Attributes:
        goal: The action's Goal message.
        goal_id: Its identifier, 16 bytes.
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
            TransportError: where it has ended already.
        """

    @abstractmethod
    def abort(self, result: Any) -> None:
        """End the goal as failed, with a Result message; raises as `succeed`."""

    @abstractmethod
    def canceled(self, result: Any) -> None:
        """End the goal as canceled, with a Result message.

        Raises:
            TransportError: where it has ended already, or no cancel request was accepted.
        """


class ActionServer(ABC):
    """What an action does; derive from it and pass it to `Transport.offer_action`."""

    @abstractmethod
    def on_goal(self, goal: Any) -> bool:
        """Return whether a Goal message is accepted; on a thread of the transport, must return soon."""

    @abstractmethod
    def on_cancel(self, goal: ServerGoal) -> bool:
        """Return whether a cancel request is accepted; as `on_goal`."""

    @abstractmethod
    def execute(self, goal: ServerGoal) -> None:
        """Execute a goal on its thread, and end it by `succeed`, `abort` or `canceled`.

        A goal that has not ended when this returns or raises is aborted with a default Result.
        """


class GoalHandle(ABC):
    """A goal that was sent, as its client sees it.

    Attributes:
        goal_id: Its identifier, 16 bytes.
        accepted: Whether the server accepted it.
    """

    goal_id: bytes
    accepted: bool

    @property
    @abstractmethod
    def done(self) -> bool:
        """Whether the result is there; True for a goal that was not accepted."""

    @abstractmethod
    def cancel(self, timeout: float = SERVER_WAIT) -> bool:
        """Request the end of the goal; return whether the server accepts that, False if it has ended.

        Raises:
            TransportError: without an answer within the time [s].
        """

    @abstractmethod
    def result(self, timeout: float | None = None) -> GoalResult:
        """Wait for the result, for any time or for `timeout` [s].

        Raises:
            TransportError: without a result within the time, or for a goal that was not accepted.
        """


class Transport(Closable):
    """Carries messages to other programs, or within this one.

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
            TransportError: where this is impossible.
        """

    @abstractmethod
    def subscribe(self, topic: str, type_name: str, qos: QoS, callback: Callable[[Any], None]) -> Closable:
        """Call back with every message of a topic until the subscription returned is closed.

        Messages that cannot be read, and errors of the callback, are logged and end nothing; raises as
        `advertise`.
        """

    def second_type(self, topic: str, type_name: str) -> str | None:
        """Return the name by which a topic that has a type already is subscribed to in a second one.

        None where a topic can have one type only.
        """
        return None

    @abstractmethod
    def offer_service(self, name: str, type_name: str, callback: Callable[[Any], Any]) -> Closable:
        """Answer calls of a service by `callback(request) -> response` until closed; raises as `advertise`.

        Args:
            name: Name of the service.
            type_name: Service type, such as "std_srvs/srv/Trigger".
            callback: Returns the Response message for a Request message.
        """

    @abstractmethod
    def call_service(self, name: str, type_name: str, request: Any, timeout: float = SERVER_WAIT) -> Any:
        """Call a service and return its Response message.

        Raises:
            TransportError: without a server or an answer within the time [s]; otherwise as `advertise`.
        """

    @abstractmethod
    def offer_action(self, name: str, type_name: str, server: ActionServer) -> Closable:
        """Offer an action until closed, which aborts goals under way; raises as `advertise`.

        Args:
            name: Name of the action.
            type_name: Action type, such as "control_msgs/action/FollowJointTrajectory".
            server: What it does.
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

        A goal that is accepted after this has raised is canceled then.

        Args:
            name: Name of the action.
            type_name: Action type.
            goal: The Goal message.
            feedback_callback: Called with every Feedback message.
            timeout: Time to wait for the server and its answer [s].

        Raises:
            TransportError: without a server or an answer within the time; otherwise as `advertise`.
        """
