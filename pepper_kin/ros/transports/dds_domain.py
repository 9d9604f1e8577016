"""DDS domain of a node and how far it reaches: the environment variables of ROS 2."""

from __future__ import annotations

import os

from pepper_kin.exceptions import InvalidValueError

LARGEST_DOMAIN = 232
"""Above it, the ports of DDS would lie beyond 65535."""

LOCALHOST, SUBNET = "LOCALHOST", "SUBNET"
_RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
_RANGES = ("OFF", LOCALHOST, SUBNET, "SYSTEM_DEFAULT")


def domain_number(domain_id: int | None = None) -> int:
    """Return a DDS domain: the one stated, else that of the variable ROS_DOMAIN_ID, else 0.

    Raises:
        InvalidValueError: for a number that is none.
    """
    text = os.environ.get("ROS_DOMAIN_ID", "") if domain_id is None else str(domain_id)
    text = text or "0"
    if not (text.isascii() and text.isdecimal() and len(text) < 10 and int(text) <= LARGEST_DOMAIN):
        name = "ROS_DOMAIN_ID" if domain_id is None else "domain_id"
        raise InvalidValueError(name, repr(text), f"a whole number from 0 to {LARGEST_DOMAIN}")
    return int(text)


def discovery_range() -> str:
    """Return which nodes are discovered: the variable ROS_AUTOMATIC_DISCOVERY_RANGE, else SUBNET.

    Raises:
        InvalidValueError: for a value that ROS 2 does not have.
    """
    text = os.environ.get(_RANGE, "").upper() or SUBNET
    if text not in _RANGES:
        raise InvalidValueError(_RANGE, repr(text), f"one of {', '.join(_RANGES)}")
    return text


def stay_on_this_machine() -> None:
    """Let nodes of this process reach this machine only, where ROS_AUTOMATIC_DISCOVERY_RANGE is not set."""
    if not os.environ.get(_RANGE):
        os.environ[_RANGE] = LOCALHOST
