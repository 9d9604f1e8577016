"""With a scene: what is returned touches nothing, and what is in the way is named."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.ik import IKStatus
from pepper_kin.ik.collisions import MARGIN, Collisions
from pepper_kin.ik.solvers import SOLVERS

PEPPER = pk.load_pepper()
TABLE = pk.Scene().add_box("table", size=(0.6, 1.0, 0.04), position=(0.55, 0.0, 0.70))


@pytest.mark.parametrize("solver", SOLVERS)
def test_reaches_over_the_table_without_touching(solver):
    for point in ((0.4, 0.2, 0.85), (0.45, 0.1, 0.9), (0.35, 0.3, 0.95)):
        tasks = [pk.ik.HandPosition("left", point), pk.ik.LookAt(point)]
        result = pk.ik.solve(PEPPER, tasks, scene=TABLE, solver=solver)
        assert result.success, result.report()
        assert not pk.collision.in_collision(PEPPER, result.q, TABLE)
        assert result.in_collision is False
        for mine, to in ((result.clearance.itself, "self"), (result.clearance.obstacles, "obstacles")):
            assert mine == pytest.approx(float(pk.collision.clearance(PEPPER, result.q, TABLE, to=to)))
        assert f"clearance: {1000 * result.clearance.obstacles:.1f} mm from obstacles" in result.report()


@pytest.mark.parametrize("solver", SOLVERS)
def test_target_inside_the_table_is_blocked_by_collision(solver):
    point = np.array([0.4, 0.2, 0.70])
    assert pk.ik.solve(PEPPER, pk.ik.HandPosition("left", point), solver=solver, collisions=False).success
    result = pk.ik.solve(PEPPER, pk.ik.HandPosition("left", point), scene=TABLE, solver=solver, restarts=24)
    assert result.status is IKStatus.CLOSEST_COLLISION
    assert "only in collision" in result.advice
    assert result.in_collision is False
    assert not pk.collision.in_collision(PEPPER, result.q, TABLE)
    hand = pk.kinematics.frame_pose(PEPPER, result.q, "LArm_effector")[:3, 3]
    assert result.errors[0].value == pytest.approx(np.linalg.norm(hand - point))
    start = pk.kinematics.frame_pose(PEPPER, PEPPER.neutral(), "LArm_effector")[:3, 3]
    assert np.linalg.norm(hand - point) < 0.5 * np.linalg.norm(start - point)


def test_empty_scene_keeps_the_robot_off_itself():
    generator = np.random.default_rng(8)
    avoided = 0
    for _ in range(8):
        point = generator.uniform((0.0, -0.25, 0.55), (0.25, 0.15, 0.9))
        task = pk.ik.HandPosition("left", point)
        plain = pk.ik.solve(PEPPER, task, collisions=False)
        clear = pk.ik.solve(PEPPER, task, scene=pk.Scene(), restarts=4)
        assert not pk.collision.in_collision(PEPPER, clear.q)
        avoided += bool(plain.success and pk.collision.in_collision(PEPPER, plain.q) and clear.success)
    assert avoided >= 1


def test_nothing_free_is_said():
    """Walled in: whatever is returned touches, and the result does not hide it."""
    wall = pk.Scene().add_box("block", size=(2.0, 2.0, 2.0), position=(0.0, 0.0, 0.9))
    result = pk.ik.solve(PEPPER, pk.ik.LookAt((2.0, 0.5, 1.0)), scene=wall, restarts=2)
    assert result.status is IKStatus.CLOSEST_COLLISION
    assert result.in_collision is True
    assert result.clearance.obstacles < 0
    assert "it touches" in result.report()


def test_half_spaces_have_the_derivative_of_the_clearance():
    """Along each joint the slope of a half-space is that of the distance."""
    q = PEPPER.joint_vector(
        {"LShoulderPitch": 0.6, "LElbowRoll": -0.7, "LShoulderRoll": 0.4, "RShoulderRoll": -0.6}
    )
    scene = pk.Scene().add_sphere("ball", 0.03, pk.kinematics.frame_pose(PEPPER, q, "l_hand")[:3, 3] + 0.08)
    rows = Collisions(PEPPER, scene).half_spaces(q, 1)
    distance = float(pk.collision.clearance(PEPPER, q, scene))
    assert MARGIN < distance < 0.1
    assert rows[0, :-1] @ q - rows[0, -1] == pytest.approx(distance - MARGIN, abs=1e-9)
    for joint in ("HipPitch", "LShoulderPitch", "LShoulderRoll", "LElbowRoll", "HeadYaw"):
        step = 1e-5 * np.eye(PEPPER.n)[PEPPER.joint_index(joint)]
        ahead, behind = (float(pk.collision.clearance(PEPPER, x, scene)) for x in (q + step, q - step))
        slope = (ahead - behind) / 2e-5
        assert rows[0, PEPPER.joint_index(joint)] == pytest.approx(slope, abs=2e-3)
