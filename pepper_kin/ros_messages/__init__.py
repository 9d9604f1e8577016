"""ROS 2's messages without ROS: classes, their bytes, JSON values and type hashes.

message_type, service_type, action_type   classes by name, such as "sensor_msgs/msg/JointState"
Message, ServiceType, ActionType          returned classes
encode, decode                            messages as bytes (CDR) and back
type_hash                                 the hash by which ROS 2 distinguishes versions of a type
message_names, interface_names            names of all types
BagWriter, Bag, BagMessage                recordings of messages: MCAP files of `ros2 bag` and Foxglove
MessageError                              error for bytes that are no valid message
"""

from pepper_kin.ros_messages.bags import Bag, BagMessage, BagWriter
from pepper_kin.ros_messages.cdr import decode, encode
from pepper_kin.ros_messages.definitions import interface_names, message_names
from pepper_kin.ros_messages.errors import MessageError
from pepper_kin.ros_messages.messages import (
    ActionType,
    Message,
    ServiceType,
    action_type,
    message_type,
    service_type,
)
from pepper_kin.ros_messages.type_hashes import type_hash

__all__ = [
    "ActionType",
    "Bag",
    "BagMessage",
    "BagWriter",
    "Message",
    "MessageError",
    "ServiceType",
    "action_type",
    "decode",
    "encode",
    "interface_names",
    "message_names",
    "message_type",
    "service_type",
    "type_hash",
]
