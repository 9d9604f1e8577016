"""A robot over rosbridge: a planned and certified motion is followed; one that is too fast is refused."""

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.naoqi import RunLog
from pepper_kin.naoqi.body import Body
from pepper_kin.ros import RobotClient, RobotNode, RosbridgeClient, RosbridgeServer

body = Body()  # the twin in real time; with a robot, only the client's lines are needed
log = RunLog(body)
body.time.start()
with RosbridgeServer(port=0) as server, RobotNode(body, server, cameras=()):
    print(f"any rosbridge client may connect to {server.url}")
    with RosbridgeClient(server.url) as transport, RobotClient(transport) as robot:
        pepper, start = robot.pepper, robot.configuration()
        arm = pepper.joint_group("left_arm")
        plan = pk.plan(pepper, start, [pk.ik.HandPosition("left", (0.30, 0.25, 0.90))], joints=arm)
        assert plan.success, plan.report()
        trajectory = pk.retime(pepper, plan, velocity_scale=0.5)
        result = robot.follow(trajectory, on_progress=lambda time: print(f"{time:.2f} s", end=" "))
        print(result.report())

        refused = ""
        try:
            robot.follow(trajectory.reversed().scaled(0.1))
        except InvalidValueError as error:
            refused = str(error)
        print(refused)
        reached = robot.configuration()
body.time.stop()
run = log.run()

hand = pk.kinematics.frame_pose(pepper, reached, "LArm_effector")[:3, 3]
print(f"the hand is at {hand.round(3)}")
assert result.success
assert "fails velocity" in refused
assert max(abs(hand - [0.30, 0.25, 0.90])) < 0.01
