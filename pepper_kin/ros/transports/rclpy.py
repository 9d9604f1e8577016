"""Transport through rclpy, where a ROS 2 is installed: topics, services and actions on the ROS graph.

Topics carry bytes of `pepper_kin.ros_messages`, which rclpy passes on as they are.  `ROS_DOMAIN_ID` and
`ROS_AUTOMATIC_DISCOVERY_RANGE` apply as to every node.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from typing import Any

from pepper_kin.exceptions import MissingDependencyError
from pepper_kin.ros.errors import TransportError
from pepper_kin.ros.qos import RELIABLE, QoS
from pepper_kin.ros.transport import SERVER_WAIT, ActionServer, Closable, GoalHandle, Publisher, Transport
from pepper_kin.ros.transports.dds_domain import discovery_range, domain_number
from pepper_kin.ros.transports.rclpy_actions import Client, Server, wait
from pepper_kin.ros.transports.rclpy_types import Converter, converter, ros_class
from pepper_kin.ros_messages import message_type, service_type
from pepper_kin.ros_messages.messages import check_message

logger = logging.getLogger(__name__)

_THREADS = 32
"""Most callbacks and goals under way at a time; threads are started as they are needed."""


class RclpyTransport(Transport):
    """Topics, services and actions of a node of rclpy.

    Attributes:
        node: The `rclpy.node.Node`.

    Args:
        node_name: Name of the node.

    Raises:
        MissingDependencyError: where rclpy cannot be imported.
        InvalidValueError: where a variable of the environment is no domain, or no range of discovery.
    """

    def __init__(self, node_name: str = "pepper_kin") -> None:
        try:
            import rclpy
            from rclpy.executors import MultiThreadedExecutor
            from rclpy.signals import SignalHandlerOptions
        except ImportError as error:
            command = "source /opt/ros/$ROS_DISTRO/setup.bash"
            raise MissingDependencyError("rclpy", command, "the transport through rclpy") from error
        domain_number()  # rclpy's own refusals do not name the variables
        discovery_range()
        self._context = rclpy.context.Context()
        rclpy.init(context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        self.node = rclpy.create_node(node_name, context=self._context, start_parameter_services=False)
        self._executor = MultiThreadedExecutor(_THREADS, context=self._context)
        self._executor.add_node(self.node)
        self._lock, self._closed = threading.RLock(), False
        self._parts: list[Part] = []
        self._clients: dict[tuple[str, str], Any] = {}
        self._action_clients: dict[tuple[str, str], Client] = {}
        self._thread = threading.Thread(target=self._spin, name="rclpy", daemon=True)
        self._thread.start()

    def advertise(self, topic: str, type_name: str, qos: QoS = RELIABLE) -> Publisher:
        """Return a publisher; see `Transport.advertise`."""
        types = self._types(topic, type_name)
        made = self.node.create_publisher(types.ros, topic, _profile(qos), callback_group=self.group())
        return self._kept(RclpyPublisher(self, topic, types, made))

    def subscribe(self, topic: str, type_name: str, qos: QoS, callback: Callable[[Any], None]) -> Closable:
        """Call back with every message; see `Transport.subscribe`."""
        types = self._types(topic, type_name)

        def receive(data: bytes) -> None:
            try:
                callback(types.from_bytes(data))
            except Exception:
                logger.exception("%s: a message could not be handled", topic)

        made = self.node.create_subscription(
            types.ros, topic, receive, _profile(qos), callback_group=self.group(), raw=True
        )
        return self._kept(Part(self, lambda: self.node.destroy_subscription(made)))

    def offer_service(self, name: str, type_name: str, callback: Callable[[Any], Any]) -> Closable:
        """Answer calls of a service; where the callback fails, with a default response."""
        self._check_open(name)
        kinds = service_type(type_name)
        request, response = (converter(kind.type_name) for kind in kinds)

        def answer(message: Any, empty: Any) -> Any:
            try:
                return response.to_ros(callback(request.from_ros(message)))
            except Exception:
                logger.exception("%s: the service failed", name)
                return empty

        found = ros_class(kinds.request.type_name.removesuffix("_Request"))
        made = self.node.create_service(found, name, answer, callback_group=self.group())
        return self._kept(Part(self, lambda: self.node.destroy_service(made)))

    def call_service(self, name: str, type_name: str, request: Any, timeout: float = SERVER_WAIT) -> Any:
        """Call a service; see `Transport.call_service`."""
        self._check_open(name)
        kinds = service_type(type_name)
        check_message(request, kinds.request)
        message = converter(kinds.request.type_name).to_ros(request)
        found = ros_class(kinds.request.type_name.removesuffix("_Request"))
        with self._lock:
            client = self._clients.get((name, type_name))
            if client is None:
                client = self.node.create_client(found, name, callback_group=self.group())
                self._clients[name, type_name] = client
        if not client.wait_for_service(timeout):
            raise TransportError(name, f"nobody offers this service within {timeout:g} s")
        future = client.call_async(message)
        if not wait(future, timeout):
            client.remove_pending_request(future)
            raise TransportError(name, f"no answer within {timeout:g} s")
        return converter(kinds.response.type_name).from_ros(future.result())

    def offer_action(self, name: str, type_name: str, server: ActionServer) -> Closable:
        """Offer an action; see `Transport.offer_action`."""
        self._check_open(name)
        offered = Server(self, name, type_name, server)
        return self._kept(Part(self, offered.close))

    def send_goal(
        self,
        name: str,
        type_name: str,
        goal: Any,
        feedback_callback: Callable[[Any], None] | None = None,
        timeout: float = SERVER_WAIT,
    ) -> GoalHandle:
        """Send a goal; see `Transport.send_goal`."""
        self._check_open(name)
        with self._lock:
            client = self._action_clients.get((name, type_name))
            if client is None:
                client = self._action_clients[name, type_name] = Client(self, name, type_name)
        return client.send(goal, feedback_callback, timeout)

    def close(self) -> None:
        """Close everything and leave the graph."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
            parts, self._parts = self._parts, []
        for part in reversed(parts):
            part.close()
        for client in self._action_clients.values():
            client.close()
        self._executor.shutdown(timeout_sec=1.0)
        self._context.try_shutdown()
        self._thread.join(SERVER_WAIT)
        self.node.destroy_node()

    def group(self, *, reentrant: bool = False) -> Any:
        """Return a new callback group: callbacks one after the other, or at the same time."""
        from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup

        return ReentrantCallbackGroup() if reentrant else MutuallyExclusiveCallbackGroup()

    def discard(self, part: Part) -> None:
        """Forget a part that was closed."""
        with self._lock:
            self._parts = [other for other in self._parts if other is not part]

    def _types(self, name: str, type_name: str) -> Converter:
        self._check_open(name)
        return converter(message_type(type_name).type_name)

    def _kept(self, part: Any) -> Any:
        with self._lock:
            self._parts.append(part)
        return part

    def _check_open(self, name: str) -> None:
        if self._closed:
            raise TransportError(name, "the transport is closed; make a new one")

    def _spin(self) -> None:
        while not self._closed and self._context.ok():
            try:
                self._executor.spin()
            except Exception:
                if not self._closed:
                    logger.exception("rclpy: a callback failed")


