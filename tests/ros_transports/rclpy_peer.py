"""A program with rclpy only: it answers one JSON object a line with another; see `Peer`."""

import base64
import importlib
import json
import os
import sys
import threading
import time

import rclpy
import rclpy.action
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message, serialize_message

rclpy.init()
node = rclpy.create_node("peer")
executor = MultiThreadedExecutor(16)
executor.add_node(node)
threading.Thread(target=executor.spin, daemon=True).start()
publishers, received, kept, goals, action_clients = {}, {}, [], {}, {}
group = ReentrantCallbackGroup()


def find(type_name):
    package, kind, name = type_name.split("/")
    found = importlib.import_module(f"{package}.{kind}")
    for part in name.split("_"):
        found = getattr(found, part)
    return found


def profile(reliable, latched):
    return QoSProfile(
        depth=50,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def until(condition, timeout=60.0):
    end = time.monotonic() + timeout
    while not condition():
        if time.monotonic() > end:
            raise TimeoutError("nothing came")
        time.sleep(0.005)


def listen(topic, type, reliable=True, latched=False):
    received.setdefault(topic, [])
    kept.append(
        node.create_subscription(
            find(type), topic, received[topic].append, profile(reliable, latched), callback_group=group
        )
    )


def joined(topic):
    """Wait until a publisher of a topic is known."""
    until(lambda: node.count_publishers(topic))


def heard(topic, count=1):
    """Return the bytes of the first `count` messages of a topic, as rclpy serializes what it has read."""
    until(lambda: len(received[topic]) >= count)
    messages = received[topic][:count]
    del received[topic][:count]
    return [base64.b64encode(serialize_message(m)).decode() for m in messages]


def newest(topic):
    """Return the next message of a topic."""
    received[topic].clear()
    return heard(topic)


def advertise(topic, type, reliable=True, latched=False):
    publishers[topic] = find(type), node.create_publisher(find(type), topic, profile(reliable, latched))


def publish(topic, data, wait=True):
    """Publish the message that rclpy reads from bytes."""
    kind, publisher = publishers[topic]
    if wait:
        until(lambda: publisher.get_subscription_count() > 0)
    publisher.publish(deserialize_message(base64.b64decode(data), kind))


def default(type):
    return base64.b64encode(serialize_message(find(type)())).decode()


def fields(type):
    return find(type).get_fields_and_field_types()


def serve(name, type):
    """Offer a service SetBool."""

    def answer(request, response):
        response.success, response.message = request.data, "peer"
        return response

    kept.append(node.create_service(find(type), name, answer, callback_group=group))


def call(name, type, value):
    client = node.create_client(find(type), name, callback_group=group)
    until(lambda: client.service_is_ready())
    request = find(type).Request()
    if value is not None:
        request.data = value
    future = client.call_async(request)
    until(future.done)
    response = future.result()
    return [response.success, response.message]


def serve_action(name, type):
    """Offer FollowJointTrajectory: the joints' names say how goals end."""
    kind = find(type)

    def accept(goal):
        wrong = "wrong" in goal.trajectory.joint_names
        return rclpy.action.GoalResponse.REJECT if wrong else rclpy.action.GoalResponse.ACCEPT

    def execute(handle):
        result, feedback = kind.Result(), kind.Feedback()
        for i in range(400):
            feedback.index = i
            feedback.joint_names = handle.request.trajectory.joint_names
            handle.publish_feedback(feedback)
            time.sleep(0.01)
            if handle.is_cancel_requested:
                handle.canceled()
                result.error_string = "stopped"
                return result
            if i == 5 and "long" not in feedback.joint_names:
                break
        if "violated" in feedback.joint_names:
            handle.abort()
            result.error_code, result.error_string = result.PATH_TOLERANCE_VIOLATED, "HeadYaw by 0.2"
        else:
            handle.succeed()
        return result

    kept.append(
        rclpy.action.ActionServer(
            node, kind, name, execute, goal_callback=accept, callback_group=group,
            cancel_callback=lambda _: rclpy.action.CancelResponse.ACCEPT,
        )
    )  # fmt: skip


def send_goal(name, type, data):
    kind = find(type)
    if name not in action_clients:
        action_clients[name] = rclpy.action.ActionClient(node, kind, name, callback_group=group)
    client = action_clients[name]
    until(client.server_is_ready)
    feedback = []
    goal = deserialize_message(base64.b64decode(data), kind.Goal)
    for _ in range(4):  # an answer is lost where the server does not know yet who asked
        future = client.send_goal_async(goal, feedback.append)
        try:
            until(future.done, 6.0)
            break
        except TimeoutError:
            feedback.clear()
    until(future.done, 0.0)
    handle = future.result()
    if not handle.accepted:
        return {"accepted": False}
    goals[name] = handle, handle.get_result_async(), feedback
    return {"accepted": True}


def cancel(name):
    future = goals[name][0].cancel_goal_async()
    until(future.done)
    return len(future.result().goals_canceling)


def result(name):
    _, future, feedback = goals[name]
    until(future.done)
    answer = future.result()
    return {
        "status": answer.status,
        "error_code": answer.result.error_code,
        "error_string": answer.result.error_string,
        "indices": [message.feedback.index for message in feedback],
        "joint_names": list(feedback[-1].feedback.joint_names) if feedback else [],
    }


def names(kind):
    """Return name -> types of all topics, services or actions."""
    if kind == "actions":
        return dict(rclpy.action.get_action_names_and_types(node))
    return dict(getattr(node, f"get_{kind[:-1]}_names_and_types")())


def hashes(topic):
    """Return the type hashes of a topic's publishers."""
    until(lambda: node.get_publishers_info_by_topic(topic))
    return [str(info.topic_type_hash) for info in node.get_publishers_info_by_topic(topic)]


def nodes(with_name):
    """Return the names of nodes once one is among them, or after a while."""
    end = time.monotonic() + 20.0
    while with_name not in node.get_node_names() and time.monotonic() < end:
        time.sleep(0.05)
    return node.get_node_names()


out = sys.stdout
print(json.dumps({"ready": True}), flush=True)
for line in sys.stdin:
    order = json.loads(line)
    try:
        answer = {"value": globals()[order.pop("do")](**order)}
    except Exception as error:
        answer = {"error": f"{type(error).__name__}: {error}"}
    print(json.dumps(answer), file=out, flush=True)
node.destroy_node()  # leaves the graph
rclpy.shutdown()
os._exit(0)
