"""Fifty mistakes of a first hour: each has an answer that tells what to do."""

import re
import warnings

import numpy as np
import pandas as pd
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import LimitError, OvershootWarning, PepperKinError

PEPPER = pk.load_pepper()
STAND = PEPPER.posture("Stand")
NOD = PEPPER.joint_vector({"HeadPitch": 0.2})
POINT = (0.35, 0.25, 0.85)
TABLE = pk.Scene().add_box("table", size=(0.4, 0.8, 0.03), position=(0.47, 0.05, 0.715))
HAND = pk.ik.HandPosition("left", POINT)
EFFECTOR = "LArm_effector"
DEGREES, MILLIMETERS = r"degrees\? use numpy.radians", r"meters; millimeters\?"
EMPTY = "The scene is empty: `add_box`"

BALL = '<collision><geometry><sphere radius="0.2"/></geometry></collision>'
INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'


def chain(shape):
    """Return a robot of four links, each within reach of the others, without SRDF."""
    parts = "".join(
        f'<joint name="j{k}" type="revolute"><parent link="l{k}"/><child link="l{k + 1}"/><axis xyz="0 1 0"/>'
        '<origin xyz="0 0 0.1"/><limit lower="-1" upper="1" velocity="1" effort="50"/></joint>'
        for k in range(3)
    )
    links = "".join(f'<link name="l{k}">{INERTIAL}{shape}</link>' for k in range(4))
    return f'<robot name="chain">{links}{parts}</robot>'


def materials():
    twice = '<material name="blue"><color rgba="0 0 1 1"/></material>'
    return chain("").replace("<link", twice + twice + "<link", 1)


def moves(**joints):
    return PEPPER.joint_vector(joints)


def dropped():
    scene = pk.Scene()
    scene.add_box("table", size=(0.4, 0.8, 0.03), position=(0.47, 0.05, 0.715))
    return scene


def tensor():
    class Tensor:
        """What torch's tensors do, of which NumPy cannot have one that requires a gradient."""

        requires_grad = True

        def __array__(self, dtype=None, copy=None):
            raise RuntimeError("Can't call numpy() on Tensor that requires grad. Use tensor.detach().numpy()")

    return Tensor()


def motion():
    return pk.retime(PEPPER, [STAND, NOD])


def failed_plan():
    goal = pk.ik.HandPosition("left", (0.47, 0.05, 0.715))
    return pk.plan(PEPPER, STAND, goal, TABLE, timeout=60.0)


