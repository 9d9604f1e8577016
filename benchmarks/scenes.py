"""What scenes cost: in_collision with and without the broad phase, clearance, and clouds.

    nice python benchmarks/scenes.py

Both ways of checking run in turn on the same configurations and must agree.
"""

import time

import numpy as np
import pinocchio

import pepper_kin as pk
from pepper_kin.collision import CollisionChecker, PointCloud


def boxes(pepper, count):
    """Boxes around the robot, none of which touches it in Stand."""
    rng = np.random.default_rng(1)
    scene, q = pk.Scene(), pepper.posture("Stand")
    while len(scene.objects) < count:
        name = f"box {len(scene.objects)}"
        more = scene.add_box(
            name,
            rng.uniform(0.05, 0.3, 3),
            rng.uniform([-1.5, -1.5, 0], [1.5, 1.5, 1.5]),
            rng.uniform(-3, 3, 3),
        )
        alone = pk.Scene({name: more.objects[name]})
        if not any(name in pair for pair in CollisionChecker(pepper, alone).contacts(q)):
            scene = more
    return scene


def office(count):
    """A million points of a table, a wall and a floor."""
    rng = np.random.default_rng(0)
    points = rng.uniform([-2, -2, 0], [2, 2, 0.005], (count, 3))
    points[: count // 3, 2] += 0.7
    points[: count // 3, 0] = rng.uniform(0.5, 1.5, count // 3)
    points[-count // 3 :, 0] = 1.5
    points[-count // 3 :, 2] = rng.uniform(0, 2, len(points[-count // 3 :]))
    return points


def row(name, pepper, scene, states):
    """Median times per configuration, the two ways in turn."""
    checker = CollisionChecker(pepper, scene)
    data, geometry = checker._data[0], checker._data[1]._kept
    times = {"broad": [], "all": [], "clearance": []}
    for q in states:
        begin = time.perf_counter()
        fast = checker._touches(q)
        middle = time.perf_counter()
        slow = pinocchio.computeCollisions(pepper.inner_model, data, checker._shapes.model, geometry, q, True)
        end = time.perf_counter()
        checker.clearance(q)
        times["broad"].append(middle - begin)
        times["all"].append(end - middle)
        times["clearance"].append(time.perf_counter() - end)
        assert fast == slow
    figures = " | ".join(f"{1e6 * np.median(values):.0f}" for values in times.values())
    print(f"| {name} | {checker.pair_count} | {figures} |")


def main():
    pepper = pk.load_pepper().with_requirements("limits")
    rng = np.random.default_rng(0)
    states = rng.uniform(pepper.lower_limits, pepper.upper_limits, (300, pepper.n))
    print("| scene | pairs | `in_collision` [us] | over all pairs [us] | `clearance` [us] |")
    print("|---|---|---|---|---|")
    for count in (0, 1, 5, 20, 100):
        row(f"{count} boxes", pepper, boxes(pepper, count), states)
    points = office(1_000_000)
    thinning, building = [], []
    for _ in range(3):
        begin = time.perf_counter()
        scene = pk.Scene().add_point_cloud("office", points, 0.005).allow("office", "Tibia")
        thinned = time.perf_counter()
        checker = CollisionChecker(pepper, scene)
        thinning.append(thinned - begin)
        building.append(time.perf_counter() - thinned)
    kept = len(scene.objects["office"].geometry.points)
    assert checker.pair_count > 0
    assert isinstance(scene.objects["office"].geometry, PointCloud)
    row(f"cloud of 1 000 000 points, {kept} kept", pepper, scene, states)
    print(f"\nThe cloud, best of three: {min(thinning):.2f} s to thin, {min(building):.2f} s for its tree.")


if __name__ == "__main__":
    main()
