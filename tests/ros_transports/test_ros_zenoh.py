"""The transport through Zenoh beside pyzeros: an independent node of rmw_zenoh's graph, with its own types.

pyzeros compiles its codecs with the machine's C compiler, into the folder `build`.
"""

import asyncio
import os
import socket
from pathlib import Path

import pytest
import zenoh

os.environ["CYDR_CACHE_DIR"] = str(Path(__file__).parents[2] / "build" / "cydr")  # before the import

import pyzeros
from pyzeros.qos import QosProfile
from ros2_pyterfaces.cyclone import all_msgs, all_srvs
from ros2_pyterfaces.cyclone.geometry_msgs import msg as geometry
from ros2_pyterfaces.cyclone.sensor_msgs import msg as sensor
from zenoh_goals import FOLLOW, Server, goal_of, until

from pepper_kin.ros import QoS, TransportError
from pepper_kin.ros.transport import GoalStatus
from pepper_kin.ros.transports.zenoh import ZenohTransport
from pepper_kin.ros_messages import decode, encode, message_type, service_type, type_hash


@pytest.fixture
def router():
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return f"tcp/localhost:{free.getsockname()[1]}"


@pytest.fixture
def ours(router):
    with ZenohTransport("ours", domain_id=7, router=router) as transport:
        yield transport


@pytest.fixture
def session(ours, router):
    """A session of Zenoh as rmw_zenoh configures it."""
    configuration = zenoh.Config()
    configuration.insert_json5("mode", '"peer"')
    configuration.insert_json5("connect/endpoints", f'["{router}"]')
    configuration.insert_json5("listen/endpoints", '["tcp/localhost:0"]')
    configuration.insert_json5("scouting/multicast/enabled", "false")
    with zenoh.open(configuration) as opened:
        yield opened


def of_pyzeros(session, task, timeout=30.0):
    """Run a task with a node of pyzeros."""

    async def run():
        return await asyncio.wait_for(task(), timeout)

    with pyzeros.auto_context(node="theirs", zenoh_session=session, domain_id=7):
        return asyncio.run(run())


def own_kind(name):
    """A message of this library for pyzeros: its bytes and its hash, where pyzeros has no such type."""
    kind = message_type(name)

    class Kind:
        def __init__(self, message=None):
            self.message = kind() if message is None else message

        get_type_name = staticmethod(lambda: name)
        hash_rihs01 = staticmethod(lambda: type_hash(name))

        def serialize(self):
            return encode(self.message)

        @staticmethod
        def deserialize(data):
            return Kind(decode(kind, bytes(data)))

    return Kind


def own_service(name):
    class Service:
        Request, Response = own_kind(f"{name}_Request"), own_kind(f"{name}_Response")
        get_type_name = staticmethod(lambda: name)
        hash_rihs01 = staticmethod(lambda: type_hash(name))

    return Service


def test_topics_reach_pyzeros_and_come_from_it(ours, session):
    states = ours.advertise("/joint_states", "sensor_msgs/msg/JointState")
    twists = []
    ours.subscribe("/cmd_vel", "geometry_msgs/msg/Twist", QoS(), twists.append)
    message = message_type("sensor_msgs/msg/JointState")(name=["HeadYaw", "été"], position=[0.25, -1.5])

    async def task():
        heard = pyzeros.Sub(sensor.JointState, "/joint_states")
        sent = pyzeros.Pub(geometry.Twist, "/cmd_vel")
        while not states.subscription_count or not sent.zenoh_pub.matching_status.matching:
            await asyncio.sleep(0.01)
        states.publish(message)
        sent.publish(geometry.Twist(linear=geometry.Vector3(x=0.3), angular=geometry.Vector3(z=-0.2)))
        async for one in heard.listen_reliable():
            return one

    key, still = (
        ours.key("/cmd_vel", "geometry_msgs/msg/Twist"),
        encode(message_type("geometry_msgs/msg/Twist")()),
    )
    for data in (b"", b"\x00", b"\x00\x01\x00\x00\xff\xff\xff\xff", still[:-1]):
        session.put(key, data)  # is logged, and ends nothing
    session.put(key, still)
    found = of_pyzeros(session, task)
    assert (list(found.name), list(found.position)) == (["HeadYaw", "été"], [0.25, -1.5])
    until(lambda: len(twists) == 2)
    assert [(twist.linear.x, twist.angular.z) for twist in twists] == [(0.0, 0.0), (0.3, -0.2)]


