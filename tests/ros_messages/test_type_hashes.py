"""Type hashes are those of ROS 2 Kilted, as its packages state them."""

from pathlib import Path

import pytest

from pepper_kin.exceptions import UnknownNameError
from pepper_kin.ros_messages import interface_names, message_names, type_hash

LINES = (Path(__file__).parent / "data" / "type_hashes_kilted.txt").read_text("utf-8").splitlines()
EXPECTED = dict(line.split() for line in LINES)
NOT_LISTED = {
    "naoqi_bridge_msgs", "moveit_msgs", "object_recognition_msgs", "diagnostic_msgs", "shape_msgs",
    "controller_manager_msgs", "octomap_msgs",
}  # fmt: skip
"""Packages that are no part of the list."""

NOT_LISTED_TYPES = {"control_msgs/msg/JointTrajectoryControllerState"}


def test_hashes_are_those_of_kilted():
    for name in EXPECTED:
        assert type_hash(name) == EXPECTED[name]


def test_every_type_of_the_packages_listed_is_compared():
    names = {*message_names(), *interface_names("srv"), *interface_names("action")}
    left = {name for name in names - set(EXPECTED) if name.split("/")[0] not in NOT_LISTED}
    assert left == NOT_LISTED_TYPES
    assert len(EXPECTED) > 100


def test_short_names_are_the_same_type_and_unknown_ones_are_refused():
    assert type_hash("std_msgs/String") == type_hash("std_msgs/msg/String")
    with pytest.raises(UnknownNameError, match="std_msgs/msg/String"):
        type_hash("std_msgs/msg/Strin")
