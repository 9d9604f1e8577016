"""One rule for collisions: on unless `collisions=False`, whatever the scene, and said where they are not."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError

PEPPER = pk.load_pepper()
STAND = PEPPER.posture("Stand")
ACROSS = pk.ik.HandPosition("left", (0.08, -0.05, 0.85))
"""A point behind the chest's shapes: the hand meets the trunk there."""


def touching(q):
    return bool(pk.collision.in_collision(PEPPER, q))


def test_ik_without_a_scene_keeps_the_robot_clear_of_itself():
    alone = pk.ik.solve(PEPPER, ACROSS)
    same = pk.ik.solve(PEPPER, ACROSS, scene=pk.Scene())
    np.testing.assert_array_equal(alone.q, same.q)
    assert alone.in_collision == touching(alone.q)
    assert not (alone.success and alone.in_collision)
    assert "not examined" not in alone.report()


def test_ik_without_collisions_says_so():
    free = pk.ik.solve(PEPPER, ACROSS, collisions=False)
    assert free.success
    assert touching(free.q)
    assert free.in_collision is None
    assert free.clearance is None
    assert "collisions were not examined" in free.report()


def test_batches_follow_the_same_rule():
    targets = np.random.default_rng(3).uniform((0.0, -0.3, 0.6), (0.5, 0.5, 1.2), (60, 3))
    task = pk.ik.HandPosition("left", targets)
    checked = pk.ik.solve_batch(PEPPER, task)
    assert not pk.collision.in_collision(PEPPER, checked.q[checked.success]).any()
    assert "not examined" not in checked.report()
    free = pk.ik.solve_batch(PEPPER, task, collisions=False)
    assert pk.collision.in_collision(PEPPER, free.q[free.success]).any()
    assert "collisions were not examined" in free.report()
    for q in pk.ik.solutions(PEPPER, pk.ik.HandPosition("left", (0.3, 0.2, 0.9)), count=4):
        assert not touching(q)


def test_servo_and_its_single_step():
    for options, examined in (({}, True), ({"collisions": False}, False)):
        servo = pk.servo.Servo(PEPPER, STAND, **options)
        servo.set_target(ACROSS)
        states = [servo.step() for _ in range(300)]
        assert touching(states[-1].q) != examined
        assert ("collisions were not examined" in states[-1].report()) != examined
        assert (states[-1].clearance is None) != examined
    hand = pk.ik.HandPosition("left", (0.3, 0.25, 0.9))
    step = pk.servo.differential_step(PEPPER, STAND, 0 * STAND, 0.01, hand)
    same = pk.servo.differential_step(PEPPER, STAND, 0 * STAND, 0.01, hand, scene=pk.Scene())
    np.testing.assert_array_equal(step.v, same.v)


def test_placements_and_certificates():
    hand = pk.ik.HandPosition("left", (0.6, 0.25, 0.9))
    found = pk.base_placement.place_base(PEPPER, hand, candidates=12)
    assert not any(result.in_collision for result in found.best.results)
    free = pk.base_placement.place_base(PEPPER, hand, candidates=12, collisions=False)
    assert "collisions were not examined" in free.report()
    inward = PEPPER.joint_vector(
        {"LShoulderPitch": 0.9, "LShoulderRoll": 0.01, "LElbowRoll": -1.4}, rest=STAND
    )
    motion = pk.retime(PEPPER, [STAND, inward])
    certificate = motion.check(PEPPER)
    assert certificate.self_clearance.value == motion.check(PEPPER, pk.Scene()).self_clearance.value
    left_out = motion.check(PEPPER, collisions=False)
    assert left_out.self_clearance is None
    assert "self clearance: not examined" in left_out.report()


def test_misuse_is_refused_by_name():
    for call in [
        lambda **k: pk.ik.solve(PEPPER, ACROSS, **k),
        lambda **k: pk.ik.solutions(PEPPER, ACROSS, **k),
        lambda **k: pk.servo.Servo(PEPPER, STAND, **k),
        lambda **k: pk.servo.differential_step(PEPPER, STAND, 0 * STAND, 0.01, ACROSS, **k),
        lambda **k: pk.base_placement.place_base(PEPPER, ACROSS, **k),
        lambda **k: pk.base_placement.placement_map(PEPPER, ACROSS, center=(0, 0), **k),
        lambda **k: pk.trajectory.check(PEPPER, pk.motion.gesture(PEPPER, "nod"), **k),
    ]:
        with pytest.raises(InvalidValueError, match="collisions: got False, expected True"):
            call(scene=pk.Scene(), collisions=False)
        with pytest.raises(InvalidValueError, match="scene: got 'table', expected a Scene"):
            call(scene="table")
