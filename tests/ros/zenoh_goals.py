"""What tests of the transport through Zenoh share: a server of goals, and waiting."""

import time

from pepper_kin.ros import ActionServer
from pepper_kin.ros_messages import action_type

FOLLOW = "control_msgs/action/FollowJointTrajectory"
KINDS = action_type(FOLLOW)


def until(condition, timeout=60.0):
    end = time.monotonic() + timeout
    while not (found := condition()):
        assert time.monotonic() < end, "nothing came"
        time.sleep(0.01)
    return found


class Server(ActionServer):
    """The joints' names say how goals end."""

    def on_goal(self, goal):
        return "wrong" not in goal.trajectory.joint_names

    def on_cancel(self, goal):
        return "stubborn" not in goal.goal.trajectory.joint_names

    def execute(self, goal):
        names, result = goal.goal.trajectory.joint_names, KINDS.result()
        for index in range(1500):
            goal.publish_feedback(KINDS.feedback(joint_names=names, index=index))
            time.sleep(0.01)
            if goal.cancel_requested:
                result.error_string = "stopped"
                goal.canceled(result)
                return
            if index == 5 and "long" not in names:
                break
        if "failing" in names:
            raise RuntimeError("a failing server")
        result.error_string = "done"
        goal.succeed(result)


def goal_of(*names):
    goal = KINDS.goal()
    goal.trajectory.joint_names = list(names)
    return goal
