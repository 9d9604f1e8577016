"""ALMotion's effectors and base, beside Pinocchio on the text of the description."""

import math

import numpy as np
import pinocchio as pin
import pytest

import pepper_kin as pk
from pepper_kin.naoqi import Broker, NaoqiError, RefusedByRobotError
from pepper_kin.naoqi.shims import almath


def place(broker, frame, root="base_footprint"):
    """The pose of a frame as found_here from another, by Pinocchio alone."""
    body = broker.body
    model = pin.buildModelFromXML(body.pepper.urdf)
    data, q = model.createData(), pin.neutral(model)
    for name in broker.motion.getBodyNames("Joints"):
        q[model.joints[model.getJointId(name)].idx_q] = body.commanded(name)
    pin.framesForwardKinematics(model, data, q)
    a, b = (data.oMf[model.getFrameId(name)] for name in (root, frame))
    return a.actInv(b)


def test_positions_are_forward_kinematics(broker, motion):
    motion.angleInterpolation(["LShoulderPitch", "LElbowRoll", "HipPitch"], [0.7, -0.9, -0.2], 1.0, True)
    expected = place(broker, "LArm_effector")
    found = motion.getPosition("LArm", 2, False)
    assert found[:3] == pytest.approx(list(expected.translation), abs=1e-9)
    assert pin.rpy.rpyToMatrix(*found[3:]) == pytest.approx(expected.rotation, abs=1e-9)
    transform = np.reshape(motion.getTransform("LArm", 0, False), (4, 4))
    assert transform == pytest.approx(place(broker, "LArm_effector", "torso_naoqi").homogeneous, abs=1e-9)


@pytest.mark.parametrize(
    ("camera", "place_in_head", "pitch"),
    [
        ("CameraTop", (0.08601, 0.0, 0.16284), 0.0),
        ("CameraBottom", (0.09262, 0.0, 0.06177), 40.0),
        ("CameraDepth", (0.05138, 0.039, 0.1194), 0.0),
    ],
)
def test_cameras_stand_in_the_head_as_the_maker_says(motion, camera, place_in_head, pitch):
    """The maker's pages on Pepper: x along the optical axis, so that an upright camera is not turned at all.

    Top and bottom: rotation from "Pepper - 2D Cameras" of NAOqi 2.0 (none, and 40 degrees about Y), places as
    in the first URDF, which are a robot's (`tests/kinematics/test_frames.py`); depth: origin and rpy of
    `CameraDepth_sensor_fixedjoint` in the URDF that the page on Pepper's kinematics of NAOqi 2.5 gives, as
    quoted in jsk-ros-pkg/jsk_robot#810.
    """
    motion.angleInterpolation(["HeadYaw", "HeadPitch", "HipPitch"], [0.8, -0.3, -0.2], 1.5, True)
    head, found = (np.reshape(motion.getTransform(name, 2, False), (4, 4)) for name in ("Head", camera))
    seen_from_head = np.linalg.inv(head) @ found
    assert seen_from_head[:3, 3] == pytest.approx(place_in_head, abs=1e-6)
    assert seen_from_head[:3, :3] == pytest.approx(pin.rpy.rpyToMatrix(0, math.radians(pitch), 0), abs=1e-6)


@pytest.mark.parametrize("camera", ["CameraTop", "CameraBottom"])
def test_a_mark_in_a_picture_lies_where_the_maker_s_sample_computes(camera):
    """The maker's sample of landmark localization: the camera's transform, angles in the picture, distance.

    The angles take the middle of the picture for the axis, as NAOqi does, which is up to 1.1 degrees off.
    """
    center = np.array([1.1, 0.25, 0.2 if camera == "CameraBottom" else 1.2])
    scene = pk.Scene().add("mark", pk.model.Sphere(0.05), center, color=(1.0, 0.0, 0.0, 1.0))
    with Broker(real_time=False, scene=scene) as broker:
        motion, video = broker.motion, broker.module("ALVideoDevice")
        motion.setAngles(["HeadYaw", "HeadPitch"], [0.3, 0.1], 0.5)
        broker.body.time.sleep(2.0)
        index = 0 if camera == "CameraTop" else 1
        picture = video.getImageRemote(video.subscribeCamera("sample", index, 2, 11, 10))
        pixels = np.frombuffer(picture[6], np.uint8).reshape(480, 640, 3).astype(int)
        rows, columns = np.nonzero((pixels[..., 0] > 60) & (pixels[..., 1:].max(axis=-1) < 40))
        assert rows.size > 200
        x, y = (columns.mean() + 0.5) / 640, (rows.mean() + 0.5) / 480
        wz, wy = video.getAngularPositionFromImagePosition(index, [x, y])
        robot_to_camera = almath.Transform(motion.getTransform(camera, 2, True))
        distance = float(np.linalg.norm(center - np.array(robot_to_camera.toVector()).reshape(4, 4)[:3, 3]))
        turned = almath.Transform_from3DRotation(0.0, wy, wz)
        found = robot_to_camera * turned * almath.Transform(distance, 0.0, 0.0)
        assert [found.r1_c4, found.r2_c4, found.r3_c4] == pytest.approx(list(center), abs=0.04)


