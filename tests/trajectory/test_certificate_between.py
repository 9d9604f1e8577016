"""Certificates between the states examined: coal and Pinocchio at a hundredth of a millisecond decide."""

import re

import numpy as np
import pinocchio
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.trajectory import Trajectory
from pepper_kin.trajectory.certificate import ScalarCheck


@pytest.fixture(scope="module")
def swing(pepper):
    """Return a fast swing of the left arm."""
    pose = {"LElbowRoll": -0.02, "LShoulderRoll": 0.6}
    ends = [pepper.joint_vector({**pose, "LShoulderPitch": angle}) for angle in (1.0, -1.0)]
    return pk.retime(pepper, ends)


def thin_plate(pepper, motion, at, gap=0.0):
    """Return a scene with a plate of 0.5 mm, held across its way, and a bead that it meets at a time [s].

    Args:
        pepper: The robot.
        motion: How it moves.
        at: When the middle of the plate is where the bead is [s].
        gap: The bead stands so far beside the plate's edge instead [m].
    """
    held = np.eye(4)
    held[0, 3] = 0.2
    before, now = (
        pk.kinematics.frame_pose(pepper, motion([t]).position[0], "LArm_effector") @ held
        for t in (at - 1e-4, at)
    )
    way = now[:3, :3].T @ (now - before)[:3, 3]
    turn = np.linalg.svd((way / np.linalg.norm(way))[None])[2][::-1].T
    held[:3, :3] = turn if np.linalg.det(turn) > 0 else turn * [-1.0, 1.0, 1.0]
    place = now[:3, 3] + (0.0 if gap == 0.0 else 0.05 + 0.0001 + gap) * now[:3, :3] @ held[:3, 0]
    scene = pk.Scene().add_sphere("bead", 0.0001, place).add_box("plate", (0.1, 0.1, 0.0005), (0.0, 0.0, 3.0))
    return scene.attach("plate", "LArm_effector", held)


@pytest.mark.parametrize("share", np.linspace(0.02, 0.98, 7))
def test_what_touches_between_two_milliseconds_is_not_certified(pepper, swing, share):
    at = (round(1000 * swing.duration / 2) + share) / 1000
    scene = thin_plate(pepper, swing, at)
    times = at + np.arange(-60, 61) * 1e-5
    assert pk.collision.in_collision(pepper, swing(times).position, scene).any()
    found = swing.check(pepper, scene).obstacle_clearance
    assert not found.success
    assert "VIOLATED" in found.sentence()


def test_what_keeps_a_millimeter_is_certified_with_a_bound_that_holds(pepper, swing):
    for at in np.linspace(0.4, 0.6, 4) * swing.duration:
        scene = thin_plate(pepper, swing, at, gap=0.0012)
        times = at + np.arange(-400, 401) * 1e-5
        least = pk.collision.least_clearance(pepper, swing(times).position, scene, to="obstacles").distance
        assert 0.0 < least < 0.0025
        found = swing.check(pepper, scene).obstacle_clearance
        assert found.success, found.sentence()
        assert 0.0 < found.margin <= least + 2e-6
        assert found.margin == pytest.approx(found.value - found.resolution)


def test_a_margin_is_proven_or_not_kept(pepper, swing):
    """It is kept up to the distance that coal finds at a hundredth of a millisecond, and not beyond."""
    at = 0.5 * swing.duration
    scene = thin_plate(pepper, swing, at, gap=0.0042)
    times = at + np.arange(-400, 401) * 1e-5
    least = pk.collision.least_clearance(pepper, swing(times).position, scene, to="obstacles").distance
    for margin, kept in ((least - 1e-4, True), (least + 1e-5, False), (least + 0.01, False)):
        found = swing.check(pepper, scene, margin=margin).obstacle_clearance
        assert found.success == kept, found.sentence()
        assert found.margin <= least - margin + 2e-6
        value, asked = re.search(r"([\d.e-]+) m is the .*, ([\d.e-]+) m asked", found.sentence()).groups()
        assert (float(value) >= float(asked)) == kept
    with pytest.raises(InvalidValueError, match="margin"):
        swing.check(pepper, scene, margin=-0.01)


def highest(pepper, motion):
    """Return the greatest shares of torque limits, (n,), and speed of the left hand [m/s], by Pinocchio."""
    model, share, speed = pepper.pinocchio_model, np.zeros(pepper.n), 0.0
    data, frame = model.createData(), model.getFrameId("LArm_effector")
    for q, v, a in zip(*motion(np.arange(0.0, motion.duration, 2e-5)), strict=True):
        share = np.maximum(share, np.abs(pinocchio.rnea(model, data, q, v, a)) / model.effortLimit)
        pinocchio.forwardKinematics(model, data, q, v)
        speed = max(speed, np.linalg.norm(pinocchio.getFrameVelocity(model, data, frame).linear))
    return share, speed


def test_torques_and_speeds_are_certified_up_to_their_limits_and_no_further(pepper):
    """With 0.1 % to spare they pass, 0.2 % above the limit they do not."""
    rng = np.random.default_rng(8)
    low, high = pepper.lower_limits, pepper.upper_limits
    for _ in range(2):
        goal = low + (high - low) * rng.uniform(0.2, 0.8, pepper.n)
        motion = pk.retime(pepper, [pepper.posture("Stand"), goal])
        share, speed = highest(pepper, motion)
        for factor, kept in ((1 / (1 - 1e-3), True), (1 / (1 + 2e-3), False)):
            found = motion.check(
                pepper,
                collisions=False,
                torque_scale=share.max() * factor,
                hand_speed={"left": speed * factor},
            )
            assert found.torque.success == kept, found.torque.sentence()
            assert found.hand_speed.success == kept, found.hand_speed.sentence()


@pytest.mark.parametrize(("use", "kept"), [(1.3, False), (1.002, False), (0.7, True)])
def test_a_torque_that_rises_and_falls_between_two_states_counts(pepper, use, kept):
    """The head turns by a jolt of one millisecond, whose acceleration is zero at both of its ends."""
    start, j, step = pepper.posture("Stand"), pepper.joint_index("HeadYaw"), 1e-3
    inertia = pk.dynamics.mass_matrix(pepper, start)[j, j]
    rise = 4 * use * pepper.effort_limits[j] / inertia  # a = rise u (1 - u), u = t / step
    coefficients = np.zeros((3, 5, pepper.n))
    coefficients[:, 0] = start
    coefficients[1, 3:, j] = rise / (6 * step), -rise / (12 * step**2)
    coefficients[2, :2, j] = start[j] + rise * step**2 / 12, rise * step / 6
    breaks = [0.0, 0.01, 0.01 + step, 0.02]
    jolt = Trajectory(pepper.joint_names, breaks, coefficients, pepper.joint_units)
    assert highest(pepper, jolt)[0][j] == pytest.approx(use, rel=1e-3)
    found = jolt.check(pepper, collisions=False).torque
    assert np.abs(found.value[j]) < 0.1 * found.upper[j]
    assert found.success == kept
    assert ("proves no limit" in found.sentence()) == (not kept)
    assert found.resolution[j] >= (use - 0.1) * found.upper[j]


@pytest.mark.parametrize(("margin", "word"), [(0.01, "NOT PROVEN"), (-0.01, "VIOLATED")])
def test_what_is_only_not_proven_is_not_called_violated(margin, word):
    check = ScalarCheck("balance", margin, 0.02 + margin, 0.1, "m", "inside", resolution=0.1, allowance=1e-4)
    assert not check.success
    assert check.sentence().startswith(f"balance: {word}: ")
