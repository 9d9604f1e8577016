"""One joint at a value, and the base at a place."""

import math

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.ik.solvers import ALL_SOLVERS
from pepper_kin.ik.tasks.task import words_for_angle

PEPPER = pk.load_pepper()
PLANAR = pk.load_pepper(base="planar")


@pytest.mark.parametrize("solver", ALL_SOLVERS)
def test_a_joint_goes_to_its_value_beside_another_task(solver):
    hand = pk.ik.HandPosition("left", (0.4, 0.2, 0.9))
    result = pk.ik.solve(PEPPER, [hand, pk.ik.JointValue("HipPitch", -0.25)], solver=solver, collisions=False)
    assert result.success, result.report()
    index = PEPPER.joint_index("HipPitch")
    assert result.q[index] == pytest.approx(-0.25, abs=math.radians(0.5))
    assert result.errors[1].value == pytest.approx(abs(result.q[index] + 0.25))
    assert f"HipPitch: error {words_for_angle(abs(result.q[index] + 0.25))}, {result.q[index]:.4f} rad" in (
        result.report()
    )
    palm = pk.kinematics.frame_pose(PEPPER, result.q, "LArm_effector")[:3, 3]
    assert np.linalg.norm(palm - (0.4, 0.2, 0.9)) <= 1e-3


@pytest.mark.parametrize("solver", ALL_SOLVERS)
def test_many_values(solver):
    values = np.array([-0.5, 0.0, 0.7])
    found = pk.ik.solve_batch(PEPPER, pk.ik.JointValue("HeadYaw", values), solver=solver, collisions=False)
    assert found.success.all()
    np.testing.assert_allclose(found.q[:, PEPPER.joint_index("HeadYaw")], values, atol=math.radians(0.5))


def test_a_value_beyond_the_limit():
    result = pk.ik.solve(PEPPER, pk.ik.JointValue("KneePitch", 1.0), collisions=False)
    assert result.status is pk.ik.IKStatus.CLOSEST_LIMITS
    assert "KneePitch stops 0.4851 rad short of 1.0000 rad: KneePitch at its limit" in result.report()


def test_units_are_those_of_the_joint():
    sliding = pk.ik.solve(PLANAR, pk.ik.JointValue("BaseX", 0.5), collisions=False)
    assert sliding.errors[0].unit == "m"
    assert sliding.errors[0].attained == f"{sliding.q[0]:.4f} m"
    assert pk.ik.solve(PLANAR, pk.ik.JointValue("HeadYaw", 0.5), collisions=False).errors[0].unit == "rad"
    both = pk.ik.JointPosture((0.5, 0.1), joints=("BaseX", "HeadYaw"))
    assert both.attained(PLANAR, PLANAR.neutral()).endswith("rad (or m) away")


@pytest.mark.parametrize("solver", ALL_SOLVERS)
def test_the_base_stands_at_its_target(solver):
    task = pk.ik.BasePlacement((1.5, -0.7), 2.0)
    hand = pk.ik.FramePosition("LArm_effector", (1.3, -0.4, 0.9))
    result = pk.ik.solve(PLANAR, [task, hand], solver=solver, collisions=False)
    assert result.success, result.report()
    base = pk.kinematics.frame_pose(PLANAR, result.q, "base_footprint")
    assert math.dist(base[:2, 3], (1.5, -0.7)) <= 1e-3
    turn = math.atan2(base[1, 0], base[0, 0]) - 2.0
    assert abs(turn) <= math.radians(0.5)
    assert [error.name for error in result.errors] == [
        "position of base",
        "yaw of base",
        "position of LArm_effector",
    ]
    assert [error.unit for error in result.errors] == ["m", "rad", "m"]


@pytest.mark.parametrize("solver", ALL_SOLVERS)
def test_the_base_turns_the_short_way_round(solver):
    q0 = PLANAR.joint_vector({"BaseYaw": -3.0})
    result = pk.ik.solve(PLANAR, pk.ik.BasePlacement(yaw=3.0), q0, solver=solver, collisions=False)
    assert result.success
    assert result.q[PLANAR.joint_index("BaseYaw")] == pytest.approx(3.0 - 2 * math.pi, abs=0.01)


@pytest.mark.thorough
@pytest.mark.parametrize("solver", ALL_SOLVERS)
def test_near_is_a_wide_tolerance(solver):
    """The base gives way within its tolerance, whatever its weight, until the hand is there."""
    near = pk.ik.BasePlacement((0.5, 0.0), tolerance=0.4)
    point = (1.4, 0.3, 0.9)
    result = pk.ik.solve(PLANAR, [near, pk.ik.HandPosition("left", point)], solver=solver, collisions=False)
    assert result.success, result.report()
    assert 0.01 < math.dist(result.q[:2], (0.5, 0.0)) <= 0.4
    assert len(near.parts) == 1
    assert near.yaw is None


def test_many_placements():
    generator = np.random.default_rng(2)
    places, yaws = generator.uniform(-2, 2, (8, 2)), generator.uniform(-9, 9, 8)
    found = pk.ik.solve_batch(PLANAR, [pk.ik.BasePlacement(places, yaws)], collisions=False)
    assert found.success.all()
    base = pk.kinematics.frame_pose(PLANAR, found.q, "base_footprint")
    np.testing.assert_allclose(base[:, :2, 3], places, atol=1e-3)
    np.testing.assert_allclose(base[:, 0, 0], np.cos(yaws), atol=0.01)
    np.testing.assert_allclose(base[:, 1, 0], np.sin(yaws), atol=0.01)


def test_a_fixed_base_is_refused():
    for task in [pk.ik.BasePlacement((0, 0)), pk.ik.BasePlacement(yaw=0.0)]:
        with pytest.raises(
            InvalidValueError, match=r"of base: got .*pepper.* without Base.*load_pepper\(base='planar'\)"
        ):
            pk.ik.solve(PEPPER, task, collisions=False)


def test_an_unknown_joint_is_refused():
    with pytest.raises(UnknownNameError, match="unknown joint 'Neck'; available: KneePitch"):
        pk.ik.solve(PEPPER, pk.ik.JointValue("Neck", 0.1), collisions=False)
