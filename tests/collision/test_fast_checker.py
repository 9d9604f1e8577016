import threading

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.collision.fast import FastChecker, fast_checker_for
from pepper_kin.exceptions import InvalidValueError

NONE = pk.Scene()


def random_q(pepper, count, seed=0):
    low = np.where(np.isfinite(pepper.lower_limits), pepper.lower_limits, -3.0)
    high = np.where(np.isfinite(pepper.upper_limits), pepper.upper_limits, 3.0)
    return np.random.default_rng(seed).uniform(low, high, (count, pepper.n))


def random_scene(kind, seed, count=8):
    """Objects of one kind around the robot, within reach of its arms, some at its trunk."""
    rng = np.random.default_rng(seed)
    scene = pk.Scene()
    while len(scene.objects) < count:
        position, rpy = rng.uniform([-0.8, -0.8, 0.3], [0.8, 0.8, 1.5]), rng.uniform(-3, 3, 3)
        if np.hypot(*position[:2]) < 0.4:
            continue
        name = f"{kind}{len(scene.objects)}"
        if kind == "box":
            scene = scene.add_box(name, rng.uniform(0.03, 0.4, 3), position, rpy)
        elif kind == "sphere":
            scene = scene.add_sphere(name, rng.uniform(0.03, 0.25), position)
        elif kind == "cylinder":
            scene = scene.add_cylinder(name, *rng.uniform(0.03, 0.3, 2), position, rpy)
        else:
            scene = scene.add_capsule(name, *rng.uniform(0.03, 0.3, 2), position, rpy)
    return scene


def assert_verdicts_of_coal(fast, q, cylinders=False):
    """The same verdicts; of cylinders, coal's distance decides where its two answers contradict each other.

    coal starts each pair where the last configuration left it; against flat ends it then misses contacts.
    """
    found, expected = fast.in_collision(q), fast.exact.in_collision(q)
    differ = np.flatnonzero(found != expected)
    if cylinders and differ.size:
        clearance = fast.exact.clearance(q[differ])
        assert differ.size < 0.002 * len(q)
        assert ((clearance < 0) == found[differ])[np.abs(clearance) > 1e-5].all()
    else:
        assert differ.size == 0
    return found


def test_self_collision_is_that_of_coal():
    pepper = pk.load_pepper()
    q = random_q(pepper, 12000)
    fast = FastChecker(pepper)
    np.testing.assert_array_equal(fast.in_collision(q), fast.exact.in_collision(q))
    doubts, ties = fast.doubts(q)
    assert 0 < doubts < 0.02 * len(q)
    assert ties < 5


@pytest.mark.parametrize("kind", ["box", "sphere", "cylinder", "capsule"])
def test_collision_with_a_scene_is_that_of_coal(kind):
    pepper = pk.load_pepper()
    fast = FastChecker(pepper, random_scene(kind, seed=3))
    q = random_q(pepper, 2500, seed=4)
    found = assert_verdicts_of_coal(fast, q, cylinders=kind == "cylinder")
    assert found.mean() > FastChecker(pepper).in_collision(q).mean() + 0.01


def test_margins_are_those_of_coal():
    pepper = pk.load_pepper()
    fast = FastChecker(pepper, random_scene("box", seed=5), margin=0.03, self_margin=0.01)
    q = random_q(pepper, 2500, seed=6)
    found = fast.in_collision(q)
    np.testing.assert_array_equal(found, fast.exact.in_collision(q))
    assert found.sum() > FastChecker(pepper, random_scene("box", seed=5)).in_collision(q).sum()