MISTAKES = {
    "joint's name": (lambda: moves(LShoulderPich=0.1), "did you mean 'LShoulderPitch'"),
    "group's name": (lambda: PEPPER.joint_group("leftarm"), "did you mean 'left_arm'"),
    "posture's name": (lambda: PEPPER.posture("Sit"), "available: Stand"),
    "gesture's name": (lambda: pk.motion.gesture(PEPPER, "wavw"), "did you mean 'wave'"),
    "hand's name": (lambda: pk.ik.HandPosition("lefft", POINT), "did you mean 'left'"),
    "frame's name": (lambda: pk.kinematics.frame_pose(PEPPER, STAND, "hand"), "available: .*LArm_effector"),
    "planner's name": (lambda: pk.plan(PEPPER, STAND, NOD, planner="rrt"), "rrt_connect"),
    "too few joints": (lambda: pk.dynamics.gravity_torque(PEPPER, STAND[:5]), "15.*KneePitch"),
    "NaN": (lambda: pk.dynamics.gravity_torque(PEPPER, np.where(STAND > 1, np.nan, STAND)), "LShoulderPitch"),
    "text for joints": (lambda: pk.plan(PEPPER, STAND, "Stand!"), "did you mean 'Stand'|expected"),
    "negative size": (lambda: pk.Scene().add_box("b", size=(-1, 1, 1), position=(1, 0, 0)), "size.*-1"),
    "object twice": (lambda: TABLE.add_sphere("table", radius=0.1, position=(1, 0, 0)), "table.*name"),
    "quaternion of length 4": (lambda: pk.pose(quaternion_xyzw=(1, 1, 1, 1)), "quaternion.*length|norm"),
    "scene and tasks exchanged": (lambda: pk.ik.solve(PEPPER, TABLE), "tasks: .*Scene|Scene.*task"),
    "failed plan timed": (lambda: pk.retime(PEPPER, failed_plan()), "goal|plan"),
    "another robot's motion": (
        lambda: motion().check(pk.load_pepper(hands="mimic")), "joint",
    ),
    "time step of a minute": (lambda: pk.Twin(PEPPER, timestep=60.0), "timestep.*60"),
    "fifty times the speed": (
        lambda: pk.retime(PEPPER, [STAND, NOD], velocity_scale=50), "velocity_scale.*1",
    ),
    "suffix": (lambda: pk.files.save(motion(), "nod.txt"), r"\.csv"),
    "missing file": (lambda: pk.files.load("nothing.csv"), "nothing.csv"),
    "start in collision": (
        lambda: pk.plan(PEPPER, STAND, NOD, pk.Scene().add_sphere("ball", radius=0.1, position=(0, 0, 0.8))),
        "ball.*move the obstacle away",
    ),
    "target inside the table": (failed_plan, "table"),
    "gap between motions": (lambda: motion().then(motion()), "HeadPitch"),
    "goal beyond limits": (lambda: pk.plan(PEPPER, STAND, STAND + 3.0), "is outside"),
    "45 rad": (lambda: moves(LShoulderPitch=45), DEGREES),
    "goal in degrees": (lambda: pk.plan(PEPPER, STAND, np.degrees(STAND)), DEGREES),
    "start in degrees": (lambda: pk.ik.solve(PEPPER, HAND, np.degrees(STAND)), DEGREES),
    "waypoints in degrees": (lambda: pk.retime(PEPPER, np.degrees([STAND, NOD])), DEGREES),
    "recording in degrees": (
        lambda: pk.Trajectory.from_positions(PEPPER, [0, 1], np.degrees([STAND, NOD])), DEGREES,
    ),
    "servo in degrees": (lambda: pk.servo.Servo(PEPPER, np.degrees(STAND)), DEGREES),
    "twin in degrees": (lambda: pk.Twin(PEPPER).reset(np.degrees(STAND)), DEGREES),
    "limits in degrees": (lambda: PEPPER.with_limits(lower={"HipPitch": -45}), DEGREES),
    "all limits in degrees": (lambda: PEPPER.with_limits(upper=np.degrees(PEPPER.upper_limits)), DEGREES),
    "velocity limits in degrees": (lambda: PEPPER.with_limits(velocity={"HipPitch": 45}), DEGREES),
    "rpy in degrees": (lambda: pk.pose(rpy=(0, 0, 90)), DEGREES),
    "rpy of an obstacle in degrees": (
        lambda: pk.Scene().add("box", pk.model.Box((1, 1, 1)), rpy=(0, 0, 90)), DEGREES,
    ),
    "target in millimeters": (
        lambda: pk.ik.solve(PEPPER, pk.ik.HandPosition("left", (350, 250, 850))), MILLIMETERS,
    ),
    "goal in millimeters": (
        lambda: pk.plan(PEPPER, STAND, pk.ik.HandPosition("left", (350, 250, 850))), MILLIMETERS,
    ),
    "path of a hand in millimeters": (
        lambda: pk.motion.follow(PEPPER, STAND, "left", pk.motion.LIN((350, 250, 850))), MILLIMETERS,
    ),
    "box in millimeters": (
        lambda: pk.Scene().add_box("table", size=(400, 800, 30), position=(470, 50, 715)), MILLIMETERS,
    ),
    "line in millimeters": (
        lambda: pk.motion.cartesian_path(PEPPER, STAND, "left", pk.motion.LIN((350, 250, 850))),
        MILLIMETERS,
    ),
    "labels of other joints": (
        lambda: pk.dynamics.gravity_torque(PEPPER, pd.Series(STAND, [f"q{k}" for k in range(15)])),
        "labels of q.*HeadYaw",
    ),
    "dropped scene, plan": (lambda: pk.plan(PEPPER, STAND, NOD, dropped()), EMPTY),
    "dropped scene, IK": (lambda: pk.ik.solve(PEPPER, HAND, scene=dropped()), EMPTY),
    "dropped scene, check": (lambda: motion().check(PEPPER, dropped()), EMPTY),
    "scene for the robot": (lambda: motion().check(TABLE), r"robot, which comes first.*check\(pepper"),
    "robot last": (
        lambda: pk.Trajectory.from_positions([0, 1], [STAND, NOD], PEPPER), r"from_positions\(pepper",
    ),
    "no robot": (lambda: pk.plan(STAND, NOD), r"robot, which comes first.*plan\(pepper"),
    "another word for an option": (
        lambda: pk.retime(PEPPER, [STAND, NOD], velocity_scaling=0.5), "did you mean 'velocity_scale'",
    ),
    "another word that is passed on": (
        lambda: motion().check(PEPPER, velocity_scaling=0.5), "did you mean 'velocity_scale'",
    ),
    "gaze in millimeters": (lambda: pk.ik.solve(PEPPER, pk.ik.LookAt((1500, 0, 1000))), MILLIMETERS),
    "pointing in millimeters": (
        lambda: pk.ik.solve(PEPPER, pk.ik.PointAt("left", (1500, 500, 1000))), MILLIMETERS,
    ),
    "quaternion without order": (lambda: pk.pose(quaternion=(0, 0, 0, 1)), "quaternion_xyzw.*_wxyz"),
    "module called": (lambda: pk.ik(PEPPER, HAND), r"ik is a module.*solve"),
    "tensor with gradient": (lambda: pk.kinematics.frame_pose(PEPPER, tensor(), EFFECTOR), r"detach\(\)"),
    "waypoint twice": (lambda: pk.retime(PEPPER, [STAND, STAND, NOD]), "rows 0 and 1 .*leave one out"),
    "material twice": (lambda: pk.load_robot(materials()), "material name='blue'> stands twice"),
    "robot that touches itself, IK": (
        lambda: pk.ik.solve(pk.load_robot(chain(BALL)), pk.ik.FramePosition("l3", (0.1, 0, 0.28))),
        r"its own links.*SRDF",
    ),
    "robot that touches itself, plan": (
        lambda: pk.plan(pk.load_robot(chain(BALL)), np.zeros(3), np.full(3, 0.1)), r"its own links.*SRDF",
    ),
    "plan given to the twin": (lambda: pk.Twin(PEPPER).execute(failed_plan()), r"retime"),
}  # fmt: skip


