"""Session of a rosbridge client: the operations of the protocol (version 2.1), one method each."""

from __future__ import annotations

import asyncio
import json
import logging
from collections import deque
from collections.abc import Callable
from concurrent.futures import Executor
from typing import Any

from pepper_kin.exceptions import PepperKinError, shortened
from pepper_kin.ros.errors import TransportError
from pepper_kin.ros.qos import LATCHED, RELIABLE
from pepper_kin.ros.transport import Closable, GoalResult, GoalStatus
from pepper_kin.ros.transports.local import LocalPublisher, LocalTransport, Topic
from pepper_kin.ros.transports.local_actions import LocalGoal
from pepper_kin.ros.transports.rosapi import answer_rosapi
from pepper_kin.ros.transports.rosbridge_json import (
    LARGEST_TEXT,
    Fragments,
    ProtocolError,
    parse,
    text_of,
)
from pepper_kin.ros.transports.rosbridge_outbox import Outbox, Outgoing
from pepper_kin.ros.transports.rosbridge_pending import PendingAnswer, RemoteAction
from pepper_kin.ros_messages import action_type, message_type, service_type
from pepper_kin.ros_messages.json_text import to_json

logger = logging.getLogger(__name__)

SERVICE_TIMEOUT = 10.0
"""Maximum time in which a client's service must answer [s]."""

MOST_ENTRIES = 1_000
"""Maximum number of open topics, subscriptions, services, actions and goals of a client, each."""

LEVELS = ("none", "error", "warning", "info")

_TYPES = {str: "a string", int: "a whole number", dict: "an object", bool: "true or false"}


def entry(message: dict[str, Any], name: str, kind: type, default: Any = ...) -> Any:
    """Return a field of a message of the protocol.

    Raises:
        ProtocolError: if it is missing without a default, or of another type.
    """
    value = message.get(name)
    if value is None:
        if default is ...:
            raise ProtocolError(f"{message['op']}: the field {name!r} is missing")
        return default
    if not isinstance(value, kind) or (kind is int and isinstance(value, bool)):
        raise ProtocolError(f"{message['op']}: {name!r} is {shortened(repr(value))}, expected {_TYPES[kind]}")
    return value


