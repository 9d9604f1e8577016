"""The rosbridge protocol: what the server answers, also to what is no message."""

import asyncio
import base64
import io
import json
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from tornado.ioloop import IOLoop
from tornado.websocket import WebSocketClosedError, websocket_connect

from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.ros import ActionServer, GoalStatus, TransportError
from pepper_kin.ros.qos import LATCHED, RELIABLE
from pepper_kin.ros.transports.rosbridge import RosbridgeServer
from pepper_kin.ros.transports.rosbridge_client import RosbridgeClient
from pepper_kin.ros.transports.rosbridge_outbox import Outbox, Outgoing
from pepper_kin.ros_messages import message_type

STRING = "std_msgs/msg/String"
FIBONACCI = "control_msgs/action/FollowJointTrajectory"


@pytest.fixture(scope="module")
def server():
    with RosbridgeServer(port=0) as made:
        yield made


@pytest.fixture
def client(server):
    with RosbridgeClient(server.url) as made:
        yield made


def talk(server, *texts, answers=0, url=None, seconds=30.0):
    """Send texts over a plain web socket; return as many answers, or those until the socket closes."""

    async def converse():
        socket = await websocket_connect(url or server.url)
        for text in texts:
            try:
                await socket.write_message(text, binary=isinstance(text, bytes))
            except WebSocketClosedError:  # the server has had enough
                return []
        found = []
        while len(found) < answers and (answer := await socket.read_message()) is not None:
            found.append(json.loads(answer))
        socket.close()
        return found

    def run():
        loop = IOLoop(make_current=False)
        try:
            return loop.run_sync(converse, timeout=seconds)
        finally:
            loop.close()

    with ThreadPoolExecutor(1) as pool:  # a browser of other tests keeps a loop running in the main thread
        return pool.submit(run).result()


def op(name, **fields):
    return json.dumps({"op": name, **fields})


def received(subscribe):
    """Return a list that fills, and an event that is set with each entry."""
    found, event = [], threading.Event()

    def take(message):
        found.append(message)
        event.set()

    subscribe(take)
    return found, event


def test_topics_both_ways(server, client):
    there, there_came = received(lambda take: client.subscribe("/to_client", STRING, RELIABLE, take))
    here, here_came = received(lambda take: server.subscribe("/to_server", STRING, RELIABLE, take))
    publisher = client.advertise("/to_server", STRING)
    publisher.publish(message_type(STRING)(data="up"))
    assert here_came.wait(60)
    server.advertise("/to_client", STRING).publish(message_type(STRING)(data="dä ✓"))
    assert there_came.wait(60)
    assert (here[0].data, there[0].data) == ("up", "dä ✓")


def test_late_subscriptions_get_latched_messages(server):
    with server.advertise("/latched", STRING, LATCHED) as publisher:
        publisher.publish(message_type(STRING)(data="once"))
        [found] = talk(server, op("subscribe", topic="/latched"), answers=1)
    assert found == {"op": "publish", "topic": "/latched", "msg": {"data": "once"}}


def test_bytes_are_base64_and_nan_is_null(server):
    kind = message_type("sensor_msgs/msg/Image")
    with server.advertise("/image", kind.type_name, LATCHED) as publisher:
        publisher.publish(kind(data=bytes(range(256)), height=16, width=16))
        [found] = talk(server, op("subscribe", topic="/image"), answers=1)
    assert base64.b64decode(found["msg"]["data"]) == bytes(range(256))
    with server.advertise("/range", "sensor_msgs/msg/Range", LATCHED) as publisher:
        publisher.publish(message_type("sensor_msgs/msg/Range")(range=float("inf")))
        [found] = talk(server, op("subscribe", topic="/range"), answers=1)
    assert found["msg"]["range"] is None


def test_fragments_and_png(server):
    from PIL import Image

    text = "x" * 900 + "ü"
    with server.advertise("/long", STRING, LATCHED) as publisher:
        publisher.publish(message_type(STRING)(data=text))
        parts = talk(server, op("subscribe", topic="/long", fragment_size=200), answers=5)
        [packed] = talk(server, op("subscribe", topic="/long", compression="png"), answers=1)
    assert [part["num"] for part in parts] == list(range(parts[0]["total"]))
    whole = json.loads("".join(part["data"] for part in parts))
    assert whole["msg"]["data"] == text
    pixels = np.asarray(Image.open(io.BytesIO(base64.b64decode(packed["data"]))))
    assert json.loads(pixels.tobytes().decode())["msg"]["data"] == text
    message = op("call_service", service="/rosapi/get_time", id="7")
    cut = [message[:20], message[20:]]
    parts_sent = [op("fragment", id="f", data=cut[k], num=k, total=2) for k in (1, 0)]
    [answer] = talk(server, *parts_sent, answers=1)
    assert (answer["op"], answer["id"]) == ("service_response", "7")


