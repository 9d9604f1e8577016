"""Transport through rclpy of an installed ROS 2: topics, services and actions on the ROS graph.

Topics carry bytes of `pepper_kin.ros_messages`, which rclpy passes on unchanged.  `ROS_DOMAIN_ID` and
`ROS_AUTOMATIC_DISCOVERY_RANGE` apply as to every node.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from typing import Any

from pepper_kin.exceptions import optional
from pepper_kin.ros.errors import TransportError
from pepper_kin.ros.qos import RELIABLE, QoS
from pepper_kin.ros.transport import SERVER_WAIT, ActionServer, Closable, GoalHandle, Publisher
from pepper_kin.ros.transports.dds_domain import discovery_range, domain_number
from pepper_kin.ros.transports.graph import GraphTransport, OpenPart
from pepper_kin.ros.transports.rclpy_actions import Client, Server, wait
from pepper_kin.ros.transports.rclpy_types import Converter, converter, ros_class
from pepper_kin.ros_messages import message_type, service_type
from pepper_kin.ros_messages.messages import check_message

logger = logging.getLogger(__name__)

_THREADS = 32
"""Maximum number of concurrent callbacks and goals; threads are started when needed."""


class RclpyTransport(GraphTransport):
    """Topics, services and actions of a node of rclpy.

    Attributes:
        node: The `rclpy.node.Node`.

    Args:
        node_name: Name of the node.

    Raises:
        MissingDependencyError: if rclpy cannot be imported.
        InvalidValueError: if an environment variable is not a domain, or not a discovery range.
    """

    def __init__(self, node_name: str = "pepper_kin") -> None:
        command = "source /opt/ros/$ROS_DISTRO/setup.bash"
        rclpy = optional("rclpy", command=command, need="the transport through rclpy")
        from rclpy.executors import MultiThreadedExecutor
        from rclpy.signals import SignalHandlerOptions

        super().__init__()
        domain_number()  # rclpy's own refusals do not name the variables
        discovery_range()
        self._context = rclpy.context.Context()
        rclpy.init(context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        self.node = rclpy.create_node(node_name, context=self._context, start_parameter_services=False)
        self._executor = MultiThreadedExecutor(_THREADS, context=self._context)
        self._executor.add_node(self.node)
        self._clients: dict[tuple[str, str], Any] = {}
        self._action_clients: dict[tuple[str, str], Client] = {}
        self._thread = threading.Thread(target=self._spin, name="rclpy", daemon=True)
        self._thread.start()

    def advertise(self, topic: str, type_name: str, qos: QoS = RELIABLE) -> Publisher:
        """Return a publisher; see `Transport.advertise`."""
        types = self._types(topic, type_name)
        return self.keep(topic, lambda: RclpyPublisher(self, topic, types, qos))

    def subscribe(self, topic: str, type_name: str, qos: QoS, callback: Callable[[Any], None]) -> Closable:
        """Call back with every message; see `Transport.subscribe`."""
        types = self._types(topic, type_name)

        def receive(data: bytes) -> None:
            try:
                callback(types.from_bytes(data))
            except Exception:
                logger.exception("%s: a message could not be handled", topic)

        def make() -> OpenPart:
            made = self.node.create_subscription(
                types.ros, topic, receive, _profile(qos), callback_group=self.group(), raw=True
            )
            return OpenPart(self, lambda: self.node.destroy_subscription(made))

        return self.keep(topic, make)

    def offer_service(self, name: str, type_name: str, callback: Callable[[Any], Any]) -> Closable:
        """Answer calls of a service; if the callback fails, the response is the default one."""
        self.check_open(name)
        kinds = service_type(type_name)
        request, response = (converter(kind.type_name) for kind in kinds)

        def answer(message: Any, empty: Any) -> Any:
            try:
                return response.to_ros(callback(request.from_ros(message)))
            except Exception:
                logger.exception("%s: the service failed", name)
                return empty

        found = ros_class(kinds.request.type_name.removesuffix("_Request"))

        def make() -> OpenPart:
            made = self.node.create_service(found, name, answer, callback_group=self.group())
            return OpenPart(self, lambda: self.node.destroy_service(made))

        return self.keep(name, make)

    def call_service(self, name: str, type_name: str, request: Any, timeout: float = SERVER_WAIT) -> Any:
        """Call a service; see `Transport.call_service`."""
        self.check_open(name)
        kinds = service_type(type_name)
        check_message(request, kinds.request)
        message = converter(kinds.request.type_name).to_ros(request)
        found = ros_class(kinds.request.type_name.removesuffix("_Request"))
        with self.lock:
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
        return self.keep(name, lambda: OpenPart(self, Server(self, name, type_name, server).close))

    def send_goal(
        self,
        name: str,
        type_name: str,
        goal: Any,
        feedback_callback: Callable[[Any], None] | None = None,
        timeout: float = SERVER_WAIT,
    ) -> GoalHandle:
        """Send a goal; see `Transport.send_goal`."""
        self.check_open(name)
        with self.lock:
            client = self._action_clients.get((name, type_name))
            if client is None:
                client = self._action_clients[name, type_name] = Client(self, name, type_name)
        return client.send(goal, feedback_callback, timeout)

    def _leave(self) -> None:
        for client in self._action_clients.values():
            client.close()
        self._executor.shutdown(timeout_sec=1.0)
        self._context.try_shutdown()
        self._thread.join(SERVER_WAIT)
        self.node.destroy_node()

    def group(self, *, reentrant: bool = False) -> Any:
        """Return a new callback group, which runs callbacks one after the other, or concurrently."""
        from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup

        return ReentrantCallbackGroup() if reentrant else MutuallyExclusiveCallbackGroup()

    def _types(self, name: str, type_name: str) -> Converter:
        self.check_open(name)
        return converter(message_type(type_name).type_name)

    def _spin(self) -> None:
        while not self.closed and self._context.ok():
            try:
                self._executor.spin()
            except Exception:
                if not self.closed:
                    logger.exception("rclpy: a callback failed")


class RclpyPublisher(OpenPart, Publisher):
    """Publisher of a topic by rclpy; see `Publisher`."""

    def __init__(self, transport: RclpyTransport, topic: str, types: Converter, qos: QoS) -> None:
        made = transport.node.create_publisher(
            types.ros, topic, _profile(qos), callback_group=transport.group()
        )
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
        """Number of matching subscriptions."""
        return 0 if self.closed else int(self._publisher.get_subscription_count())


def _profile(qos: QoS) -> Any:
    """Return rclpy's profile of a quality of service."""
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

    return QoSProfile(
        depth=qos.depth,
        reliability=ReliabilityPolicy.RELIABLE if qos.reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if qos.latched else DurabilityPolicy.VOLATILE,
    )