class RosbridgeSession:
    """Session of one client, with its open parts.

    Args:
        transport: Transport whose topics, services and actions the client uses.
        outbox: Messages to the client.
        loop: The event loop that calls the session.
        executor: Threads for services.
    """

    def __init__(
        self, transport: LocalTransport, outbox: Outbox, loop: asyncio.AbstractEventLoop, executor: Executor
    ) -> None:
        self.transport, self.outbox = transport, outbox
        self._loop, self._executor = loop, executor
        self._fragments = Fragments()
        self._publishers: dict[str, LocalPublisher] = {}
        self._heard: dict[tuple[str, str | None], tuple[Outgoing, Closable]] = {}
        self._services: dict[str, Closable] = {}
        self._actions: dict[str, tuple[Closable, RemoteAction]] = {}
        self._goals: dict[str, LocalGoal] = {}
        self._calls: dict[str, PendingAnswer] = {}
        self._queued: deque[tuple[Outgoing, str]] = deque()
        self._woken = False
        self._level = LEVELS.index("error")
        self._count = 0
        self.faults = 0
        self.ended = False

    def take(self, text: str | bytes) -> None:
        """Execute the operation of a text; errors are answered with a `status`."""
        identifier = None
        try:
            message = parse(text)
            identifier = message.get("id") if isinstance(message.get("id"), str) else None
            operation = _OPERATIONS.get(message["op"])
            if operation is None:
                known = ", ".join(_OPERATIONS)
                raise ProtocolError(f"unknown op {shortened(message['op'])!r}; known: {known}")
            operation(self, message)
        except PepperKinError as error:
            self.faults += 1
            self.report("error", str(error), identifier)
        except Exception as error:  # a fault of the server, reported to the client
            self.faults += 1
            logger.exception("rosbridge: a message could not be handled")
            self.report("error", f"the server failed: {error}", identifier)

    def report(self, level: str, text: str, identifier: str | None = None) -> None:
        """Send a `status`, if the client's level includes it."""
        if LEVELS.index(level) <= self._level:
            status = {"op": "status", "level": level, "msg": _cut(text)}
            self.outbox.answer(status if identifier is None else {**status, "id": identifier})

    def send(self, message: dict[str, Any] | str) -> None:
        """Send an answer; from any thread.

        Raises:
            ValueError: for values that JSON cannot represent; raised here, so that the caller can answer.
        """
        text = message if isinstance(message, str) else text_of(message)
        if not self.ended:
            self._loop.call_soon_threadsafe(self.outbox.answer, text)

    def close(self) -> None:
        """End the session: goals are canceled, and topics, services and actions withdrawn."""
        self.ended = True
        for goal in tuple(self._goals.values()):
            logger.warning("rosbridge: connection lost, goal of %s canceled", goal.action.name)
            self._executor.submit(goal.request_cancel)
        for call in tuple(self._calls.values()):
            call.fail("the connection was lost")
        for _, remote in self._actions.values():
            remote.lose()
        closables = [*self._publishers.values(), *self._services.values()]
        closables += [closable for _, closable in self._heard.values()]
        closables += [closable for closable, _ in self._actions.values()]
        for closable in closables:
            closable.close()

    # Topics.

    def _limit(self, table: Any, what: str) -> None:
        if len(table) >= MOST_ENTRIES:
            raise ProtocolError(f"more than {MOST_ENTRIES} {what}")

    def _advertise(self, message: dict[str, Any]) -> None:
        name, kind = entry(message, "topic", str), entry(message, "type", str)
        qos = LATCHED if entry(message, "latch", bool, False) else RELIABLE
        self._limit(self._publishers, "topics")
        known = self._publishers.get(name)
        if known is not None and known.topic.kind is message_type(kind):
            return
        publisher = LocalPublisher(self.transport, self.transport.topic(name, kind), qos)
        if known is not None:
            known.close()
        self._publishers[name] = publisher

    def _unadvertise(self, message: dict[str, Any]) -> None:
        publisher = self._publishers.pop(entry(message, "topic", str), None)
        if publisher is None:
            raise ProtocolError(f"unadvertise: {message['topic']!r} was not advertised")
        publisher.close()

    def _publish(self, message: dict[str, Any]) -> None:
        name, values = entry(message, "topic", str), entry(message, "msg", dict, {})
        publisher = self._publishers.get(name)
        if publisher is None:
            self._limit(self._publishers, "topics")
            topic = self.transport.topic(name, entry(message, "type", str, None))
            made = topic.kind.from_dict(values)  # an invalid message advertises nothing
            publisher = self._publishers[name] = LocalPublisher(self.transport, topic, RELIABLE)
        else:
            made = publisher.topic.kind.from_dict(values)
        publisher.publish(made)

    def _subscribe(self, message: dict[str, Any]) -> None:
        name, identifier = entry(message, "topic", str), entry(message, "id", str, None)
        options = {key: entry(message, key, int, 0) for key in ("throttle_rate", "queue_length")}
        size = entry(message, "fragment_size", int, None)
        compression = entry(message, "compression", str, "none")
        if not 0 <= options["throttle_rate"] <= 3_600_000 or not 0 <= options["queue_length"] <= 10_000:
            raise ProtocolError("subscribe: throttle_rate is 0 to 3600000 ms, queue_length 0 to 10000")
        if size is not None and not 100 <= size <= LARGEST_TEXT:
            raise ProtocolError(f"subscribe: fragment_size is 100 to {LARGEST_TEXT} characters")
        if compression not in ("none", "png"):
            self.report("warning", f"compression {shortened(compression)!r} is not offered; sent as JSON")
        self._limit(self._heard, "subscriptions")
        topic = self.transport.topic(name, entry(message, "type", str, None))
        old = self._heard.pop((name, identifier), None)
        if old is not None:
            self._forget(old)
        outgoing = Outgoing(name, identifier, {**options, "fragment_size": size, "compression": compression})
        self.outbox.subscriptions.append(outgoing)
        taken = self.transport.listen(name, topic.type_name, self._sender(topic, outgoing))
        self._heard[name, identifier] = (outgoing, taken)

    def _sender(self, topic: Topic, outgoing: Outgoing) -> Callable[[Any], None]:
        """Return a callback that queues messages of a topic, on any thread.

        The event loop is woken once for all messages that arrive before it runs: each wake-up costs a system
        call, during which other threads may delay the control cycle of the robot.
        """

        def take(message: Any) -> None:
            if self.ended:
                return
            self._queued.append((outgoing, encoded(self.transport, topic, message)))
            if not self._woken:
                self._woken = True
                self._loop.call_soon_threadsafe(self._hand_over)

        return take

    def _hand_over(self) -> None:
        """Pass queued messages to their subscriptions; on the event loop."""
        self._woken = False  # first, so that a later message wakes the loop again
        while self._queued:
            outgoing, text = self._queued.popleft()
            outgoing.add(text)
        self.outbox.wake()

    def _unsubscribe(self, message: dict[str, Any]) -> None:
        name, identifier = entry(message, "topic", str), entry(message, "id", str, None)
        keys = [key for key in self._heard if key[0] == name and identifier in (None, key[1])]
        if not keys:
            raise ProtocolError(f"unsubscribe: {shortened(name)!r} is not subscribed")
        for key in keys:
            self._forget(self._heard.pop(key))

    def _forget(self, heard: tuple[Outgoing, Closable]) -> None:
        outgoing, taken = heard
        taken.close()
        self.outbox.subscriptions.remove(outgoing)

    # Services.

    def _call_service(self, message: dict[str, Any]) -> None:
        name, identifier = entry(message, "service", str), entry(message, "id", str, None)
        values = message.get("args") or {}
        answer = {"op": "service_response", "service": name}
        if identifier is not None:
            answer["id"] = identifier

        def call() -> None:
            try:
                found = answer_rosapi(self.transport, name, values)
                if found is None:
                    service = self.transport.service(name)
                    fields = values
                    if isinstance(values, list):  # in the order of the fields
                        names = [f.name for f in service.request.definition.fields]
                        fields = dict(zip(names, values, strict=False))
                    response = to_json(service.call(service.request.from_dict(fields)))
                else:
                    response = text_of(found)
                self.send(f'{text_of({**answer, "result": True})[:-1]},"values":{response}}}')
            except Exception as error:
                if not isinstance(error, PepperKinError):
                    logger.exception("rosbridge: %s failed", name)
                self.send({**answer, "values": _cut(error), "result": False})

        self._executor.submit(call)

    def _advertise_service(self, message: dict[str, Any]) -> None:
        name, kind = entry(message, "service", str), entry(message, "type", str)
        self._limit(self._services, "services")
        response = service_type(kind).response

        def answer(request: Any) -> Any:
            call = self._begin("service", name)
            self.send(
                {"op": "call_service", "service": name, "id": call.identifier, "args": request.to_dict()}
            )
            try:
                return response.from_dict(call.wait(name, SERVICE_TIMEOUT))
            finally:
                self._calls.pop(call.identifier, None)

        self._services[name] = self.transport.offer_service(name, kind, answer)

    def _begin(self, kind: str, name: str) -> PendingAnswer:
        self._count += 1
        call = PendingAnswer(f"{kind}:{name}:{self._count}")
        self._calls[call.identifier] = call
        if self.ended:
            call.fail("the connection was lost")
        return call

    def _unadvertise_service(self, message: dict[str, Any]) -> None:
        service = self._services.pop(entry(message, "service", str), None)
        if service is None:
            raise ProtocolError(f"unadvertise_service: {shortened(message['service'])!r} was not advertised")
        service.close()

    def _service_response(self, message: dict[str, Any]) -> None:
        call = self._calls.get(entry(message, "id", str))
        if call is None:
            raise ProtocolError("service_response: nobody waits for this id")
        if entry(message, "result", bool, True):
            call.succeed(message.get("values") or {})
        else:
            call.fail(_cut(message.get("values")))

    # Actions.

    def _send_action_goal(self, message: dict[str, Any]) -> None:
        name, identifier = entry(message, "action", str), entry(message, "id", str, "")
        wants_feedback = entry(message, "feedback", bool, False)
        self._limit(self._goals, "goals")
        common: dict[str, Any] = {"action": name, "id": identifier}
        try:
            action = self.transport.action(name)
            kind = entry(message, "action_type", str, None)
            if kind is not None and action_type(kind).goal is not action.goal_type:
                raise TransportError(name, f"its type is {action.type_name}, not {shortened(kind)}")
            goal = action.goal_type.from_dict(entry(message, "args", dict, {}))
            if identifier in self._goals:
                raise TransportError(name, f"a goal with the id {shortened(identifier)!r} is under way")
        except PepperKinError as error:
            self.outbox.answer(_refused(common, str(error)))
            raise

        def feedback(values: Any) -> None:
            head = text_of({"op": "action_feedback", **common})[:-1]
            self.send(f'{head},"values":{to_json(values)}}}')

        def end(result: GoalResult) -> None:
            self._goals.pop(identifier, None)
            reached = result.status is GoalStatus.SUCCEEDED
            head = {"op": "action_result", **common, "status": int(result.status), "result": reached}
            self.send(f'{text_of(head)[:-1]},"values":{to_json(result.result)}}}')

        made = LocalGoal(action, goal, feedback if wants_feedback else None, end)
        self._goals[identifier] = made
        if action.server.on_goal(goal):
            made.begin()
        else:
            self._goals.pop(identifier, None)
            self.outbox.answer(_refused(common, "the goal was not accepted"))

    def _cancel_action_goal(self, message: dict[str, Any]) -> None:
        entry(message, "action", str)
        goal = self._goals.get(entry(message, "id", str, ""))
        if goal is None:
            raise ProtocolError("cancel_action_goal: no goal with this id is under way")
        self._executor.submit(goal.request_cancel)

    def _advertise_action(self, message: dict[str, Any]) -> None:
        name, kind = entry(message, "action", str), entry(message, "type", str)
        self._limit(self._actions, "actions")
        remote = RemoteAction(self, name, kind)
        self._actions[name] = self.transport.offer_action(name, kind, remote), remote

    def _unadvertise_action(self, message: dict[str, Any]) -> None:
        found = self._actions.pop(entry(message, "action", str), None)
        if found is None:
            raise ProtocolError(f"unadvertise_action: {shortened(message['action'])!r} was not advertised")
        found[1].lose()
        found[0].close()

    def _action_feedback(self, message: dict[str, Any]) -> None:
        self._remote(message).feedback(entry(message, "id", str), entry(message, "values", dict, {}))

    def _action_result(self, message: dict[str, Any]) -> None:
        status = entry(message, "status", int, int(GoalStatus.ABORTED))
        values = message.get("values")
        self._remote(message).end(
            entry(message, "id", str), status, values if isinstance(values, dict) else {}
        )

    def _remote(self, message: dict[str, Any]) -> RemoteAction:
        name = entry(message, "action", str)
        if name not in self._actions:
            raise ProtocolError(f"{message['op']}: {shortened(name)!r} was not advertised")
        return self._actions[name][1]

    # Other operations.

    def _fragment(self, message: dict[str, Any]) -> None:
        whole = self._fragments.add(message)
        if whole is None:
            return
        if parse(whole)["op"] == "fragment":
            raise ProtocolError("a fragment within fragments")
        self.take(whole)

    def _set_level(self, message: dict[str, Any]) -> None:
        level = entry(message, "level", str)
        if level not in LEVELS:
            raise ProtocolError(f"set_level: {shortened(level)!r}, expected one of {', '.join(LEVELS)}")
        self._level = LEVELS.index(level)

    def _status(self, message: dict[str, Any]) -> None:
        logger.info("rosbridge: a client reports: %s", shortened(str(message.get("msg"))))