def test_position_interpolations_follow_straight_lines(broker, motion):
    begin = np.array(motion.getPosition("LArm", 2, False)[:3])
    end = begin + np.array([0.06, 0.02, 0.08])
    number = motion.pCall("positionInterpolations", ["LArm"], 2, [[*end, 0, 0, 0]], [7], [1.5])
    apart = []
    while motion.isRunning(number):
        broker.body.time.sleep(0.02)
        point = np.array(motion.getPosition("LArm", 2, False)[:3]) - begin
        direction = (end - begin) / np.linalg.norm(end - begin)
        apart.append(np.linalg.norm(point - direction * (point @ direction)))
    assert motion.getPosition("LArm", 2, False)[:3] == pytest.approx(list(end), abs=1.5e-3)
    assert max(apart) < 3e-3


def test_two_arms_at_once_and_there_and_back(motion):
    paths = []
    for arm in ("LArm", "RArm"):
        now = motion.getPosition(arm, 0, False)
        up = [*now[:2], now[2] + 0.05, *now[3:]]
        paths.append([up, now])
    before = motion.getAngles("JointActuators", False)
    motion.positionInterpolations(["LArm", "RArm"], 0, paths, [7, 7], [[1.0, 2.0], [1.0, 2.0]])
    assert motion.getPosition("LArm", 0, False)[:3] == pytest.approx(paths[0][1][:3], abs=2e-3)
    assert motion.getPosition("RArm", 0, False)[:3] == pytest.approx(paths[1][1][:3], abs=2e-3)
    assert len(before) == len(motion.getAngles("JointActuators", False))


def test_set_transforms_returns_at_once_and_gets_there(broker, motion):
    goal = np.reshape(motion.getTransform("RArm", 2, False), (4, 4))
    goal[2, 3] += 0.05
    before = broker.body.time.now
    motion.setTransforms("RArm", 2, list(goal.ravel()), 0.5, 7)
    assert broker.body.time.now == before
    broker.body.time.sleep(3.0)
    assert motion.getPosition("RArm", 2, False)[:3] == pytest.approx(list(goal[:3, 3]), abs=1.5e-3)


@pytest.mark.parametrize(
    "target", [(0.4, 0.0, 0.0), (0.0, 0.3, 0.0), (-0.2, 0.1, 1.0), (0.0, 0.0, math.pi / 2)]
)
def test_move_to_arrives(motion, target):
    assert motion.moveTo(*target) is True
    found = motion.getRobotPosition(True)
    assert found[:2] == pytest.approx(list(target[:2]), abs=6e-3)
    assert math.remainder(found[2] - target[2], 2 * math.pi) == pytest.approx(0.0, abs=1e-2)


@pytest.mark.parametrize(
    ("places", "turned"),
    [
        ([[0.0, 0.0, math.pi]], math.pi),
        ([[0.0, 0.0, -math.pi]], -math.pi),
        ([[0.0, 0.0, float(np.float32(math.pi))]], math.pi),
        ([[0.2, 0.0, -3.1416]], -math.pi),
        ([[0.0, 0.0, math.pi / 2], [0.0, 0.0, -math.pi / 2]], 0.0),
        ([[0.0, 0.0, 2.0], [0.0, 0.0, -2.5]], -0.5),
    ],
)
@pytest.mark.parametrize("before", [0.0, 0.7, -3.0])
def test_half_a_turn_goes_the_way_that_its_sign_says(broker, motion, before, places, turned):
    """The maker's pages on `moveTo`: theta is in [-pi, pi], and positive angles turn to the left."""
    if before:
        motion.moveTo(0.0, 0.0, before)
    begin = motion.getRobotPosition(False)[2]
    number = motion.pCall("moveTo", places if len(places) > 1 else places[0])
    broker.body.time.sleep(0.5)
    assert math.copysign(1.0, motion.getRobotVelocity()[2]) == math.copysign(1.0, places[0][2])
    motion.wait(number, 0)
    assert motion.getRobotPosition(False)[2] - begin == pytest.approx(turned, abs=0.02)


def test_control_points_are_seen_from_the_one_before(motion):
    """The maker's example of curves hands them over so."""
    motion.moveTo([[0.0, 0.0, math.pi / 2], [0.2, 0.0, 0.0], [0.1, 0.0, 0.0]])
    assert motion.getRobotPosition(True) == pytest.approx([0.0, 0.3, math.pi / 2], abs=1.2e-2)