@pytest.mark.parametrize("kind", [None, "box", "sphere", "cylinder", "capsule"])
def test_verdicts_agree_beside_contact(kind):
    """From free to touching by halving, then just before and just after: 1e-4 m and less from the surface.

    Of flat cylinder ends coal itself says now this, now that within 6e-5 m, depending on earlier calls.
    """
    pepper = pk.load_pepper()
    fast = FastChecker(pepper, NONE if kind is None else random_scene(kind, seed=7))
    q = random_q(pepper, 3000, seed=8)
    q = q[~np.any([t.violated(q) for t in fast.exact._ranges], axis=0)]
    touching = fast.exact.in_collision(q)
    count = min(40, int(touching.sum()), int((~touching).sum()))
    free, hit = q[~touching][:count].copy(), q[touching][:count].copy()
    for step in range(24):
        middle = (free + hit) / 2
        found = fast.exact.in_collision(middle)
        differ = fast.in_collision(middle) != found
        if kind == "cylinder" and differ.any():
            differ[differ] = np.abs(fast.exact.clearance(middle[differ])) > 1e-4
        assert not differ.any()
        free[~found], hit[found] = middle[~found], middle[found]
        if step > 14:
            assert np.abs(free - hit).max() < 1e-3


def test_what_is_as_near_as_the_margin_is_a_tie():
    """A ball exactly as far from the hand as the margin says: within 3e-6 m machine code cannot tell."""
    pepper = pk.load_pepper()
    q = pepper.posture("Stand")
    far = pk.Scene().add_sphere("ball", 0.05, (0.5, 0.0, 0.9))
    gap = min(c.distance for c in pk.collision.contacts(pepper, q, far, within=2.0) if "ball" in c.names)
    for less, tie in ((-1e-6, True), (1e-6, True), (1e-5, False)):
        fast = FastChecker(pepper, far, gap - less)
        assert fast.doubts(q)[1] == int(tie)


@pytest.mark.parametrize(
    "choice", [{"base": "planar"}, {"hands": "mimic"}], ids=["planar base", "mimic hands"]
)
def test_other_pepper(choice):
    pepper = pk.load_pepper(**choice)
    fast = FastChecker(pepper, random_scene("box", seed=1))
    q = random_q(pepper, 1500, seed=2)
    q[0, 0] = pepper.upper_limits[0] + 30.0  # far beyond what single precision is trusted with
    np.testing.assert_array_equal(fast.in_collision(q), fast.exact.in_collision(q))


def test_any_urdf_without_an_srdf():
    link = '<link name="{0}"><inertial><mass value="1"/>'
    link += '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
    link += '</inertial><collision><origin xyz="0.2 0 0"/><geometry>{1}</geometry></collision></link>'
    joint = '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/><origin xyz="{3} 0 0"/>'
    joint += '<axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
    urdf = "<robot name='chain'>" + link.format("a", '<box size="0.3 0.1 0.1"/>')
    urdf += link.format("b", '<cylinder radius="0.05" length="0.3"/>') + link.format(
        "c", '<sphere radius="0.1"/>'
    )
    urdf += joint.format("j1", "a", "b", 0.5) + joint.format("j2", "b", "c", 0.5) + "</robot>"
    robot = pk.load_robot(urdf)
    fast = FastChecker(robot, pk.Scene().add_cylinder("post", 0.1, 0.5, (0.6, 0.6, 0.1)))
    q = random_q(robot, 2000)
    found = assert_verdicts_of_coal(fast, q, cylinders=True)
    assert 0.02 < found.mean() < 0.98


def test_plain_function_takes_the_fast_way_for_batches():
    pepper = pk.load_pepper()
    q = random_q(pepper, 6000, seed=9).reshape(2, 3000, 15)
    found = pk.collision.in_collision(pepper, q)
    assert found.shape == (2, 3000)
    np.testing.assert_array_equal(found[0], pk.collision.checker_for(pepper).in_collision(q[0]))


