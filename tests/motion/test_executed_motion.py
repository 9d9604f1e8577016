"""What a live motion sent, as one trajectory: that of its cycles, with one certificate."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.motion import LiveMotion, executed


@pytest.fixture(scope="module")
def states():
    """Cycles to one goal and another, one of them late, so that the robot stops for a while."""
    pepper = pk.load_pepper()
    live = LiveMotion(pepper, pepper.posture("Ready"), budget=1.0)
    found = []
    for cycle in range(60):
        now = 5.0 + cycle / 30 + (1.5 if cycle >= 10 else 0.0)
        live.set_goal(
            pepper.joint_vector({"HeadYaw": 0.9 if cycle < 30 else -0.5}, rest=pepper.posture("Ready"))
        )
        found.append(live.step(now))
    return found


def test_it_is_at_each_time_what_the_newest_cycle_sent(states):
    motion, begins = executed(states), np.array([state.begin for state in states])
    assert motion.duration == pytest.approx(begins[-1] - begins[0] + states[-1].trajectory.duration)
    for t in np.random.default_rng(0).uniform(begins[0], begins[-1] + 0.3, 300):
        newest = states[np.searchsorted(begins, t, side="right") - 1].at(t)
        found = motion(min(t - begins[0], motion.duration))
        np.testing.assert_allclose(found[:2], newest[:2], atol=1e-9)


def test_its_certificate_counts_what_stands_in_the_way_that_was_gone(states):
    pepper, motion = pk.load_pepper(), executed(states)
    assert motion.check(pepper).success, motion.check(pepper).report()
    eye = pk.kinematics.frame_pose(pepper, motion(0.4 * motion.duration)[0], "CameraTop_frame")[:3, 3]
    certificate = motion.check(pepper, pk.Scene().add_sphere("ball", 0.05, eye))
    assert certificate.failures == ("obstacle_clearance",)


def test_cycles_that_do_not_go_on_from_one_another_are_refused(states):
    with pytest.raises(InvalidValueError, match="in order"):
        executed([])
    with pytest.raises(InvalidValueError, match="in order"):
        executed([state.status for state in states])
    with pytest.raises(InvalidValueError, match="times that rise"):
        executed(states[::-1])
    with pytest.raises(InvalidValueError, match="where the first one ends"):
        executed([states[0], states[40]])