def test_control_points_are_for_nao():
    with Broker(mode="robot", real_time=False) as robot:
        robot.motion.wakeUp()
        with pytest.raises(NaoqiError, match="control points are for NAO"):
            robot.motion.moveTo([[0.2, 0.0, 0.0], [0.3, 0.0, 0.0]])


@pytest.mark.thorough
@pytest.mark.parametrize("end", ["moveToward", "killMove"])
def test_a_move_is_finished_when_the_base_stands(broker, motion, end):
    motion.move(0.3, 0.0, 0.0)
    broker.body.time.sleep(2.0)
    motion.waitUntilMoveIsFinished()  # somebody drives it on: that is not waited for
    assert motion.getRobotVelocity()[0] == pytest.approx(0.3)
    motion.moveToward(0.0, 0.0, 0.0) if end == "moveToward" else motion.killMove()
    motion.waitUntilMoveIsFinished()
    assert not motion.moveIsActive()
    assert motion.getRobotVelocity() == pytest.approx([0.0, 0.0, 0.0])


def test_a_velocity_is_kept_until_somebody_stops_it(broker, motion):
    motion.move(0.1, 0.0, 0.2)
    broker.body.time.sleep(3.0)
    assert motion.moveIsActive()
    assert motion.getRobotVelocity() == pytest.approx([0.1, 0.0, 0.2])
    motion.stopMove()
    assert not motion.moveIsActive()
    rest = motion.getRobotPosition(False)
    broker.body.time.sleep(1.0)
    assert motion.getRobotPosition(False) == pytest.approx(rest)


def test_velocities_of_the_base_keep_the_limits_asked(broker, motion):
    motion.moveToward(1.0, 0.0, 0.0, [["MaxVelXY", 0.2]])
    found_here = []
    for _ in range(150):
        broker.body.time.sleep(0.02)
        found_here.append(motion.getRobotVelocity()[0])
    assert max(found_here) == pytest.approx(0.2)


def test_an_obstacle_stops_the_base_and_protection_can_be_switched_off():
    scene = pk.Scene().add_box("wall", size=(0.1, 2.0, 1.0), position=(1.0, 0.0, 0.5))
    with Broker(real_time=False, scene=scene) as broker:
        motion = broker.motion
        assert motion.moveTo(0.9, 0.0, 0.0) is False
        here = motion.getRobotPosition(True)[0]
        assert here < 0.45
        near = pk.collision.near_pairs(broker.body.pepper, broker.body.configuration(True), 1.0, scene)
        assert min(d for names, d in zip(near.names, near.distances, strict=True) if "wall" in names) > 0.3
        motion.setExternalCollisionProtectionEnabled("Move", False)
        assert motion.moveTo(0.1, 0.0, 0.0) is True


@pytest.mark.thorough
def test_navigation_goes_around():
    scene = pk.Scene().add_box("post", size=(0.1, 0.1, 1.0), position=(0.9, 0.0, 0.5))
    with Broker(real_time=False, scene=scene) as broker:
        assert broker.module("ALNavigation").navigateTo(1.8, 0.0) is True
        assert broker.motion.getRobotPosition(True)[:2] == pytest.approx([1.8, 0.0], abs=1e-2)


def test_mass_and_center_of_mass_are_those_of_the_description(broker, motion):
    model = pin.buildModelFromXML(broker.body.pepper.urdf)
    assert motion.getMass("Body") == pytest.approx(sum(inertia.mass for inertia in model.inertias), rel=1e-9)
    pepper, data, q = broker.body.pepper, model.createData(), pin.neutral(model)
    full, inner = pepper.to_full(broker.body.configuration(False)), pepper.inner_model
    for name in list(model.names)[1:]:
        joint = model.joints[model.getJointId(name)]
        if joint.nq == 1:  # the base's yaw is neutral
            q[joint.idx_q] = full[inner.joints[inner.getJointId(name)].idx_v]
    assert motion.getCOM("Body", 1, False) == pytest.approx(list(pin.centerOfMass(model, data, q)), abs=1e-9)


def off_aim(broker, side, point):
    """Return the angle between a forearm and the line from the elbow to a point [rad]."""
    letter = side[0]
    elbow = place(broker, f"{letter.upper()}ForeArm").translation
    forearm, aim = place(broker, f"{letter}_wrist").translation - elbow, point - elbow
    return float(np.arccos(forearm @ aim / np.linalg.norm(forearm) / np.linalg.norm(aim)))


