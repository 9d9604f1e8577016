"""A client of roslibpy: PORT JOB -> what it found, as JSON."""

import base64
import json
import sys
import threading
import time

import roslibpy

ACTION = "control_msgs/action/FollowJointTrajectory"


def points(*pairs):
    return [
        {"positions": p, "time_from_start": {"sec": int(t), "nanosec": int(t % 1 * 1e9)}} for t, p in pairs
    ]


def goal(joints, *pairs, path=(), end=(), goal_time=0):
    def tolerances(values):
        return [{"name": joint, "position": value} for joint, value in values]

    return {
        "trajectory": {"joint_names": joints, "points": points(*pairs)},
        "path_tolerance": tolerances(path),
        "goal_tolerance": tolerances(end),
        "goal_time_tolerance": {"sec": 0, "nanosec": int(goal_time * 1e9)},
    }


def act(ros, controller, values, cancel_after=None):
    client = roslibpy.ActionClient(ros, f"/{controller}/follow_joint_trajectory", ACTION)
    done, found, feedback = threading.Event(), {}, []

    def end(result):
        values = result["values"]
        found.update(status=result["status"].value, code=values["error_code"], text=values["error_string"])
        done.set()

    handle = client.send_goal(roslibpy.Goal(values), end, feedback.append, end)
    if cancel_after is not None:
        time.sleep(cancel_after)
        client.cancel_goal(handle)
    assert done.wait(60)
    return {**found, "feedback": len(feedback)}


def topics(ros):
    answer = roslibpy.Service(ros, "/rosapi/topics", "rosapi_msgs/srv/Topics").call(roslibpy.ServiceRequest())
    kinds = dict(zip(answer["topics"], answer["types"], strict=True))
    received = {}
    heard = [roslibpy.Topic(ros, name, kind) for name, kind in kinds.items()]
    for topic in heard:
        topic.subscribe(lambda message, name=topic.name: received.__setitem__(name, message))
    time.sleep(2.5)
    x = received["/odom"]["pose"]["pose"]["position"]["x"]
    drive = roslibpy.Topic(ros, "/cmd_vel", "geometry_msgs/msg/Twist")
    head = roslibpy.Topic(ros, "/joint_angles", "naoqi_bridge_msgs/msg/JointAnglesWithSpeed")
    arm = roslibpy.Topic(ros, "/LeftArm_controller/joint_trajectory", "trajectory_msgs/msg/JointTrajectory")
    head.publish(roslibpy.Message({"joint_names": ["HeadYaw"], "joint_angles": [0.25], "speed": 0.5}))
    arm.publish(roslibpy.Message({"joint_names": ["LElbowYaw"], "points": points((0.5, [-1.0]))}))
    for _ in range(10):
        drive.publish(roslibpy.Message({"linear": {"x": 0.1}}))
        time.sleep(0.1)
    time.sleep(1.0)
    state = received["/joint_states"]
    picture = received["/camera/front/image_raw"]["data"]
    return {
        "received": sorted(received),
        "names": state["name"],
        "joint": state["position"][state["name"].index("HeadYaw")],
        "picture": len(base64.b64decode(picture)),
        "drove": received["/odom"]["pose"]["pose"]["position"]["x"] - x,
    }


def plan(ros):
    service = roslibpy.Service(ros, "/plan_kinematic_path", "moveit_msgs/srv/GetMotionPlan")
    target = {"joint_constraints": [{"joint_name": "HeadYaw", "position": -0.5}]}
    wanted = {"group_name": "head", "goal_constraints": [target], "allowed_planning_time": 60.0}
    planned = service.call(roslibpy.ServiceRequest({"motion_plan_request": wanted}), timeout=100)
    planned = planned["motion_plan_response"]
    trajectory = planned["trajectory"]["joint_trajectory"]
    done = act(ros, "Head_controller", {"trajectory": trajectory})
    return {"val": planned["error_code"]["val"], "points": len(trajectory["points"]), "code": done["code"]}


def actions(ros):
    head = "Head_controller"
    reached = act(ros, head, goal(["HeadYaw"], (1.0, [0.3])))
    canceled = act(ros, head, goal(["HeadYaw"], (5.0, [0.0])), cancel_after=0.7)
    return {
        "reached": reached,
        "feedback": reached["feedback"],
        "canceled": {"status": canceled["status"], "text": canceled["text"]},
        "wrong joints": act(ros, head, goal(["Tail"], (1.0, [0.3]))),
        "path tolerance": act(ros, head, goal(["HeadYaw"], (0.05, [1.8]), path=[("HeadYaw", 0.05)])),
        "goal tolerance": act(
            ros, head, goal(["HeadYaw"], (0.02, [-1.8]), end=[("HeadYaw", 1e-6)], goal_time=0.1)
        ),
    }


JOBS = {
    "topics": topics,
    "actions": actions,
    "plan": plan,
    "left": lambda ros: act(ros, "LeftArm_controller", goal(["LElbowYaw"], (1.5, [-0.8]))),
    "right": lambda ros: act(ros, "RightArm_controller", goal(["RElbowYaw"], (1.5, [0.8]))),
    "die": lambda ros: act(ros, "Head_controller", goal(["HeadYaw"], (0.1, [0.0]), (30.0, [1.9]))),
}

if __name__ == "__main__":
    connection = roslibpy.Ros("127.0.0.1", int(sys.argv[1]))
    connection.run(timeout=30)
    print(json.dumps(JOBS[sys.argv[2]](connection)), flush=True)
    connection.terminate()
