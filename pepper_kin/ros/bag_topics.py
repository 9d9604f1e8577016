"""Recording of topics from a transport to a bag, and playback.

with BagRecorder(transport, "run.mcap", {"/joint_states": "sensor_msgs/msg/JointState"}):
    ...
play_bag("run.mcap", transport, topics=["/joint_states"])
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Collection, Mapping
from typing import Any

from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.file_access.atomic_file import PathName
from pepper_kin.ros.qos import LATCHED, QoS
from pepper_kin.ros.transport import Closable, Publisher, Transport
from pepper_kin.ros_messages.bags import Bag, BagWriter

logger = logging.getLogger(__name__)

LATCHED_TOPICS = ("/tf_static", "/robot_description")
"""Topics whose last message is sent to late subscriptions."""

_QUEUE = QoS(depth=1000)


class BagRecorder(Closable):
    """Recorder of topics' messages to an MCAP file, which is complete after `close`; a context manager.

    Args:
        transport: Transport of the topics.
        path: The file; its folder must exist.
        topics: Name of each topic -> message type.
        latched: Topics whose last message is kept for late subscriptions.
        clock: Returns the arrival time of a message [ns]; wall time if omitted.

    Attributes:
        count: Number of recorded messages.

    Raises:
        MissingDependencyError: if the package `mcap` is not installed.
        FileFormatError: if the file cannot be written.
        UnknownNameError: for an unknown type.
        TransportError: for a topic of another type.
    """

    def __init__(
        self,
        transport: Transport,
        path: PathName,
        topics: Mapping[str, str],
        *,
        latched: Collection[str] = LATCHED_TOPICS,
        clock: Callable[[], int] = time.time_ns,
    ) -> None:
        self._bag, self._clock, self.count = BagWriter(path), clock, 0
        self._lock, self._ended = threading.Lock(), False
        self._subscriptions: list[Closable] = []
        try:
            for topic, type_name in topics.items():
                qos = LATCHED if topic in latched else _QUEUE
                take = self._taker(topic)
                self._subscriptions.append(transport.subscribe(topic, type_name, qos, take))
        except BaseException:
            self._end()
            self._bag.discard()
            raise

    def close(self) -> None:
        """End the recording and complete the file; a second call does nothing.

        Raises:
            FileFormatError: if it cannot be written.
        """
        self._end()
        self._bag.close()

    def _end(self) -> None:
        with self._lock:
            self._ended = True
        for subscription in self._subscriptions:
            subscription.close()
        self._subscriptions.clear()

    def _taker(self, topic: str) -> Callable[[Any], None]:
        def take(message: Any) -> None:
            with self._lock:
                if not self._ended:
                    self._bag.write(topic, message, self._clock())
                    self.count += 1

        return take


def play_bag(
    path: PathName,
    transport: Transport,
    *,
    topics: Collection[str] | None = None,
    rate: float = 1.0,
    latched: Collection[str] = LATCHED_TOPICS,
) -> int:
    """Publish the messages of an MCAP file in the order and at the intervals of their times.

    Args:
        path: The file.
        transport: Transport to publish to, under the topics' names in the file.
        topics: Names of the topics to publish; all with known types if omitted.
        rate: Ratio of the speed to that of the recording.
        latched: Topics whose last message is sent to late subscriptions.

    Returns:
        The number of published messages.

    Raises:
        MissingDependencyError: if the package `mcap` is not installed.
        FileFormatError: if the file cannot be read, or is damaged.
        UnknownNameError: for a topic in `topics` that is not in the file or has an unknown type.
        InvalidValueError: for a rate that is not above 0.
    """
    if not 0.0 < rate < float("inf"):
        raise InvalidValueError("rate", rate, "a number above 0")
    bag = Bag(path)
    chosen = dict(bag.topics)
    for topic in topics or ():
        if topic not in chosen:
            raise UnknownNameError("topic", topic, chosen)
    publishers: dict[str, Publisher] = {}
    first, start, count = None, time.monotonic(), 0
    try:
        for topic, type_name in chosen.items():
            if topics is None or topic in topics:
                try:
                    qos = LATCHED if topic in latched else _QUEUE
                    publishers[topic] = transport.advertise(topic, type_name, qos)
                except UnknownNameError:
                    if topics is not None:
                        raise
                    logger.warning("%s: not played, its type %s is unknown here", topic, type_name)
        for topic, stamp, message in bag.messages(topics=publishers):
            first = stamp if first is None else first
            wait = start + 1e-9 * (stamp - first) / rate - time.monotonic()
            if wait > 0.0:
                time.sleep(wait)
            publishers[topic].publish(message)
            count += 1
    finally:
        for publisher in publishers.values():
            publisher.close()
    return count
