"""Rosbridge client: topics, services and actions of a robot or a simulator that serves rosbridge."""

from __future__ import annotations

import asyncio
import itertools
import logging
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from pepper_kin.exceptions import PepperKinError, shortened
from pepper_kin.kernels.threads import OWN_THREADS
from pepper_kin.ros.errors import TransportError
from pepper_kin.ros.qos import RELIABLE, QoS
from pepper_kin.ros.transport import (
    SERVER_WAIT,
    ActionServer,
    Closable,
    GoalHandle,
    GoalResult,
    GoalStatus,
    Publisher,
)
from pepper_kin.ros.transports.graph import GraphTransport, OpenPart
from pepper_kin.ros.transports.local import LocalTransport
from pepper_kin.ros.transports.local_actions import Action, LocalGoal
from pepper_kin.ros.transports.rosbridge_json import LARGEST_TEXT, Fragments, parse, text_of
from pepper_kin.ros.transports.rosbridge_pending import PendingAnswer, RosbridgeGoal
from pepper_kin.ros_messages import action_type, message_type, service_type

logger = logging.getLogger(__name__)

PING_SECONDS, PONG_SECONDS = 2.0, 2.0
"""Interval of pings to the server, and time without a pong after which the connection is lost [s]."""


class RosbridgeClient(GraphTransport):
    """A connection to a rosbridge server, ours or rosbridge_suite's.

    Args:
        url: Address of the server, such as "ws://127.0.0.1:9090".
        timeout: Maximum time to connect [s].

    Raises:
        TransportError: if no server answers, or the server refuses.
    """

    def __init__(self, url: str, timeout: float = SERVER_WAIT) -> None:
        super().__init__()
        self.url = url
        self._numbers = itertools.count(1)
        self._heard: dict[str, list[_Heard]] = {}
        self._answers: dict[str, PendingAnswer] = {}
        self._goals: dict[str, RosbridgeGoal] = {}
        self._offered: dict[str, Callable[[dict[str, Any]], None]] = {}
        self._on_lost: list[Callable[[], object]] = []
        self._fragments = Fragments()
        self._executor = ThreadPoolExecutor(8, thread_name_prefix=f"{OWN_THREADS}-rosbridge-client")
        self._socket: Any = None
        self._loop = asyncio.new_event_loop()
        self._connected, self._error = threading.Event(), ""
        self._thread = threading.Thread(target=self._run, name="rosbridge-client", daemon=True)
        self._thread.start()
        if not self._connected.wait(timeout) or self._error:
            self.closed = True
            raise TransportError(url, self._error or f"no answer within {timeout:g} s; is a server there?")

    @property
    def connected(self) -> bool:
        """Whether the client is connected."""
        return self._socket is not None and not self.closed

    def on_lost(self, callback: Callable[[], object]) -> None:
        """Call back when the connection is lost."""
        self._on_lost.append(callback)

    def _leave(self) -> None:
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._loop.call_soon_threadsafe(self._end)
            self._thread.join(5.0)
        self._executor.shutdown(wait=False, cancel_futures=True)

    def _end(self) -> None:
        if self._socket is not None:
            self._socket.close()

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._converse())
        except Exception as error:
            self._error = f"cannot connect: {error}"
        finally:
            self._connected.set()
            self._lost()
            self._loop.close()

    async def _converse(self) -> None:
        from tornado.websocket import websocket_connect

        self._socket = await websocket_connect(
            self.url,
            ping_interval=PING_SECONDS,
            ping_timeout=PONG_SECONDS,
            max_message_size=LARGEST_TEXT,
        )
        self._connected.set()
        while (text := await self._socket.read_message()) is not None:
            self._take(text)

    def _lost(self) -> None:
        """End all pending answers and goals, and call the callbacks for a lost connection."""
        was_open, self._socket = self._socket is not None and not self.closed, None
        with self.lock:
            answers, goals = list(self._answers.values()), list(self._goals.values())
        for answer in answers:
            answer.fail("the connection was lost")
        for goal in goals:
            goal.end(GoalStatus.UNKNOWN, goal.kind.result())
        if was_open:
            logger.warning("%s: the connection was lost", self.url)
            for callback in self._on_lost:
                callback()

    def check_open(self, name: str) -> None:
        """Refuse the use of a lost or closed connection; see `GraphTransport.check_open`."""
        if not self.connected:
            raise TransportError(self.url, "the connection is closed; connect again")

    def send(self, message: dict[str, Any]) -> None:
        """Send a message of the protocol; from any thread.

        Raises:
            TransportError: if the connection is lost or closed.
        """
        text = text_of(message)
        self.check_open(self.url)
        try:
            self._loop.call_soon_threadsafe(self._write, text)
        except RuntimeError as error:
            raise TransportError(self.url, "the connection is closed; connect again") from error

    def _write(self, text: str) -> None:
        from tornado.websocket import WebSocketClosedError

        if self._socket is not None:
            try:
                self._socket.write_message(text).add_done_callback(lambda future: future.exception())
            except WebSocketClosedError:
                logger.info("%s: a message was not sent: the connection is lost", self.url)

    def _take(self, text: str | bytes) -> None:
        try:
            message = parse(text)
            if message["op"] == "fragment":
                whole = self._fragments.add(message)
                if whole is not None:
                    self._take(whole)
                return
            handler = getattr(self, f"_on_{message['op']}", None)
            if handler is None:
                logger.warning("%s: unknown op %s", self.url, shortened(message["op"]))
            else:
                handler(message)
        except Exception:
            logger.exception("%s: a message could not be handled", self.url)

    # Handlers of received messages.

    def _on_publish(self, message: dict[str, Any]) -> None:
        with self.lock:
            heard = list(self._heard.get(message["topic"], ()))
        made: dict[Any, Any] = {}
        for one in heard:
            if one.kind not in made:
                made[one.kind] = one.kind.from_dict(message.get("msg") or {})
            one.publisher.publish(made[one.kind])

    def _on_status(self, message: dict[str, Any]) -> None:
        text = str(message.get("msg"))
        logger.warning("%s: %s: %s", self.url, message.get("level"), text)
        answer = self._answers.get(str(message.get("id")))
        if answer is not None and message.get("level") == "error":
            answer.fail(text)

    def _on_service_response(self, message: dict[str, Any]) -> None:
        answer = self._answers.get(str(message.get("id")))
        if answer is None:
            return
        if message.get("result", True):
            answer.succeed(message.get("values") or {})
        else:
            answer.fail(str(message.get("values")))

    def _on_action_feedback(self, message: dict[str, Any]) -> None:
        goal = self._goals.get(str(message.get("id")))
        if goal is not None and goal.on_feedback is not None:
            values = goal.kind.feedback.from_dict(message.get("values") or {})
            self._executor.submit(_logged, goal.on_feedback, values)

    def _on_action_result(self, message: dict[str, Any]) -> None:
        goal = self._goals.pop(str(message.get("id")), None)
        if goal is None:
            return
        values, status = message.get("values"), message.get("status", int(GoalStatus.UNKNOWN))
        if not isinstance(values, dict):
            goal.refuse(str(values))
            return
        goal.end(GoalStatus(status), goal.kind.result.from_dict(values))

    def _on_call_service(self, message: dict[str, Any]) -> None:
        self._offered_call(f"service {message.get('service')}", message)

    def _on_send_action_goal(self, message: dict[str, Any]) -> None:
        self._offered_call(f"action {message.get('action')}", message)

    def _on_cancel_action_goal(self, message: dict[str, Any]) -> None:
        self._offered_call(f"action {message.get('action')}", message)

    def _offered_call(self, key: str, message: dict[str, Any]) -> None:
        answer = self._offered.get(key)
        if answer is not None:
            self._executor.submit(_logged, answer, message)

    # Topics.

    def advertise(self, topic: str, type_name: str, qos: QoS = RELIABLE) -> Publisher:
        """Return a publisher; see `Transport.advertise`."""
        kind = message_type(type_name)
        return self.keep(topic, lambda: _RosbridgePublisher(self, topic, kind, qos))

    def subscribe(self, topic: str, type_name: str, qos: QoS, callback: Callable[[Any], None]) -> Closable:
        """Call back with every message; see `Transport.subscribe`."""
        kind = message_type(type_name)
        heard: _Heard = self.keep(topic, lambda: _Heard(self, topic, kind, qos, callback))
        with self.lock:
            self._heard.setdefault(topic, []).append(heard)
        subscribe = {"op": "subscribe", "id": heard.identifier, "topic": topic, "queue_length": qos.depth}
        self.send({**subscribe, "type": heard.kind.type_name})
        return heard

    def forget(self, heard: _Heard) -> None:
        """End a subscription."""
        with self.lock:
            if heard not in self._heard.get(heard.topic, ()):
                return
            self._heard[heard.topic].remove(heard)
        if self.connected:
            self.send({"op": "unsubscribe", "id": heard.identifier, "topic": heard.topic})

    # Services.

    def offer_service(self, name: str, type_name: str, callback: Callable[[Any], Any]) -> Closable:
        """Answer calls; see `Transport.offer_service`."""
        kind = service_type(type_name)

        def answer(message: dict[str, Any]) -> None:
            response = {"op": "service_response", "service": name, "id": message.get("id")}
            try:
                values = callback(kind.request.from_dict(message.get("args") or {})).to_dict()
                self.send({**response, "values": values, "result": True})
            except Exception as error:
                self.send({**response, "values": str(error)[:500], "result": False})

        return self._offer("service", name, type_name, answer)

    def _offer(
        self, kind: str, name: str, type_name: str, answer: Callable[[dict[str, Any]], None]
    ) -> Closable:
        def end() -> None:
            if self._offered.pop(f"{kind} {name}", None) is not None and self.connected:
                self.send({"op": f"unadvertise_{kind}", kind: name})

        def make() -> OpenPart:
            self._offered[f"{kind} {name}"] = answer
            self.send({"op": f"advertise_{kind}", kind: name, "type": type_name})
            return OpenPart(self, end)

        return self.keep(name, make)

    def call_service(self, name: str, type_name: str, request: Any, timeout: float = SERVER_WAIT) -> Any:
        """Call a service; see `Transport.call_service`."""
        kind = service_type(type_name)
        identifier = f"call:{next(self._numbers)}"
        answer = self._answers[identifier] = PendingAnswer(identifier)
        try:
            call = {"op": "call_service", "id": identifier, "service": name, "type": type_name}
            self.send({**call, "args": request.to_dict()})
            return kind.response.from_dict(answer.wait(name, timeout))
        finally:
            self._answers.pop(identifier, None)

    # Actions.

    def offer_action(self, name: str, type_name: str, server: ActionServer) -> Closable:
        """Offer an action; see `Transport.offer_action`."""
        kind = action_type(type_name)
        action = Action(lambda _: None, name, type_name, server)
        goals: dict[Any, LocalGoal] = {}

        def answer(message: dict[str, Any]) -> None:
            key = message.get("id")
            common = {"action": name, "id": key}
            if message["op"] == "cancel_action_goal":
                if key in goals:
                    goals[key].request_cancel()
                return

            def feedback(values: Any) -> None:
                self.send({"op": "action_feedback", **common, "values": values.to_dict()})

            def end(result: GoalResult) -> None:
                goals.pop(key, None)
                values = {"values": result.result.to_dict(), "status": int(result.status)}
                reached = result.status is GoalStatus.SUCCEEDED
                if self.connected:
                    self.send({"op": "action_result", **common, **values, "result": reached})

            goal = kind.goal.from_dict(message.get("args") or {})
            made = LocalGoal(action, goal, feedback, end)
            goals[key] = made
            if server.on_goal(goal):
                made.begin()
            else:
                end(GoalResult(GoalStatus.ABORTED, kind.result()))

        self._on_lost.append(action.close)
        offered = self._offer("action", name, type_name, answer)

        def close() -> None:
            offered.close()
            action.close()

        return self.keep(name, lambda: OpenPart(self, close))

    def send_goal(
        self,
        name: str,
        type_name: str,
        goal: Any,
        feedback_callback: Callable[[Any], None] | None = None,
        timeout: float = SERVER_WAIT,
    ) -> GoalHandle:
        """Send a goal; the protocol does not report acceptance, so `accepted` is True until it is refused."""
        made = RosbridgeGoal(self, name, type_name, feedback_callback)
        with self.lock:
            self._goals[made.identifier] = made
        message: dict[str, Any] = {"op": "send_action_goal", "action": name, "action_type": type_name}
        message |= {"id": made.identifier, "feedback": feedback_callback is not None}
        self.send({**message, "args": goal.to_dict()})
        return made


