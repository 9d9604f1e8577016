"""Rows that cannot be solved: proofs that they cannot, reasons, and that nothing solvable is given up."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

import pepper_kin as pk
from pepper_kin.ik import IKStatus
from pepper_kin.ik.reach_bound import shortfalls

PEPPER = pk.load_pepper()
TWO_LINKS = """<robot name="two"><link name="base"/><link name="one"/><link name="two"/><link name="tip"/>
<joint name="a" type="{kind}"><parent link="base"/><child link="one"/><origin xyz="0 0 0.5" rpy="0 0 0.4"/>
  <axis xyz="0 0 1"/><limit lower="-0.5" upper="0.5" velocity="1" effort="1"/></joint>
<joint name="b" type="revolute"><parent link="one"/><child link="two"/><origin xyz="0.4 0 0"/>
  <axis xyz="0 0 1"/><limit lower="-2" upper="2" velocity="1" effort="1"/></joint>
<joint name="c" type="fixed"><parent link="two"/><child link="tip"/><origin xyz="0.3 0 0"/></joint></robot>"""


def bound(pepper, points, frame="LArm_effector", start=None, movable=None):
    starts = np.tile(pepper.neutral() if start is None else start, (len(points), 1))
    return shortfalls(pepper, [pk.ik.FramePosition(frame, points)], starts, movable)[:, 0]


def draw(pepper, count, seed, frame="LArm_effector", start=None, movable=None):
    free = np.ones(pepper.n, bool) if movable is None else movable
    low, high = np.maximum(pepper.lower_limits, -np.pi), np.minimum(pepper.upper_limits, np.pi)
    q = np.random.default_rng(seed).uniform(low, high, (count, pepper.n))
    q[:, ~free] = (pepper.neutral() if start is None else start)[~free]
    q[: count // 2] = np.where((q[: count // 2] > 0.5 * (low + high)) & free, high, np.where(free, low, q[0]))
    return pk.kinematics.frame_pose(pepper, q, frame)[:, :3, 3]


@pytest.mark.parametrize("frame", ["LArm_effector", "RArm_effector", "CameraTop_frame", "l_wrist"])
def test_what_is_reached_is_never_called_out_of_reach(frame):
    """Postures within the limits, half of them at corners of the joint box."""
    assert bound(PEPPER, draw(PEPPER, 40_000, 1, frame), frame).max() == 0.0


@pytest.mark.parametrize("hands", ["mimic", "independent"])
def test_nor_with_other_hands_or_joints_that_keep_still(hands):
    pepper = pk.load_pepper(hands=hands)
    frame = next(name for name in pepper.frame_names if "Finger" in name)
    assert bound(pepper, draw(pepper, 20_000, 2, frame), frame).max() == 0.0
    movable = np.isin(pepper.joint_names, pepper.joint_group("left_arm"))
    start = pepper.posture("Crouch")
    points = draw(pepper, 20_000, 3, start=start, movable=movable)
    assert bound(pepper, points, start=start, movable=movable).max() == 0.0
    assert np.median(bound(pepper, draw(pepper, 2000, 4), start=start, movable=movable)) > 0.02


def test_the_bound_is_the_distance_to_the_convex_hull():
    """Beside Qhull's hull of random postures, from which the true one stands out by a little."""
    hull = ConvexHull(draw(PEPPER, 200_000, 5))
    points = np.random.default_rng(6).uniform((-1.0, -1.5, -0.5), (1.5, 1.5, 2.5), (3000, 3))
    planes = (points @ hull.equations[:, :3].T + hull.equations[:, 3]).max(axis=1)
    found = bound(PEPPER, points)
    assert np.all(found[planes < 0] == 0)
    assert (planes > 0.05).sum() > 1000
    nearest = np.array([np.linalg.norm(hull.points[hull.vertices] - p, axis=1).min() for p in points])
    assert np.all(found <= nearest + 1e-9)
    far = planes > 0.3
    assert np.median(planes[far] - found[far]) < 0.03
    assert np.median(nearest[far] - found[far]) < 0.05


