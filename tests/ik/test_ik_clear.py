"""IK that touches nothing: descents with distances, judged by coal; what stands in the way is named."""

import ctypes

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.collision.checker import checker_for
from pepper_kin.collision.near_pairs import pairs_within
from pepper_kin.core.inverse_kinematics.proximity import near_rows
from pepper_kin.ik import IKStatus
from pepper_kin.ik.fast.proximity_table import proximity_memory

PEPPER = pk.load_pepper()
LOW, HIGH = PEPPER.lower_limits, PEPPER.upper_limits
APART = 0.005


def random_scene(generator, count=10):
    """Boxes, balls, cylinders and capsules of 5 to 40 cm that leave the robot clear where it stands."""
    scene = pk.Scene()
    while len(scene.objects) < count:
        position, rpy = generator.uniform([-1, -1, 0], [1, 1, 1.6]), generator.uniform(-3, 3, 3)
        name, kind = f"object {len(scene.objects)}", len(scene.objects) % 4
        if kind == 0:
            more = scene.add_box(name, generator.uniform(0.05, 0.4, 3), position, rpy)
        elif kind == 1:
            more = scene.add_sphere(name, generator.uniform(0.03, 0.2), position)
        elif kind == 2:
            more = scene.add_cylinder(name, *generator.uniform(0.05, 0.3, 2), position, rpy)
        else:
            more = scene.add_capsule(name, *generator.uniform(0.05, 0.3, 2), position, rpy)
        if not checker_for(PEPPER, more, 0.04).in_collision(PEPPER.neutral()):
            scene = more
    return scene


def clear_targets(scene, count, generator, margin=0.0):
    """Places of the left hand in random postures that touch nothing: they can be reached."""
    checker, points = checker_for(PEPPER, scene, margin), []
    while len(points) < count:
        q = generator.uniform(LOW, HIGH)
        if not checker.in_collision(q):
            points.append(pk.kinematics.frame_pose(PEPPER, q, "LArm_effector")[:3, 3])
    return np.array(points)


def rows_at(q, block, count=64):
    """Rows of `near_rows` at q: slopes, shortages, depths."""
    call = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_int64] * 4)(near_rows.address)
    rows, q = np.empty((count, PEPPER.n + 2)), np.array(q)
    found = call(q.ctypes.data, rows.ctypes.data, count, block.address)
    return rows[:found, :-2], rows[:found, -2], rows[:found, -1]


@pytest.mark.parametrize("seed", range(4))
def test_near_shapes_are_those_that_coal_measures(seed):
    """Boxes and capsules: every pair within 5 mm, with coal's distance, and below zero its depth."""
    generator = np.random.default_rng(seed)
    scene = (
        pk.Scene()
        .add_box("table", (0.6, 1.0, 0.04), (0.55, 0.0, 0.7))
        .add_sphere("ball", 0.1, (0.4, 0.3, 1.0))
    )
    checker = checker_for(PEPPER, scene)
    block, touching = proximity_memory(checker, APART, 64), 0
    for q in generator.uniform(LOW, HIGH, (100, PEPPER.n)):
        _, shortages, depths = rows_at(q, block)
        expected = pairs_within(checker, q, APART)
        ranges = sum(bool(table.violated(q)) for table in checker._ranges)
        assert len(expected) <= len(shortages) <= len(expected) + len(checker._ranges)
        np.testing.assert_allclose(
            np.sort(APART - shortages[: len(expected)]), np.sort(expected.distances), atol=2e-6
        )
        assert (depths.max(initial=-1.0) > 0.0) == bool(checker.in_collision(q))
        assert ranges <= len(shortages) - len(expected)
        touching += bool(checker.in_collision(q))
    assert 20 < touching < 90


def test_slopes_are_derivatives_of_the_shortages():
    generator = np.random.default_rng(1)
    block, looked_at = proximity_memory(checker_for(PEPPER, random_scene(generator)), APART, 64), 0
    for q in generator.uniform(LOW, HIGH, (60, PEPPER.n)):
        slopes, shortages, _ = rows_at(q, block)
        for joint in range(PEPPER.n):
            step = 1e-6 * np.eye(PEPPER.n)[joint]
            ahead, behind = (rows_at(q + sign * step, block)[1] for sign in (1, -1))
            if len(ahead) == len(shortages) == len(behind):
                off = np.abs((behind - ahead) / 2e-6 - slopes[:, joint]) > 1e-3
                # Where the nearest points jump, as from one face of a box to another, there is no slope.
                looked_at += off.size
                assert off.sum() <= 1
    assert looked_at > 500


