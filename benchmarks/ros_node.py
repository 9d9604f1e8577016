"""Costs of messages, and cycles of the ROS 2 node while a rosbridge client listens to everything.

Asked are 50 us for a joint state and 1 ms for a QVGA picture (made and written as JSON), and 3 ms for the
99th percentile of the delay of the 50 Hz cycle.  How late cycles begin depends on what else the machine
does; what a cycle computes, in processor time of its thread, hardly does.

Run: python benchmarks/ros_node.py [seconds]
"""

import subprocess
import sys
import time
from collections.abc import Callable

import numpy as np

from pepper_kin.naoqi.body import Body
from pepper_kin.ros import RobotNode, RosbridgeServer
from pepper_kin.ros.sensor_messages import CameraMessages
from pepper_kin.ros.state_messages import StateMessages
from pepper_kin.ros_messages import encode
from pepper_kin.ros_messages.json_text import to_json

LISTENING = """
import json, sys, time
from tornado.ioloop import IOLoop
from tornado.websocket import websocket_connect

async def listen():
    socket = await websocket_connect(sys.argv[1])
    await socket.write_message('{"op": "call_service", "service": "/rosapi/topics"}')
    for topic in json.loads(await socket.read_message())["values"]["topics"]:
        await socket.write_message(json.dumps({"op": "subscribe", "topic": topic}))
    end, count = time.time() + float(sys.argv[2]), 0
    while time.time() < end:
        await socket.read_message()
        count += 1
    print(count / float(sys.argv[2]))

IOLoop.current().run_sync(listen)
"""


def median(call: Callable[[], object], count: int) -> float:
    """Return the median of what calls cost [us]."""
    spent = []
    for _ in range(count):
        begin = time.perf_counter()
        call()
        spent.append(time.perf_counter() - begin)
    return 1e6 * float(np.median(spent))


def main(seconds: float) -> None:
    """Print the figures."""
    body = Body(real_time=False)
    body.time.sleep(0.1)
    states, camera = StateMessages(body), CameraMessages(body, "front")
    picture, odometry = camera.picture(), np.zeros(3)
    for name, make, count in (
        ("joint state", lambda: states.joint_states(1.0), 5000),
        ("transforms", lambda: states.moving_transforms(1.0, odometry), 1000),
        ("QVGA picture", lambda: camera.image(picture, 1.0), 1000),
    ):
        message = make()
        costs = (median(make, count), median(lambda m=message: to_json(m), count))
        binary = median(lambda m=message: encode(m), count)
        print(f"{name}: made {costs[0]:.1f} us, as JSON {costs[1]:.1f} us, as bytes {binary:.1f} us")
    print(f"drawing of a QVGA picture: {median(camera.picture, 20) / 1e3:.2f} ms")

    for cameras in ((), ("front",), ("front", "bottom", "depth")):
        print(f"cameras {', '.join(cameras) or 'none'}: {cycles(cameras, seconds)}", flush=True)


def cycles(cameras: tuple[str, ...], seconds: float) -> str:
    """Return how late the cycles begin while a client listens to everything for some time [s]."""
    body = Body()
    body.time.start()
    with RosbridgeServer(port=0) as server, RobotNode(body, server, cameras=cameras):
        body.time.sleep(1.0)
        computed, cycle = [], body.time._on_cycle

        def timed() -> None:
            begin = time.thread_time()
            cycle()
            computed.append(time.thread_time() - begin)

        body.time._on_cycle = timed
        body.time.delays.clear()
        client = subprocess.run(
            [sys.executable, "-c", LISTENING, server.url, str(seconds)],
            capture_output=True, text=True, check=True,
        )  # fmt: skip
        late = 1e3 * np.array(body.time.delays)
    body.time.stop()
    return (
        f"{float(client.stdout):.0f} messages a second; the cycle begins late by {np.median(late):.2f} ms "
        f"in the median, {np.percentile(late, 99):.2f} ms at the 99th percentile, and computes "
        f"{1e3 * np.median(computed):.2f} ms"
    )


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 10.0)
