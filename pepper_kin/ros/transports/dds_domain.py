"""DDS domain and discovery range of a node, from the environment variables of ROS 2."""

from __future__ import annotations

import os

from pepper_kin.exceptions import InvalidValueError

LARGEST_DOMAIN = 232
"""Maximum DDS domain: for larger ones, ports would exceed 65535."""

LOCALHOST, SUBNET = "LOCALHOST", "SUBNET"
_RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
_RANGES = ("OFF", LOCALHOST, SUBNET, "SYSTEM_DEFAULT")


def domain_number(domain_id: int | None = None) -> int:
    """Return a DDS domain: the given one, else the variable ROS_DOMAIN_ID, else 0.

    Raises:
        InvalidValueError: for a number that is not a domain.
    """
    text = os.environ.get("ROS_DOMAIN_ID", "") if domain_id is None else str(domain_id)
    text = text or "0"
    if not (text.isascii() and text.isdecimal() and len(text) < 10 and int(text) <= LARGEST_DOMAIN):
        name = "ROS_DOMAIN_ID" if domain_id is None else "domain_id"
        raise InvalidValueError(name, repr(text), f"a whole number from 0 to {LARGEST_DOMAIN}")
    return int(text)


def discovery_range() -> str:
    """Return the discovery range of nodes: the variable ROS_AUTOMATIC_DISCOVERY_RANGE, else SUBNET.

    Raises:
        InvalidValueError: for a value unknown to ROS 2.
    """
    text = os.environ.get(_RANGE, "").upper() or SUBNET
    if text not in _RANGES:
        raise InvalidValueError(_RANGE, repr(text), f"one of {', '.join(_RANGES)}")
    return text


def stay_on_this_machine() -> None:
    """Limit nodes of this process to this machine, unless ROS_AUTOMATIC_DISCOVERY_RANGE is set."""
    if not os.environ.get(_RANGE):
        os.environ[_RANGE] = LOCALHOST
