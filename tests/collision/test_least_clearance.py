"""The least distance along a path is that of the loop over all of it, and the bound behind it holds."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.collision import checker_for, least_clearance
from pepper_kin.collision.least_clearance import _LeastClearanceSearch
from pepper_kin.collision.near_pairs import measure_by_coal
from pepper_kin.core.certificates import clearance
from pepper_kin.exceptions import InvalidValueError

COAL = 2e-6  # [m] what two distances by coal may be off
KINDS = [{}, {"base": "planar", "hands": "mimic"}]
FLOOR = pk.Scene().add_half_space("floor", normal=(0.1, 0, 1), offset=-0.05)
TABLE = pk.Scene().add_box("table", size=(0.4, 0.8, 0.03), position=(0.47, 0.05, 0.715))
HELD = TABLE.add_cylinder("cup", radius=0.03, length=0.12, position=(0, 0, 0)).attach(
    "cup", "l_gripper", np.array([[1.0, 0, 0, 0.03], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
)
POINTS = np.random.default_rng(0).uniform((0.3, -0.5, 0.4), (0.6, 0.5, 1.2), (200, 3))
CLOUD = FLOOR.add_point_cloud("cloud", POINTS, radius=0.01)
SHEET = TABLE.add_mesh("sheet", [(0.4, -0.5, 0.2), (0.4, 0.5, 0.2), (0.4, 0, 1.3)], [(0, 1, 2)]).padded(0.01)
SCENES = {"nothing": None, "table": TABLE, "held": HELD, "cloud": CLOUD, "sheet": SHEET}


def smooth_path(pepper, seed, count=200, size=0.5):
    """Waves of all joints about the middle of their ranges."""
    rng = np.random.default_rng(seed)
    low, high = np.clip(pepper.lower_limits, -1.0, 1.0), np.clip(pepper.upper_limits, -1.0, 1.0)
    low[:3], high[:3] = 0.2 * low[:3], 0.2 * high[:3]
    phase = rng.uniform(0, 2 * np.pi, pepper.n) + rng.uniform(0.5, 2, pepper.n) * np.linspace(
        0, np.pi, count
    ).reshape(-1, 1)
    return (low + high) / 2 + size * (high - low) / 2 * np.sin(phase)


def assert_least(pepper, path, scene):
    found = least_clearance(pepper, path, scene)
    every = checker_for(pepper, scene).clearance(path)
    assert found.distance == pytest.approx(every.min(), abs=COAL)
    assert every[found.index] == pytest.approx(every.min(), abs=COAL)
    if np.sum(every < every.min() + COAL) == 1:
        assert found.index == np.argmin(every)
    assert found.pair.distance == found.distance
    return found, every


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("scene", SCENES)
def test_it_is_that_of_the_full_loop(kind, scene):
    pepper = pk.load_pepper(**kind)
    measured = total = 0
    for seed in range(2):
        found, every = assert_least(pepper, smooth_path(pepper, seed), SCENES[scene])
        measured, total = measured + found.measured, total + len(every)
    assert measured < 0.75 * total


def test_timed_motions_are_measured_in_few_places():
    pepper = pk.load_pepper()
    rng = np.random.default_rng(3)
    measured = total = 0
    for _ in range(4):
        goal = pepper.posture("Stand") + 0.15 * rng.normal(size=pepper.n)
        goal = np.clip(goal, pepper.lower_limits, pepper.upper_limits)
        motion = pk.retime(pepper, [pepper.posture("Stand"), goal], torque=False)
        found, every = assert_least(pepper, motion.sample(0.001).position, TABLE)
        measured, total = measured + found.measured, total + len(every)
    assert measured < 0.1 * total


def bounds_at(checker, path, pairs):
    """Of pairs: bounds on the distances at the first configuration, and on how much nearer they come then."""
    search = _LeastClearanceSearch(checker, path)
    (poses, _), bodies = search._workspace(), search.bodies
    poses.used[:] = True
    clearance._place_joints(bodies, search.path[0], poses)
    clearance._place_bodies(bodies, poses)
    steps = np.abs(search.path[1:] - search.path[0]).reshape(-1, 2, search.path.shape[1])
    near = [[clearance._approach(bodies, poses.motion_bounds, two, pair) for pair in pairs] for two in steps]
    balls = np.array([clearance._of_balls(bodies, poses, pair) for pair in pairs])
    solids = [clearance._of_solids(bodies, poses, pair, -np.inf, np.inf) for pair in pairs]
    return balls, *np.transpose(solids), np.moveaxis(near, 1, 2).reshape(len(path) - 1, len(pairs))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("scene", ["held", "sheet"])
def test_no_pair_comes_nearer_than_the_bounds_say(kind, scene):
    """Any two configurations, near or far: no distance changes by more than steps times motion bounds."""
    pepper = pk.load_pepper(**kind)
    checker = checker_for(pepper, SCENES[scene])
    rng = np.random.default_rng(5)
    nearest, width = 0.0, []
    for size in (0.01, 0.1, 1.0):
        pairs = rng.choice(checker.pair_count, 150, replace=False)
        here = smooth_path(pepper, int(rng.integers(1000)), count=2)[0]
        steps = size * rng.normal(size=(8, pepper.n)) * (rng.random((8, pepper.n)) < 0.3)
        path = np.concatenate([here[None], here + steps])
        balls, low, high, allowed = bounds_at(checker, path, pairs.tolist())
        distance = measure_by_coal(checker, pepper.to_full(path), pairs, -np.inf)[..., 0]
        apart = (distance > 0).all(axis=0)  # depths are less exact
        change = np.abs(distance[1:] - distance[0])[:, apart]
        assert np.all(change <= allowed[:, apart] + COAL)
        moving = allowed[:, apart] > 1e-3
        nearest = max(nearest, float((change[moving] / allowed[:, apart][moving]).max()))
        assert np.all(np.maximum(balls, low) <= distance[0] + COAL)
        assert np.all(high >= distance[0] - COAL)
        width.append((high - low)[np.isfinite(high) & apart])
    assert nearest > 0.6  # the bound is not far from what happens
    assert np.mean(np.concatenate(width) < 1e-6) > 0.8  # few pairs need to be measured


def test_an_arm_that_passes_a_ball():
    """A ball on an arm of 0.5 m passes another further out; they are nearest where both are in line."""
    robot = pk.load_robot(
        """<robot name="r"><link name="a"/><link name="b"><collision><origin xyz="0.5 0 0"/>
        <geometry><sphere radius="0.05"/></geometry></collision></link>
        <joint name="J" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/></joint>
        </robot>"""
    )
    angle = 0.7
    scene = pk.Scene().add_sphere("ball", 0.1, (0.8 * np.cos(angle), 0.8 * np.sin(angle), 0.0))
    path = np.linspace(-2, 2, 4001).reshape(-1, 1)
    found = least_clearance(robot, path, scene)
    assert found.distance == pytest.approx(0.15, abs=1e-9)
    assert path[found.index, 0] == pytest.approx(angle, abs=1e-9)
    assert found.pair.names == ("b", "ball")
    assert found.forbidden is None
    assert found.measured < 300


def test_configurations_far_from_each_other_are_all_looked_at():
    pepper = pk.load_pepper()
    low, high = pepper.lower_limits, pepper.upper_limits
    path = np.random.default_rng(8).uniform(low, high, (150, pepper.n))
    assert_least(pepper, path, TABLE)


def test_a_robot_at_rest_is_measured_once_in_a_stretch():
    pepper = pk.load_pepper()
    found, every = assert_least(pepper, np.repeat(pepper.posture("Stand")[None], 500, axis=0), TABLE)
    assert found.measured <= 8
    assert every.min() == every.max()
    one, _ = assert_least(pepper, pepper.posture("Stand")[None], TABLE)
    assert (one.measured, one.index) == (1, 0)


def test_what_a_table_forbids_is_named_by_its_place():
    pepper = pk.load_pepper()
    path = np.repeat(pepper.posture("Stand")[None], 60, axis=0)
    path[:, pepper.joint_index("HeadPitch")] = np.linspace(0, pepper.upper_limits[4], 60)
    path[:, pepper.joint_index("HeadYaw")] = np.linspace(0, 1.5, 60)
    path[:, pepper.joint_index("HipPitch")] = np.linspace(-0.1, pepper.lower_limits[1], 60)
    tables = checker_for(pepper, None)._ranges
    forbidden = np.any([table.violated(path) for table in tables], axis=0)
    assert forbidden.any()
    assert not forbidden.all()
    assert least_clearance(pepper, path).forbidden == np.argmax(forbidden)
    assert least_clearance(pepper, path[~forbidden]).forbidden is None


def test_nothing_to_collide_with():
    robot = pk.load_robot(
        """<robot name="r"><link name="a"/><link name="b"/><joint name="J" type="continuous">
        <parent link="a"/><child link="b"/><axis xyz="0 0 1"/></joint></robot>"""
    )
    found = least_clearance(robot, [[0.0], [1.0]])
    assert (found.distance, found.index, found.pair, found.forbidden) == (np.inf, 0, None, None)
    assert found.measured == 0


def test_misuse_is_named():
    pepper = pk.load_pepper()
    q = pepper.posture("Stand")
    with pytest.raises(InvalidValueError, match=r"q: got shape \(15,\), expected one or more of them"):
        least_clearance(pepper, q)
    with pytest.raises(InvalidValueError, match=r"q: got shape \(0, 15\), expected one or more"):
        least_clearance(pepper, np.empty((0, pepper.n)))
    with pytest.raises(InvalidValueError, match=r"q.*NaN|q.*nan"):
        least_clearance(pepper, np.full((3, pepper.n), np.nan))
