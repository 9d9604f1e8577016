"""Transport through Zenoh, compatible with rmw_zenoh: topics, services and actions of the ROS graph, no ROS.

Nodes communicate through a router.  If none listens on this machine, the first transport becomes one.

Source: rmw_zenoh, docs/design.md: key expressions of topics and services, liveliness tokens, attachments.
"""

from __future__ import annotations

import contextlib
import hashlib
import itertools
import json
import logging
import socket
import struct
import threading
import time
from collections.abc import Callable
from typing import Any

from pepper_kin.exceptions import InvalidValueError, optional
from pepper_kin.ros.errors import TransportError
from pepper_kin.ros.qos import RELIABLE, QoS
from pepper_kin.ros.transport import SERVER_WAIT, ActionServer, Closable, GoalHandle, Publisher
from pepper_kin.ros.transports.dds_domain import domain_number
from pepper_kin.ros.transports.graph import GraphTransport, OpenPart
from pepper_kin.ros.transports.zenoh_actions import OfferedAction, ZenohGoal
from pepper_kin.ros_messages import decode, encode, message_type, type_hash
from pepper_kin.ros_messages.messages import check_message

logger = logging.getLogger(__name__)

ROUTER = "tcp/localhost:7447"
"""Default endpoint of the router of rmw_zenoh's nodes."""

_OWN = ("localhost", "127.0.0.1", "[::1]", "0.0.0.0", "[::]")
_USUAL_DEPTH = 42  # default depth of rmw_zenoh, which tokens omit
_ATTACHED = struct.Struct("<qqB16s")  # number, time [ns], length of the identifier, identifier
_AGAIN = 0.1  # interval between searches for a server [s]


class ZenohTransport(GraphTransport):
    """Topics, services and actions of a node of rmw_zenoh's graph.

    Args:
        node_name: Name of the node in the ROS graph.
        domain_id: Domain, 0 to 232; if omitted, the variable ROS_DOMAIN_ID, else 0.
        router: Endpoint of a router, such as "tcp/192.168.1.5:7447".

    Raises:
        MissingDependencyError: if `eclipse-zenoh` is not installed.
        InvalidValueError: for a domain out of range, or a router that is not an endpoint.
        TransportError: if no router listens at an endpoint of another machine.
    """

    def __init__(
        self, node_name: str = "pepper_kin", *, domain_id: int | None = None, router: str = ROUTER
    ) -> None:
        need = "the transport through Zenoh"
        zenoh = optional("zenoh", package="eclipse-zenoh", extra="zenoh", need=need)
        super().__init__()
        self.node_name, self.domain_id = node_name, domain_number(domain_id)
        self._numbers = itertools.count(1)
        self._zenoh = zenoh
        try:
            self.session = zenoh.open(_configuration(zenoh, router))
        except zenoh.ZError as error:
            raise TransportError(router, f"a session with the router cannot be opened: {error}") from error
        self._id = str(self.session.zid())
        self._node_token = self.declare(f"{self._prefix(0)}/NN/%/%/{node_name}")

    def advertise(self, topic: str, type_name: str, qos: QoS = RELIABLE) -> Publisher:
        """Return a publisher; see `Transport.advertise`."""
        kind = message_type(type_name)
        return self.keep(topic, lambda: ZenohPublisher(self, topic, kind, qos))

    def subscribe(self, topic: str, type_name: str, qos: QoS, callback: Callable[[Any], None]) -> Closable:
        """Call back with every message; see `Transport.subscribe`."""
        kind = message_type(type_name)
        return self.keep(topic, lambda: ZenohSubscription(self, topic, kind, qos, callback))

    def second_type(self, topic: str, type_name: str) -> str:
        """Return the topic's own name: topics of different types are separate on the graph."""
        return topic

    def offer_service(self, name: str, type_name: str, callback: Callable[[Any], Any]) -> Closable:
        """Answer calls, each on a thread; see `Transport.offer_service`."""
        message_type(f"{type_name}_Request")
        return self.keep(name, lambda: ZenohService(self, name, type_name, callback))

    def call_service(self, name: str, type_name: str, request: Any, timeout: float = SERVER_WAIT) -> Any:
        """Call a service; see `Transport.call_service`."""
        end = time.monotonic() + timeout
        while True:
            answer = self.ask(name, type_name, request, end - time.monotonic())
            if answer is not None:
                return answer
            if time.monotonic() + _AGAIN > end:
                raise TransportError(name, f"no answer within {timeout:g} s")
            time.sleep(_AGAIN)

    def offer_action(self, name: str, type_name: str, server: ActionServer) -> Closable:
        """Offer an action; see `Transport.offer_action`."""
        return self.keep(name, lambda: OfferedAction(self, name, type_name, server))

    def send_goal(
        self,
        name: str,
        type_name: str,
        goal: Any,
        feedback_callback: Callable[[Any], None] | None = None,
        timeout: float = SERVER_WAIT,
    ) -> GoalHandle:
        """Send a goal; see `Transport.send_goal`."""
        return ZenohGoal(self, name, type_name, feedback_callback).send(goal, timeout)

    def _leave(self) -> None:
        self._node_token.undeclare()
        self.session.close()

    # Methods for the parts of the transport.

    def ask(self, name: str, type_name: str, request: Any, timeout: float) -> Any:
        """Call a service once; return its response, or None if there is no server or it has gone.

        Raises:
            TransportError: if the service fails, or the transport is closed.
        """
        zenoh, kind = self._zenoh, message_type(f"{type_name}_Response")
        check_message(request, message_type(f"{type_name}_Request"))
        self.check_open(name)
        token: Any = None
        try:
            token = self.token("SC", name, type_name, RELIABLE)
            replies = self.session.get(
                self.key(name, type_name),
                payload=encode(request),
                encoding=zenoh.Encoding.APPLICATION_CDR,
                attachment=_attached(next(self._numbers), bytes.fromhex(self._id.zfill(32))[:16]),
                target=zenoh.QueryTarget.ALL_COMPLETE,
                consolidation=zenoh.ConsolidationMode.NONE,
                timeout=max(timeout, 0.0),
            )
            for reply in replies:
                if reply.ok is not None:
                    return decode(kind, reply.ok.payload.to_bytes())
                payload = b"" if reply.err is None else reply.err.payload.to_bytes()
                reason = payload.decode("utf-8", errors="replace")
                if reason != "Timeout":
                    raise TransportError(name, f"the service failed: {reason}")
            return None
        except zenoh.ZError as error:
            raise TransportError(name, f"the session has ended: {error}") from error
        finally:
            with contextlib.suppress(zenoh.ZError):
                if token is not None:
                    token.undeclare()

    def key(self, name: str, type_name: str) -> str:
        """Return the key expression of a topic or a service."""
        return f"{self.domain_id}/{name.strip('/')}/{_typed(type_name)}"

    def token(self, kind: str, name: str, type_name: str, qos: QoS) -> Any:
        """Declare a part of the node to the graph, of kind MP, MS, SC or SS; return its token."""
        depth = "" if qos.depth == _USUAL_DEPTH else str(qos.depth)
        quality = f"{'' if qos.reliable else '2'}:{'1' if qos.latched else ''}:,{depth}:,:,:,,"
        named = f"{self.node_name}/{name.replace('/', '%')}/{_typed(type_name)}/{quality}"
        return self.declare(f"{self._prefix(next(self._numbers))}/{kind}/%/%/{named}")

    def declare(self, token: str) -> Any:
        """Declare and return a liveliness token of the graph."""
        return self.session.liveliness().declare_token(token)

    def subscribers(self, topic: str) -> int:
        """Return the number of subscriptions to a topic on the graph."""
        mangled = topic.replace("/", "%")
        pattern = f"@ros2_lv/{self.domain_id}/*/*/*/MS/*/*/*/{mangled}/**"
        return sum(
            reply.ok is not None for reply in self.session.liveliness().get(pattern, timeout=SERVER_WAIT)
        )

    def _prefix(self, entity: int) -> str:
        return f"@ros2_lv/{self.domain_id}/{self._id}/0/{entity}"


