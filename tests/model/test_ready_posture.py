"""The posture that motions begin from: room around the arms, balance, and little torque."""

import numpy as np

import pepper_kin as pk

PEPPER = pk.load_pepper()
READY = PEPPER.posture("Ready")


def test_nothing_is_within_3_cm_and_the_wrists_clear_the_pelvis_by_more():
    near = pk.collision.near_pairs(PEPPER, READY, 0.1)
    assert near.distances.min() > 0.03
    wrists = [d for names, d in zip(near.names, near.distances, strict=True) if "Pelvis" in names]
    assert min(wrists, default=0.1) > 0.03
    assert pk.collision.clearance(PEPPER, PEPPER.posture("Stand")) < 0.004  # NAOqi's, as it was


def test_it_stands_and_takes_a_fifth_of_the_torque():
    still = np.zeros(PEPPER.n)
    assert pk.dynamics.tip_over_margin(PEPPER, READY, still, still) > 0.08
    assert np.abs(pk.dynamics.gravity_torque(PEPPER, READY) / PEPPER.effort_limits).max() < 0.2


def test_it_is_symmetric_and_the_same_with_other_hands_and_bases():
    mirrored = [n.replace("L", "R", 1) for n in PEPPER.joint_group("left_arm")]
    left = [READY[PEPPER.joint_index(name)] for name in PEPPER.joint_group("left_arm")]
    right = [READY[PEPPER.joint_index(name)] for name in mirrored]
    np.testing.assert_array_equal(np.abs(left), np.abs(right))
    for hands in ("mimic", "independent"):
        other = pk.load_pepper(base="planar", hands=hands)
        same = [other.joint_index(name) for name in PEPPER.joint_names]
        np.testing.assert_array_equal(other.posture("Ready")[same], READY)