@pytest.mark.thorough
def test_looking_and_pointing_aim_at_the_point(broker):
    point = np.array([1.2, 0.5, 1.1])
    tracker = broker.module("ALTracker")
    tracker.lookAt(list(point), 2, 0.4, False)
    camera = place(broker, "CameraTop_optical_frame")
    found_here = camera.actInv(point)
    assert np.arctan2(np.hypot(found_here[0], found_here[1]), found_here[2]) < 0.01
    tracker.pointAt("LArm", list(point), 2, 0.4)
    assert off_aim(broker, "left", point) < 0.2


def test_a_tracked_target_is_followed_with_the_head(broker):
    tracker = broker.module("ALTracker")
    tracker.registerTarget("Face", 0.1)
    tracker.place_target("Face", [1.5, 0.8, 1.2])
    tracker.track("Face")
    broker.body.time.sleep(2.0)
    found_here = place(broker, "CameraTop_optical_frame").actInv(np.array([1.5, 0.8, 1.2]))
    assert np.arctan2(np.hypot(found_here[0], found_here[1]), found_here[2]) < 0.02
    tracker.stopTracker()
    assert not tracker.isActive()


@pytest.mark.thorough
@pytest.mark.parametrize("arms", [("LArm",), ("RArm",), ("LArm", "RArm")], ids="_".join)
def test_the_effector_points_at_what_is_tracked(broker, motion, arms):
    tracker, sides = broker.module("ALTracker"), [{"L": "left", "R": "right"}[arm[0]] for arm in arms]
    tracker.registerTarget("RedBall", 0.1)
    tracker.place_target("RedBall", [1.5, 0.8, 1.2])
    tracker.track("RedBall")
    broker.body.time.sleep(1.0)
    hanging = motion.getAngles("Arms", False)
    tracker.setEffector(arms[0] if len(arms) == 1 else "Arms")
    for target in ([1.5, 0.8, 1.2], [1.5, -0.3, 1.0], [1.2, 0.2, 1.4]):
        tracker.place_target("RedBall", target)
        broker.body.time.sleep(3.0)
        assert [off_aim(broker, side, np.array(target)) for side in sides] == pytest.approx(
            [0.0] * len(sides), abs=0.2
        )
        found_here = place(broker, "CameraTop_optical_frame").actInv(np.array(target))
        assert np.arctan2(np.hypot(found_here[0], found_here[1]), found_here[2]) < 0.02
    if len(arms) == 1:
        still = "RArm" if arms == ("LArm",) else "LArm"
        assert motion.getAngles(still, False) == (hanging[6:] if still == "RArm" else hanging[:6])
    with pytest.raises(NaoqiError, match="expected None, LArm, RArm, Arms"):
        tracker.setEffector("Head")


def test_the_mode_robot_refuses_what_pepper_refuses():
    with Broker(real_time=False, mode="robot") as broker:
        for call in (
            lambda: broker.motion.wbEnable(True),
            lambda: broker.motion.setStiffnesses("Leg", 0.0),
            lambda: broker.motion.setPositions("LArm", 2, [0.3, 0.2, 0.8, 0, 0, 0], 0.3, 7),
        ):
            with pytest.raises(RefusedByRobotError, match="the robot does not"):
                call()
        with pytest.raises(RefusedByRobotError, match="no feet"):
            broker.motion.getFootSteps()


@pytest.mark.thorough
def test_navigation_goes_along_circles_and_composed_parts_begin_where_the_one_before_ended(broker):
    """By hand: half a meter ahead, then a quarter of a circle to the left with a radius of half a meter."""
    quarter = math.pi / 2
    circle = ["Holonomic", ["Circle", [0.0, 0.5], quarter], quarter, 4.0]
    parts = ["Composed", ["Holonomic", ["Line", [0.5, 0.0]], 0.0, 2.0], circle]
    inside = []
    broker.body.listeners.append(lambda: inside.append(broker.body.base_pose(True)[:2]))
    assert broker.module("ALNavigation").moveAlong(parts)
    assert broker.body.base_pose(True) == pytest.approx([1.0, 0.5, quarter], abs=0.02)
    turned = np.array([place for place in inside if place[0] > 0.55])
    assert np.linalg.norm(turned - [0.5, 0.5], axis=1) == pytest.approx(0.5, abs=0.03)  # on the circle
    back = ["Composed", ["Composed", *parts[1:]], ["Holonomic", ["Line", [0.0, 0.5]], 0.0, 2.0]]
    broker.module("ALNavigation").moveAlong(back)  # from (1, 0.5, pi/2), then to the left
    assert broker.body.base_pose(True)[:2] == pytest.approx([0.5, 1.0], abs=0.03)
    assert math.cos(broker.body.base_pose(True)[2]) == pytest.approx(-1.0, abs=0.01)