@pytest.mark.parametrize(("kind", "farthest"), [("revolute", 0.9), ("prismatic", None)])
def test_the_bound_of_two_links_is_exact(kind, farthest):
    """Straight ahead the arm of 0.7 m ends there; sliding, its height ends at 1.0 m."""
    arm = pk.load_robot(TWO_LINKS.format(kind=kind))
    if kind == "revolute":
        point = np.array([[np.cos(farthest), np.sin(farthest), 0.5]])
        assert bound(arm, point, "tip")[0] == pytest.approx(0.3, abs=2e-3)
        behind = np.array([[-1.0, 0.0, 0.5]])
        assert bound(arm, behind, "tip")[0] > 0.7  # a circle without limits says 0.3
    else:
        assert bound(arm, np.array([[0.5, 0.2, 1.4]]), "tip")[0] == pytest.approx(0.4, abs=2e-3)
    assert bound(arm, draw(arm, 5000, 7, "tip"), "tip").max() == 0.0


def test_a_base_that_drives_is_out_of_nothing():
    pepper = pk.load_pepper(base="planar")
    assert bound(pepper, np.array([[9.0, 0.0, 0.8]])).tolist() == [0.0]


def rows(count, share, seed):
    generator = np.random.default_rng(seed)
    q = generator.uniform(PEPPER.lower_limits, PEPPER.upper_limits, (4 * count, PEPPER.n))
    q = q[~pk.collision.in_collision(PEPPER, q)][:count]
    points = pk.kinematics.frame_pose(PEPPER, q, "LArm_effector")[:, :3, 3].copy()
    far = generator.permutation(count)[: round(share * count)]
    points[far] = generator.uniform((-0.5, -1.0, 0.0), (1.0, 1.0, 1.7), (far.size, 3))
    return points, far


def test_no_solution_is_given_up_and_every_other_row_has_a_reason():
    points, far = rows(600, 0.1, 8)
    task = pk.ik.HandPosition("left", points)
    whole = pk.ik.solve_batch(PEPPER, task)
    short = pk.ik.solve_batch(PEPPER, task, closest=False)
    assert np.delete(short.success, far).all()
    np.testing.assert_array_equal(short.success, whole.success)
    easy = whole.success & (whole.restarts < 40)
    np.testing.assert_array_equal(short.q[easy], whole.q[easy])
    assert not pk.collision.in_collision(PEPPER, short.q).any()
    assert np.mean(short.codes == whole.codes) > 0.97
    assert [bool(short.reason(row)) for row in range(600)] == (~short.success).tolist()
    proven = np.flatnonzero(short.shortfalls[:, 0] > 1e-3)
    assert proven.size > 30
    assert np.all(whole.errors[proven, 0] >= short.shortfalls[proven, 0])  # the closest found is no closer
    assert np.median(whole.errors[proven, 0] - short.shortfalls[proven, 0]) < 0.15
    assert "of them proven out of reach" in short.report()
    row = int(proven[np.argmax(short.shortfalls[proven, 0])])
    assert short.reason(row).startswith("left hand is out of reach by ")
    assert short.iterations[proven].max() < whole.iterations[proven].min()


def test_what_touches_something_says_so():
    scene = pk.Scene().add_box("box", (0.3, 0.3, 0.3), (0.45, 0.2, 0.85))
    points = np.array([(0.45, 0.2, 0.85), (0.2, 0.3, 0.8)])
    found = pk.ik.solve_batch(PEPPER, pk.ik.HandPosition("left", points), scene=scene, closest=False)
    assert found.status(0) is IKStatus.CLOSEST_COLLISION
    assert "touch" in found.reason(0)
    assert not found.reason(1)
    assert not pk.collision.in_collision(PEPPER, found.q, scene).any()


def test_threads_and_other_rows_change_nothing():
    points, _ = rows(700, 0.3, 9)
    one = pk.ik.solve_batch(PEPPER, pk.ik.HandPosition("left", points), closest=False)
    two = pk.ik.solve_batch(PEPPER, pk.ik.HandPosition("left", points[::-1]), closest=False, threads=2)
    for name in ("q", "codes", "errors", "iterations", "restarts"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name)[::-1], err_msg=name)


def test_hard_tasks_are_still_met_where_a_soft_one_is_out_of_reach():
    """One descent with all weights would leave the hard one by the way."""
    tasks = [
        pk.ik.HandPosition("left", np.array([(2.0, 0.0, 0.8), (0.2, 0.3, 0.8)])),
        pk.ik.HandPosition("right", (0.25, -0.2, 0.9), hard=True),
    ]
    found = pk.ik.solve_batch(PEPPER, tasks, closest=False)
    assert found.hard_met.all()
    assert found.success.tolist() == [False, True]
    assert "out of reach by" in found.reason(0)
