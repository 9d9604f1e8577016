"""The library of gestures: every one passes the certificate, for both sides, sizes and tempos."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.motion import gesture, gesture_meaning, gesture_names
from pepper_kin.motion.gesture_scores import SCORES

VARIANTS = [
    {},
    {"side": "left", "amplitude": 1.25, "tempo": 4.0},
    {"side": "right", "amplitude": 0.4, "tempo": 2.0},
]


@pytest.mark.parametrize("name", gesture_names())
def test_every_gesture_is_certified(pepper, name):
    """In full at tempo 4; the others' clearance, which does not depend on the pace, every 20 ms."""
    body = pk.Scene()
    for variant in VARIANTS:
        found = gesture(pepper, name, **variant)
        certificate = found.check(pepper, body if variant.get("tempo") == 4.0 else None)
        assert certificate.success, f"{name} {variant}: {certificate.report()}"
        position = found.sample(0.02).position
        assert not pk.collision.in_collision(pepper, position, body).any()
        np.testing.assert_allclose(found.start, pepper.posture("Stand"), atol=1e-12)
        np.testing.assert_allclose(found.end, pepper.posture("Stand"), atol=1e-12)


@pytest.mark.parametrize("name", gesture_names())
def test_left_is_the_mirror_of_right(pepper, name):
    """The authored keys, mirrored through the plane between the sides, end at mirrored hands."""
    right, left = gesture(pepper, name), gesture(pepper, name, side="left")
    t = np.linspace(0.2, 0.8, 7) * min(right.duration, left.duration)
    mirror = np.array([1.0, -1.0, 1.0])
    for ours, theirs in (("LArm_effector", "RArm_effector"), ("RArm_effector", "LArm_effector")):
        there = pk.kinematics.frame_pose(pepper, right(t).position, theirs)[:, :3, 3]
        here = pk.kinematics.frame_pose(pepper, left(t).position, ours)[:, :3, 3]
        np.testing.assert_allclose(here, there * mirror, atol=0.03)  # Stand itself is not symmetric


def test_the_named_hand_acts(pepper):
    for name, least in [("wave", 0.4), ("point", 0.2), ("beat", 0.1), ("think", 0.3)]:
        for side, hand, other in (("right", "RArm", "LArm"), ("left", "LArm", "RArm")):
            motion = gesture(pepper, name, side=side).sample(0.02).position
            height = {
                arm: pk.kinematics.frame_pose(pepper, motion, f"{arm}_effector")[:, 2, 3]
                for arm in (hand, other)
            }
            assert np.ptp(height[hand]) > least
            assert np.ptp(height[other]) < 0.05


def test_gestures_look_like_what_they_say(pepper):
    def of(name, joint, **options):
        return gesture(pepper, name, **options).sample(0.01).position[:, pepper.joint_index(joint)]

    assert of("nod", "HeadPitch").max() > 0.15  # down is positive
    assert np.ptp(of("shake-head", "HeadYaw")) > 0.8
    assert of("bow", "HipPitch").min() < -0.4  # forward is negative
    assert np.ptp(of("bow", "HipRoll")) < 0.01
    assert np.ptp(of("look-around", "HeadYaw")) > 1.7
    assert np.ptp(of("sway", "HipRoll")) > 0.15
    clap = gesture(pepper, "clap").sample(0.01).position
    hands = [pk.kinematics.frame_pose(pepper, clap, f"{a}Arm_effector")[:, :3, 3] for a in "LR"]
    apart = np.linalg.norm(hands[0] - hands[1], axis=1)
    dips = np.flatnonzero((apart[1:-1] < apart[:-2]) & (apart[1:-1] <= apart[2:]) & (apart[1:-1] < 0.25))
    assert dips.size == 3


def test_amplitude_scales_and_tempo_hastens(pepper):
    j = pepper.joint_index("HeadPitch")
    rest = pepper.posture("Stand")[j]
    ways = [
        np.ptp(gesture(pepper, "nod", amplitude=a).sample(0.005).position[:, j] - rest) for a in (0.5, 1.0)
    ]
    assert ways[1] == pytest.approx(2 * ways[0], rel=0.02)
    slow, normal, fast = (gesture(pepper, "breathe", tempo=tempo).duration for tempo in (0.5, 1.0, 2.0))
    assert slow == pytest.approx(16.0, abs=0.05)
    assert normal == pytest.approx(8.0, abs=0.05)
    assert fast == pytest.approx(4.0, abs=0.05)


@pytest.mark.thorough
def test_robots_with_hands_and_a_moving_base_gesture_too():
    for options in ({"base": "planar"}, {"hands": "mimic"}):
        other = pk.load_pepper(**options)
        found = gesture(other, "wave")
        assert found.joint_names == other.joint_names
        assert found.check(other).success


def test_a_gesture_begins_where_the_base_has_driven():
    """Its joints are those of the gesture at the base's zero; hands are moved by the base's pose."""
    planar = pk.load_pepper(base="planar")
    away = planar.joint_vector({"BaseX": 0.4, "BaseY": -0.1, "BaseYaw": 0.5})
    drive = pk.retime(planar, [planar.posture("Stand"), away])
    there, home = gesture(planar, "wave", start=drive.end), gesture(planar, "wave")
    both = drive.then(there)
    assert both.duration == pytest.approx(drive.duration + home.duration)
    assert both.check(planar).success
    base = pk.pose((0.4, -0.1, 0.0), rpy=(0, 0, 0.5))
    for t in np.linspace(0.0, home.duration, 9):
        hand, first = (
            pk.kinematics.frame_pose(planar, g(t).position, "RArm_effector") for g in (there, home)
        )
        np.testing.assert_allclose(hand, base @ first, atol=1e-9)
    bent = away.copy()
    bent[planar.joint_index("HeadYaw")] = 0.2
    with pytest.raises(InvalidValueError, match=r"start: got HeadYaw at 0\.2 rad, expected the posture"):
        gesture(planar, "wave", start=bent)


def test_names_and_meanings():
    names = gesture_names()
    assert len(names) == len(set(names)) == len(SCORES) >= 20
    assert {"wave", "point", "nod", "bow", "shrug", "welcome", "yes", "no", "me", "you"} <= set(names)
    assert all(gesture_meaning(name) for name in names)
    for score in SCORES.values():
        times = [0.0, *(key.time for key in score.keys), score.duration]
        assert np.all(np.diff(times) > 0)


def test_wrong_options(pepper):
    for options, message in [
        ({"side": "middle"}, "side: got 'middle'"),
        ({"amplitude": 0.0}, "amplitude: got 0.0, expected a number above 0 and at most 1.25"),
        ({"amplitude": 1.3}, "amplitude: got 1.3"),
        ({"amplitude": float("nan")}, "amplitude: got nan"),
        ({"amplitude": True}, "amplitude: got True"),
        ({"tempo": 0.1}, "tempo: got 0.1, expected a number at least 0.25 and at most 4"),
        ({"tempo": 9}, "tempo: got 9"),
        ({"tempo": "fast"}, "tempo: got 'fast'"),
    ]:
        with pytest.raises(InvalidValueError, match=message):
            gesture(pepper, "wave", **options)


def test_unknown_gestures(pepper):
    for ask in (lambda: gesture(pepper, "dance"), lambda: gesture_meaning("dance")):
        with pytest.raises(UnknownNameError, match="unknown gesture 'dance'; available: wave, point"):
            ask()
