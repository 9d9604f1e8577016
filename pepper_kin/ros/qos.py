"""Quality of service of topics: ROS 2's profiles as values."""

from __future__ import annotations

from dataclasses import dataclass

from pepper_kin.exceptions import InvalidValueError

DEEPEST = 10_000
"""Maximum number of messages in a queue."""


@dataclass(frozen=True)
class QoS:
    """Quality of service of a publisher or a subscription.

    Attributes:
        depth: Number of messages kept for a slow receiver; the oldest are dropped first.
        reliable: Whether lost messages are sent again; otherwise "best effort".
        latched: Whether the last `depth` messages are sent to later subscriptions ("transient local").

    Raises:
        InvalidValueError: for a depth outside 1 to 10,000.
    """

    depth: int = 10
    reliable: bool = True
    latched: bool = False

    def __post_init__(self) -> None:
        if not isinstance(self.depth, int) or not 1 <= self.depth <= DEEPEST:
            raise InvalidValueError("depth", self.depth, f"a whole number from 1 to {DEEPEST}")


RELIABLE = QoS()
"""ROS 2's default profile: `/joint_states`, `/cmd_vel`, trajectories."""

SENSOR_DATA = QoS(depth=5, reliable=False)
"""rmw's sensor-data profile: the newest message counts, losses are acceptable."""

LATCHED = QoS(depth=1, latched=True)
"""Profile of `/tf_static`, `/robot_description`: late subscriptions receive the last message."""

TRANSFORMS = QoS(depth=100)
"""Profile of `/tf`, as of tf2's broadcaster and listener."""

CLOCK = QoS(depth=1, reliable=False)
"""Profile of `/clock`, as of rclcpp's subscription."""
