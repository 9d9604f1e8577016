"""Transport within one program: topics, services and actions between its parts."""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Callable
from typing import Any

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ros.errors import TransportError
from pepper_kin.ros.qos import RELIABLE, QoS
from pepper_kin.ros.transport import (
    SERVER_WAIT,
    ActionServer,
    Closable,
    Publisher,
)
from pepper_kin.ros.transports.graph import GraphTransport
from pepper_kin.ros.transports.local_actions import Action, LocalGoal
from pepper_kin.ros_messages import message_type

logger = logging.getLogger(__name__)

Callback = Callable[[Any], None]


class LocalTransport(GraphTransport):
    """Topics, services and actions within this program.

    A rosbridge server makes them available to clients elsewhere.

    Attributes:
        written: The last message that was encoded as text for clients, and its text.
    """

    def __init__(self) -> None:
        super().__init__()
        self.written: tuple[Any, str] = (None, "")
        self._topics: dict[str, Topic] = {}
        self._second: dict[tuple[str, str], str] = {}  # (topic, second type) -> internal name
        self._services: dict[str, Service] = {}
        self._actions: dict[str, Action] = {}

    def _leave(self) -> None:
        with self.lock:
            entries: list[Closable] = [*self._services.values(), *self._actions.values()]
            entries += [entry for topic in self._topics.values() for entry in topic.subscriptions]
        for entry in entries:
            entry.close()

    @property
    def topics(self) -> dict[str, str]:
        """Name -> type of all topics with a publisher or a subscription."""
        with self.lock:
            within = set(self._second.values())
            used = {name: t for name, t in sorted(self._topics.items()) if t.is_used}
            return {name: t.type_name for name, t in used.items() if name not in within}

    def flush(self, timeout: float = SERVER_WAIT) -> None:
        """Wait until the callbacks of all messages so far have returned, such as before time advances.

        Raises:
            TransportError: if callbacks take longer than the timeout [s].
        """
        with self.lock:
            entries = [entry for topic in self._topics.values() for entry in topic.subscriptions]
        for entry in entries:
            if isinstance(entry, Subscription) and not entry.flush(timeout):
                raise TransportError(entry.topic.name, f"a callback takes longer than {timeout:g} s")

    @property
    def services(self) -> dict[str, str]:
        """Name -> type of all services."""
        with self.lock:
            return {name: entry.type_name for name, entry in sorted(self._services.items())}

    @property
    def actions(self) -> dict[str, str]:
        """Name -> type of all actions."""
        with self.lock:
            return {name: entry.type_name for name, entry in sorted(self._actions.items())}

    def topic(self, name: str, type_name: str | None) -> Topic:
        """Return a topic, which is made if it is new.

        Args:
            name: Name of the topic.
            type_name: Type of the topic; None for the type of a known topic.

        Raises:
            UnknownNameError: for an unknown type.
            TransportError: for a topic of another type, or an unknown one without a type.
        """
        with self.lock:
            self.check_open(name)
            name = self._second.get((name, str(type_name)), name)
            found = self._topics.get(name)
            if found is None and type_name is None:
                raise TransportError(name, "it is not known, and no type was stated; state its type")
            kind = None if type_name is None else message_type(type_name)
            if found is None or not (found.is_used or kind is None or kind is found.kind):
                assert kind is not None
                found = self._topics[name] = Topic(name, kind)
            elif kind is not None and kind is not found.kind:
                raise TransportError(name, f"its type is {found.type_name}, not {type_name}")
            return found

    def advertise(self, topic: str, type_name: str, qos: QoS = RELIABLE) -> Publisher:
        """Return a publisher; see `Transport.advertise`."""
        return LocalPublisher(self, self.topic(topic, type_name), qos)

    def subscribe(self, topic: str, type_name: str, qos: QoS, callback: Callback) -> Closable:
        """Call back with every message, on a thread of the subscription; see `Transport.subscribe`."""
        return Subscription(self, self.topic(topic, type_name), qos, callback)

    def second_type(self, topic: str, type_name: str) -> str:
        """Return the internal name of a topic's second type; clients use the topic's name and that type."""
        with self.lock:
            return self._second.setdefault(
                (topic, message_type(type_name).type_name), f"{topic} of {type_name}"
            )

    def listen(self, topic: str, type_name: str | None, callback: Callback) -> Closable:
        """Call back with every message on the publishing thread, for callbacks that return at once."""
        return DirectSubscription(self, self.topic(topic, type_name), callback)

    def offer_service(self, name: str, type_name: str, callback: Callable[[Any], Any]) -> Closable:
        """Answer calls on the caller's thread; see `Transport.offer_service`."""
        return self._offer(self._services, Service(self, name, type_name, callback))

    def offer_action(self, name: str, type_name: str, server: ActionServer) -> Closable:
        """Offer an action; see `Transport.offer_action`."""
        return self._offer(self._actions, Action(self.withdraw, name, type_name, server))

    def _offer(self, table: dict[str, Any], entry: Any) -> Any:
        with self.lock:
            self.check_open(entry.name)
            if entry.name in table:
                raise TransportError(entry.name, "it is offered already; close that first")
            table[entry.name] = entry
        return entry

    def withdraw(self, entry: Service | Action) -> None:
        """Forget a service or an action."""
        with self.lock:
            table: dict[str, Any] = self._services if isinstance(entry, Service) else self._actions
            if table.get(entry.name) is entry:
                del table[entry.name]

    def service(self, name: str) -> Service:
        """Return a service by name.

        Raises:
            TransportError: for a service that nobody offers.
        """
        with self.lock:
            return self._known(self._services, name, "service")

    def action(self, name: str) -> Action:
        """Return an action by name; raises TransportError for an action that nobody offers."""
        with self.lock:
            return self._known(self._actions, name, "action")

    @staticmethod
    def _known(table: dict[str, Any], name: str, kind: str) -> Any:
        if name not in table:
            known = ", ".join(sorted(table)[:20]) or "(none)"
            raise TransportError(name, f"nobody offers this {kind}; there are: {known}")
        return table[name]

    def call_service(self, name: str, type_name: str, request: Any, timeout: float = SERVER_WAIT) -> Any:
        """Call a service; see `Transport.call_service`."""
        return self.service(name).call(request)

    def send_goal(
        self,
        name: str,
        type_name: str,
        goal: Any,
        feedback_callback: Callback | None = None,
        timeout: float = SERVER_WAIT,
    ) -> LocalGoal:
        """Send a goal; see `Transport.send_goal`."""
        return self.action(name).send(goal, feedback_callback)


