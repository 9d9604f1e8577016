"""A program with one of this library's transports: it answers each JSON line with another; see `Peer`."""

import base64
import json
import sys
import threading
import time

from pepper_kin.ros import ActionServer, QoS, TransportError
from pepper_kin.ros_messages import action_type, decode, encode, message_type, service_type

if sys.argv[1] == "rclpy":
    from pepper_kin.ros.transports.rclpy import RclpyTransport as Transport
else:
    from pepper_kin.ros.transports.cyclonedds import CycloneTransport as Transport

transport = Transport("tested_node")
publishers, subscriptions, received, goals = {}, {}, {}, {}


def until(condition, timeout=60.0):
    end = time.monotonic() + timeout
    while not condition():
        if time.monotonic() > end:
            raise TimeoutError("nothing came")
        time.sleep(0.005)


def text(message):
    return base64.b64encode(encode(message)).decode()


def listen(topic, type, reliable=True, latched=False):
    messages = received.setdefault(topic, [])
    subscriptions[topic] = transport.subscribe(topic, type, QoS(50, reliable, latched), messages.append)


def joined(topic):
    """Wait until a publisher of a topic is known to the subscription."""
    if sys.argv[1] == "rclpy":
        until(lambda: transport.node.count_publishers(topic))
    else:
        until(lambda: subscriptions[topic].entity.get_matched_publications())


def heard(topic, count=1):
    until(lambda: len(received[topic]) >= count)
    messages = received[topic][:count]
    del received[topic][:count]
    return [text(message) for message in messages]


def advertise(topic, type, reliable=True, latched=False):
    publishers[topic] = message_type(type), transport.advertise(topic, type, QoS(50, reliable, latched))


def publish(topic, data, wait=True):
    kind, publisher = publishers[topic]
    if wait:
        until(lambda: publisher.subscription_count)
    publisher.publish(decode(kind, base64.b64decode(data)))


def duration(topic, data, count):
    """Publish a message so many times and return the shortest time that it took [s]."""
    kind, publisher = publishers[topic]
    message = decode(kind, base64.b64decode(data))
    times = []
    for _ in range(count):
        start = time.perf_counter()
        publisher.publish(message)
        times.append(time.perf_counter() - start)
        time.sleep(0.002)
    return min(times)


def serve(name, type):
    response = service_type(type).response

    def answer(request):
        if request.data:
            raise RuntimeError("a failing service")
        return response(success=True, message="tested")

    transport.offer_service(name, type, answer)


def call(name, type, value):
    response = transport.call_service(name, type, service_type(type).request(data=value), 20.0)
    return [response.success, response.message]


class Server(ActionServer):
    """FollowJointTrajectory: the joints' names say how goals end."""

    def __init__(self, kinds):
        self.kinds = kinds

    def on_goal(self, goal):
        return "wrong" not in goal.trajectory.joint_names

    def on_cancel(self, goal):
        return "stubborn" not in goal.goal.trajectory.joint_names

    def execute(self, goal):
        result, names = self.kinds.result(), goal.goal.trajectory.joint_names
        for i in range(400):
            goal.publish_feedback(self.kinds.feedback(index=i, joint_names=names))
            time.sleep(0.01)
            if goal.cancel_requested:
                result.error_string = "stopped"
                goal.canceled(result)
                return
            if i == 5 and "long" not in names:
                break
        if "failing" in names:
            raise RuntimeError("a failing server")
        if "violated" in names:
            result.error_code, result.error_string = result.PATH_TOLERANCE_VIOLATED, "HeadYaw by 0.2"
            goal.abort(result)
        else:
            goal.succeed(result)


def serve_action(name, type):
    received[name] = transport.offer_action(name, type, Server(action_type(type)))


def stop_serving(name):
    received.pop(name).close()


def send_goal(name, type, data):
    feedback = []
    goal = decode(action_type(type).goal, base64.b64decode(data))
    handle = transport.send_goal(name, type, goal, feedback.append, 20.0)
    goals[name] = handle, feedback
    return {"accepted": handle.accepted}


def cancel(name):
    return int(goals[name][0].cancel())


def result(name):
    handle, feedback = goals[name]
    status, answer = handle.result(60.0)
    return {
        "status": int(status),
        "error_code": answer.error_code,
        "error_string": answer.error_string,
        "indices": [message.index for message in feedback],
        "joint_names": feedback[-1].joint_names if feedback else [],
    }


def refused(name, type):
    """Return the message of the error of a call without a server."""
    try:
        transport.call_service(name, type, service_type(type).request(), 0.2)
    except TransportError as error:
        return str(error)
    return ""


def node(cameras):
    """Run a simulated Pepper as a node."""
    from pepper_kin.naoqi.body import Body
    from pepper_kin.ros.node import RobotNode

    body = Body()
    body.time.start()
    received["body"] = body
    received["node"] = RobotNode(body, transport, cameras=cameras, resolution="QQVGA")


def topics():
    """Return name -> type of what the node publishes."""
    return received["node"].topics


def linked(sent, heard):
    """Wait until the node knows others that listen to topics which it sends, and that send those it hears.

    A message that is sent before is lost, and others may know the node seconds before it knows them.
    """
    publishers = [part for part in received["node"]._open if getattr(part, "_topic", None) in sent]
    assert len(publishers) == len(sent)
    until(lambda: all(publisher.subscription_count for publisher in publishers))
    if sys.argv[1] == "rclpy":
        until(lambda: all(transport.node.count_publishers(topic) for topic in heard))


def press(pressed):
    """Put objects on a bumper, the head and a hand, or take them away."""
    from pepper_kin.collision import Scene
    from pepper_kin.kinematics import frame_pose

    body, scene = received["body"], Scene()
    with body.time.lock:
        for name, frame in (
            ("bumper", "BumperB_frame"),
            ("head", "HeadTouchMiddle_frame"),
            ("hand", "LHandTouchBack_frame"),
        ):
            place = frame_pose(body.pepper, body.configuration(True), frame)[:3, 3]
            scene = scene.add_sphere(name, radius=0.02, position=place)
        body.scene = scene if pressed else None


def close():
    if "node" in received:
        received.pop("node").close()
        received.pop("body").time.stop()
    transport.close()
    return [thread.name for thread in threading.enumerate() if not thread.daemon]


print(json.dumps({"ready": True}), flush=True)
for line in sys.stdin:
    order = json.loads(line)
    try:
        answer = {"value": globals()[order.pop("do")](**order)}
    except Exception as error:
        answer = {"error": f"{type(error).__name__}: {error}"}
    print(json.dumps(answer), flush=True)
