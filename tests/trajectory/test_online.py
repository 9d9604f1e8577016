"""Motion online: states meet, limits hold, joints arrive together, targets change in mid-motion."""

import contextlib

import numpy as np
import pytest

from pepper_kin.exceptions import InfeasibleError, InvalidValueError, LimitError
from pepper_kin.trajectory import OnlineMotion


def posture(pepper, seed):
    rng = np.random.default_rng(seed)
    middle = (pepper.lower_limits + pepper.upper_limits) / 2
    return middle + 0.7 * (rng.uniform(pepper.lower_limits, pepper.upper_limits) - middle)


@pytest.mark.parametrize("seed", range(20))
def test_targets_that_change_in_mid_motion(pepper, seed):
    rng = np.random.default_rng(seed)
    motion = OnlineMotion(pepper, posture(pepper, seed), jerk="moderate")
    states = []
    for k in range(4):
        with contextlib.suppress(InfeasibleError):  # too fast to stop inside the position limits
            motion.set_target(posture(pepper, 100 * seed + k))
        for _ in range(int(rng.integers(5, 60))):
            state = motion.step(0.01)
            states.append((motion.time, state))
    while not motion.arrived:
        motion.step(0.01)
    np.testing.assert_allclose(motion.state.position, motion.target, atol=1e-8)
    trajectory = motion.to_trajectory()
    found = trajectory.check(pepper, jerk="moderate", collisions=False)
    assert set(found.failures) <= {"torque", "balance"}, found.report()
    for time, state in states:
        for ours, theirs in zip(state, trajectory(time), strict=True):
            np.testing.assert_allclose(ours, theirs, atol=1e-8)


def test_duration_is_the_closed_form_of_the_slowest_joint(pepper):
    q = pepper.posture("Stand")
    j = pepper.joint_index("HeadYaw")
    goal = q + 0.4 * (np.arange(pepper.n) == j)
    motion = OnlineMotion(pepper, q, jerk=1e6)
    a = pepper.acceleration_limits[j]
    assert motion.set_target(goal) == pytest.approx(2 * np.sqrt(0.4 / a), rel=1e-3)
    both = goal + 0.01 * (np.arange(pepper.n) == 8)
    motion = OnlineMotion(pepper, q, jerk=1e6)
    motion.set_target(both)
    late = motion.to_trajectory()
    velocity = np.abs(late(late.duration - 1e-3).velocity)
    assert velocity[8] > 0  # the short way arrives with the long one
    assert np.count_nonzero(velocity) == 2


def test_arriving_with_a_velocity_goes_on_with_it(pepper):
    q = pepper.posture("Stand")
    j = pepper.joint_index("HeadYaw")
    goal, rate = q + 0.5 * (np.arange(pepper.n) == j), 0.3 * (np.arange(pepper.n) == j)
    motion = OnlineMotion(pepper, q)
    duration = motion.set_target(goal, rate)
    state = motion.step(duration + 0.1)
    np.testing.assert_allclose(state.velocity, rate, atol=1e-9)
    np.testing.assert_allclose(state.position, goal + 0.1 * rate, atol=1e-8)


def test_starting_in_motion_it_comes_to_rest(pepper):
    q = pepper.posture("Stand")
    v = 0.5 * (np.arange(pepper.n) == pepper.joint_index("HeadYaw"))
    motion = OnlineMotion(pepper, q, v)
    np.testing.assert_allclose(motion.state.velocity, v)
    while not motion.arrived:
        motion.step(0.01)
    assert np.abs(motion.state.velocity).max() < 1e-9
    assert motion.to_trajectory().check(pepper, jerk="moderate", collisions=False).jerk.success


def test_a_target_where_it_is_takes_no_time(pepper):
    q = pepper.posture("Stand")
    motion = OnlineMotion(pepper, q)
    assert motion.set_target(q) == pytest.approx(0.0, abs=1e-9)
    assert motion.arrived
    with pytest.raises(InvalidValueError, match="motion: got a duration of zero"):
        motion.to_trajectory()
    motion.step(0.1)
    assert motion.to_trajectory().duration == pytest.approx(0.1)


def test_states_are_read_only_and_inputs_copied(pepper):
    q = pepper.posture("Stand").copy()
    motion = OnlineMotion(pepper, q)
    q += 1.0
    np.testing.assert_array_equal(motion.state.position, pepper.posture("Stand"))
    with pytest.raises(ValueError, match="read-only"):
        motion.step(0.1).position[0] = 1.0


def test_refusals_name_what_is_wrong(pepper):
    q = pepper.posture("Stand")
    head = np.arange(pepper.n) == pepper.joint_index("HeadYaw")
    for call, error, message in [
        (lambda: OnlineMotion(pepper, q * np.nan), InvalidValueError, "q: .*nan"),
        (lambda: OnlineMotion(pepper, q + 9 * head), LimitError, "q: HeadYaw = 8.99"),
        (lambda: OnlineMotion(pepper, q, 99 * head), LimitError, "v: HeadYaw = 99 rad/s is outside"),
        (lambda: OnlineMotion(pepper, q, 0, 999 * head), LimitError, "a: HeadYaw = 999 rad/s\\^2 is outside"),
        (lambda: OnlineMotion(pepper, q[None]), InvalidValueError, r"q: got shape \(1, 15\)"),
        (lambda: OnlineMotion(pepper, q, velocity_scale=2), InvalidValueError, "velocity_scale: got 2"),
        (lambda: OnlineMotion(pepper, q).set_target(q + 9 * head), LimitError, "q_target: HeadYaw = 8.99"),
        (lambda: OnlineMotion(pepper, q).set_target(q, 99 * head), LimitError, "v_target: HeadYaw = 99"),
        (lambda: OnlineMotion(pepper, q).step(0), InvalidValueError, "dt: got 0"),
        (lambda: OnlineMotion(pepper, q).step(float("nan")), InvalidValueError, "dt: got nan"),
    ]:
        with pytest.raises(error, match=message):
            call()


def test_too_fast_to_stop_inside_the_limits_is_refused(pepper):
    q = pepper.posture("Stand").copy()
    j = pepper.joint_index("HeadYaw")
    q[j] = pepper.upper_limits[j] - 0.01
    v = 3.0 * (np.arange(pepper.n) == j)
    with pytest.raises(InfeasibleError, match=r"HeadYaw would pass .* rad on the way, outside"):
        OnlineMotion(pepper, q, v)