def test_shapes_threads_and_repetition():
    pepper = pk.load_pepper()
    fast = fast_checker_for(pepper)
    assert fast is fast_checker_for(pepper)
    q = random_q(pepper, 3000, seed=10)
    once = fast.in_collision(q)
    assert fast.in_collision(q[0]).shape == ()
    assert fast.in_collision(np.empty((0, 15))).shape == (0,)
    np.testing.assert_array_equal(fast.in_collision(q, threads=2), once)
    one_by_one = [bool(fast.in_collision(state)) for state in q[:100]]
    np.testing.assert_array_equal(one_by_one, once[:100])
    results = [None] * 4

    def work(k):
        results[k] = fast.in_collision(q)

    threads = [threading.Thread(target=work, args=(k,)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for result in results:
        np.testing.assert_array_equal(result, once)


def test_a_wall_in_the_base_is_a_contact_everywhere():
    pepper = pk.load_pepper()
    scene = pk.Scene().add_box("wall", (0.1, 0.1, 0.1), (0.0, 0.0, 0.15))
    fast = FastChecker(pepper, scene)
    assert fast.exact.in_collision(pepper.posture("Stand"))
    assert fast.in_collision(random_q(pepper, 50)).all()
    assert fast.lower_bound(pepper.posture("Stand")) <= 0
    assert not fast.edge_certified(pepper.posture("Stand"), pepper.posture("Stand"))


@pytest.mark.parametrize("kind", [None, "box", "cylinder"])
def test_lower_bound_is_below_the_clearance_and_near_it(kind):
    pepper = pk.load_pepper()
    fast = FastChecker(pepper, NONE if kind is None else random_scene(kind, seed=11), margin=0.02)
    q = random_q(pepper, 400, seed=12)
    bound, clearance = fast.lower_bound(q), fast.exact.clearance(q)
    assert (bound <= clearance + 1e-9).all()
    clear = clearance > 0.02
    assert np.median((clearance - bound)[clear]) < 0.01


def test_misuse_is_named():
    for call, message in [
        (lambda f, q: FastChecker(f.pepper, None, -0.1), r"margin: got -0\.1, .*0 or more \[m\]"),
        (lambda f, q: FastChecker(f.pepper, None, 0.0, np.nan), "self_margin: got nan"),
        (lambda f, q: f.in_collision(q[:3]), r"q: got shape \(3,\)"),
        (lambda f, q: f.in_collision(q * np.nan), "KneePitch"),
        (lambda f, q: f.in_collision(q, threads=0), "threads: got 0, .*at least 1"),
        (lambda f, q: f.edge_free(q, q, resolution=0.0), r"resolution: got 0\.0"),
        (lambda f, q: f.compiled(q, [0, 0]), r"free: got \[0, 0\], .*different places of joints, 0 to 14"),
        (lambda f, q: f.compiled(q, [15]), r"free: got \[15\]"),
        (lambda f, q: f.compiled(q, [1], np.ones(3)), "effort_limits: .*15 numbers, one per joint"),
        (lambda f, q: f.compiled(q, [1]).valid_steps([0.0, 1.0], [0.0], 3), r"a: got shape \(2,\)"),
        (lambda f, q: f.compiled(q, [1]).valid_steps([0.0], [0.0], 0), "steps: got 0, .*at least 1"),
    ]:
        pepper = pk.load_pepper()
        with pytest.raises(InvalidValueError, match=message):
            call(fast_checker_for(pepper), pepper.posture("Stand"))


@pytest.mark.parametrize(("margin", "step"), [(0.0, 0.002), (0.004, 0.02), (0.015, 0.1)])
def test_along_walks_verdicts_are_coals(margin, step):
    """Gaps that are kept from one configuration to the next may not be taken for larger than they are."""
    rng, pepper = np.random.default_rng(8), pk.load_pepper()
    fast = FastChecker(pepper, None, 0.0, margin)
    start = np.tile(pepper.posture("Stand"), (30, 1)) + rng.normal(0.0, 0.05, (30, pepper.n))
    walks = start[:, None] + np.cumsum(rng.normal(0.0, step, (30, 150, pepper.n)), axis=1)
    walks = np.clip(walks, pepper.lower_limits, pepper.upper_limits).reshape(-1, pepper.n)
    expected = fast.exact.in_collision(walks)
    np.testing.assert_array_equal(fast.in_collision(walks), expected)
    assert 0.05 < expected.mean() < 0.95
    one_by_one = [bool(fast.in_collision(q)) for q in walks[::7]]
    np.testing.assert_array_equal(one_by_one, expected[::7])
