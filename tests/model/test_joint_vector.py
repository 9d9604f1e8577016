"""Joint vectors from names, groups and sequences, with and without limits."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError, LimitError, UnknownNameError

PEPPER = pk.load_pepper()
STAND = PEPPER.posture("Stand")


def test_some_joints_are_set_and_the_rest_stay():
    q = PEPPER.joint_vector({"HeadYaw": 0.3, "RWristYaw": -1})
    expected = STAND.copy()
    expected[[3, 14]] = 0.3, -1.0
    np.testing.assert_array_equal(q, expected)
    crouched = PEPPER.joint_vector({"HeadYaw": 0.3}, rest="Crouch")
    np.testing.assert_array_equal(np.delete(crouched, 3), np.delete(PEPPER.posture("Crouch"), 3))
    low = PEPPER.joint_vector({"HeadYaw": 0.3}, rest=PEPPER.lower_limits)
    np.testing.assert_array_equal(np.delete(low, 3), np.delete(PEPPER.lower_limits, 3))
    assert PEPPER.lower_limits[3] != 0.3  # a copy was changed


def test_a_group_takes_a_sequence():
    q = PEPPER.joint_vector({"left_arm": (0.5, 0.2, -0.4, -0.9, 0.1), "head": [0.1, 0.2]})
    np.testing.assert_array_equal(q[3:10], (0.1, 0.2, 0.5, 0.2, -0.4, -0.9, 0.1))
    np.testing.assert_array_equal(q[10:], STAND[10:])


def test_a_sequence_is_the_whole_vector():
    numbers = [0.01 * j for j in range(15)]
    for q_like in (numbers, tuple(numbers), np.array(numbers)):
        q = PEPPER.joint_vector(q_like)
        np.testing.assert_array_equal(q, numbers)
    q_like = np.array(numbers)
    PEPPER.joint_vector(q_like)[0] = 7.0
    assert q_like[0] == 0.0


def test_limits_are_checked_where_asked_for():
    beyond = float(PEPPER.upper_limits[3]) + 0.5
    assert PEPPER.joint_vector({"HeadYaw": beyond})[3] == beyond
    with pytest.raises(
        LimitError, match=r"joint vector: HeadYaw = 2.58\d* rad is outside \[-2.08\d*, 2.08\d*\]"
    ):
        PEPPER.joint_vector({"HeadYaw": beyond}, check_limits=True)
    with pytest.raises(LimitError, match="LElbowRoll"):
        PEPPER.joint_vector(np.where(np.arange(15) == 8, 1.0, STAND), check_limits=True)
    np.testing.assert_array_equal(PEPPER.joint_vector(STAND, check_limits=True), STAND)


def test_misuse_is_named():
    for values, error, words in [
        ({"Tail": 0.1}, UnknownNameError, "unknown joint or group 'Tail'"),
        ({"HeadYaw": "left"}, InvalidValueError, "position of HeadYaw: got 'left'"),
        ({"HeadYaw": np.nan}, InvalidValueError, "position of HeadYaw: got nan"),
        ({"HeadYaw": [0.1, 0.2]}, InvalidValueError, r"position of HeadYaw: got shape \(2,\)"),
        ({"head": 0.1}, InvalidValueError, r"position of head: got shape \(\), expected shape \(2,\)"),
        ({"head": (0.1, 0.2), "HeadYaw": 0.3}, InvalidValueError, "position of HeadYaw: got two values"),
        ([0.1, 0.2], InvalidValueError, r"joint vector: got shape \(2,\), expected shape \(15,\)"),
    ]:
        with pytest.raises(error, match=words):
            PEPPER.joint_vector(values)


def test_an_unknown_rest_is_named():
    with pytest.raises(UnknownNameError, match="unknown posture 'Sit'"):
        PEPPER.joint_vector({}, rest="Sit")
