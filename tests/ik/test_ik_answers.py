"""The answer in words: each status provoked, each number of the report computed again by Pinocchio alone."""

import inspect
import itertools
import math
import re

import numpy as np
import pinocchio
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.ik import IKStatus

PEPPER = pk.load_pepper()
MODEL = pinocchio.buildModelFromXML(PEPPER.export("urdf"))
TABLE = pk.Scene().add_box("table", size=(0.6, 1.0, 0.04), position=(0.55, 0.0, 0.70))
VECTOR = r"\((-?[\d.]+), (-?[\d.]+), (-?[\d.]+)\)"


def pose(q, frame):
    """Pose of a frame by Pinocchio, from the exported description."""
    assert list(MODEL.names)[1:] == list(PEPPER.joint_names)
    data = MODEL.createData()
    pinocchio.framesForwardKinematics(MODEL, data, np.array(q))
    return data.oMf[MODEL.getFrameId(frame)].homogeneous


def hand_point(q, hand="L"):
    return pose(q, f"{hand}Arm_effector")[:3, 3]


def angle(a, b):
    return math.degrees(math.atan2(np.linalg.norm(np.cross(a, b)), a @ b))


def length(number, unit):
    return float(number) * {"m": 1.0, "cm": 0.01, "mm": 0.001}[unit]


def rounding(number, unit):
    """Half a unit of the last digit that is printed."""
    digits = len(number.partition(".")[2]) if "e" not in number else 6
    return length(0.51 * 10.0**-digits, unit) + 1e-12


def vector(match, first=1):
    return np.array([float(x) for x in match.groups()[first - 1 : first + 2]])


def check_torque(result, report):
    found = re.search(r"gravity uses at most (\d+) % of a motor's torque \((\w+)\)", report)
    data = MODEL.createData()
    ratio = (
        np.abs(pinocchio.computeGeneralizedGravity(MODEL, data, np.array(result.q))) / PEPPER.effort_limits
    )
    assert float(found[1]) == pytest.approx(100 * ratio.max(), abs=0.6)
    assert found[2] == PEPPER.joint_names[int(ratio.argmax())]
    assert ("cannot hold" in report) == (ratio.max() > 1)


def check_limits(result, report):
    """Joints named in the report are at a limit, to the last bit that matters."""
    found = re.search(r": ([\w, ]+?) at (its limit|their limits);", report)
    if found is None:
        return ()
    names = tuple(re.split(r", | and ", found[1]))
    assert (found[2] == "its limit") == (len(names) == 1)
    for name in names:
        i = PEPPER.joint_index(name)
        assert min(result.q[i] - PEPPER.lower_limits[i], PEPPER.upper_limits[i] - result.q[i]) < 1e-4
    return names


def check_stop(result, report, target, hand="L"):
    """The distance and the point where the hand stops."""
    stated = re.search(rf"hand stops ([\d.]+) (m|cm|mm) short of {VECTOR}", report)
    distance = math.dist(hand_point(result.q, hand), target)
    assert length(stated[1], stated[2]) == pytest.approx(distance, abs=rounding(stated[1], stated[2]))
    np.testing.assert_allclose(vector(stated, 3), target, atol=5.1e-4)
    reached = re.search(rf"comes to point {VECTOR}", report)
    np.testing.assert_allclose(vector(reached), hand_point(result.q, hand), atol=5.1e-4)
    assert (np.asarray(result.q) >= PEPPER.lower_limits).all()
    assert (np.asarray(result.q) <= PEPPER.upper_limits).all()


