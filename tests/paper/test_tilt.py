"""Joint angles from accelerometers on the links."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.paper.tilt import GRAVITY, measure_by_tilt, tilt_angles


def turn(axis: str, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return {
        "x": np.array([[1, 0, 0], [0, c, -s], [0, s, c]]),
        "y": np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]),
        "z": np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]),
    }[axis]


@pytest.mark.parametrize("angle", [-1.2, -0.3, 0.0, 0.7, 1.4])
def test_formulas_give_a_turn_about_one_horizontal_axis(angle):
    up = np.array([0.0, 0.0, GRAVITY])
    assert tilt_angles(turn("x", angle).T @ up)[0] == pytest.approx(angle, abs=1e-12)
    assert tilt_angles(turn("y", angle).T @ up)[1] == pytest.approx(angle, abs=1e-12)
    # The third is the tilt of z, the same for both; a turn about the vertical leaves no trace.
    assert tilt_angles(turn("y", angle).T @ up)[2] == pytest.approx(abs(angle), abs=1e-12)
    assert np.allclose(tilt_angles(turn("z", angle).T @ up), 0.0)


def test_formulas_refuse_what_is_not_a_vector():
    with pytest.raises(InvalidValueError, match=r"specific_force.*shape \(\.\.\., 3\)"):
        tilt_angles(np.zeros(4))


def motion(pepper, joints, amplitude=0.3, seconds=8.0):
    time = np.linspace(0.0, seconds, 800)
    q = np.tile(pepper.joint_vector({"LShoulderPitch": 0.5, "LElbowRoll": -0.8}), (len(time), 1))
    v, a = np.zeros_like(q), np.zeros_like(q)
    for k, name in enumerate(joints):
        j, w = pepper.joint_index(name), 0.5 + 0.1 * k
        q[:, j] += amplitude * np.sin(w * time)
        v[:, j], a[:, j] = amplitude * w * np.cos(w * time), -amplitude * w**2 * np.sin(w * time)
    return time, q, v, a


def test_without_noise_the_filter_recovers_every_joint_and_the_formulas_do_not():
    pepper = pk.load_pepper()
    joints = ("LShoulderPitch", "LElbowYaw", "LElbowRoll", "LWristYaw", "HeadPitch")
    found = measure_by_tilt(pepper, *motion(pepper, joints), joints, noise=False)
    assert found.estimate_error.max() < 2e-3
    assert found.formulas_error.max() > 0.1


def test_a_turn_about_the_vertical_is_seen_by_gyroscopes_only():
    pepper = pk.load_pepper()
    found = measure_by_tilt(pepper, *motion(pepper, ("HeadYaw",)), ("HeadYaw",), noise=False)
    assert found.blind.all()
    assert np.abs(found.formulas).max() < 0.05
    assert found.formulas_error[0] > 0.15
    assert found.estimate_error[0] < 2e-3


def test_noise_follows_its_seed_and_an_unknown_joint_is_named():
    pepper = pk.load_pepper()
    moved = motion(pepper, ("HeadPitch",))
    first, again, other = (
        measure_by_tilt(pepper, *moved, ("HeadPitch",), seed=s).estimate for s in (1, 1, 2)
    )
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
    with pytest.raises(UnknownNameError, match="Elbow"):
        measure_by_tilt(pepper, *moved, ("Elbow",))
