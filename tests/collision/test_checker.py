import gc
import weakref

import numpy as np
import pinocchio
import pytest

import pepper_kin as pk
from pepper_kin.collision.dependent_ranges import dependent_ranges
from pepper_kin.exceptions import InvalidValueError

TABLE = pk.Scene().add_box("table", size=(0.6, 1.0, 0.04), position=(0.55, 0.0, 0.70))


def random_q(pepper, count, seed=0):
    return np.random.default_rng(seed).uniform(pepper.lower_limits, pepper.upper_limits, (count, pepper.n))


def test_named_postures_keep_3_mm():
    pepper = pk.load_pepper()
    for name in pepper.posture_names:
        assert pk.collision.clearance(pepper, pepper.posture(name)) > 0.003, name


@pytest.mark.parametrize("base", ["fixed", "planar"])
@pytest.mark.parametrize("hands", ["locked", "mimic", "independent"])
def test_every_named_posture_is_free_however_the_robot_is_loaded(base, hands):
    pepper = pk.load_pepper(base=base, hands=hands)
    assert set(pepper.posture_names) == {"Stand", "StandInit", "StandZero", "Crouch", "Rest", "Ready"}
    for name in pepper.posture_names:
        q = pepper.posture(name)
        assert not pk.collision.in_collision(pepper, q), (name, pk.collision.closest_pair(pepper, q))


@pytest.mark.parametrize("hands", ["locked", "mimic"])
def test_an_open_hand_passes_the_pelvis_in_crouch(hands):
    """At every opening, and the nearest pair of hand and pelvis keeps 3 mm."""
    pepper = pk.load_pepper(hands=hands)
    for opening in np.linspace(0.02, 0.98, 9) if hands == "mimic" else (None,):
        q = np.array(pepper.posture("Crouch"))
        if opening is not None:
            q[[pepper.joint_index("LHand"), pepper.joint_index("RHand")]] = opening
        near = pk.collision.contacts(pepper, q, within=0.05)
        distances = [c.distance for c in near if "Pelvis" in c.links]
        assert distances
        assert min(distances) > 0.003, opening