def test_solved_states_its_errors():
    point, straight = np.array([0.35, 0.2, 0.95]), np.array([1.0, 0.3, 0.0])
    tasks = [pk.ik.HandPosition("left", point), pk.ik.LookAt(point), pk.ik.Point("right", straight)]
    result = pk.ik.solve(PEPPER, tasks, collisions=False)
    assert result.status is IKStatus.SOLVED
    report = result.report()
    assert report.startswith("solved: every task is met\n")
    assert result.blocking_limits == ()
    assert result.clearance is None
    assert result.in_collision is None
    found = re.search(rf"left hand: error ([\d.e-]+) (m|cm|mm), point {VECTOR}", report)
    distance = math.dist(hand_point(result.q), point)
    assert length(found[1], found[2]) == pytest.approx(distance, rel=0.06, abs=1e-9)
    assert distance <= 1e-3
    np.testing.assert_allclose(vector(found, 3), hand_point(result.q), atol=5.1e-4)
    camera = pose(result.q, "CameraTop_frame")
    gaze = re.search(rf"gaze of CameraTop_frame: error ([\d.e-]+) deg, direction {VECTOR}", report)
    assert float(gaze[1]) == pytest.approx(angle(camera[:3, 0], point - camera[:3, 3]), rel=0.06, abs=1e-6)
    np.testing.assert_allclose(vector(gaze, 2), camera[:3, 0], atol=5.1e-4)
    pointing = re.search(r"right hand: error ([\d.e-]+) deg", report)
    axis = pose(result.q, "RArm_effector")[:3, 0]
    assert float(pointing[1]) == pytest.approx(angle(axis, straight), rel=0.06, abs=1e-6)
    check_torque(result, report)
    assert result.advice not in report


@pytest.mark.parametrize(("target", "hand"), [((1.2, 0.3, 1.0), "left"), ((0.2, -0.9, 1.5), "right")])
def test_unreachable_states_where_the_hand_stops(target, hand):
    result = pk.ik.solve(PEPPER, pk.ik.HandPosition(hand, target), collisions=False)
    assert result.status is IKStatus.CLOSEST_UNREACHABLE
    report = result.report()
    check_stop(result, report, target, hand[0].upper())
    check_torque(result, report)
    check_limits(result, report)
    assert "beyond reach" in report
    assert "even without joint limits" in result.advice
    assert result.errors[0].value == pytest.approx(math.dist(hand_point(result.q, hand[0].upper()), target))
    assert report.endswith(result.advice)
    assert result.hint == ""
    # No posture out of many comes nearer than the one that is called the closest.
    q = np.random.default_rng(0).uniform(PEPPER.lower_limits, PEPPER.upper_limits, (100_000, PEPPER.n))
    points = pk.kinematics.frame_pose(PEPPER, q, f"{hand[0].upper()}Arm_effector")[:, :3, 3]
    assert math.dist(hand_point(result.q, hand[0].upper()), target) <= np.linalg.norm(
        points - target, axis=1
    ).min()  # fmt: skip


def test_limits_are_named():
    target = (-0.15, 0.05, 0.9)
    result = pk.ik.solve(PEPPER, pk.ik.HandPosition("left", target), joints="left_arm", collisions=False)
    assert result.status is IKStatus.CLOSEST_LIMITS
    report = result.report()
    check_stop(result, report, target)
    check_torque(result, report)
    names = check_limits(result, report)
    assert set(names) <= set(PEPPER.joint_group("left_arm"))
    assert names
    # Beyond the limits that are named the hand would come nearer.
    data = MODEL.createData()
    frame = MODEL.getFrameId("LArm_effector")
    pinocchio.computeJointJacobians(MODEL, data, np.array(result.q))
    pinocchio.framesForwardKinematics(MODEL, data, np.array(result.q))
    jacobian = pinocchio.getFrameJacobian(MODEL, data, frame, pinocchio.LOCAL_WORLD_ALIGNED)[:3]
    for name in names:
        i = PEPPER.joint_index(name)
        outwards = 1.0 if PEPPER.upper_limits[i] - result.q[i] < 1e-4 else -1.0
        assert outwards * jacobian[:, i] @ (hand_point(result.q) - target) < 0


