"""Quality of service of topics: ROS 2's profiles as values."""

from __future__ import annotations

from dataclasses import dataclass

from pepper_kin.exceptions import InvalidValueError

DEEPEST = 10_000
"""Most messages that a queue may hold."""


@dataclass(frozen=True)
class QoS:
    """Quality of service of a publisher or a subscription.

    Attributes:
        depth: Messages kept for a slow receiver, the oldest are dropped first.
        reliable: Lost messages are sent again; otherwise "best effort".
        latched: The last `depth` messages are kept for subscriptions that come later ("transient local").

    Raises:
        InvalidValueError: for a depth outside of 1 to 10,000.
    """

    depth: int = 10
    reliable: bool = True
    latched: bool = False

    def __post_init__(self) -> None:
        if not isinstance(self.depth, int) or not 1 <= self.depth <= DEEPEST:
            raise InvalidValueError("depth", self.depth, f"a whole number from 1 to {DEEPEST}")


RELIABLE = QoS()
"""ROS 2's default: `/joint_states`, `/cmd_vel`, trajectories."""

SENSOR_DATA = QoS(depth=5, reliable=False)
"""rmw's sensor-data profile: the newest counts, losses are acceptable."""

LATCHED = QoS(depth=1, latched=True)
"""`/tf_static`, `/robot_description`: late subscriptions receive the last message."""

TRANSFORMS = QoS(depth=100)
"""`/tf`, as tf2's broadcaster and listener have it."""

CLOCK = QoS(depth=1, reliable=False)
"""`/clock`, as rclcpp subscribes to it."""
