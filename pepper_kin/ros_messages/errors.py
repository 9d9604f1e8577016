"""Errors of messages that cannot be read."""

from __future__ import annotations

from pepper_kin.exceptions import PepperKinError, shortened


class MessageError(PepperKinError):
    """Bytes, or the text of a definition, that are no valid message.

    Attributes:
        type_name: The message type, such as `sensor_msgs/msg/JointState`.
        reason: Reason, with the position in bytes if it is known.
    """

    def __init__(self, type_name: str, reason: str) -> None:
        self.type_name, self.reason = type_name, reason
        super().__init__(f"{shortened(type_name)}: {shortened(reason)}")