def point_segment_distance(p, a, b):
    t = np.clip((p - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
    return np.linalg.norm(p - a - t * (b - a))


def test_clearance_to_the_only_near_thing():
    pepper = pk.load_pepper()
    q = pepper.posture("Stand")
    head = next(s for s in pepper.collision_shapes if s.link == "Head")
    pose = pk.kinematics.frame_pose(pepper, q, "Head") @ head.transform_shape_to_link
    center = pose[:3, 3] + [0.0, 0.0, 0.2]
    half = pose[:3, :3] @ [0, 0, head.geometry.length / 2]
    expected = (
        point_segment_distance(center, pose[:3, 3] - half, pose[:3, 3] + half) - head.geometry.radius - 0.0855
    )
    found = pk.collision.closest_pair(pepper, q, pk.Scene().add_sphere("lamp", 0.0855, center))
    assert found.names == ("Head", "lamp")
    assert found.distance == pytest.approx(expected, abs=1e-6)
    assert 0 < expected < 0.0032


def test_culled_clearance_equals_the_minimum_over_all_pairs():
    pepper = pk.load_pepper()
    checker = pk.collision.checker_for(pepper, TABLE)
    for q in random_q(pepper, 60):
        found = checker.clearance(q)
        data, geometry = checker._data[0], checker._data[1]._kept
        pinocchio.computeDistances(pepper.pinocchio_model, data, checker._shapes.model, geometry, q)
        assert found == pytest.approx(min(r.min_distance for r in geometry.distanceResults), abs=1e-6)


def test_collision_is_negative_clearance_or_a_violated_range():
    pepper = pk.load_pepper()
    q = random_q(pepper, 200, seed=1)
    ranges = np.any([table.violated(q) for table in dependent_ranges(pepper)], axis=0)
    negative = pk.collision.clearance(pepper, q, TABLE) < 0
    np.testing.assert_array_equal(pk.collision.in_collision(pepper, q, TABLE), negative | ranges)
    assert 0.2 < ranges.mean() < 0.8


def test_dependent_ranges_find_contacts_that_capsules_cannot():
    for values, links in [
        ({"HipRoll": 0.45}, ("Pelvis", "torso")),
        ({"HeadYaw": 2.0, "HeadPitch": 0.6}, ("torso", "Head")),
        ({"LElbowYaw": 2.0, "LElbowRoll": -1.5, "LShoulderRoll": 0.6}, ("LBicep", "LForeArm")),
        ({"RElbowYaw": -2.0, "RElbowRoll": 1.5, "RShoulderRoll": -0.6}, ("RBicep", "RForeArm")),
    ]:
        pepper = pk.load_pepper()
        q = pepper.joint_vector(values)
        assert pk.collision.in_collision(pepper, q)
        assert links in pk.collision.checker_for(pepper).contacts(q)


def test_a_checker_is_freed_with_its_last_name():
    """Without a collection of garbage, which comes late: hundreds of 2 MB each were there."""
    pepper = pk.load_pepper()
    checker = pk.collision.CollisionChecker(pepper, pk.Scene().add_sphere("ball", 0.1, (1.0, 0.0, 1.0)))
    wider = checker.with_margins(0.01, 0.0)
    assert wider.shapes_of is wider.with_margins(0.02, 0.0).shapes_of is checker
    checker.in_collision(pepper.neutral())
    both = [weakref.ref(checker), weakref.ref(wider)]
    gc.disable()
    try:
        del checker, wider
        assert [one() for one in both] == [None, None]
    finally:
        gc.enable()


def test_batch_shapes():
    pepper = pk.load_pepper()
    q = random_q(pepper, 6).reshape(2, 3, 15)
    assert pk.collision.in_collision(pepper, q).shape == (2, 3)
    assert pk.collision.clearance(pepper, q[0, 0]).shape == ()
    assert pk.collision.in_collision(pepper, np.empty((0, 15))).shape == (0,)


def test_scene_is_frozen_and_methods_return_new_ones():
    moved = TABLE.move("table", (1, 0, 0.7)).add_cylinder("can", 0.03, 0.1, (0.5, 0, 0.8))
    assert tuple(TABLE.objects) == ("table",)
    assert TABLE.objects["table"].transform_object_to_world[0, 3] == 0.55
    assert moved.objects["table"].transform_object_to_world[0, 3] == 1
    assert tuple(moved.remove("table").objects) == ("can",)
    with pytest.raises(AttributeError, match="frozen"):
        TABLE.objects = {}
    with pytest.raises(TypeError):
        TABLE.objects["table"] = None


def test_padded_scene_is_nearer_by_the_margin():
    """Growing a sphere by a margin lowers the distance to it by just that; a box grows on every side."""
    pepper = pk.load_pepper()
    q = pepper.posture("Stand")
    head = next(s for s in pepper.collision_shapes if s.link == "Head")
    top = (pk.kinematics.frame_pose(pepper, q, "Head") @ head.transform_shape_to_link)[:3, 3]
    scene = pk.Scene().add_sphere("lamp", 0.05, top + np.array([0, 0, head.geometry.radius + 0.0525]))
    before, after = (
        pk.collision.closest_pair(pepper, q, s) for s in (scene.padded(0.0), scene.padded(0.002))
    )
    assert before.names == after.names == ("Head", "lamp")
    assert before.distance - after.distance == pytest.approx(0.002, abs=1e-9)
    assert TABLE.padded(0.01).objects["table"].geometry.size == pytest.approx((0.62, 1.02, 0.06))
    with pytest.raises(InvalidValueError, match=r"margin: got -0\.1"):
        scene.padded(-0.1)


def test_margins_widen_what_counts_as_contact():
    pepper = pk.load_pepper()
    q = pepper.posture("Stand")
    own = float(pk.collision.clearance(pepper, q))
    assert not pk.collision.checker_for(pepper, None, 0.0, own * 0.9).in_collision(q)
    assert pk.collision.checker_for(pepper, None, 0.0, own * 1.1).in_collision(q)
    hand = pk.kinematics.frame_pose(pepper, q, "LArm_effector")[:3, 3]
    scene = pk.Scene().add_sphere("ball", 0.05, hand + np.array([0.15, 0.1, 0]))
    gap = pk.collision.closest_pair(pepper, q, scene)
    near = float(pk.collision.clearance(pepper, q, scene))
    assert near <= own or gap.names[1] == "ball"
    assert not pk.collision.checker_for(pepper, scene, 0.001).in_collision(q)
    assert pk.collision.checker_for(pepper, scene, 0.2).in_collision(q)
