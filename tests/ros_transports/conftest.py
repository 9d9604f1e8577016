"""Programs with a real ROS 2, in an environment that is made once."""

import pytest
import ros_environment
from peers import Peer


@pytest.fixture(scope="session")
def ros_python():
    """The interpreter of the environment with ROS 2."""
    try:
        return ros_environment.environment()
    except ros_environment.NotAvailableError as error:
        pytest.skip(f"the wheels of ROS 2 cannot be had here: {error}")


@pytest.fixture(scope="module")
def peer(ros_python):
    """A program with rclpy only."""
    made = Peer(ros_python, "rclpy_peer.py")
    yield made
    made.end()


@pytest.fixture(scope="module", params=["rclpy", "cyclonedds"])
def either(request, ros_python):
    """A program with one of our transports."""
    made = Peer(ros_python, "transport_peer.py", request.param)
    yield made
    made.end()


@pytest.fixture(scope="module")
def ours(ros_python):
    """A program with our transport through rclpy."""
    made = Peer(ros_python, "transport_peer.py", "rclpy")
    yield made
    made.end()