class _ZenohPart(OpenPart):
    """An open part of the node on the graph.

    Args:
        transport: Transport of the node.
        kind: Kind of the token: MP, MS or SS.
        name: Name of the topic or service.
        type_name: Type of the topic or service.
        qos: Quality of service.
    """

    def __init__(self, transport: ZenohTransport, kind: str, name: str, type_name: str, qos: QoS) -> None:
        super().__init__(transport, self._end)
        self.transport, self.name = transport, name
        self.key = transport.key(name, type_name)
        self._busy = threading.Lock()  # a part in use cannot be ended
        self._entity = self._declared(qos)
        self._token = transport.token(kind, name, type_name, qos)

    def _declared(self, qos: QoS) -> Any:
        """Return Zenoh's publisher, subscriber or queryable."""
        raise NotImplementedError

    def _end(self) -> None:
        with self._busy, contextlib.suppress(self.transport._zenoh.ZError):  # the session may have ended
            self._token.undeclare()
            self._entity.undeclare()


class ZenohPublisher(_ZenohPart, Publisher):
    """Publisher of a topic by Zenoh; see `Publisher`."""

    def __init__(self, transport: ZenohTransport, topic: str, kind: type[Any], qos: QoS) -> None:
        self._kind, self._count = kind, itertools.count(1)
        super().__init__(transport, "MP", topic, kind.type_name, qos)
        seed = f"{transport.session.zid()} {self.key} {id(self)}".encode()
        self._identifier = hashlib.blake2b(seed, digest_size=16).digest()

    def _declared(self, qos: QoS) -> Any:
        zenoh, session = self.transport._zenoh, self.transport.session
        if qos.latched:
            cache = zenoh.ext.CacheConfig(max_samples=qos.depth)
            return zenoh.ext.declare_advanced_publisher(
                session,
                self.key,
                encoding=zenoh.Encoding.APPLICATION_CDR,
                cache=cache,
                publisher_detection=True,
            )
        reliability = zenoh.Reliability.RELIABLE if qos.reliable else zenoh.Reliability.BEST_EFFORT
        return session.declare_publisher(
            self.key, encoding=zenoh.Encoding.APPLICATION_CDR, reliability=reliability
        )

    def publish(self, message: Any) -> None:
        """Send a message."""
        if not isinstance(message, self._kind):
            check_message(message, self._kind)
        data = encode(message)
        with self._busy:
            if self.closed:
                raise TransportError(self.name, "the publisher is closed; advertise the topic again")
            self._entity.put(data, attachment=_attached(next(self._count), self._identifier))

    @property
    def subscription_count(self) -> int:
        """1 if there is a subscription, else 0."""
        with self._busy:
            return 0 if self.closed else int(self._entity.matching_status.matching)


