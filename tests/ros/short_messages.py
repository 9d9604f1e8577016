"""Short ways to messages, for tests."""

from pepper_kin.ros_messages import message_type

ACTION = "control_msgs/action/FollowJointTrajectory"


def trajectory(names, *points, stamp=0.0):
    """JointTrajectory: points are (time, positions, velocities, accelerations), the last two optional."""
    made = message_type("trajectory_msgs/msg/JointTrajectory")(joint_names=list(names))
    made.header.stamp.sec, made.header.stamp.nanosec = int(stamp), int(stamp % 1.0 * 1e9)
    for time, *values in points:
        point = message_type("trajectory_msgs/msg/JointTrajectoryPoint")(
            **dict(zip(("positions", "velocities", "accelerations", "effort"), values, strict=False))
        )
        point.time_from_start.sec = int(time // 1)
        point.time_from_start.nanosec = round(time % 1.0 * 1e9)
        made.points.append(point)
    return made


def goal(message, path=(), end=(), goal_time=0.0):
    """FollowJointTrajectory_Goal: tolerances are (joint, position)."""
    kind = message_type("control_msgs/msg/JointTolerance")
    made = message_type(f"{ACTION}_Goal")(
        trajectory=message,
        path_tolerance=[kind(name=name, position=value) for name, value in path],
        goal_tolerance=[kind(name=name, position=value) for name, value in end],
    )
    made.goal_time_tolerance.sec = int(goal_time // 1)
    made.goal_time_tolerance.nanosec = round(goal_time % 1.0 * 1e9)
    return made
