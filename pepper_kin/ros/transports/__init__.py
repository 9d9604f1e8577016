"""Transports of messages.

LocalTransport                            within this program
RosbridgeServer, RosbridgeClient          JSON over web sockets
RclpyTransport, CycloneTransport, ZenohTransport   the ROS 2 graph, by one of three libraries
DEFAULT_PORT                              TCP port of rosbridge
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from pepper_kin.lazy_names import lazily

if TYPE_CHECKING:
    from pepper_kin.ros.transports.cyclonedds import CycloneTransport
    from pepper_kin.ros.transports.local import LocalTransport
    from pepper_kin.ros.transports.rclpy import RclpyTransport
    from pepper_kin.ros.transports.rosbridge import DEFAULT_PORT, RosbridgeServer
    from pepper_kin.ros.transports.rosbridge_client import RosbridgeClient
    from pepper_kin.ros.transports.zenoh import ZenohTransport

__all__ = [
    "DEFAULT_PORT",
    "CycloneTransport",
    "LocalTransport",
    "RclpyTransport",
    "RosbridgeClient",
    "RosbridgeServer",
    "ZenohTransport",
]

__getattr__, __dir__ = lazily(__name__)