def test_the_sentence_with_all_its_parts():
    """What stops short, by how much, whose limits, the nearest point, and which joints would help."""
    helped = PEPPER.joint_vector({"HipPitch": -0.5, "LShoulderPitch": 0.2, "LElbowRoll": -0.1})
    target = hand_point(helped)
    result = pk.ik.solve(PEPPER, pk.ik.HandPosition("left", target), joints="left_arm", collisions=False)
    assert result.status in (IKStatus.CLOSEST_LIMITS, IKStatus.CLOSEST_UNREACHABLE)
    report = result.report()
    sentence = re.search(
        rf"left hand stops ([\d.]+) cm short of {VECTOR}: [\w, ]+ at (its limit|their limits); "
        rf"comes to point {VECTOR}\nwith the torso free it would be reached\.",
        report,
    )
    assert sentence is not None, report
    check_stop(result, report, target)
    assert check_limits(result, report) == result.blocking_limits
    # The advice holds: with the torso free too, it is reached.
    joints = (*PEPPER.joint_group("left_arm"), *PEPPER.joint_group("torso"))
    assert pk.ik.solve(PEPPER, pk.ik.HandPosition("left", target), joints=joints, collisions=False).success
    # The nearest point for the arm alone is not beaten by sampled postures of the arm.
    arm = [PEPPER.joint_index(name) for name in PEPPER.joint_group("left_arm")]
    q = np.tile(PEPPER.neutral(), (100_000, 1))
    q[:, arm] = np.random.default_rng(1).uniform(
        PEPPER.lower_limits[arm], PEPPER.upper_limits[arm], (100_000, 5)
    )
    points = pk.kinematics.frame_pose(PEPPER, q, "LArm_effector")[:, :3, 3]
    assert (
        math.dist(hand_point(result.q), target) <= np.linalg.norm(points - target, axis=1).min() + 1e-4
    )  # fmt: skip


def test_the_smallest_group_that_helps_is_named():
    target = hand_point(PEPPER.joint_vector({"HipPitch": -0.5, "LShoulderPitch": 0.2, "LElbowRoll": -0.1}))
    task = pk.ik.HandPosition("left", target)
    assert (
        pk.ik.solve(PEPPER, task, joints="torso", collisions=False).hint
        == "with the left arm free it would be reached"
    )
    both = [task, pk.ik.LookAt((0.0, 0.8, 0.2))]
    assert (
        pk.ik.solve(PEPPER, both, joints=("HipPitch",), collisions=False).hint
        == "with all joints free it would be reached"
    )
    assert (
        pk.ik.solve(
            PEPPER, pk.ik.HandPosition("left", (2.0, 0, 1.0)), joints="left_arm", collisions=False
        ).hint
        == ""
    )
    assert pk.ik.solve(PEPPER, pk.ik.HandPosition("left", (2.0, 0, 1.0)), collisions=False).hint == ""
    planar = pk.load_pepper(base="planar")
    joints = (*planar.joint_group("torso"), *planar.joint_group("left_arm"))
    far = pk.ik.solve(planar, pk.ik.HandPosition("left", (2.0, 0, 1.0)), joints=joints, collisions=False)
    assert far.hint == "with the base free it would be reached"


def test_collision_states_its_clearance():
    target = np.array([0.4, 0.2, 0.70])
    result = pk.ik.solve(PEPPER, pk.ik.HandPosition("left", target), scene=TABLE, restarts=8)
    assert result.status is IKStatus.CLOSEST_COLLISION
    report = result.report()
    assert "blocked by collision" in report
    assert "comes to point" in report
    check_stop(result, report, target)
    check_torque(result, report)
    stated = float(re.search(r"clearance: ([\d.]+) mm from obstacles", report)[1])
    assert result.clearance.least > 0
    assert "touches" not in report
    assert stated == pytest.approx(
        1000 * float(pk.collision.clearance(PEPPER, result.q, TABLE, to="obstacles")), abs=0.051
    )


