"""ROS 2 without ROS: transports of messages between programs.

RobotNode                                 a simulated Pepper as a node, over any transport
RobotClient, FollowResult                 certified motions on any robot with `follow_joint_trajectory`
BagRecorder, play_bag                     recording of topics as MCAP files, and playback
LocalTransport                            within this program
RosbridgeServer, RosbridgeClient          JSON over web sockets
Transport                                 interface of all transports
Publisher, ActionServer, ServerGoal, GoalHandle, GoalResult, GoalStatus   arguments and results of a transport
QoS, RELIABLE, SENSOR_DATA, LATCHED, TRANSFORMS, CLOCK   quality of service
TransportError                            error of a transport
"""

from typing import TYPE_CHECKING

from pepper_kin.lazy_names import lazily

if TYPE_CHECKING:
    from pepper_kin.ros.bag_topics import BagRecorder, play_bag
    from pepper_kin.ros.client import FollowResult, RobotClient
    from pepper_kin.ros.errors import TransportError
    from pepper_kin.ros.node import RobotNode
    from pepper_kin.ros.qos import CLOCK, LATCHED, RELIABLE, SENSOR_DATA, TRANSFORMS, QoS
    from pepper_kin.ros.transport import (
        ActionServer,
        GoalHandle,
        GoalResult,
        GoalStatus,
        Publisher,
        ServerGoal,
        Transport,
    )
    from pepper_kin.ros.transports.local import LocalTransport
    from pepper_kin.ros.transports.rosbridge import RosbridgeServer
    from pepper_kin.ros.transports.rosbridge_client import RosbridgeClient

__all__ = [
    "CLOCK",
    "LATCHED",
    "RELIABLE",
    "SENSOR_DATA",
    "TRANSFORMS",
    "ActionServer",
    "BagRecorder",
    "FollowResult",
    "GoalHandle",
    "GoalResult",
    "GoalStatus",
    "LocalTransport",
    "Publisher",
    "QoS",
    "RobotClient",
    "RobotNode",
    "RosbridgeClient",
    "RosbridgeServer",
    "ServerGoal",
    "Transport",
    "TransportError",
    "play_bag",
]

__getattr__, __dir__ = lazily(__name__)