@pytest.mark.parametrize("margin", [0.0, 0.03])
def test_targets_that_can_be_reached_clear_are_reached_clear(margin):
    """Solved means: coal finds nothing in contact, nor nearer to the scene than the margin."""
    generator, solved, count = np.random.default_rng(3), 0, 0
    for number in range(12):
        scene = random_scene(generator) if number % 3 else pk.Scene()
        judge = checker_for(PEPPER, scene, margin)
        for point in clear_targets(scene, 20, generator, margin):
            task = pk.ik.HandPosition("left", point)
            result = pk.ik.solve(PEPPER, task, scene=scene, margin=margin)
            count += 1
            solved += result.success
            if result.success:
                assert not judge.in_collision(result.q)
                assert task.error(PEPPER, result.q) <= 1e-3
    assert solved >= 0.99 * count


def test_the_arm_in_the_way_is_moved_away():
    """The target lies where the other arm is: joints that no task depends on give way."""
    q0 = PEPPER.joint_vector({"RShoulderPitch": 0.3, "RElbowRoll": 0.6, "RShoulderRoll": -0.1})
    point = pk.kinematics.frame_pose(PEPPER, q0, "r_wrist")[:3, 3]
    task = pk.ik.HandPosition("left", point)
    assert pk.collision.in_collision(PEPPER, pk.ik.solve(PEPPER, task, q0, collisions=False).q)
    result = pk.ik.solve(PEPPER, task, q0, scene=pk.Scene())
    assert result.success
    assert not checker_for(PEPPER, pk.Scene()).in_collision(result.q)


def test_rows_of_a_batch_are_single_answers():
    generator = np.random.default_rng(5)
    scene = random_scene(generator)
    points = clear_targets(scene, 40, generator, 0.01)
    found = pk.ik.solve_batch(PEPPER, pk.ik.HandPosition("left", points), scene=scene, margin=0.01)
    shared = pk.ik.solve_batch(
        PEPPER, pk.ik.HandPosition("left", points), scene=scene, margin=0.01, threads=2
    )
    np.testing.assert_array_equal(found.q, shared.q)
    assert found.success.mean() > 0.95
    for row, point in enumerate(points):
        one = pk.ik.solve(PEPPER, pk.ik.HandPosition("left", point), scene=scene, margin=0.01)
        np.testing.assert_array_equal(one.q, found.q[row])
        assert one.status is found.status(row)
    assert found.result(0).in_collision is False
    assert not checker_for(PEPPER, scene, 0.01).in_collision(found.q[found.success]).any()


def test_solutions_touch_nothing_and_are_more_than_those_looked_through():
    generator = np.random.default_rng(6)
    scene, more, fewer = random_scene(generator), 0, 0
    for point in clear_targets(scene, 10, generator):
        task = pk.ik.HandPosition("left", point)
        q = pk.ik.solutions(PEPPER, task, scene=scene, count=64)
        assert not checker_for(PEPPER, scene).in_collision(q).any()
        assert all(task.error(PEPPER, row) <= 1e-3 for row in q)
        plain = pk.ik.solutions(PEPPER, task, count=64, collisions=False)
        more += len(q)
        fewer += int((~checker_for(PEPPER, scene).in_collision(plain)).sum()) if len(plain) else 0
    assert more > fewer


def test_the_report_names_what_is_in_the_way():
    table = pk.Scene().add_box("table", size=(0.6, 1.0, 0.04), position=(0.55, 0.0, 0.70))
    result = pk.ik.solve(PEPPER, pk.ik.HandPosition("left", (0.4, 0.2, 0.70)), scene=table)
    assert result.status is IKStatus.CLOSEST_COLLISION
    assert "l_wrist and table touching" in result.report()
    assert "deep on the median" in result.hint
    assert result.in_collision is False


def test_where_no_margin_is_left_the_hint_says_so():
    table = pk.Scene().add_box("table", size=(0.6, 1.0, 0.04), position=(0.55, 0.0, 0.70))
    task = pk.ik.HandPosition("left", (0.4, 0.2, 0.80))
    assert pk.ik.solve(PEPPER, task, scene=table).success
    result = pk.ik.solve(PEPPER, task, scene=table, margin=0.2)
    assert result.status is IKStatus.CLOSEST_COLLISION
    assert "l_wrist and table too near" in result.hint


def test_margins_are_checked():
    for options, message in [
        ({"margin": 0.01, "collisions": False}, "margin: got 0.01, expected 0 where collisions are left out"),
        ({"scene": pk.Scene(), "collisions": False}, "collisions: got False, expected True"),
        ({"collisions": "no"}, "collisions: got 'no', expected True or False"),
        ({"margin": -0.01, "scene": pk.Scene()}, "margin: got -0.01"),
        ({"margin": float("nan"), "scene": pk.Scene()}, "margin: got nan"),
        ({"scene": "table"}, "scene: got 'table', expected a Scene"),
    ]:
        point = (0.3, 0.2, 0.9)
        for call, target in (
            (pk.ik.solve, point),
            (pk.ik.solutions, point),
            (pk.ik.solve_batch, np.array([point] * 2)),
        ):
            with pytest.raises(pk.exceptions.InvalidValueError, match=message):
                call(PEPPER, pk.ik.HandPosition("left", target), **options)
