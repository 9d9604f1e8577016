import pickle

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError, LimitError, UnknownNameError
from pepper_kin.model.joint_vectors import check_within_limits

BASES = ("fixed", "planar")
HANDS = ("locked", "mimic", "independent")


def test_default_order_of_joints():
    pepper = pk.load_pepper()
    arm = ("ShoulderPitch", "ShoulderRoll", "ElbowYaw", "ElbowRoll", "WristYaw")
    assert pepper.joint_names == (
        "KneePitch", "HipPitch", "HipRoll", "HeadYaw", "HeadPitch",
        *(f"L{name}" for name in arm), *(f"R{name}" for name in arm),
    )  # fmt: skip
    assert pepper.n == 15


@pytest.mark.parametrize("base", BASES)
@pytest.mark.parametrize(("hands", "more"), [("locked", 0), ("mimic", 2), ("independent", 28)])
def test_options_add_joints(base, hands, more):
    pepper = pk.load_pepper(base=base, hands=hands)
    assert pepper.n == 15 + more + (3 if base == "planar" else 0)
    if base == "planar":
        assert pepper.joint_names[:3] == ("BaseX", "BaseY", "BaseYaw")
        assert pepper.joint_units[:3] == ("m", "m", "rad")
        assert np.isinf(pepper.upper_limits[2])


def test_limits_are_the_published_ones():
    pepper = pk.load_pepper()
    i = pepper.joint_index("LElbowRoll")
    assert (pepper.lower_limits[i], pepper.upper_limits[i]) == (-1.56207, -0.00872665)
    assert (pepper.velocity_limits[i], pepper.effort_limits[i]) == (9.22756, 2.666)
    i = pepper.joint_index("RShoulderRoll")
    assert (pepper.lower_limits[i], pepper.upper_limits[i]) == (-1.56207, -0.00872665)
    assert pepper.acceleration_limits[pepper.joint_index("HipRoll")] == 6.8797


@pytest.mark.parametrize("base", BASES)
@pytest.mark.parametrize("hands", HANDS)
def test_the_documented_limit_of_the_head_is_an_option_that_changes_nothing_else(base, hands):
    """25.5 degrees in place of 36.5."""
    pepper = pk.load_pepper(base, hands)
    documented = pk.load_pepper(base, hands, head_limits="documented")
    i = pepper.joint_index("HeadPitch")
    assert np.degrees(pepper.upper_limits[i]) == pytest.approx(36.5, abs=1e-4)
    assert np.degrees(documented.upper_limits[i]) == pytest.approx(25.5, abs=1e-12)
    assert documented.joint_names == pepper.joint_names
    for one, other in (
        (pepper.lower_limits, documented.lower_limits),
        (pepper.effort_limits, documented.effort_limits),
    ):
        np.testing.assert_array_equal(one, other)
    others = np.arange(pepper.n) != i
    np.testing.assert_array_equal(pepper.upper_limits[others], documented.upper_limits[others])
    assert documented is pk.load_pepper(base, hands, head_limits="documented")
    assert pk.model.pepper_urdf(base=base, hands=hands) == pepper.urdf
    with pytest.raises(InvalidValueError, match=r"head_limits.*'urdf'"):
        pk.load_pepper(head_limits="measured")


def test_arrays_are_read_only_and_model_is_frozen():
    pepper = pk.load_pepper()
    with pytest.raises(ValueError, match="read-only"):
        pepper.lower_limits[0] = 0.0
    with pytest.raises(AttributeError):
        pepper.name = "other"
    pepper.posture("Stand")[0] = 9.0
    assert pepper.posture("Stand")[0] == 0.0


@pytest.mark.parametrize("base", BASES)
@pytest.mark.parametrize("hands", HANDS)
def test_postures_are_within_limits(base, hands):
    pepper = pk.load_pepper(base=base, hands=hands)
    assert set(pepper.posture_names) >= {"Stand", "StandInit", "StandZero", "Crouch"}
    for name in pepper.posture_names:
        check_within_limits(pepper, pepper.posture(name), name, tolerance=0.0)


def test_groups():
    pepper = pk.load_pepper(hands="mimic")
    assert pepper.joint_group("left_arm") == (
        "LShoulderPitch", "LShoulderRoll", "LElbowYaw", "LElbowRoll", "LWristYaw",
    )  # fmt: skip
    assert pepper.joint_group("both_hands") == ("LHand", "RHand")
    assert pepper.joint_group("whole_body") == pepper.joint_names
    assert len(pk.load_pepper(hands="independent").joint_group("LHand")) == 14