class Part(Closable):
    """Something of a node that is open.

    Args:
        transport: Which it is of.
        end: Ends it.
    """

    def __init__(self, transport: RclpyTransport, end: Callable[[], object]) -> None:
        self._transport, self._end = transport, end
        self._lock, self.closed = threading.Lock(), False

    def close(self) -> None:
        """End it."""
        with self._lock:
            if self.closed:
                return
            self.closed = True
        self._transport.discard(self)
        self._end()


class RclpyPublisher(Part, Publisher):
    """See `Publisher`."""

    def __init__(self, transport: RclpyTransport, topic: str, types: Converter, made: Any) -> None:
        super().__init__(transport, lambda: transport.node.destroy_publisher(made))
        self._topic, self._types, self._publisher = topic, types, made

    def publish(self, message: Any) -> None:
        """Send a message."""
        if self.closed:
            raise TransportError(self._topic, "the publisher is closed; advertise the topic again")
        if not isinstance(message, self._types.kind):
            check_message(message, self._types.kind)
        self._publisher.publish(self._types.to_bytes(message))

    @property
    def subscription_count(self) -> int:
        """Number of subscriptions that match."""
        return 0 if self.closed else int(self._publisher.get_subscription_count())


def _profile(qos: QoS) -> Any:
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

    return QoSProfile(
        depth=qos.depth,
        reliability=ReliabilityPolicy.RELIABLE if qos.reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if qos.latched else DurabilityPolicy.VOLATILE,
    )
