"""The planning service: its trajectories against forward kinematics, and its reasons."""

import numpy as np
import pytest

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.kinematics import frame_pose
from pepper_kin.naoqi.joint_names import LEFT_ARM
from pepper_kin.ros.planning import CODES, SERVICE, TYPE
from pepper_kin.ros_messages import message_type


def constraint(kind, **fields):
    return message_type(f"moveit_msgs/msg/{kind}")(**fields)


def ask(node, group, *, joints=None, link=None, point=None, frame="world", **fields):
    goal = constraint("Constraints")
    for name, value in (joints or {}).items():
        goal.joint_constraints.append(constraint("JointConstraint", joint_name=name, position=value))
    if link is not None:
        position = constraint("PositionConstraint", link_name=link)
        position.header.frame_id = frame
        pose = message_type("geometry_msgs/msg/Pose")()
        pose.position.x, pose.position.y, pose.position.z = (float(x) for x in point)
        position.constraint_region.primitive_poses.append(pose)
        goal.position_constraints.append(position)
    request = message_type(f"{TYPE}_Request")()
    wanted = request.motion_plan_request
    wanted.group_name, wanted.goal_constraints, wanted.allowed_planning_time = group, [goal], 60.0
    for name, value in fields.items():
        setattr(wanted, name, value)
    return node.transport.call_service(SERVICE, TYPE, request).motion_plan_response


@pytest.mark.thorough
def test_a_link_arrives_at_a_point_in_a_frame_of_the_robot(node):
    answer = ask(node, "left_arm", link="LArm_effector", point=(0.3, 0.25, 0.85), frame="base_footprint")
    assert answer.error_code.val == CODES.SUCCESS, answer.error_code.message
    trajectory = answer.trajectory.joint_trajectory
    assert trajectory.joint_names == list(LEFT_ARM[:-1])
    pepper, q = node.body.pepper, node.body.configuration(False)
    for name, value in zip(trajectory.joint_names, trajectory.points[-1].positions, strict=True):
        q[pepper.joint_index(name)] = value
    np.testing.assert_allclose(frame_pose(pepper, q, "LArm_effector")[:3, 3], [0.3, 0.25, 0.85], atol=2e-3)
    assert not np.any(trajectory.points[-1].velocities)
    assert answer.error_code.source == "pepper_kin"


@pytest.mark.thorough
def test_scales_of_velocity_make_it_slower(node):
    def duration(scale):
        answer = ask(node, "head", joints={"HeadYaw": 1.0}, max_velocity_scaling_factor=scale)
        time = answer.trajectory.joint_trajectory.points[-1].time_from_start
        return time.sec + 1e-9 * time.nanosec

    assert duration(0.1) > 3.0 * duration(1.0)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("request_", "code", "words"),
    [
        ({"group": "tail", "joints": {"HeadYaw": 0.1}}, "INVALID_GROUP_NAME", "tail"),
        ({"group": "head", "joints": {"LHand": 0.1}}, "INVALID_GOAL_CONSTRAINTS", "'LHand'"),
        ({"group": "head"}, "INVALID_GOAL_CONSTRAINTS", "a goal has"),
        ({"group": "head", "joints": {"HeadYaw": 9.0}}, "PLANNING_FAILED", "HeadYaw"),
        ({"group": "", "link": "Tail", "point": (0, 0, 0)}, "INVALID_LINK_NAME", "'Tail'"),
        (
            {"group": "left_arm", "link": "LArm_effector", "point": (0, 0, 0), "frame": "moon"},
            "FRAME_TRANSFORM_FAILURE",
            "moon",
        ),
        (
            {
                "group": "left_arm",
                "link": "LArm_effector",
                "point": (3.0, 0.0, 1.0),
                "allowed_planning_time": 1.0,
            },
            "NO_IK_SOLUTION",
            "Move the target",
        ),
    ],
)
def test_reasons(node, request_, code, words):
    answer = ask(node, **request_)
    assert answer.error_code.val == getattr(CODES, code), answer.error_code
    assert words in answer.error_code.message
    assert not answer.trajectory.joint_trajectory.points


def test_a_request_of_another_type(node):
    with pytest.raises(InvalidValueError, match="request of"):
        node.transport.call_service(SERVICE, TYPE, message_type("std_msgs/msg/Empty")())
