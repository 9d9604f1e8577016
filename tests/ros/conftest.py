"""A simulated robot as a node of ROS 2: in simulated time, or in real time over rosbridge."""

import pytest

import pepper_kin as pk
from pepper_kin.naoqi.body import Body
from pepper_kin.ros.node import RobotNode
from pepper_kin.ros.transports.local import LocalTransport
from pepper_kin.ros.transports.rosbridge import RosbridgeServer


def wall():
    return pk.Scene().add_box("wall", size=(0.1, 3.0, 1.0), position=(1.5, 0.0, 0.5))


@pytest.fixture
def node():
    """A node before a wall, whose time passes while somebody waits."""
    with LocalTransport() as transport, RobotNode(Body(real_time=False, scene=wall()), transport) as made:
        yield made


@pytest.fixture(scope="module")
def served():
    """A node in real time, served over rosbridge on a free port."""
    with RosbridgeServer(port=0) as server:
        body = Body(scene=wall())
        body.time.start()
        with RobotNode(body, server, resolution="QQVGA") as made:
            yield made
        body.time.stop()