def test_joint_vector_takes_the_rest_from_stand():
    pepper = pk.load_pepper()
    q = pepper.joint_vector({"HeadYaw": 0.3})
    stand = pepper.posture("Stand")
    assert q[pepper.joint_index("HeadYaw")] == 0.3
    assert np.array_equal(np.delete(q, 3), np.delete(stand, 3))


def test_unknown_names_list_what_there_is():
    for call, kind, listed in [
        (lambda p: p.posture("Sit"), "posture", "StandZero"),
        (lambda p: p.joint_group("tail"), "joint group", "both_arms"),
        (lambda p: p.joint_index("Tail"), "joint", "KneePitch"),
        (lambda p: p.frame_id("Tail"), "frame", "LArm_effector"),
        (lambda p: p.joint_vector({"Tail": 0.1}), "joint or group", "HeadYaw"),
    ]:
        with pytest.raises(UnknownNameError) as caught:
            call(pk.load_pepper())
        assert caught.value.kind == kind
        assert listed in caught.value.available
        assert listed in str(caught.value)


def test_bad_choice_and_bad_value_are_named():
    with pytest.raises(InvalidValueError, match=r"base: got 'flying', expected one of 'fixed', 'planar'"):
        pk.load_pepper(base="flying")
    with pytest.raises(InvalidValueError, match=r"position of HeadYaw: got nan"):
        pk.load_pepper().joint_vector({"HeadYaw": float("nan")})


def test_limit_check_names_the_worst_joint():
    pepper = pk.load_pepper()
    q = pepper.joint_vector({"HeadYaw": 2.2, "LElbowRoll": 1.0})
    with pytest.raises(LimitError, match=r"start: LElbowRoll = 1 rad is outside \[-1.56207, -0.0087"):
        check_within_limits(pepper, q, "start")


def test_pickle_gives_the_same_robot():
    pepper = pk.load_pepper(hands="mimic")
    copy = pickle.loads(pickle.dumps(pepper))
    q = pepper.posture("Stand")
    assert copy.joint_names == pepper.joint_names
    assert np.array_equal(
        pk.kinematics.frame_pose(copy, q, "LFinger13_link"),
        pk.kinematics.frame_pose(pepper, q, "LFinger13_link"),
    )


def test_collision_capsules_are_read_back_as_capsules():
    pepper = pk.load_pepper()
    bicep = next(shape for shape in pepper.collision_shapes if shape.link == "LBicep")
    assert isinstance(bicep.geometry, pk.model.Capsule)
    assert bicep.geometry.radius == 0.04449
    ends = np.array([[-0.00435, 0.0044, 0.00211], [0.14574, 0.0186, -0.00388]])
    half = bicep.geometry.length / 2
    found = [(bicep.transform_shape_to_link @ [0, 0, z, 1])[:3] for z in (-half, half)]
    np.testing.assert_allclose(found, ends, atol=1e-9)


def test_open_hand_has_the_published_mass_however_the_fingers_are_modeled():
    """The fingers' mass is taken out of the wrist body, so the open mimic hand equals the locked one."""
    locked, mimic = pk.load_pepper(), pk.load_pepper(hands="mimic")
    q = locked.posture("Stand")
    full = mimic.joint_vector({**dict(zip(locked.joint_names, q, strict=True)), "LHand": 0.98, "RHand": 0.98})
    assert pk.dynamics.total_mass(mimic) == pytest.approx(pk.dynamics.total_mass(locked), abs=1e-9)
    keep = [mimic.joint_index(name) for name in locked.joint_names]
    mass = pk.dynamics.mass_matrix(mimic, full)[np.ix_(keep, keep)]
    np.testing.assert_allclose(mass, pk.dynamics.mass_matrix(locked, q), atol=1e-7)


def test_fingers_follow_the_published_origins():
    """Middle phalanx: 18 mm along the first one and turned by -60 degrees about its joint when closed."""
    pepper = pk.load_pepper(hands="independent")
    q = pepper.joint_vector({"LFinger11": 0.0, "LFinger12": 0.0})
    first, second = (pk.kinematics.frame_pose(pepper, q, f"LFinger1{i}_link") for i in (1, 2))
    relative = np.linalg.inv(first) @ second
    np.testing.assert_allclose(relative[:3, 3], [0.018, 0, 0], atol=1e-12)
    np.testing.assert_allclose(relative[:2, 0], [np.cos(-1.0472), np.sin(-1.0472)], atol=1e-12)