def test_throttled_subscriptions_get_fewer(server):
    import time

    with server.advertise("/fast", STRING) as publisher, RosbridgeClient(server.url) as client:
        for rate in (0, 200):
            client.send({"op": "subscribe", "topic": "/fast", "id": f"s{rate}",
                         "type": STRING, "throttle_rate": rate})  # fmt: skip
        taken = []
        client._take = lambda text: taken.append(json.loads(text))  # what comes over the wire
        while len(server.topic("/fast", None).subscriptions) < 2:
            time.sleep(0.01)
        begun = time.monotonic()
        for k in range(40):
            publisher.publish(message_type(STRING)(data=str(k)))
            time.sleep(0.02)
        numbers = []
        while len({*numbers}) < 40 and time.monotonic() < begun + 60.0:
            time.sleep(0.01)
            numbers = [int(message["msg"]["data"]) for message in taken]
        passed = time.monotonic() - begun
    assert all(numbers.count(k) >= 1 for k in range(40))
    assert 2 <= len(numbers) - 40 <= passed / 0.2 + 2


def test_services_both_ways(server, client):
    kind = "std_srvs/srv/SetBool"
    response = message_type(f"{kind}_Response")
    request = message_type(f"{kind}_Request")
    with server.offer_service("/here", kind, lambda r: response(success=r.data, message="here")):
        assert client.call_service("/here", kind, request(data=True)).message == "here"
    with pytest.raises(TransportError, match="nobody offers this service"):
        client.call_service("/here", kind, request())
    with client.offer_service("/there", kind, lambda r: response(success=not r.data, message="there")):
        while "/there" not in server.services:
            threading.Event().wait(0.01)
        assert server.call_service("/there", kind, request(data=True)).success is False

    def broken(_):
        raise RuntimeError("it is broken")

    with server.offer_service("/broken", kind, broken), pytest.raises(TransportError, match="is broken"):
        client.call_service("/broken", kind, request())


class Counting(ActionServer):
    """Feeds back until it is canceled, or to the end of the goal's time."""

    def on_goal(self, goal):
        return bool(goal.trajectory.joint_names)

    def on_cancel(self, goal):
        return True

    def execute(self, goal):
        result = message_type(f"{FIBONACCI}_Result")
        feedback = message_type(f"{FIBONACCI}_Feedback")
        for _ in range(goal.goal.goal_time_tolerance.sec):
            goal.publish_feedback(feedback(joint_names=goal.goal.trajectory.joint_names))
            if goal.cancel_requested:
                goal.canceled(result(error_string="stopped"))
                return
            threading.Event().wait(0.02)
        goal.succeed(result(error_string="done"))


@pytest.mark.parametrize("offered", ["server", "client"])
def test_actions_both_ways(server, client, offered):
    offering, sending = (server, client) if offered == "server" else (client, server)
    goal = message_type(f"{FIBONACCI}_Goal")()
    goal.trajectory.joint_names, goal.goal_time_tolerance.sec = ["A"], 3
    with offering.offer_action("/count", FIBONACCI, Counting()):
        while "/count" not in server.actions:
            threading.Event().wait(0.01)
        feedback = []
        found = sending.send_goal("/count", FIBONACCI, goal, feedback.append).result(60)
        assert (found.status, found.result.error_string) == (GoalStatus.SUCCEEDED, "done")
        assert [message.joint_names for message in feedback] == [["A"]] * 3
        goal.goal_time_tolerance.sec = 5000
        handle = sending.send_goal("/count", FIBONACCI, goal)
        threading.Event().wait(0.1)
        assert handle.cancel()
        found = handle.result(60)
        assert (found.status, found.result.error_string) == (GoalStatus.CANCELED, "stopped")
        if offered == "server":
            goal.trajectory.joint_names = []
            with pytest.raises(TransportError, match="not accepted"):
                sending.send_goal("/count", FIBONACCI, goal).result(60)


def test_goals_of_lost_clients_are_canceled(server):
    goal = message_type(f"{FIBONACCI}_Goal")()
    goal.trajectory.joint_names, goal.goal_time_tolerance.sec = ["A"], 5000
    with server.offer_action("/count", FIBONACCI, Counting()):
        with RosbridgeClient(server.url) as client:
            handle = client.send_goal("/count", FIBONACCI, goal)
            while not (goals := tuple(server.action("/count").goals)):
                threading.Event().wait(0.01)
        assert goals[0].result(60).status is GoalStatus.CANCELED
        assert handle.result(60).status is GoalStatus.UNKNOWN


