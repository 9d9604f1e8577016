"""The servo's clock: a new aim begins at once, and yet no second has more ticks than it should."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.ik import HandPosition
from pepper_kin.viewer.server.follower import MOST_TICKS, RATE, Follower

TICK = 1.0 / RATE


@pytest.fixture
def follower(pepper):
    q = pepper.joint_vector({"LShoulderPitch": 0.9, "LElbowRoll": -1.0, "LShoulderRoll": 0.2})
    return Follower(pepper, q, pk.Scene())


def aim(follower, pepper, lift):
    q = pepper.joint_vector({"LShoulderPitch": 0.9, "LElbowRoll": -1.0, "LShoulderRoll": 0.2})
    start = pk.kinematics.frame_pose(pepper, q, "LArm_effector")[:3, 3]
    follower.aim([HandPosition("left", start + np.array([0.02, 0.02, lift]))])


def test_a_new_aim_is_followed_at_once_and_the_next_tick_comes_later(follower, pepper):
    assert follower.wait == TICK
    aim(follower, pepper, 0.03)
    assert follower.wait == 0.0
    assert follower.advance(0.2 * TICK) is not None
    assert follower.wait == pytest.approx(1.8 * TICK)
    assert follower.advance(1.7 * TICK) is None
    assert follower.wait == pytest.approx(0.1 * TICK)
    assert follower.advance(0.1 * TICK + 1e-9) is not None
    aim(follower, pepper, 0.04)  # another one as soon as the last was followed
    follower.advance(0.1 * TICK)
    aim(follower, pepper, 0.05)
    assert follower.wait == pytest.approx(1.9 * TICK)
    assert follower.advance(0.5 * TICK) is None


def test_many_new_aims_make_time_pass_no_quicker(follower, pepper):
    rng, passed, ticks = np.random.default_rng(1), 0.0, 0
    while passed < 1.0:
        aim(follower, pepper, rng.uniform(0.0, 0.06))
        for step in rng.uniform(0.0, TICK, size=3):
            ticks += follower.advance(step) is not None
            passed += step
    assert abs(ticks - passed * RATE) <= 1.0


def test_lost_time_is_made_up_for_in_part(follower, pepper):
    q = pepper.joint_vector({"LShoulderPitch": 0.9, "LElbowRoll": -1.0, "LShoulderRoll": 0.2})
    other = Follower(pepper, q, pk.Scene())
    for one in (follower, other):
        aim(one, pepper, 0.05)
    late, _ = follower.advance(1.0)
    assert follower.wait == TICK
    states = [other.advance(TICK) for _ in range(MOST_TICKS)]
    np.testing.assert_array_equal(late.q, states[-1][0].q)


@pytest.mark.parametrize("seconds", [0.001, 0.01, 0.035])
def test_the_way_does_not_depend_on_how_time_is_cut(follower, pepper, seconds):
    """The body is where as many ticks take it, however they were asked for."""
    q = pepper.joint_vector({"LShoulderPitch": 0.9, "LElbowRoll": -1.0, "LShoulderRoll": 0.2})
    other = Follower(pepper, q, pk.Scene())
    aim(follower, pepper, 0.05)
    aim(other, pepper, 0.05)
    steps = round(0.35 / seconds)
    mine = [done for _ in range(steps) if (done := follower.advance(seconds)) is not None][-1]
    theirs = [done for _ in range(70) if (done := other.advance(0.005)) is not None][-1]
    away = np.abs(np.array(mine[0].q) - np.array(theirs[0].q)).max()
    assert away <= 2 * TICK * float(pepper.velocity_limits.max())
    assert np.abs(np.array(mine[0].q) - q).max() > 0.05
