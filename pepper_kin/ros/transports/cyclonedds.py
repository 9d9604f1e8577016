"""Transport through Cyclone DDS: topics of the ROS graph, without an installed ROS.

Services and actions need an installed ROS (rclpy) or rosbridge: each vendor's DDS sends their requests in
another way.  Joint trajectories can still move a robot, by the topic `joint_trajectory` of its controllers.

Source: ROS 2 design, "Topic and Service name mapping to DDS"; rmw_dds_common for `ros_discovery_info`.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from typing import Any

from pepper_kin.exceptions import optional
from pepper_kin.ros.errors import NotCarriedError, TransportError
from pepper_kin.ros.qos import LATCHED, RELIABLE, QoS
from pepper_kin.ros.transport import SERVER_WAIT, ActionServer, Closable, GoalHandle, Publisher
from pepper_kin.ros.transports.cyclonedds_types import announced_type, topic_name
from pepper_kin.ros.transports.dds_domain import LOCALHOST, discovery_range, domain_number
from pepper_kin.ros.transports.graph import GraphTransport, OpenPart
from pepper_kin.ros_messages import decode, encode, message_type, type_hash
from pepper_kin.ros_messages.messages import check_message

logger = logging.getLogger(__name__)

DISCOVERY = "ros_discovery_info"
_GRAPH_TYPE = "rmw_dds_common/msg/ParticipantEntitiesInfo"
_MOST_TAKEN = 64  # maximum number of messages taken at a time
_BLOCKED = 1.0  # maximum time that a reliable publisher waits for a slow receiver [s]

_CONFIGURATION = """<CycloneDDS><Domain>
<General>{general}<AllowMulticast>true</AllowMulticast><MaxMessageSize>65500B</MaxMessageSize></General>
<Internal><SocketReceiveBufferSize min="default" max="4MB"/></Internal>
<Compatibility><IgnoreTypeInformation>1.15</IgnoreTypeInformation></Compatibility>
<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>120</MaxAutoParticipantIndex>
{peers}</Discovery>
</Domain></CycloneDDS>"""
"""Fast DDS 3 (vendor 1.15) describes sequences in types in a way that Cyclone takes for another type."""

_LOCAL = ('<Interfaces><NetworkInterface address="127.0.0.1" multicast="true"/></Interfaces>',
          '<Peers><Peer Address="127.0.0.1"/></Peers>')  # fmt: skip

_domains: dict[int, tuple[Any, int]] = {}
_domains_lock = threading.Lock()


class CycloneTransport(GraphTransport):
    """Topics of a node of Cyclone DDS; services and actions are refused.

    Args:
        node_name: Name of the node in the ROS graph.
        domain_id: DDS domain, 0 to 232; if omitted, the variable ROS_DOMAIN_ID, else 0.
        local: Whether to stay on this machine; if omitted, if ROS_AUTOMATIC_DISCOVERY_RANGE is LOCALHOST.

    Raises:
        MissingDependencyError: if `cyclonedds` is not installed.
        InvalidValueError: for a domain out of range.
        TransportError: if the domain cannot be opened.
    """

    def __init__(
        self, node_name: str = "pepper_kin", *, domain_id: int | None = None, local: bool | None = None
    ) -> None:
        need = "the transport through Cyclone DDS"
        domain = optional("cyclonedds.domain", extra="cyclonedds", need=need)
        from cyclonedds.qos import Policy, Qos

        super().__init__()
        self.node_name, self._domain_id = node_name, domain_number(domain_id)
        if local is None:
            local = discovery_range() == LOCALHOST
        _open_domain(self._domain_id, local)
        self._topics: dict[str, Any] = {}
        enclave = Qos(Policy.Userdata(b"enclave=/;"))
        self.participant = domain.DomainParticipant(self._domain_id, enclave)
        graph = self._topic(DISCOVERY, _GRAPH_TYPE)
        self._graph = _writer(self.participant, graph, LATCHED, _GRAPH_TYPE)
        self._listed()

    def advertise(self, topic: str, type_name: str, qos: QoS = RELIABLE) -> Publisher:
        """Return a publisher; see `Transport.advertise`."""
        kind = message_type(type_name)

        def make() -> CyclonePublisher:
            made = self._topic(topic_name(topic), kind.type_name)
            return CyclonePublisher(self, topic, kind, _writer(self.participant, made, qos, kind.type_name))

        return self.keep(topic, make)

    def subscribe(self, topic: str, type_name: str, qos: QoS, callback: Callable[[Any], None]) -> Closable:
        """Call back with every message; see `Transport.subscribe`."""
        from cyclonedds.sub import DataReader

        kind = message_type(type_name)

        def make() -> CycloneSubscription:
            made = self._topic(topic_name(topic), kind.type_name)
            reader = DataReader(self.participant, made, _quality(qos, kind.type_name))
            return CycloneSubscription(self, topic, kind, reader, callback)

        return self.keep(topic, make)

    def offer_service(self, name: str, type_name: str, callback: Callable[[Any], Any]) -> Closable:
        """Refuse: this transport carries topics only, see the module."""
        raise _not_carried(name)

    def call_service(self, name: str, type_name: str, request: Any, timeout: float = SERVER_WAIT) -> Any:
        """Refuse: this transport carries topics only, see the module."""
        raise _not_carried(name)

    def offer_action(self, name: str, type_name: str, server: ActionServer) -> Closable:
        """Refuse: this transport carries topics only, see the module."""
        raise _not_carried(name)

    def send_goal(
        self,
        name: str,
        type_name: str,
        goal: Any,
        feedback_callback: Callable[[Any], None] | None = None,
        timeout: float = SERVER_WAIT,
    ) -> GoalHandle:
        """Refuse: this transport carries topics only, see the module."""
        raise _not_carried(name)

    def _leave(self) -> None:
        del self._graph, self._topics, self.participant
        _close_domain(self._domain_id)

    def _topic(self, name: str, type_name: str) -> Any:
        from cyclonedds.topic import Topic

        if name not in self._topics:
            self._topics[name] = type_name, Topic(self.participant, name, announced_type(type_name))
        known, topic = self._topics[name]
        if known != type_name:
            raise TransportError(name, f"its type is {known}, not {type_name}")
        return topic

    def _listed(self) -> None:
        """Publish the node's readers and writers, for tools that list nodes."""
        gid, node, graph = (message_type(f"rmw_dds_common/msg/{name}") for name in _GRAPH_NAMES)
        ends: dict[bool, list[Any]] = {True: [], False: []}
        for part in self._parts:
            assert isinstance(part, _CyclonePart)
            ends[isinstance(part, CyclonePublisher)].append(gid(data=part.entity.get_guid().bytes))
        listed = node(
            node_namespace="/",
            node_name=self.node_name,
            reader_gid_seq=ends[False],
            writer_gid_seq=ends[True],
        )
        own = gid(data=self.participant.get_guid().bytes)
        _write(self._graph, encode(graph(gid=own, node_entities_info_seq=[listed])), DISCOVERY)