class _RosbridgePublisher(OpenPart, Publisher):
    def __init__(self, client: RosbridgeClient, topic: str, kind: Any, qos: QoS) -> None:
        super().__init__(client, self._end)
        self._client, self._topic = client, topic
        latch = {"latch": qos.latched, "queue_size": qos.depth}
        client.send({"op": "advertise", "topic": topic, "type": kind.type_name, **latch})

    @property
    def subscription_count(self) -> int:
        """Always 1: the protocol does not report subscriptions."""
        return 1

    def publish(self, message: Any) -> None:
        """Send a message."""
        if self.closed:
            raise TransportError(self._topic, "the publisher is closed; advertise the topic again")
        self._client.send({"op": "publish", "topic": self._topic, "msg": message.to_dict()})

    def _end(self) -> None:
        if self._client.connected:
            self._client.send({"op": "unadvertise", "topic": self._topic})


class _Heard(OpenPart):
    """A subscription that calls back with messages on a separate thread."""

    def __init__(
        self, client: RosbridgeClient, topic: str, kind: Any, qos: QoS, callback: Callable[[Any], None]
    ) -> None:
        super().__init__(client, self._end)
        self._client, self.topic, self.kind = client, topic, kind
        self.identifier = f"subscribe:{next(client._numbers)}"
        self._local = LocalTransport()
        self.publisher = self._local.advertise(topic, kind.type_name)
        self._local.subscribe(topic, kind.type_name, qos, callback)

    def _end(self) -> None:
        self._client.forget(self)
        self._local.close()


def _logged(call: Callable[[Any], object], value: Any) -> None:
    """Call a function and log its exception."""
    try:
        call(value)
    except PepperKinError as error:
        logger.warning("rosbridge: %s", error)
    except Exception:
        logger.exception("rosbridge: a callback failed")
