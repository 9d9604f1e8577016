"""Start states of MoveIt's services: what does not fit is refused by name, nothing is moved or left out."""

import re

import numpy as np
import pytest

from pepper_kin.kinematics import frame_pose
from pepper_kin.naoqi.body import Body
from pepper_kin.ros import LocalTransport, RobotNode
from pepper_kin.ros.joint_trajectory import TrajectoryRefusedError, refuse_other_parts
from pepper_kin.ros_messages import action_type, message_type

CODES = message_type("moveit_msgs/msg/MoveItErrorCodes")
STATE = message_type("moveit_msgs/msg/RobotState")
JOINTS = message_type("sensor_msgs/msg/JointState")


@pytest.fixture(scope="module")
def node():
    with LocalTransport() as transport, RobotNode(Body(real_time=False), transport, cameras=()) as made:
        yield made


def state(names=(), positions=(), **parts):
    return STATE(joint_state=JOINTS(name=list(names), position=list(positions)), **parts)


def forward(node, robot_state):
    request = message_type("moveit_msgs/srv/GetPositionFK_Request")(fk_link_names=["LArm_effector"])
    request.robot_state = robot_state
    return node.transport.call_service("/compute_fk", "moveit_msgs/srv/GetPositionFK", request, 60.0)


def planned(node, robot_state, goals=(("LShoulderPitch", 1.0),), **parts):
    kind = message_type("moveit_msgs/msg/JointConstraint")
    wanted = [
        kind(joint_name=name, position=value, tolerance_above=0.01, tolerance_below=0.01, weight=1.0)
        for name, value in goals
    ]
    request = message_type("moveit_msgs/srv/GetMotionPlan_Request")()
    asked = request.motion_plan_request
    asked.group_name, asked.start_state = "left_arm", robot_state
    asked.goal_constraints = [message_type("moveit_msgs/msg/Constraints")(joint_constraints=wanted)]
    for name, value in parts.items():
        setattr(asked, name, value)
    found = node.transport.call_service(
        "/plan_kinematic_path", "moveit_msgs/srv/GetMotionPlan", request, 60.0
    )
    return found.motion_plan_response


def test_the_node_s_own_joint_states_are_a_start_state(node):
    """With the wheels, as `/joint_states` has them."""
    heard = []
    subscription = node.transport.listen("/joint_states", "sensor_msgs/msg/JointState", heard.append)
    node.body.time.sleep(0.1)
    node.transport.flush()
    subscription.close()
    own = STATE(joint_state=heard[-1])
    assert "WheelFL" in own.joint_state.name
    found = forward(node, own)
    assert found.error_code.val == CODES.SUCCESS
    pepper = node.body.pepper
    known = dict(zip(own.joint_state.name, own.joint_state.position.tolist(), strict=True))
    q = np.array([known.get(name, 0.0) for name in pepper.joint_names])
    place = found.pose_stamped[0].pose.position
    expected = frame_pose(pepper, q, "LArm_effector")[:3, 3]
    np.testing.assert_allclose((place.x, place.y, place.z), expected, atol=1e-6)
    assert planned(node, own).error_code.val == CODES.SUCCESS


def test_a_plan_begins_where_the_request_says(node):
    found = planned(node, state(["LShoulderPitch"], [1.3]))
    assert found.error_code.val == CODES.SUCCESS
    trajectory = found.trajectory.joint_trajectory
    first = dict(zip(trajectory.joint_names, trajectory.points[0].positions.tolist(), strict=True))
    assert first["LShoulderPitch"] == pytest.approx(1.3, abs=1e-9)


@pytest.mark.parametrize(
    ("start", "code", "reason"),
    [
        (state(["LShoulderPitch"], [5.0]), CODES.START_STATE_INVALID, "at 5 .* limits -2.08567 and 2.08567"),
        (state(["LShoulderPitch"], [2.1]), CODES.START_STATE_INVALID, "LShoulderPitch is at 2.1"),
        (state(["LShoulderPitch"], [np.nan]), CODES.INVALID_ROBOT_STATE, "LShoulderPitch is at nan"),
        (state(["LShoulderPitch", "HeadYaw"], [0.5]), CODES.INVALID_ROBOT_STATE, "1 positions for 2"),
        (state(["HeadYaw", "HeadYaw"], [0.5, 0.1]), CODES.INVALID_ROBOT_STATE, "for 1 different joints of 2"),
        (state(["Nose"], [0.5]), CODES.INVALID_ROBOT_STATE, "no joint 'Nose'"),
        (
            state(multi_dof_joint_state=message_type("sensor_msgs/msg/MultiDOFJointState")(joint_names=["w"])),
            CODES.INVALID_ROBOT_STATE,
            "multi_dof_joint_state",
        ),
        (
            state(
                attached_collision_objects=[
                    message_type("moveit_msgs/msg/AttachedCollisionObject")(
                        object=message_type("moveit_msgs/msg/CollisionObject")(id="cup")
                    )
                ]
            ),
            CODES.INVALID_ROBOT_STATE,
            "does not hold 'cup'",
        ),
    ],
)  # fmt: skip
def test_a_state_that_does_not_fit_is_refused_by_name(node, start, code, reason):
    for found in (forward(node, start), planned(node, start)):
        assert found.error_code.val == code
        assert re.search(reason, found.error_code.message), found.error_code.message


def test_constraints_that_are_not_kept_are_refused(node):
    twice = planned(node, state(), goals=(("LShoulderPitch", 1.0), ("LShoulderPitch", 0.5)))
    assert (twice.error_code.val, "has 2 constraints" in twice.error_code.message) == (
        CODES.INVALID_GOAL_CONSTRAINTS,
        True,
    )
    held = message_type("moveit_msgs/msg/Constraints")(
        joint_constraints=[message_type("moveit_msgs/msg/JointConstraint")(joint_name="HeadYaw")]
    )
    path = planned(node, state(), path_constraints=held)
    assert "path_constraints has joint_constraints" in path.error_code.message
    kind = message_type("moveit_msgs/srv/GetPositionIK_Request")
    request = kind()
    request.ik_request.group_name, request.ik_request.constraints = "left_arm", held
    found = node.transport.call_service("/compute_ik", "moveit_msgs/srv/GetPositionIK", request, 60.0)
    assert found.error_code.val == CODES.INVALID_GOAL_CONSTRAINTS


def test_parts_of_a_goal_that_are_not_followed_are_refused():
    goal = action_type("control_msgs/action/FollowJointTrajectory").goal()
    refuse_other_parts(goal)
    goal.component_path_tolerance = [message_type("control_msgs/msg/JointComponentTolerance")()]
    with pytest.raises(TrajectoryRefusedError, match="it has a component_path_tolerance"):
        refuse_other_parts(goal)