def test_services_are_called_by_pyzeros_and_call_it(ours, session):
    kinds = service_type("std_srvs/srv/SetBool")

    def answer(request):
        if request.data:
            raise RuntimeError("a failing service")
        return kinds.response(success=True, message="ours")

    ours.offer_service("/ask_ours", "std_srvs/srv/SetBool", answer)

    async def task():
        client = pyzeros.Client(all_srvs.SetBool, "/ask_ours")
        await client.wait_for_service()
        answered = await client.call_async(all_srvs.SetBool.Request(data=False))
        with pytest.raises(RuntimeError, match="a failing service"):
            await client.call_async(all_srvs.SetBool.Request(data=True))
        server = pyzeros.Server(all_srvs.SetBool, "/ask_theirs")
        called = asyncio.get_running_loop().run_in_executor(
            None, ours.call_service, "/ask_theirs", "std_srvs/srv/SetBool", kinds.request(data=True), 20.0
        )
        async for one in server.listen_reliable():
            one.response.success, one.response.message = one.request.data, "theirs"
            one.send()
            break
        return answered, await called

    answered, called = of_pyzeros(session, task)
    assert (answered.success, answered.message) == (True, "ours")
    assert (called.success, called.message) == (True, "theirs")
    with pytest.raises(TransportError, match=r"no answer within 0\.5 s"):
        ours.call_service("/nobody", "std_srvs/srv/SetBool", kinds.request(), 0.5)


def test_actions_are_served_to_pyzeros(ours, session):
    ours.offer_action("/follow", FOLLOW, Server())
    send = own_service(f"{FOLLOW}_SendGoal")
    results, cancels = own_service(f"{FOLLOW}_GetResult"), own_service("action_msgs/srv/CancelGoal")

    async def task():
        names = ("send_goal", send), ("get_result", results), ("cancel_goal", cancels)
        clients = [pyzeros.Client(kind, f"/follow/_action/{name}") for name, kind in names]
        feedback = pyzeros.Sub(own_kind(f"{FOLLOW}_FeedbackMessage"), "/follow/_action/feedback")
        heard = []
        feedback.asap_callback.append(heard.append)
        for client in clients:
            await client.wait_for_service()
        found = {}
        for number, names in enumerate(
            (["x"], ["wrong"], ["failing"], ["long"], ["long", "stubborn"]), start=1
        ):
            identifier = bytes([number] * 16)
            request = send.Request()
            request.message.goal_id.uuid, request.message.goal = identifier, goal_of(*names)
            accepted = (await clients[0].call_async(request)).message.accepted
            cancel = cancels.Request()
            cancel.message.goal_info.goal_id.uuid = identifier
            if "long" in names:
                found[number, "cancel"] = (await clients[2].call_async(cancel)).message
            if "stubborn" in names or not accepted:
                found[number] = accepted
                continue
            asked = results.Request()
            asked.message.goal_id.uuid = identifier
            found[number] = (await clients[1].call_async(asked)).message
        found["late"] = (await clients[2].call_async(cancel_of(cancels, 1))).message.return_code
        found["unknown"] = (await clients[2].call_async(cancel_of(cancels, 99))).message.return_code
        return found, [one.message for one in heard]

    found, heard = of_pyzeros(session, task)
    assert (found[1].status, found[1].result.error_string) == (GoalStatus.SUCCEEDED, "done")
    assert found[2] is False
    assert found[3].status == GoalStatus.ABORTED
    assert (found[4].status, found[4].result.error_string) == (GoalStatus.CANCELED, "stopped")
    assert bytes(found[4, "cancel"].goals_canceling[0].goal_id.uuid) == bytes([4] * 16)
    assert (found[4, "cancel"].return_code, found[5, "cancel"].return_code) == (0, 1)  # rejected
    assert (found["late"], found["unknown"]) == (3, 2)  # has ended, is not known
    first = [one.feedback.index for one in heard if bytes(one.goal_id.uuid) == bytes([1] * 16)]
    assert first == list(range(6))


def cancel_of(cancels, number):
    cancel = cancels.Request()
    cancel.message.goal_info.goal_id.uuid = bytes([number] * 16)
    return cancel


def test_the_graph_lists_the_node_and_its_parts(ours, session):
    ours.advertise("/pictures", "sensor_msgs/msg/Image", QoS(5, reliable=False))
    ours.offer_service("/ask", "std_srvs/srv/Trigger", lambda _: None)
    tokens = [str(one.ok.key_expr).split("/") for one in session.liveliness().get("@ros2_lv/7/**")]
    listed = {token[5]: token[8:] for token in tokens}
    assert listed["NN"] == ["ours"]
    hashes = all_msgs.Image.hash_rihs01(), all_srvs.Trigger.hash_rihs01()
    picture = ["ours", "%pictures", "sensor_msgs::msg::dds_::Image_", hashes[0]]
    assert listed["MP"] == [*picture, QosProfile(depth=5, reliability="best_effort").encode()]
    asked = ["ours", "%ask", "std_srvs::srv::dds_::Trigger_", hashes[1]]
    assert listed["SS"] == [*asked, QosProfile.services().encode()]
    ours.close()
    until(lambda: not list(session.liveliness().get("@ros2_lv/7/**")))