def test_timed_out_states_how_far_it_came():
    target = (1.5, 0.5, 1.2)
    result = pk.ik.solve(PEPPER, pk.ik.HandPosition("left", target), timeout=1e-9, collisions=False)
    assert result.status is IKStatus.TIMED_OUT
    report = result.report()
    assert report.startswith("not reached: time ran out")
    np.testing.assert_array_equal(result.q, PEPPER.neutral())
    check_stop(result, report, target)
    check_torque(result, report)


def test_other_tasks_state_their_shortfalls():
    behind, up = np.array([-1.0, 0.0, 0.2]), np.array([0.0, 0.0, 1.0])
    gaze = pk.ik.solve(PEPPER, pk.ik.LookAt(behind), joints="head", collisions=False)
    passes = re.search(rf"gaze of CameraTop_frame passes ([\d.]+) deg beside {VECTOR}", gaze.report())
    camera = pose(gaze.q, "CameraTop_frame")
    assert float(passes[1]) == pytest.approx(angle(camera[:3, 0], behind - camera[:3, 3]), abs=0.051)
    pointed = pk.ik.solve(
        PEPPER, pk.ik.Point("left", up), joints=("LWristYaw", "LElbowYaw"), collisions=False
    )
    points = re.search(r"left hand points ([\d.]+) deg away from direction", pointed.report())
    assert float(points[1]) == pytest.approx(
        angle(pose(pointed.q, "LArm_effector")[:3, 0], up), abs=0.051
    )  # fmt: skip
    wanted = np.diag([-1.0, 1.0, -1.0])
    turned = pk.ik.solve(PEPPER, pk.ik.FrameOrientation("Head", wanted), joints="head", collisions=False)
    stays = re.search(r"Head is turned ([\d.]+) deg away from its orientation", turned.report())
    rotation = pose(turned.q, "Head")[:3, :3] @ wanted.T
    assert float(stays[1]) == pytest.approx(
        math.degrees(math.acos((np.trace(rotation) - 1) / 2)), abs=0.051
    )  # fmt: skip
    bent = pk.ik.solve(PEPPER, pk.ik.JointPosture((1.0,), joints=("KneePitch",)), collisions=False)
    stops = re.search(r"KneePitch stops at ([\d.]+) rad, short of 1.0000 rad", bent.report())
    assert float(stops[1]) == pytest.approx(float(PEPPER.upper_limits[0]), abs=5.1e-5)


# Every class of task, those that come later too: arguments that it accepts are found by trying these.
VALUES = (
    "left",
    "LArm_effector",
    "RArm_effector",
    "LElbowRoll",
    (0.4, 0.2, 0.9),
    (0.1, 0.0),
    np.eye(3),
    np.eye(4),
    PEPPER.neutral(),
    0.1,
)
PLANAR = pk.load_pepper(base="planar")
OTHER_VALUES = {"pepper": (PEPPER,), "function": (lambda q: q[0],)}
CLASSES = [
    item
    for name in pk.ik.__all__
    if inspect.isclass(item := getattr(pk.ik, name))
    and issubclass(item, (pk.ik.Task, pk.ik.TaskGroup))
    and not inspect.isabstract(item)
]


def build_and_check(item, arguments, robot):
    task = item(**arguments)
    for part in task.parts if isinstance(task, pk.ik.TaskGroup) else (task,):
        part.check(robot)
        if part.count is not None:
            raise InvalidValueError("target", "several", "one target")
    return task


def good_arguments(item):
    """Values for the arguments that are needed, the first of VALUES that the class accepts, and a robot.

    Where a class asks for one at least of several optional arguments, those that are None count as needed.
    """
    parameters = inspect.signature(item).parameters.items()
    needed = [name for name, p in parameters if p.default is p.empty]
    optional = [name for name, p in parameters if p.default is None and p.kind is p.POSITIONAL_OR_KEYWORD]
    for names, robot in itertools.product((needed, needed + optional), (PEPPER, PLANAR)):
        for values in itertools.product(*(OTHER_VALUES.get(name, VALUES) for name in names)):
            arguments = dict(zip(names, values, strict=True))
            try:
                build_and_check(item, arguments, robot)
            except (InvalidValueError, UnknownNameError, TypeError, ValueError):
                continue
            return arguments, robot
    raise AssertionError(f"no arguments found for {item.__name__}: add values that it accepts to VALUES")