_GRAPH_NAMES = ("Gid", "NodeEntitiesInfo", "ParticipantEntitiesInfo")


class _CyclonePart(OpenPart):
    """An open reader or writer."""

    def __init__(self, transport: CycloneTransport, entity: Any) -> None:
        super().__init__(transport, self._end)
        self.entity = entity

    def _end(self) -> None:
        self.entity = None  # dropping the reference deletes the entity


class CyclonePublisher(_CyclonePart, Publisher):
    """Publisher of a topic by a Cyclone writer; see `Publisher`."""

    def __init__(self, transport: CycloneTransport, topic: str, kind: type[Any], writer: Any) -> None:
        super().__init__(transport, writer)
        self._topic, self._kind = topic, kind

    def publish(self, message: Any) -> None:
        """Send a message."""
        entity = self.entity
        if self.closed or entity is None:
            raise TransportError(self._topic, "the publisher is closed; advertise the topic again")
        if not isinstance(message, self._kind):
            check_message(message, self._kind)
        _write(entity, encode(message), self._topic)

    @property
    def subscription_count(self) -> int:
        """Number of matching subscriptions."""
        entity = self.entity
        return 0 if entity is None else len(entity.get_matched_subscriptions())


class CycloneSubscription(_CyclonePart):
    """Subscription by a Cyclone reader; it calls back on a thread of its own."""

    def __init__(
        self,
        transport: CycloneTransport,
        topic: str,
        kind: type[Any],
        reader: Any,
        callback: Callable[[Any], None],
    ) -> None:
        from cyclonedds.core import (
            GuardCondition,
            InstanceState,
            ReadCondition,
            SampleState,
            ViewState,
            WaitSet,
        )

        super().__init__(transport, reader)
        self._topic, self._kind, self._callback = topic, kind, callback
        self._mask = SampleState.Any | ViewState.Any | InstanceState.Any
        self._guard = GuardCondition(transport.participant)
        self._condition = ReadCondition(reader, self._mask)
        self._waiting = WaitSet(transport.participant)
        self._waiting.attach(self._guard)
        self._waiting.attach(self._condition)
        self._thread = threading.Thread(target=self._run, name=f"cyclonedds {topic}", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        from cyclonedds._clayer import ddspy_take
        from cyclonedds.util import duration

        longest = duration(seconds=3600)
        while not self.closed:
            self._waiting.wait(longest)
            taken = () if self.closed else ddspy_take(self.entity._ref, self._mask, _MOST_TAKEN)
            if isinstance(taken, int):
                logger.error("%s: reading failed, code %d", self._topic, taken)
                return
            for data, info in taken:
                if info.valid_data and not self.closed:
                    self._handle(data)

    def _handle(self, data: bytes) -> None:
        try:
            self._callback(decode(self._kind, data))
        except Exception:
            logger.exception("%s: a message could not be handled", self._topic)

    def _end(self) -> None:
        self._guard.set(True)
        if threading.current_thread() is not self._thread:
            self._thread.join(SERVER_WAIT)
        del self._waiting, self._condition, self._guard
        super()._end()


def _writer(participant: Any, topic: Any, qos: QoS, type_name: str) -> Any:
    from cyclonedds.pub import DataWriter

    return DataWriter(participant, topic, _quality(qos, type_name))


def _write(writer: Any, data: bytes, name: str) -> None:
    """Write encoded bytes, padded to whole words, by a writer; raise TransportError if that fails."""
    from cyclonedds._clayer import ddspy_write

    code = ddspy_write(writer._ref, data + bytes(-len(data) % 4))
    if code < 0:
        raise TransportError(name, f"Cyclone DDS could not write, code {code}")


def _quality(qos: QoS, type_name: str) -> Any:
    """Return Cyclone's quality of service, with the hash of the type as user data."""
    from cyclonedds.qos import Policy, Qos
    from cyclonedds.util import duration

    blocked = duration(seconds=_BLOCKED)
    return Qos(
        Policy.Reliability.Reliable(blocked) if qos.reliable else Policy.Reliability.BestEffort,
        Policy.Durability.TransientLocal if qos.latched else Policy.Durability.Volatile,
        Policy.History.KeepLast(qos.depth),
        Policy.DataRepresentation(use_cdrv0_representation=True),
        Policy.Userdata(f"typehash={type_hash(type_name)};".encode()),
    )


def _open_domain(number: int, local: bool) -> None:
    """Configure a domain for its first transport in this process."""
    from cyclonedds.core import DDSException
    from cyclonedds.domain import Domain

    with _domains_lock:
        domain, count = _domains.get(number, (None, 0))
        if domain is None:
            general, peers = _LOCAL if local else ("", "")
            try:
                domain = Domain(number, _CONFIGURATION.format(general=general, peers=peers))
            except DDSException as error:
                reason = f"it cannot be opened, perhaps another part of this program uses it: {error}"
                raise TransportError(f"DDS domain {number}", reason) from error
        _domains[number] = domain, count + 1


def _close_domain(number: int) -> None:
    with _domains_lock:
        domain, count = _domains.pop(number)
        if count > 1:
            _domains[number] = domain, count - 1


def _not_carried(name: str) -> NotCarriedError:
    reason = "the transport through Cyclone DDS carries topics only; use rclpy or rosbridge for this"
    return NotCarriedError(name, reason)