class Topic:
    """A topic: its type, publishers and subscriptions, and its last encoded message.

    Args:
        name: Name of the topic.
        kind: Class of its messages.
    """

    def __init__(self, name: str, kind: Any) -> None:
        self.name, self.kind = name, kind
        self.type_name: str = kind.type_name
        self.publishers: set[LocalPublisher] = set()
        self.subscriptions: tuple[DirectSubscription, ...] = ()
        self.encoded: tuple[Any, Any] = (None, None)

    @property
    def is_used(self) -> bool:
        """Whether the topic has a publisher or a subscription."""
        return bool(self.publishers or self.subscriptions)


class LocalPublisher(Publisher):
    """Publisher within this program; see `Publisher`."""

    def __init__(self, transport: LocalTransport, topic: Topic, qos: QoS) -> None:
        self._transport, self.topic = transport, topic
        self.kept: deque[Any] = deque(maxlen=qos.depth if qos.latched else 0)
        with transport.lock:
            topic.publishers.add(self)

    @property
    def subscription_count(self) -> int:
        """Number of subscriptions."""
        return len(self.topic.subscriptions) + (self.kept.maxlen or 0)

    def publish(self, message: Any) -> None:
        """Hand a message to all subscriptions."""
        topic = self.topic
        if self not in topic.publishers:
            raise TransportError(topic.name, "the publisher is closed; advertise the topic again")
        if not isinstance(message, topic.kind):
            got = getattr(message, "type_name", type(message).__name__)
            raise InvalidValueError(f"message for {topic.name}", got, topic.type_name)
        self.kept.append(message)
        for subscription in topic.subscriptions:
            subscription.take(message)

    def close(self) -> None:
        """Remove the publisher from its topic."""
        with self._transport.lock:
            self.topic.publishers.discard(self)


class DirectSubscription(Closable):
    """Subscription that calls back on the publishing thread."""

    def __init__(self, transport: LocalTransport, topic: Topic, callback: Callback) -> None:
        self._transport, self.topic, self._callback = transport, topic, callback
        with transport.lock:
            topic.subscriptions = (*topic.subscriptions, self)
            kept = [message for publisher in topic.publishers for message in publisher.kept]
        for message in kept:
            self.take(message)

    def take(self, message: Any) -> None:
        """Call back with a message; an exception is logged."""
        try:
            self._callback(message)
        except Exception:
            logger.exception("%s: the callback of a subscription failed", self.topic.name)

    def close(self) -> None:
        """Remove the subscription from its topic."""
        with self._transport.lock:
            self.topic.subscriptions = tuple(one for one in self.topic.subscriptions if one is not self)


class Subscription(DirectSubscription):
    """Subscription that calls back on a separate thread; if it is slow, the oldest messages are dropped."""

    def __init__(self, transport: LocalTransport, topic: Topic, qos: QoS, callback: Callback) -> None:
        self._waiting: deque[Any] = deque(maxlen=qos.depth)
        self._changed = threading.Condition()
        self._ended = self._busy = False
        name = f"ros {topic.name}"
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        super().__init__(transport, topic, callback)
        self._thread.start()

    def take(self, message: Any) -> None:
        """Queue a message for the thread."""
        with self._changed:
            self._waiting.append(message)
            self._changed.notify_all()

    def close(self) -> None:
        """Remove the subscription from its topic, and end the thread."""
        super().close()
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    def _run(self) -> None:
        while True:
            with self._changed:
                while not self._waiting and not self._ended:
                    self._changed.wait()
                if self._ended:
                    return
                message, self._busy = self._waiting.popleft(), True
            super().take(message)
            with self._changed:
                self._busy = False
                self._changed.notify_all()

    def flush(self, timeout: float) -> bool:
        """Wait until the callbacks of all messages so far have returned; return whether they did in time."""
        with self._changed:
            return self._changed.wait_for(lambda: self._ended or not (self._waiting or self._busy), timeout)


class Service(Closable):
    """A service and the callback that answers it."""

    def __init__(
        self, transport: LocalTransport, name: str, type_name: str, callback: Callable[[Any], Any]
    ) -> None:
        self._transport, self.name, self._callback = transport, name, callback
        self.request = message_type(f"{type_name}_Request")
        self.response = message_type(f"{type_name}_Response")
        self.type_name = type_name

    def call(self, request: Any) -> Any:
        """Return the response to a request.

        Raises:
            InvalidValueError: for a request of another type.
            TransportError: with the text of an error of the server.
        """
        if not isinstance(request, self.request):
            raise InvalidValueError(f"request of {self.name}", type(request).__name__, self.type_name)
        try:
            return self._callback(request)
        except TransportError:
            raise
        except Exception as error:
            logger.exception("%s: the service failed", self.name)
            raise TransportError(self.name, f"the service failed: {error}") from error

    def close(self) -> None:
        """Withdraw the service."""
        self._transport.withdraw(self)