class ZenohSubscription(_ZenohPart):
    """Subscription that calls back on a thread of Zenoh."""

    def __init__(
        self,
        transport: ZenohTransport,
        topic: str,
        kind: type[Any],
        qos: QoS,
        callback: Callable[[Any], None],
    ) -> None:
        self._kind, self._callback = kind, callback
        super().__init__(transport, "MS", topic, kind.type_name, qos)

    def _declared(self, qos: QoS) -> Any:
        zenoh, session = self.transport._zenoh, self.transport.session
        if not qos.latched:
            return session.declare_subscriber(self.key, self._handle)
        history = zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=qos.depth)
        return zenoh.ext.declare_advanced_subscriber(session, self.key, self._handle, history=history)

    def _handle(self, sample: Any) -> None:
        try:
            if not self.closed:
                self._callback(decode(self._kind, sample.payload.to_bytes()))
        except Exception:
            logger.exception("%s: a message could not be handled", self.name)


class ZenohService(_ZenohPart):
    """Service that answers the queries of clients, each on a thread."""

    def __init__(
        self, transport: ZenohTransport, name: str, type_name: str, callback: Callable[[Any], Any]
    ) -> None:
        self._request = message_type(f"{type_name}_Request")
        self._response = message_type(f"{type_name}_Response")
        self._callback = callback
        super().__init__(transport, "SS", name, type_name, RELIABLE)

    def _declared(self, qos: QoS) -> Any:
        return self.transport.session.declare_queryable(self.key, self._begin, complete=True)

    def _begin(self, query: Any) -> None:
        thread = threading.Thread(target=self._answer, args=(query,), name=f"ros {self.name}", daemon=True)
        thread.start()

    def _answer(self, query: Any) -> None:
        zenoh = self.transport._zenoh
        try:
            if query.payload is None:
                raise InvalidValueError(f"request of {self.name}", "nothing", "a message")
            attached = b"" if query.attachment is None else query.attachment.to_bytes()
            number, identifier = 0, bytes(16)
            if len(attached) == _ATTACHED.size:
                number, _, _, identifier = _ATTACHED.unpack(attached)
            response = self._callback(decode(self._request, query.payload.to_bytes()))
            check_message(response, self._response)
            query.reply(
                self.key,
                encode(response),
                encoding=zenoh.Encoding.APPLICATION_CDR,
                attachment=_attached(number, identifier),
            )
        except Exception as error:
            if not self.closed:
                logger.exception("%s: a request could not be answered", self.name)
                query.reply_err(str(error).encode(), encoding=zenoh.Encoding.TEXT_PLAIN)
        finally:
            query.drop()


def _typed(type_name: str) -> str:
    """Return type and type hash in the form of key expressions."""
    package, group, own = type_name.split("/")
    return f"{package}::{group}::dds_::{own}_/{type_hash(type_name)}"


def _attached(number: int, identifier: bytes) -> bytes:
    return _ATTACHED.pack(number, time.time_ns(), len(identifier), identifier)


def _configuration(zenoh: Any, router: str) -> Any:
    """Return the configuration of a session with a router, or of a session that is a router itself.

    Raises:
        InvalidValueError: for a router that is not an endpoint.
        TransportError: if nothing listens at an endpoint of another machine.
    """
    protocol, _, place = router.partition("/")
    host, _, port = place.rpartition(":")
    if protocol != "tcp" or not host or not port.isdecimal():
        raise InvalidValueError("router", router, "an endpoint such as tcp/192.168.1.5:7447")
    settings: dict[str, Any] = {"scouting/multicast/enabled": False, "timestamping/enabled": True}
    try:
        socket.create_connection((host.strip("[]"), int(port)), SERVER_WAIT).close()
        settings |= {"mode": "peer", "connect/endpoints": [router], "listen/endpoints": ["tcp/localhost:0"]}
    except OSError as error:
        if host not in _OWN:
            raise TransportError(router, f"no router of Zenoh listens there: {error}") from error
        settings |= {"mode": "router", "listen/endpoints": [router]}
    configuration = zenoh.Config()
    for name, value in settings.items():
        configuration.insert_json5(name, json.dumps(value))
    return configuration