def is_numbers(value):
    return isinstance(value, (np.ndarray, float)) or (
        isinstance(value, tuple) and all(isinstance(x, (int, float)) for x in value)
    )


def spoilt(value):
    """The value with a NaN, an infinity, another shape, and things that are no numbers."""
    array = np.array(value, dtype=float)
    for bad in (np.nan, np.inf, -np.inf):
        wrong = array.copy()
        wrong.reshape(-1)[-1] = bad
        yield wrong if array.ndim else bad, str(bad)
    wider = np.ones((*array.shape[:-1], array.shape[-1] + 1)) if array.ndim else np.ones((2, 2))
    yield wider, r"shape|numbers?"
    yield np.ones((1, 1, 1, *array.shape)), r"shape|numbers?"
    yield "abc", "abc|numbers?"
    yield None, "None|nan|numbers?|shape"


def test_the_help_of_a_task_describes_what_all_tasks_take():
    for item in CLASSES:
        for name in {"weight", "tolerance", "hard"} & set(inspect.signature(item).parameters):
            assert re.search(rf"^ +{name}: ", inspect.getdoc(item), re.MULTILINE), name


def test_targets_that_are_none_are_refused_by_name():
    for item in CLASSES:
        arguments, robot = good_arguments(item)
        defaults = {
            name: p.default
            for name, p in inspect.signature(item).parameters.items()
            if isinstance(p.default, tuple) and is_numbers(p.default)
        }
        checked = 0
        for name, value in {**arguments, **defaults}.items():
            if not is_numbers(value):
                continue
            for wrong, words in spoilt(value):
                if wrong is None and inspect.signature(item).parameters[name].default is None:
                    continue
                with pytest.raises(InvalidValueError, match=words) as caught:
                    build_and_check(item, {**arguments, name: wrong}, robot)
                assert caught.value.quantity
                assert caught.value.allowed
                assert str(caught.value).startswith(f"{caught.value.quantity}: got ")
                checked += 1
        assert checked or not any(is_numbers(value) for value in arguments.values())


def test_unknown_frames_hands_and_joints_are_refused_by_name():
    for item in CLASSES:
        arguments, robot = good_arguments(item)
        for name, value in arguments.items():
            if isinstance(value, str):
                with pytest.raises(UnknownNameError, match="nose") as caught:
                    pk.ik.solve(robot, item(**{**arguments, name: "nose"}), collisions=False)
                assert caught.value.name == "nose"
                assert {"LArm_effector", "LElbowRoll", "left"} & set(caught.value.available)
        if "joints" in inspect.signature(item).parameters:
            numbers = {name: (0.1,) for name, value in arguments.items() if isinstance(value, np.ndarray)}
            with pytest.raises(UnknownNameError, match="nose"):
                pk.ik.solve(robot, item(**{**arguments, **numbers, "joints": ("nose",)}), collisions=False)


def test_weights_and_tolerances_that_are_none_are_refused_by_name():
    for item in CLASSES:
        arguments, _ = good_arguments(item)
        names = [n for n in inspect.signature(item).parameters if n.endswith(("weight", "tolerance"))]
        assert names
        for name in names:
            for wrong in (np.nan, 0.0, -1.0, "abc", None):
                with pytest.raises(InvalidValueError, match=name.rpartition("_")[2]) as caught:
                    item(**{**arguments, name: wrong})
                assert str(wrong) in str(caught.value)


def test_the_classes_are_those_that_are_public():
    assert {"HandPosition", "LookAt", "HandPose", "JointPosture"} <= {item.__name__ for item in CLASSES}
    assert len(CLASSES) >= 9