def encoded(transport: LocalTransport, topic: Topic, message: Any) -> str:
    """Return the `publish` text of a message, encoded once for all clients, its content for all topics."""
    known, text = topic.encoded
    if known is not message:
        written, content = transport.written
        if written is not message:
            content = to_json(message)
            transport.written = message, content
        text = f'{{"op":"publish","topic":{json.dumps(topic.name)},"msg":{content}}}'
        topic.encoded = message, text
    return text


def _refused(common: dict[str, Any], reason: str) -> dict[str, Any]:
    """Return the result of a goal that did not begin."""
    status = {"values": _cut(reason), "status": int(GoalStatus.ABORTED), "result": False}
    return {"op": "action_result", **common, **status}


def _cut(text: object) -> str:
    """Return the first 500 characters of a text."""
    return str(text)[:500]


_OPERATIONS: dict[str, Callable[[RosbridgeSession, dict[str, Any]], None]] = {
    name.lstrip("_"): getattr(RosbridgeSession, name)
    for name in (
        "_advertise", "_unadvertise", "_publish", "_subscribe", "_unsubscribe", "_call_service",
        "_advertise_service", "_unadvertise_service", "_service_response", "_send_action_goal",
        "_cancel_action_goal", "_advertise_action", "_unadvertise_action", "_action_feedback",
        "_action_result", "_fragment", "_set_level", "_status",
    )
}  # fmt: skip
"""Name of an operation -> method that executes it."""
