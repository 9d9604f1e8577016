"""MoveIt's services of kinematics, against Pinocchio's forward kinematics."""

import numpy as np
import pinocchio as pin
import pytest

from pepper_kin.model import rotation_from_quaternion
from pepper_kin.ros.kinematics_services import (
    CARTESIAN_PATH,
    COMPUTE_FK,
    COMPUTE_IK,
    FK_TYPE,
    IK_TYPE,
    PATH_TYPE,
)
from pepper_kin.ros.message_parts import pose_message
from pepper_kin.ros.planning import CODES
from pepper_kin.ros_messages import message_type


def stamped(pose, frame="world"):
    made = message_type("geometry_msgs/msg/PoseStamped")(pose=pose_message(pose))
    made.header.frame_id = frame
    return made


def matrix(pose):
    p, o, made = pose.position, pose.orientation, np.eye(4)
    made[:3, :3], made[:3, 3] = rotation_from_quaternion(np.array([o.x, o.y, o.z, o.w])), (p.x, p.y, p.z)
    return made


def link_pose(node, names, positions, link):
    pepper = node.body.pepper
    q = node.body.configuration(False)
    q[[pepper.joint_index(name) for name in names]] = positions
    model, full = pepper.pinocchio_model, pepper.full_map @ q + pepper.full_offset
    data = model.createData()
    pin.framesForwardKinematics(model, data, full)
    return data.oMf[model.getFrameId(link)].homogeneous


def solve(node, **fields):
    request = message_type(f"{IK_TYPE}_Request")()
    for name, value in fields.items():
        setattr(request.ik_request, name, value)
    return node.transport.call_service(COMPUTE_IK, IK_TYPE, request)


@pytest.mark.thorough
def test_links_are_where_pinocchio_has_them(node):
    request = message_type(f"{FK_TYPE}_Request")()
    request.fk_link_names = ["LArm_effector", "Head"]
    request.robot_state.joint_state.name = ["HipPitch", "LShoulderPitch"]
    request.robot_state.joint_state.position = [-0.3, 0.5]
    node.body.place_base(np.array([0.4, -0.2, 0.6]))
    for frame in ("", "torso", "base_footprint"):
        request.header.frame_id = frame
        answer = node.transport.call_service(COMPUTE_FK, FK_TYPE, request)
        assert answer.error_code.val == CODES.SUCCESS, answer.error_code.message
        for link, one in zip(answer.fk_link_names, answer.pose_stamped, strict=True):
            state = request.robot_state.joint_state
            expected = link_pose(node, state.name, state.position, link)
            if frame:
                expected = np.linalg.inv(link_pose(node, state.name, state.position, frame)) @ expected
            np.testing.assert_allclose(matrix(one.pose), expected, atol=1e-9)
            assert one.header.frame_id == (frame or "world")


@pytest.mark.thorough
def test_a_solution_puts_links_where_they_are_asked_for(node):
    target = np.eye(4)
    target[:3, 3] = 0.3, 0.25, 0.85
    position = stamped(target, "base_footprint")
    position.pose.orientation.w = 0.0
    answer = solve(node, group_name="left_arm", pose_stamped=position, avoid_collisions=True)
    assert answer.error_code.val == CODES.SUCCESS, answer.error_code.message
    state = answer.solution.joint_state
    reached = link_pose(node, state.name, state.position, "LArm_effector")
    np.testing.assert_allclose(reached[:3, 3], target[:3, 3], atol=1e-3)
    before = node.body.configuration(False)
    moved = [n for n, p in zip(state.name, state.position, strict=True) if p != before[node.body.index[n]]]
    assert set(moved) <= set(node.body.pepper.joint_group("left_arm"))
    both = solve(
        node,
        ik_link_names=["LArm_effector", "RArm_effector"],
        pose_stamped_vector=[stamped(reached), stamped(link_pose(node, [], [], "RArm_effector"))],
    )
    assert both.error_code.val == CODES.SUCCESS, both.error_code.message
    state = both.solution.joint_state
    np.testing.assert_allclose(
        link_pose(node, state.name, state.position, "LArm_effector"), reached, atol=2e-2
    )


@pytest.mark.thorough
def test_what_cannot_be_answered_has_its_code(node):
    far = np.eye(4)
    far[:3, 3] = 3.0, 0.0, 0.0
    for fields, code in (
        ({"group_name": "left_arm", "pose_stamped": stamped(far)}, CODES.NO_IK_SOLUTION),
        ({"group_name": "tail", "pose_stamped": stamped(far)}, CODES.INVALID_GROUP_NAME),
        ({"pose_stamped": stamped(far)}, CODES.INVALID_LINK_NAME),
        ({"ik_link_name": "tail", "pose_stamped": stamped(far)}, CODES.INVALID_LINK_NAME),
        ({"ik_link_name": "Head", "pose_stamped": stamped(far, "moon")}, CODES.FRAME_TRANSFORM_FAILURE),
        ({"ik_link_names": ["Head"]}, CODES.INVALID_LINK_NAME),
    ):
        answer = solve(node, **fields)
        assert answer.error_code.val == code
        assert answer.error_code.message
        assert not answer.solution.joint_state.name
    request = message_type(f"{FK_TYPE}_Request")(fk_link_names=["Head", "tail"])
    answer = node.transport.call_service(COMPUTE_FK, FK_TYPE, request)
    assert (answer.error_code.val, answer.pose_stamped) == (CODES.INVALID_LINK_NAME, [])


def lead(node, way, **fields):
    request = message_type(f"{PATH_TYPE}_Request")(group_name="left_arm", max_step=0.005)
    here = np.linalg.inv(link_pose(node, [], [], "base_footprint")) @ link_pose(node, [], [], "LArm_effector")
    for step in way:
        here = here.copy()
        here[:3, 3] += step
        request.waypoints.append(pose_message(here))
    request.header.frame_id = "base_footprint"
    for name, value in fields.items():
        setattr(request, name, value)
    return here, node.transport.call_service(CARTESIAN_PATH, PATH_TYPE, request)


@pytest.mark.thorough
def test_a_hand_is_led_along_lines(node):
    end, answer = lead(node, [(0.0, 0.05, 0.03), (0.0, -0.02, 0.05)])
    assert answer.error_code.val == CODES.SUCCESS, answer.error_code.message
    assert answer.fraction == pytest.approx(1.0)
    trajectory = answer.solution.joint_trajectory
    assert set(trajectory.joint_names) <= set(node.body.pepper.joint_group("left_arm"))
    reached = link_pose(node, trajectory.joint_names, trajectory.points[-1].positions, "LArm_effector")
    base = link_pose(node, [], [], "base_footprint")
    np.testing.assert_allclose((np.linalg.inv(base) @ reached)[:3, 3], end[:3, 3], atol=1.1e-3)
    _, slow = lead(node, [(0.0, 0.05, 0.03)], max_cartesian_speed=0.01)
    assert slow.solution.joint_trajectory.points[-1].time_from_start.sec >= 5
    _, partly = lead(node, [(0.0, 0.0, 1.5)])
    assert partly.error_code.val == CODES.SUCCESS
    assert 0.0 < partly.fraction < 1.0
    assert "left hand stops after" in partly.error_code.message
    for fields, code in (
        ({"link_name": "Head"}, CODES.INVALID_LINK_NAME),
        ({"waypoints": []}, CODES.FAILURE),
    ):
        assert lead(node, [(0.0, 0.0, 0.1)], **fields)[1].error_code.val == code
