"""A client of roslibpy: PORT JOB [POSITION] -> what it found, as JSON."""

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


def until(condition, timeout=30.0):
    """Wait for a condition, or for the time [s]; the assertion of the test says what is missing."""
    end = time.monotonic() + timeout
    while not condition() and time.monotonic() < end:
        time.sleep(0.05)


def topics(ros):
    answer = roslibpy.Service(ros, "/rosapi/topics", "rosapi_msgs/srv/Topics").call(roslibpy.ServiceRequest())
    kinds = dict(zip(answer["topics"], answer["types"], strict=True))
    received = {}
    heard = [roslibpy.Topic(ros, name, kind) for name, kind in kinds.items()]
    for topic in heard:
        topic.subscribe(lambda message, name=topic.name: received.__setitem__(name, message))
    time.sleep(2.5)

    def place():
        return received["/odom"]["pose"]["pose"]["position"]["x"]

    def joint(name):
        state = received["/joint_states"]
        return state["position"][state["name"].index(name)]

    head = roslibpy.Topic(ros, "/joint_angles", "naoqi_bridge_msgs/msg/JointAnglesWithSpeed")
    head.publish(roslibpy.Message({"joint_names": ["HeadYaw"], "joint_angles": [0.25], "speed": 0.5}))
    for topic, name, angle in (
        ("/LeftArm_controller/joint_trajectory", "LElbowYaw", -1.0),
        ("/pepper_robot/joint_trajectory", "RElbowYaw", 1.0),
    ):
        arm = roslibpy.Topic(ros, topic, "trajectory_msgs/msg/JointTrajectory")
        arm.publish(roslibpy.Message({"joint_names": [name], "points": points((0.5, [angle]))}))
    until(lambda: abs(joint("LElbowYaw") + 1.0) + abs(joint("RElbowYaw") - 1.0) < 0.01)
    until(lambda: abs(joint("HeadYaw") - 0.25) < 0.005)

    def driven(drive, message):
        x = place()

        def has_moved():
            drive.publish(roslibpy.Message(message))
            return place() - x > 0.03

        until(has_moved)  # a loaded machine gives some seconds no driving at all
        time.sleep(1.0)
        return place() - x

    drove = []
    plain = {"linear": {"x": 0.1}}
    for topic, kind, message in (
        ("/cmd_vel", "Twist", plain),
        ("/model/pepper_robot/cmd_vel", "Twist", plain),
        ("/cmd_vel", "TwistStamped", {"header": {"frame_id": "base_link"}, "twist": plain}),
    ):
        drive = roslibpy.Topic(ros, topic, f"geometry_msgs/msg/{kind}")
        drove.append(driven(drive, message))
        drive.unadvertise()
    x = place()
    goal = {"header": {"frame_id": "base_footprint"}, "pose": {"position": {"x": -0.1}}}
    goal["pose"]["orientation"] = {"w": 1.0}
    base = roslibpy.Topic(ros, "/move_base_simple/goal", "geometry_msgs/msg/PoseStamped")
    base.publish(roslibpy.Message(goal))
    until(lambda: place() - x < -0.05)
    time.sleep(1.5)
    return {
        "received": sorted(received),
        "names": received["/joint_states"]["name"],
        "joints": [joint(name) for name in ("HeadYaw", "LElbowYaw", "RElbowYaw")],
        "picture": len(base64.b64decode(received["/camera/front/image_raw"]["data"])),
        "drove": drove,
        "base": place() - x,
    }


def follow(ros):
    """Let the left palm follow a position in base_footprint."""
    x, y, z = json.loads(sys.argv[3])
    target = {"position": {"x": x, "y": y, "z": z}, "orientation": {"w": 1.0}}
    topic = roslibpy.Topic(ros, "/pepper_robot/follow_target/left", "geometry_msgs/msg/PoseStamped")
    for _ in range(40):
        topic.publish(roslibpy.Message({"header": {"frame_id": "base_footprint"}, "pose": target}))
        time.sleep(0.1)
    return {}


def touched(ros):
    """Hear every sensor of touch pressed and released."""
    found = {name: set() for name in ("bumper", "head_touch", "hand_touch")}
    heard = [
        roslibpy.Topic(ros, f"/{name}", f"naoqi_bridge_msgs/msg/{kind}")
        for name, kind in zip(found, ("Bumper", "HeadTouch", "HandTouch"), strict=True)
    ]
    for topic in heard:
        topic.subscribe(lambda message, name=topic.name[1:]: found[name].add(tuple(message.items())))
    time.sleep(0.5)
    print("listening", flush=True)
    touched = {"bumper": ("bumper", 2), "head_touch": ("button", 2), "hand_touch": ("hand", 3)}
    wanted = [
        (name, {key: sensor, "state": state}) for name, (key, sensor) in touched.items() for state in (0, 1)
    ]
    until(lambda: all(entry in map(dict, list(found[name])) for name, entry in wanted), 120.0)
    return {name: sorted(map(dict, states), key=str) for name, states in found.items()}


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
    replaced = []
    thread = threading.Thread(
        target=lambda: replaced.append(act(ros, head, goal(["HeadYaw"], (6.0, [-0.5]))))
    )
    thread.start()
    time.sleep(0.7)
    second = act(ros, head, goal(["HeadYaw"], (1.0, [0.1])))
    thread.join()
    return {
        "reached": reached,
        "feedback": reached["feedback"],
        "replaced": replaced[0],
        "second": second,
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
    "follow": follow,
    "touched": touched,
    "left": lambda ros: act(ros, "LeftArm_controller", goal(["LElbowYaw"], (1.5, [-0.8]))),
    "right": lambda ros: act(ros, "RightArm_controller", goal(["RElbowYaw"], (1.5, [0.8]))),
    "die": lambda ros: act(ros, "Head_controller", goal(["HeadYaw"], (0.1, [0.0]), (60.0, [1.9]))),
}

if __name__ == "__main__":
    connection = roslibpy.Ros("127.0.0.1", int(sys.argv[1]))
    connection.run(timeout=30)
    print(json.dumps(JOBS[sys.argv[2]](connection)), flush=True)
    connection.terminate()