def answer_of(mistake):
    """Return what a mistake is answered: the error's sentence, the warnings, or the report of the result."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            found = mistake()
        except PepperKinError as error:
            return str(error)
    said = [str(w.message) for w in caught if issubclass(w.category, (UserWarning, OvershootWarning))]
    return "\n".join([*said, found.report() if hasattr(found, "report") else ""])


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_answered_by_what_to_do(name):
    mistake, words = MISTAKES[name]
    answer = answer_of(mistake)
    assert re.search(words, answer, re.DOTALL), answer


def test_there_are_fifty():
    assert len(MISTAKES) >= 50


def test_angles_and_scenes_that_are_right_are_left_alone():
    with pytest.raises(LimitError) as outside:
        pk.plan(PEPPER, STAND, STAND + 3.0)
    assert "degrees" not in str(outside.value)
    assert pk.pose(rpy=(0, 0, -2 * np.pi)).shape == (4, 4)
    assert "empty" not in pk.plan(PEPPER, STAND, NOD).report()
    assert "empty" not in pk.ik.solve(PEPPER, HAND).report()
    assert "millimeters" not in pk.ik.solve(PEPPER, pk.ik.LookAt((30.0, 0, 1))).report()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        PEPPER.with_limits(velocity=2 * PEPPER.velocity_limits, lower={"LWristYaw": -2.5})
    assert (
        "SRDF" not in pk.ik.solve(pk.load_robot(chain("")), pk.ik.FramePosition("l3", (0.1, 0, 0.2))).report()
    )


def test_calls_that_fail_for_another_reason_keep_their_error():
    with pytest.raises(TypeError, match="missing 1 required positional argument: 'path'"):
        pk.retime(PEPPER)

    def broken(s, wrong=0):
        return int(speed=s)

    with pytest.raises(TypeError, match="'speed' is an invalid keyword"):
        pk.motion.follow(PEPPER, STAND, broken, 1.0, speed=0.1)


def test_labeled_positions_go_by_their_names():
    series = pd.Series(STAND, index=PEPPER.joint_names).sort_index()
    frame = pd.DataFrame([STAND, STAND], columns=PEPPER.joint_names)[sorted(PEPPER.joint_names)]
    expected = pk.kinematics.frame_pose(PEPPER, STAND, "LArm_effector")
    np.testing.assert_array_equal(pk.kinematics.frame_pose(PEPPER, series, "LArm_effector"), expected)
    found = pk.kinematics.frame_pose(PEPPER, frame, "LArm_effector")
    np.testing.assert_allclose(found, [expected, expected], atol=1e-12)
    unnamed = pd.Series(STAND)
    np.testing.assert_array_equal(pk.kinematics.frame_pose(PEPPER, unnamed, "LArm_effector"), expected)