def test_rosapi(server):
    with server.advertise("/known", STRING):
        found = talk(
            server,
            op("call_service", service="/rosapi/topics", id="1"),
            op("call_service", service="/rosapi/topic_type", id="2", args={"topic": "/known"}),
            op("call_service", service="/rosapi/message_details", id="3", args={"type": STRING}),
            op("call_service", service="/rosapi/topic_type", id="4", args={"topic": "/unknown"}),
            answers=4,
        )
    values = {answer["id"]: answer for answer in found}
    topics = values["1"]["values"]
    assert dict(zip(topics["topics"], topics["types"], strict=True))["/known"] == STRING
    assert values["2"]["values"] == {"type": STRING}
    assert values["3"]["values"]["typedefs"][0]["fieldnames"] == ["data"]
    assert values["4"]["result"] is False


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{", "not JSON"),
        ("[1, 2]", 'not an object with a string "op"'),
        (op("fly"), "unknown op 'fly'"),
        (b"\x00\x01", "binary messages are not read"),
        (op("publish", topic="/x"), "no type was stated"),
        (op("publish", topic="/x", type=STRING, msg={"data": 3}), "String.data"),
        (op("publish", topic="/x", type=STRING, msg={"date": "3"}), "did you mean 'data'?"),
        (op("advertise", topic="/x", type="no_msgs/None"), "no_msgs"),
        (op("subscribe", topic=5), "'topic' is 5, expected a string"),
        (op("subscribe", topic="/x", type=STRING, throttle_rate=-1), "throttle_rate is 0 to"),
        (op("fragment", id="a", data="", num=3, total=2), "fragment 3 of 2"),
        (op("unsubscribe", topic="/never"), "is not subscribed"),
        (op("cancel_action_goal", action="/a", id="9"), "no goal with this id"),
        (op("set_level", level="loud"), "expected one of none, error"),
        (op("advertise_service", service="/s", type="std_srvs/srv/None"), "std_srvs/srv/None"),
        ("[" * 100_000, "not JSON"),
    ],
)
def test_faults_are_answered_with_a_status(server, text, words):
    [found] = talk(server, text, answers=1)
    assert (found["op"], found["level"]) == ("status", "error")
    assert words in found["msg"]


def test_a_message_that_is_too_large_ends_its_client_alone(server):
    with RosbridgeClient(server.url) as other:
        assert talk(server, "x" * 17_000_000, answers=1) == []
        assert talk(server, op("call_service", service="/rosapi/get_time"), answers=1)[0]["result"]
        assert other.connected


def test_tokens_and_addresses():
    with pytest.raises(InvalidValueError, match="others could move the robot"):
        RosbridgeServer("0.0.0.0", 0)
    with pytest.raises(InvalidValueError, match="port"):
        RosbridgeServer(port=70_000)
    with RosbridgeServer("0.0.0.0", 0, allow_remote=True) as server:
        local = f"ws://127.0.0.1:{server.port}/"
        with pytest.raises(TransportError, match="403"):
            RosbridgeClient(local)
        with pytest.raises(TransportError, match="403"):
            RosbridgeClient(f"{local}?token=0123456789abcdef")
        with RosbridgeClient(f"{local}?token={server.access.token}") as client:
            assert client.connected


@pytest.mark.parametrize(
    ("origin", "allowed"),
    [
        (None, True),
        ("http://localhost:8080", True),
        ("http://127.0.0.1", True),
        ("https://evil.example", False),
    ],
)
def test_pages_of_other_sites_are_refused(server, origin, allowed):
    assert (server.fault(f"127.0.0.1:{server.port}", origin, None) is None) is allowed


def test_types_are_checked(server):
    with server.advertise("/typed", STRING) as publisher:
        with pytest.raises(TransportError, match="its type is std_msgs/msg/String"):
            server.advertise("/typed", "std_msgs/msg/Float32")
        with pytest.raises(InvalidValueError, match="message for /typed"):
            publisher.publish(message_type("std_msgs/msg/Float32")())
    with pytest.raises(TransportError, match="closed"):
        publisher.publish(message_type(STRING)())
    with pytest.raises(UnknownNameError):
        server.advertise("/other", "std_msgs/msg/Strong")


def test_nobody_there():
    with pytest.raises(TransportError, match="cannot connect"):
        RosbridgeClient("ws://127.0.0.1:1")


def test_an_outbox_ends_where_it_is_woken_and_canceled_at_once():
    async def run():
        async def write(text):
            del text

        outbox = Outbox(write, lambda: None)
        options = {"throttle_rate": 3_600_000, "queue_length": 1, "fragment_size": None}
        throttled = Outgoing("/slow", None, {**options, "compression": "none"})
        outbox.subscriptions.append(throttled)
        throttled.add("first")
        throttled.add("second")
        task = asyncio.ensure_future(outbox.run())
        await asyncio.sleep(0.01)
        throttled.add("third")  # waits for an hour
        outbox.wake()
        await asyncio.sleep(0)
        outbox.wake()
        task.cancel()
        done, _ = await asyncio.wait([task], timeout=60.0)
        return bool(done) and task.cancelled()

    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(asyncio.run, run()).result(30)
