"""Items that versions of a scene share, against dictionaries."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.collision.fast import FastChecker
from pepper_kin.collision.named_items import NamedItems


def test_versions_are_dictionaries_of_their_own():
    """Random growth from random versions: each stays what a plain dictionary would be."""
    rng = np.random.default_rng(0)
    versions = [(NamedItems({}), {}), (NamedItems({"a": 1, "b": 2}), {"a": 1, "b": 2})]
    for k in range(300):
        items, plain = versions[rng.integers(len(versions))] if k % 3 else versions[-1]
        name = f"n{rng.integers(40)}"
        if name in plain:
            continue
        versions.append((items.and_one(name, k), {**plain, name: k}))
    assert len(versions) > 100
    for items, plain in versions:
        assert dict(items) == plain
        assert list(items) == list(plain)
        assert list(items.values()) == list(plain.values())
        assert list(items.items()) == list(plain.items())
        assert len(items) == len(plain)
        assert repr(items) == repr(plain)
        for name in (f"n{k}" for k in range(40)):
            assert (name in items, items.get(name)) == (name in plain, plain.get(name))
    with pytest.raises(KeyError):
        versions[0][0]["n0"]


def test_a_scene_may_grow_while_its_objects_are_looked_at():
    scene = pk.Scene().add_sphere("a", 0.1, (0, 0, 1)).add_sphere("b", 0.1, (0, 1, 1))
    for name in scene.objects:
        scene = scene.add_sphere(f"{name} again", 0.1, (0, 0, 2))
    assert list(scene.objects) == ["a", "b", "a again", "b again"]


@pytest.mark.thorough
@pytest.mark.parametrize("count", [11, 12, 13, 60, 1000])
def test_verdicts_among_many_objects_are_those_of_coal(count):
    """Boxes in trees of every depth, a floor among them, with and without margins."""
    pepper, rng = pk.load_pepper(), np.random.default_rng(count)
    scene = pk.Scene().add_half_space("floor", (0, 0, 1), 0.05).allow("floor", "Tibia", "WheelB_link")
    scene = scene.allow("floor", "WheelFL_link", "WheelFR_link", "Pelvis")
    reach = 1.0 if count < 100 else 2.0
    for k in range(count - 1):
        position = rng.uniform([-reach, -reach, 0], [reach, reach, 2.0])
        if np.hypot(*position[:2]) > 0.5:
            scene = scene.add_box(f"box{k}", rng.uniform(0.01, 0.08, 3), position, rng.uniform(-3, 3, 3))
    q = rng.uniform(pepper.lower_limits, pepper.upper_limits, (300, pepper.n))
    for margins in ((0.0, 0.0), (0.015, 0.0)):
        fast = FastChecker(pepper, scene, *margins)
        found = fast.in_collision(q)
        np.testing.assert_array_equal(found, fast.exact.in_collision(q))
        assert 0.2 < found.mean() < 1.0
        bounds = fast.lower_bound(q[:40])
        assert (bounds <= fast.exact.clearance(q[:40]) + 1e-6).all()
