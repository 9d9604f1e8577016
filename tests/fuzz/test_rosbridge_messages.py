"""Messages to the rosbridge server with something wrong in them: it answers the next client as before.

The oracle: after all of them a client gets the answer of a service on the same connection, and another client
on its own.  A robot that they were sent to was commanded within its limits all the time, and follows a goal.
"""

import json
import random
from concurrent.futures import ThreadPoolExecutor

import pytest
from random_messages import random_message
from tornado.ioloop import IOLoop
from tornado.websocket import websocket_connect

from pepper_kin.naoqi.body import Body
from pepper_kin.ros import GoalStatus, RobotNode
from pepper_kin.ros.transports.rosbridge import RosbridgeServer
from pepper_kin.ros_messages import action_type, message_type, service_type
from pepper_kin.ros_messages.json_text import to_json

LAST = json.dumps({"op": "call_service", "service": "/rosapi/get_time", "id": "last"})


@pytest.fixture(scope="module")
def server():
    with RosbridgeServer(port=0) as made:
        yield made


def malformed(random_numbers):
    """Return a message with something wrong in it."""
    operations = (
        "publish",
        "subscribe",
        "advertise",
        "call_service",
        "send_action_goal",
        "fragment",
        "status",
    )
    odd = (None, -1, 1e308, True, "", "/x", [], {}, [[]], {"a": {}}, "\ud800", "x" * 500)
    fields = (
        "topic",
        "type",
        "msg",
        "id",
        "service",
        "args",
        "action",
        "data",
        "num",
        "total",
        "level",
        "op",
    )
    text = json.dumps(
        {"op": random_numbers.choice(operations)}
        | {random_numbers.choice(fields): random_numbers.choice(odd) for _ in range(3)}
    )
    kind = random_numbers.randrange(4)
    if kind == 0:
        return text
    place = random_numbers.randrange(len(text))
    if kind == 1:
        return text[:place]
    if kind == 2:
        return text[:place] + random_numbers.choice('{}[]",:\\\0é') + text[place + 1 :]
    return random_numbers.randbytes(20)


def answered(server, texts):
    """Send texts; return whether the last, a call, was answered."""

    async def converse():
        socket = await websocket_connect(server.url)
        for text in [*texts, LAST]:
            await socket.write_message(text, binary=isinstance(text, bytes))
        found = False
        while not found and (answer := await socket.read_message()) is not None:
            found = json.loads(answer).get("id") == "last"
        socket.close()
        return found

    def converse_in_a_loop():
        loop = IOLoop(make_current=False)
        try:
            return loop.run_sync(converse, timeout=300)
        finally:
            loop.close()

    # In a separate thread: where a browser is driven by the same process, this one has a running loop.
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(converse_in_a_loop).result(330)


def test_malformed_messages_do_not_end_the_server(server, amount, tried):
    """Malformed rosbridge messages: the server goes on, for this client and for others."""
    count, random_numbers = amount(300, 10_000, 1_000_000), random.Random(8)
    rounds = [min(2_000, count - k) for k in range(0, count, 2_000)]
    wrong = sum(not answered(server, [malformed(random_numbers) for _ in range(size)]) for size in rounds)
    wrong += not answered(server, [])
    tried("malformed rosbridge messages", count, wrong)


@pytest.fixture(scope="module")
def robot():
    """A robot in real time behind a server."""
    with RosbridgeServer(port=0) as made:
        body = Body()
        body.time.start()
        with RobotNode(body, made, cameras=()) as node:
            yield node
        body.time.stop()


def senseless(node, rng):
    """Return a message of the right type for a topic, a service or an action, with random content."""
    transport = node.transport
    commands = sorted(set(transport.topics) - set(node.topics))
    kind = int(rng.integers(6))
    if kind == 0:
        name = str(rng.choice(sorted(transport.actions)))
        goal = action_type(transport.actions[name]).goal
        values = to_json(random_message(goal, rng))
        return f'{{"op":"send_action_goal","action":"{name}","id":"{rng.integers(1 << 40)}","args":{values}}}'
    if kind == 1:
        name = "/plan_kinematic_path"
        values = to_json(random_message(service_type(transport.services[name]).request, rng))
        return f'{{"op":"call_service","service":"{name}","args":{values}}}'
    name = str(rng.choice(commands))
    values = random_message(message_type(transport.topics[name]), rng)
    if kind == 2 and hasattr(values, "joint_names"):
        values.joint_names = [str(n) for n in rng.choice(node.body.pepper.joint_names, 2)]
    return f'{{"op":"publish","topic":"{name}","msg":{to_json(values)}}}'


def test_senseless_messages_leave_a_robot_that_works(robot, amount, rng, tried):
    """Messages of the right type without sense to all topics, actions and the service of a robot."""
    count, outside = amount(200, 1_000, 1_000_000), []
    pepper, body = robot.body.pepper, robot.body

    def look():
        q = body.configuration(False)
        if not ((q >= pepper.lower_limits - 1e-9) & (q <= pepper.upper_limits + 1e-9)).all():
            outside.append(q)

    body.listeners.append(look)
    wrong = 0
    for done in range(0, count, 100):
        texts = [senseless(robot, rng) for _ in range(min(100, count - done))]
        # A client that is too slow to show a sign of life is disconnected; the next one must be answered.
        wrong += not answered(robot.transport, texts) and not answered(robot.transport, [])
    body.listeners.remove(look)
    robot.transport.flush(60.0)
    assert not outside, outside[:3]
    assert not wrong, "a call was not answered"
    goal = action_type("control_msgs/action/FollowJointTrajectory").goal()
    point = message_type("trajectory_msgs/msg/JointTrajectoryPoint")(positions=[0.3])
    point.time_from_start.sec = 2
    goal.trajectory.joint_names, goal.trajectory.points = ["HeadYaw"], [point]
    name = "/Head_controller/follow_joint_trajectory"
    found = robot.transport.send_goal(name, "control_msgs/action/FollowJointTrajectory", goal).result(60)
    assert found.status is GoalStatus.SUCCEEDED, found
    tried("senseless messages to a robot", count, 0)
