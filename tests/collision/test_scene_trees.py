"""Trees of boxes around a scene's objects, walked as checks walk them, against all objects one by one."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.collision.checker import checker_for
from pepper_kin.collision.fast.prepared import prepare
from pepper_kin.core.collision import layout as at
from pepper_kin.core.collision.records import GROUP, NODE, OBJECT, ROOT


def scene_of(count: int, rng: np.random.Generator) -> pk.Scene:
    """Return a scene of boxes and spheres, a few of which are long."""
    scene = pk.Scene()
    for k in range(count):
        position = rng.uniform((-2.0, -2.0, 1.0), (2.0, 2.0, 5.0))
        if k % 3 == 0:
            scene = scene.add_sphere(f"{k}", rng.uniform(0.01, 0.1), position)
        else:
            size = rng.uniform(0.02, 0.2, 3) * (30.0 if k % 17 == 1 else 1.0)
            scene = scene.add_box(f"{k}", size, position, rng.uniform(-3.0, 3.0, 3))
    return scene


def corners_of(scene: pk.Scene) -> tuple[np.ndarray, np.ndarray]:
    """Return least and greatest corners of boxes around the objects, shape (k, 3) each [m]."""
    lows, highs = [], []
    for item in scene.objects.values():
        pose, shape = item.transform_object_to_world, item.geometry
        half = np.full(3, shape.radius) if hasattr(shape, "radius") else np.array(shape.size) / 2
        turned = half if hasattr(shape, "radius") else np.abs(pose[:3, :3]) @ half
        lows.append(pose[:3, 3] - turned)
        highs.append(pose[:3, 3] + turned)
    return np.array(lows), np.array(highs)


def met_by(block: np.ndarray, group: int, low: np.ndarray, high: np.ndarray) -> tuple[set[int], int]:
    """Return places in the block of the objects whose boxes meet a box, and how many leaves were opened."""
    nodes = at.section_single(block, at.NODES)
    nodes = nodes[: nodes.size // NODE.width * NODE.width].reshape(-1, NODE.width)
    boxes = at.section_single(block, at.BOXES).reshape(-1, 6, 8)
    lists, roots = at.section_bits(block, at.ROOT_LISTS), at.section_bits(block, at.ROOTS)
    found, opened = set(), 0
    for r in range(lists[group], lists[group + 1]):
        n, end = roots[ROOT.width * r : ROOT.width * r + 2]
        while n < end:
            if (nodes[n, NODE.columns.low] > high).any() or (nodes[n, NODE.columns.high] < low).any():
                n = int(nodes[n, NODE.columns.after])
                continue
            opened += nodes[n, NODE.columns.object_end] > nodes[n, NODE.columns.first_object]
            for k in range(*nodes[n, [NODE.columns.first_object, NODE.columns.object_end]].astype(int)):
                box = boxes[k // 8, :, k % 8]
                if (box[:3] <= high).all() and (box[3:] >= low).all():
                    found.add(k)
            n += 1
    return found, opened


@pytest.mark.parametrize("count", [1, 2, 12, 13, 16, 17, 60, 333])
def test_trees_find_every_object_that_a_box_meets(count):
    rng = np.random.default_rng(count)
    scene, pepper = scene_of(count, rng), pk.load_pepper()
    made = prepare(checker_for(pepper, scene))
    block, order = made.scene.block, made.scene.order
    assert sorted(order.tolist()) == list(range(count))
    lows, highs = corners_of(scene)
    meeting = opened = 0
    for _ in range(100):
        low = rng.uniform((-2.5, -2.5, 0.5), (2.0, 2.0, 5.0))
        high = low + rng.uniform(0.01, 0.6, 3)
        truth = set(np.flatnonzero((lows <= high).all(axis=1) & (highs >= low).all(axis=1)).tolist())
        places, leaves = met_by(block, 0, low, high)
        found = set(order[list(places)].tolist())
        assert truth <= found
        slack = 1e-4  # for single precision
        near = (lows <= high + slack).all(axis=1) & (highs >= low - slack).all(axis=1)
        assert found <= set(np.flatnonzero(near).tolist())
        meeting, opened = meeting + len(truth), opened + leaves
    if count == 333:
        assert meeting > 100
        assert opened < 100 * 40  # of 100 leaves or so


def test_objects_stand_in_the_block_as_in_the_scene():
    scene, pepper = scene_of(40, np.random.default_rng(0)), pk.load_pepper()
    made = prepare(checker_for(pepper, scene))
    items = at.section_single(made.scene.block, at.OBJECTS)[: 40 * OBJECT.width].reshape(40, -1)
    poses = at.section(made.scene.block, at.SOLID_POSES).reshape(40, 12)
    names = list(scene.objects)
    for k, o in enumerate(made.scene.order.tolist()):
        pose = scene.objects[names[o]].transform_object_to_world
        np.testing.assert_allclose(items[k, OBJECT.columns.center], pose[:3, 3], atol=1e-6)
        np.testing.assert_array_equal(poses[k], np.concatenate([pose[:3, 3], pose[:3, :3].T.ravel()]))


def test_a_group_meets_only_the_objects_it_may_not_touch():
    scene = scene_of(30, np.random.default_rng(1)).allow("3", "l_wrist").allow("7", "l_wrist")
    pepper = pk.load_pepper()
    made = prepare(checker_for(pepper, scene))
    block, structure = made.scene.block, made.structure
    groups = at.section_bits(made.block, at.GROUPS).reshape(-1, GROUP.width)
    assert len(groups) == len(structure.groups)
    everywhere = np.full(3, -100.0), np.full(3, 100.0)
    for g, members in enumerate(structure.groups):
        places, _ = met_by(block, g, *everywhere)
        names = {structure.items[o].name for o in made.scene.order[list(places)].tolist()}
        wrist = {structure.solids[i].owner for i in members} == {"l_wrist"}
        assert names == set(scene.objects) - ({"3", "7"} if wrist else set())


def test_gaps_are_below_the_distance_of_what_never_moves():
    import coal

    rng, pepper = np.random.default_rng(5), pk.load_pepper()
    scene = pk.Scene()
    for k in range(12):
        place = rng.normal(size=3)
        place *= rng.uniform(0.5, 1.2) / np.linalg.norm(place)
        scene = scene.add_box(f"{k}", rng.uniform(0.02, 0.2, 3), place, rng.uniform(-3.0, 3.0, 3))
    structure = prepare(checker_for(pepper, scene)).structure
    gaps, least = structure.gaps
    assert len(gaps) == len(structure.resting) > 0
    assert least == gaps.min()
    distances = []
    for i, o in structure.resting.tolist():
        body, item = structure.moving.bodies[i], structure.items[o]
        ours, pose = body.geometry_object, item.transform_object_to_world
        transform = coal.Transform3s(ours.placement.rotation, ours.placement.translation)
        result = coal.DistanceResult()
        box = coal.Box(*item.geometry.size)
        apart = coal.distance(
            ours.geometry, transform, box, coal.Transform3s(pose[:3, :3], pose[:3, 3]),
            coal.DistanceRequest(), result,
        )  # fmt: skip
        distances.append(apart - body.padding)
    distances = np.array(distances)
    far = distances > 0.0
    assert far.any()
    assert (gaps[far] <= distances[far] + 1e-6).all()
    assert (gaps > 0.0).any()
