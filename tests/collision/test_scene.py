"""Scenes: what they take, what they refuse, and what hangs on the robot."""

import os
import pickle
import re
import time

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.collision import ConvexMesh, HalfSpace, PointCloud, SceneObject, TriangleMesh
from pepper_kin.exceptions import InvalidValueError, ModelError, PepperKinError, UnknownNameError

BASE = ("Tibia", "WheelB_link", "WheelFL_link", "WheelFR_link")
CUBE = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * 0.1
TRIANGLE = ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])


def cup_scene():
    return pk.Scene().add_cylinder("cup", 0.03, 0.1, (0.3, 0.2, 0.8)).add_box("wall", (1, 1, 1), (3, 0, 0))


def test_bad_objects_are_refused_by_name():
    for call, message in [
        (lambda s: s.add_box("b", (1, 0, 1), (0, 0, 0)), r"box size: got \(1.0, 0.0, 1.0\)"),
        (lambda s: s.add_box("b", (1, np.nan, 1), (0, 0, 0)), "size of 'b': got nan"),
        (lambda s: s.add_box("b", (1, 1), (0, 0, 0)), r"size of 'b': got shape \(2,\), .* shape \(3,\)"),
        (lambda s: s.add_box("b", (1, 1, 1), (0, np.nan, 0)), "position of 'b': got nan"),
        (lambda s: s.add_sphere("b", -0.1, (0, 0, 0)), "sphere radius: got -0.1"),
        (lambda s: s.add_sphere("b", "wide", (0, 0, 0)), "radius of 'b': got 'wide'"),
        (lambda s: s.add_cylinder("b", 0.1, np.inf, (0, 0, 0)), "length of 'b': got inf"),
        (lambda s: s.add_capsule("b", 0.1, 0.0, (0, 0, 0)), "capsule length: got 0.0"),
        (lambda s: s.add_half_space("b", (0, 0, 0)), "normal of 'b': got .* not all zeros"),
        (lambda s: s.add_half_space("b", (0, 0, 1), np.nan), "offset of 'b': got nan"),
        (lambda s: s.add_mesh("b", [], []), r"vertices of 'b': got shape \(0,\)"),
        (lambda s: s.add_mesh("b", TRIANGLE[0], []), "faces of a mesh: got .* whole numbers of shape"),
        (lambda s: s.add_mesh("b", *TRIANGLE[:1]), "faces of 'b': got NoneType, expected indices"),
        (lambda s: s.add_mesh("b", TRIANGLE[0], [[0, 1, 3]]), "faces of a mesh: got vertex 3 in face 0"),
        (lambda s: s.add_mesh("b", TRIANGLE[0], [[0, 1, -1]]), "got vertex -1 in face 0, .* from 0 to 2"),
        (lambda s: s.add_mesh("b", TRIANGLE[0], [[0, 1, 0.5]]), "faces of a mesh: got float64"),
        (lambda s: s.add_mesh("b", TRIANGLE[0], [[0, 1, 1]]), "1 triangles, none of which has an area"),
        (lambda s: s.add_mesh("b", [[0, 0, np.nan], *TRIANGLE[0][1:]], [[0, 1, 2]]), "of 'b': got nan"),
        (lambda s: s.add_convex_mesh("b", CUBE * [1, 1, 0]), "convex mesh: got 8 points in a plane"),
        (lambda s: s.add_convex_mesh("b", CUBE[:3]), "convex mesh: got 3 points in a plane"),
        (lambda s: s.add_convex_mesh("b", CUBE * np.inf), "vertices of 'b': got"),
        (lambda s: s.add_point_cloud("b", [[0, 0, np.nan]], 0.01), "points of a cloud: got nan"),
        (lambda s: s.add_point_cloud("b", [[0, 0]], 0.01), r"points of a cloud: got shape \(1, 2\)"),
        (lambda s: s.add_point_cloud("b", CUBE, -1), "point radius: got -1"),
        (lambda s: s.add_point_cloud("b", CUBE, 0.01, voxel=0), "voxel: got 0, expected a finite length"),
        (lambda s: s.add_point_cloud("b", CUBE * 9e6, 0.01, voxel=1e-7), "voxel: got 1e-07, .* fewer cubes"),
        (lambda s: s.add("b", "box"), "geometry of 'b': got str, expected Box"),
        (lambda s: s.add("b", pk.model.Sphere(1), color=(1, 2, 0, 1)), r"color of 'b': got \(1, 2, 0, 1\)"),
        (
            lambda s: s.add_sphere("cup", 1, (0, 0, 0)),
            "object name: got 'cup', expected a new name; taken: cup",
        ),
        (lambda s: s.add_sphere("", 1, (0, 0, 0)), "object name: got ''"),
        (lambda s: s.padded(np.nan), "margin: got nan"),
        (lambda s: s.allow("cup", "cup"), "pair allowed for 'cup': got 'cup'"),
        (lambda s: s.attach("cup", "l_gripper"), "place of 'cup' on the robot: .* either transform"),
        (lambda s: s.attach("cup", "l_gripper", 2 * np.eye(4)), "transform_object_to_frame of 'cup': got a"),
        (
            lambda s: s.attach("cup", "l_gripper", np.eye(4) * np.nan),
            "transform_object_to_frame of 'cup': got n",
        ),
        (
            lambda s: s.add_half_space("floor", (0, 0, 1)).attach("floor", "l_gripper", np.eye(4)),
            "geometry of 'floor': got HalfSpace, expected a bounded shape",
        ),
        (
            lambda s: s.attach("cup", "l_gripper", np.eye(4)).move("cup", (0, 0, 0)),
            "object: got 'cup', .* hangs on l_gripper: release it",
        ),
    ]:
        with pytest.raises(InvalidValueError, match=message):
            call(cup_scene())


def test_unknown_names_are_listed():
    for call, message in [
        (lambda s, p: s.remove("chair"), "unknown scene object 'chair'; available: cup, wall"),
        (lambda s, p: s.allow("chair", "torso"), "unknown scene object 'chair'"),
        (lambda s, p: s.disallow("cup", "torso"), "unknown pair allowed for 'cup' with 'torso'"),
        (lambda s, p: s.release(p, "cup", p.neutral()), "unknown attached object 'cup'"),
        (lambda s, p: s.attach("chair", "l_gripper", np.eye(4)), "unknown scene object 'chair'"),
        (lambda s, p: s.attach("cup", "tail", pepper=p, q=p.neutral()), "unknown frame 'tail'"),
        (
            lambda s, p: s.attach("cup", "l_gripper", pepper=p, q=p.neutral(), touch_links=["tail"]),
            "unknown frame 'tail'",
        ),
        (
            lambda s, p: pk.collision.in_collision(p, p.neutral(), s.attach("cup", "tail", np.eye(4))),
            "unknown frame 'tail'",
        ),
        (
            lambda s, p: pk.collision.in_collision(p, p.neutral(), s.allow("cup", "tail")),
            "unknown link or object in an allowed pair 'tail'; available: cup, wall, Tibia",
        ),
    ]:
        with pytest.raises(UnknownNameError, match=message):
            call(cup_scene(), pk.load_pepper())


def test_an_object_may_not_be_named_like_a_link():
    pepper = pk.load_pepper()
    with pytest.raises(InvalidValueError, match="object name: got 'Head', expected a name that no link"):
        pk.collision.in_collision(pepper, pepper.neutral(), pk.Scene().add_sphere("Head", 0.1, (3, 0, 0)))


def test_a_million_points_are_thinned_and_still_covered():
    rng = np.random.default_rng(0)
    points = rng.uniform([-2, -2, 0], [2, 2, 0.01], (1_000_000, 3))
    points[:400_000, 2] = rng.uniform(0.7, 0.72, 400_000)
    begin = time.thread_time()
    cloud = PointCloud.thinned(points, 0.005, 0.05)
    assert time.thread_time() - begin < 60  # it ends; how fast is in the documentation
    assert len(cloud.points) < 20_000
    assert cloud.radius <= 0.005 + 0.05 * np.sqrt(3) / 2
    from scipy.spatial import cKDTree

    nearest = cKDTree(cloud.points).query(points[::7])[0]
    assert nearest.max() + 0.005 <= cloud.radius + 1e-12


def test_thinning_keeps_single_points():
    """A point alone in its cube stays where it is, and the balls do not grow."""
    grid = np.stack(np.meshgrid(*3 * [np.arange(4) * 0.1]), -1).reshape(-1, 3)
    cloud = PointCloud.thinned(grid, 0.01, 0.05)
    assert cloud.radius == 0.01
    assert np.array_equal(np.unique(cloud.points, axis=0), np.unique(grid, axis=0))


def test_an_empty_cloud_touches_nothing():
    pepper = pk.load_pepper()
    scene = pk.Scene().add_point_cloud("nothing", np.empty((0, 3)), 0.1).add_point_cloud("list", [], 0.1)
    q = pepper.neutral()
    assert pk.collision.clearance(pepper, q, scene) == pk.collision.clearance(pepper, q)
    assert pk.collision.checker_for(pepper, scene).pair_count == pk.collision.checker_for(pepper).pair_count


def test_arrays_are_copied_and_read_only():
    points = CUBE.copy()
    cloud, hull = PointCloud(points, 0.01), ConvexMesh(points)
    points[:] = 0
    assert np.array_equal(cloud.points, CUBE)
    assert np.array_equal(hull.vertices, CUBE)
    for array in (cloud.points, hull.vertices, hull.faces):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


def test_objects_that_are_given_no_color_differ_in_it():
    scene = pk.Scene().add_box("table", (0.4, 0.8, 0.03), (0.5, 0, 0.7)).add_sphere("red", 0.1, (1, 0, 0))
    for k in range(6):
        scene = scene.add_sphere(f"ball {k}", 0.1, (k, 2, 0))
    colors = {name: thing.color for name, thing in scene.objects.items()}
    assert len(set(colors.values())) == 8
    moved = scene.move("ball 3", (0, 0, 5)).padded(0.01).with_cloud("ball 2", np.zeros((1, 3)), 0.1)
    assert {name: thing.color for name, thing in moved.objects.items()} == colors
    chosen = scene.add_box("red box", (1, 1, 1), (0, 0, 9), color=(1, 0, 0, 1)).objects["red box"]
    assert chosen.color == (1.0, 0.0, 0.0, 1.0)


def test_objects_move_at_once_and_clouds_are_swapped():
    scene = (
        pk.Scene()
        .add_box("a", (0.1, 0.2, 0.3), (1, 0, 0), rpy=(0.1, 0.2, 0.3))
        .add_sphere("b", 0.1, (0, 1, 0))
    )
    scene = scene.add_half_space("floor", (0, 0, 1)).allow("floor", "Tibia")
    turned = (
        pk.Scene().add_box("a", (1, 1, 1), (2, 2, 2), rpy=(0, 0, 1)).objects["a"].transform_object_to_world
    )
    moved = scene.moved({"b": (3, 1, 0), "a": turned})
    expected = scene.move("b", (3, 1, 0)).move("a", (2, 2, 2), (0, 0, 1))
    assert moved.equals(expected)
    assert moved.names == scene.names
    assert scene.moved({"a": (5, 0, 0)}).equals(scene.move("a", (5, 0, 0), (0.1, 0.2, 0.3)))
    one, other = moved.add_sphere("c", 0.1, (0, 0, 3)), scene.add_box("c", (1, 1, 1), (0, 0, 4))
    assert moved.names == ("a", "b", "floor")
    assert isinstance(one.objects["c"].geometry, pk.model.Sphere)
    assert isinstance(other.objects["c"].geometry, pk.model.Box)
    points = np.random.default_rng(0).uniform(1, 2, (50, 3))
    swapped = one.with_cloud("d", points, 0.01).with_cloud("d", points + 1, 0.02)
    assert swapped.equals(one.add_point_cloud("d", points + 1, 0.02))
    assert swapped.with_cloud("c", points, 0.01).names == swapped.names


@pytest.mark.parametrize(
    ("poses", "message"),
    [
        ({"c": (0, 0, 0)}, "'c'"),
        ({"a": (0, 0)}, "position of 'a'"),
        ({"a": np.diag([1.0, 1.0, -1.0, 1.0])}, "pose of 'a'.*rigid"),
        ({"a": np.diag([1.0, 1.0, 1.0, 2.0])}, "pose of 'a'.*rigid"),
        ({"a": (0, 0, np.nan)}, "of 'a'"),
        ({"a": (0, 0, 1e9)}, "another unit"),
        ({"cup": (0, 0, 1)}, "release it"),
        ([("a", (0, 0, 0))], "a mapping"),
        ({"a": [[1], 2]}, "of 'a'"),
    ],
)
def test_poses_that_no_object_can_take_are_refused(poses, message):
    scene = pk.Scene().add_box("a", (1, 1, 1), (0, 0, 9)).add_sphere("cup", 0.02, (0, 0, 0))
    with pytest.raises(PepperKinError, match=message):
        scene.attach("cup", "l_gripper", np.eye(4)).moved(poses)


def test_convex_mesh_keeps_corners_and_faces_outward():
    rng = np.random.default_rng(1)
    hull = ConvexMesh(np.concatenate([CUBE, rng.uniform(-0.09, 0.09, (50, 3))]))
    assert np.array_equal(hull.vertices, CUBE)
    a, b, c = (hull.vertices[hull.faces[:, k]] for k in range(3))
    assert (np.einsum("ij,ij->i", np.cross(b - a, c - a), a) > 0).all()
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6
    assert volume == pytest.approx(0.008)
    assert len(TriangleMesh(CUBE, [*hull.faces, [0, 0, 1]]).faces) == len(hull.faces)


def test_padded_scene_grows_every_kind():
    scene = (
        pk.Scene()
        .add_half_space("floor", (0, 0, 1), -0.2)
        .add_convex_mesh("hull", CUBE, (2, 0, 1))
        .add_mesh("net", *TRIANGLE, (2, 1, 1))
        .add_point_cloud("cloud", CUBE, 0.01, (2, -1, 1))
        .add_cylinder("cup", 0.03, 0.1, (1, 0, 1))
        .attach("cup", "l_gripper", np.eye(4))
    )
    grown = scene.padded(0.02)
    assert grown.objects["floor"].geometry == HalfSpace(0.02)
    assert grown.objects["hull"].geometry.padding == grown.objects["net"].geometry.padding == 0.02
    assert grown.objects["cloud"].geometry.radius == pytest.approx(0.03)
    assert grown.attached["cup"].geometry == scene.attached["cup"].geometry
    pepper = pk.load_pepper()
    q = pepper.neutral()
    for name in scene.objects:
        alone = scene
        for other in (*scene.objects, "cup"):
            alone = alone if other == name else alone.remove(other)
        found = []
        for each in (alone, alone.padded(0.02)):
            pairs = pk.collision.contacts(pepper, q, each, within=5.0)
            found.append(min(c.distance for c in pairs if name in c.names))
        assert found[0] - found[1] == pytest.approx(0.02, abs=1e-9), name


def test_scenes_move_remove_and_compare():
    scene = cup_scene().allow("cup", "torso")
    moved = scene.move("cup", (1, 0, 0))
    assert tuple(moved.objects) == ("cup", "wall")
    assert not moved.equals(scene)
    assert moved.move("cup", (0.3, 0.2, 0.8)).equals(scene)
    assert scene.remove("cup").allowed == frozenset()
    assert scene.allow("cup", "wall").disallow("cup", "torso").allowed == {("cup", "wall")}
    assert scene.disallow("cup").allowed == frozenset()
    held = scene.attach("cup", "l_gripper", np.eye(4), touch_links="LForeArm")
    assert repr(held) == "Scene(wall, cup on l_gripper)"
    assert held.attached["cup"].touch_links == ("LForeArm",)
    assert not held.equals(scene)
    assert pickle.loads(pickle.dumps(held)).equals(held)
    with pytest.raises(AttributeError, match="frozen"):
        held.attached = {}


def test_an_attached_object_moves_with_its_link():
    pepper = pk.load_pepper()
    q, other = pepper.posture("Stand"), pepper.posture("StandZero")
    held = cup_scene().attach("cup", "l_gripper", pepper=pepper, q=q)
    assert tuple(held.objects) == ("wall",)
    back = held.release(pepper, "cup", q)
    np.testing.assert_allclose(
        back.objects["cup"].transform_object_to_world,
        cup_scene().objects["cup"].transform_object_to_world,
        atol=1e-12,
    )
    moved = held.release(pepper, "cup", other).objects["cup"].transform_object_to_world
    hands = [pk.kinematics.frame_pose(pepper, state, "l_gripper") for state in (q, other)]
    expected = hands[1] @ np.linalg.inv(hands[0]) @ cup_scene().objects["cup"].transform_object_to_world
    np.testing.assert_allclose(moved, expected, atol=1e-12)


@pytest.mark.parametrize("hands", ["locked", "mimic", "independent"])
def test_a_held_object_touches_the_world_and_the_body_but_not_its_hand(hands):
    pepper = pk.load_pepper(hands=hands)
    q = pepper.posture("Stand")
    grip = pk.kinematics.frame_pose(pepper, q, "l_gripper")
    free = pk.Scene().add_sphere("ball", 0.03, grip[:3, 3])
    assert pk.collision.in_collision(pepper, q, free)
    held = free.attach("ball", "l_gripper", pepper=pepper, q=q)
    assert not pk.collision.in_collision(pepper, q, held)
    # The same ball, in the world, tells what the held one touches elsewhere.
    blocked = held.add_box("brick", (0.05, 0.05, 0.05), grip[:3, 3] + [0.04, 0.0, 0.0])
    names = pk.collision.checker_for(pepper, blocked).contacts(q)
    assert ("ball", "brick") in names
    allowed = pk.collision.checker_for(pepper, blocked.allow("ball", "brick"))
    assert ("ball", "brick") not in allowed.contacts(q)
    long = pk.Scene().add_capsule("rod", 0.02, 0.9, grip[:3, 3])
    poking = long.attach("rod", "l_gripper", pepper=pepper, q=q)
    touched = {pair[0] for pair in pk.collision.checker_for(pepper, poking).contacts(q)}
    assert "torso" in touched
    assert not {link for link in touched if link.startswith(("l_wrist", "LFinger", "LThumb"))}
    lenient = long.attach("rod", "l_gripper", pepper=pepper, q=q, touch_links=sorted(touched))
    assert not pk.collision.in_collision(pepper, q, lenient)


def test_what_hangs_on_the_torso_is_checked_against_arms():
    """Only a hand's own fingers are exempt, not all that moves beyond a link."""
    pepper = pk.load_pepper()
    q = pepper.neutral()
    arm = pk.kinematics.frame_pose(pepper, q, "LForeArm")[:3, 3]
    scene = pk.Scene().add_sphere("bag", 0.05, arm).attach("bag", "torso", pepper=pepper, q=q)
    assert ("LForeArm", "bag") in pk.collision.checker_for(pepper, scene).contacts(q)


def test_allowed_pairs_are_skipped():
    pepper = pk.load_pepper()
    q = pepper.neutral()
    floor = pk.Scene().add_half_space("floor", (0, 0, 1), 0.001)
    touching = {pair[0] for pair in pk.collision.checker_for(pepper, floor).contacts(q)}
    assert touching
    assert touching <= set(BASE)
    assert not pk.collision.in_collision(pepper, q, floor.allow("floor", *BASE))
    assert pk.collision.in_collision(pepper, q, floor.allow("floor", *BASE).disallow("floor", *BASE))
    bowed = pepper.joint_vector({"HipPitch": -1.03, "KneePitch": 0.5, "LShoulderPitch": 0.5})
    deep = pk.Scene().add_half_space("floor", (0, 0, 1), 0.6).allow("floor", *BASE, "Pelvis", "Hip")
    assert pk.collision.in_collision(pepper, bowed, deep)


def test_a_held_object_keeps_margins_as_part_of_the_robot():
    pepper = pk.load_pepper()
    q = pepper.posture("Stand")
    grip = pk.kinematics.frame_pose(pepper, q, "l_gripper")[:3, 3]
    held = pk.Scene().add_sphere("ball", 0.03, grip).attach("ball", "l_gripper", pepper=pepper, q=q)
    scene = held.add_sphere("post", 0.05, grip + np.array([0.2, 0, 0]))
    gap = 0.2 - 0.03 - 0.05
    found = [c for c in pk.collision.contacts(pepper, q, scene, within=0.5) if c.names == ("ball", "post")]
    assert found[0].distance == pytest.approx(gap, abs=1e-9)
    assert found[0].links == ("l_gripper", None)
    bare = scene.allow("post", *{s.link for s in pepper.collision_shapes})
    assert not pk.collision.checker_for(pepper, bare, gap - 0.001).in_collision(q)
    assert pk.collision.checker_for(pepper, bare, gap + 0.001).in_collision(q)


def test_an_overlap_at_the_start_is_a_status_of_the_plan():
    pepper = pk.load_pepper()
    q = pepper.posture("Stand")
    scene = pk.Scene().add_point_cloud("dust", [pk.kinematics.frame_pose(pepper, q, "Head")[:3, 3]], 0.05)
    found = pk.plan(pepper, q, pepper.posture("StandZero"), scene, seed=0)
    assert not found.success
    assert "dust overlap" in found.message


def test_planning_accounts_for_what_is_held():
    """The farther a held object reaches, the finer a motion is looked at; and it does not hit the post."""
    from pepper_kin.collision.motion_tree import motion_bounds

    pepper = pk.load_pepper()
    shoulder = pepper.joint_index("LShoulderPitch")
    assert motion_bounds(pepper, held=(("l_gripper", 2.0),))[shoulder] > motion_bounds(pepper)[shoulder] + 1.5
    q, goal = pepper.posture("Stand"), pepper.joint_vector({"LShoulderPitch": 0.6, "LShoulderRoll": 0.6})
    grip = pk.kinematics.frame_pose(pepper, q, "l_gripper")
    at = grip[:3, 3] + [0.02, 0.02, 0.0]
    scene = pk.Scene().add_cylinder("cup", 0.02, 0.1, at).attach("cup", "l_gripper", pepper=pepper, q=q)
    scene = scene.add_sphere("lamp", 0.04, (0.35, 0.25, 0.6))
    found = pk.plan(pepper, q, goal, scene, seed=0)
    assert found.success, found.message
    assert not pk.collision.in_collision(pepper, found.path, scene).any()


def test_extent_bounds_every_point_of_a_held_object():
    for geometry, expected in [
        (pk.model.Box((0.2, 0.2, 0.2)), 0.5 + 0.1 * np.sqrt(3)),
        (pk.model.Sphere(0.1), 0.6),
        (pk.model.Capsule(0.1, 0.4), 0.8),
        (pk.model.Cylinder(0.3, 0.8), 1.0),
        (ConvexMesh(CUBE, 0.02), np.linalg.norm([0.6, 0.1, 0.1]) + 0.02),
        (PointCloud([[0.1, 0, 0], [-0.2, 0, 0]], 0.01), 0.61),
    ]:
        pose = np.eye(4)
        pose[0, 3] = 0.5
        held = pk.Scene().add("it", geometry).attach("it", "l_gripper", pose).attached["it"]
        assert held.extent == pytest.approx(expected)


def cube_file(path, half):
    corners = half * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    hull = ConvexMesh(corners)
    lines = [f"v {x} {y} {z}" for x, y, z in hull.vertices]
    path.write_text("\n".join([*lines, *(f"f {a + 1} {b + 1} {c + 1}" for a, b, c in hull.faces)]))


def test_a_mesh_file_that_changes_is_read_again_by_all_checkers(pepper, tmp_path):
    """Checkers are kept for a scene: they answered with the file as it had been."""
    from pepper_kin.collision.fast import fast_checker_for

    file, q = tmp_path / "cube.obj", pepper.posture("Stand")
    hand = pk.kinematics.frame_pose(pepper, q, "l_gripper")[:3, 3]
    place = np.eye(4)
    place[:3, 3] = hand[0] + 0.3, hand[1], hand[2]
    cube_file(file, 0.02)
    scene = pk.Scene({"cube": SceneObject("cube", pk.model.Mesh(file), place)})
    for half, touches in ((0.02, False), (0.3, True), (0.02, False)):
        cube_file(file, half)
        os.utime(file, ns=(0, int(1e9 * half)))
        assert bool(fast_checker_for(pepper, scene).in_collision(q)) is touches
        assert bool(pk.collision.checker_for(pepper, scene).in_collision(q)) is touches
        assert (pk.collision.clearance(pepper, q, scene) < 0.0) == touches
        assert (pk.plan(pepper, q, q, scene).status is pk.motion.PlanStatus.START_IN_COLLISION) == touches


def test_a_relative_mesh_name_is_that_of_the_folder_in_which_it_was_given(pepper, tmp_path, monkeypatch):
    (tmp_path / "here").mkdir()
    (tmp_path / "elsewhere").mkdir()
    cube_file(tmp_path / "here" / "cube.obj", 0.02)
    monkeypatch.chdir(tmp_path / "here")
    scene = pk.Scene().add("cube", pk.model.Mesh("cube.obj"), (1.0, 0.0, 1.0))
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert scene.objects["cube"].geometry.path == tmp_path / "here" / "cube.obj"
    assert not pk.collision.in_collision(pepper, pepper.posture("Stand"), scene)


FAR = 1e300


@pytest.mark.parametrize("far", [1.1e6, 1e15, FAR])
@pytest.mark.parametrize(
    ("what", "add"),
    [
        ("position of 'a'", lambda far: pk.Scene().add_box("a", (1, 1, 1), (far, 0, 0))),
        ("size of 'a'", lambda far: pk.Scene().add_box("a", (1, far, 1), (0, 0, 9))),
        ("size of 'a'", lambda far: pk.Scene().add_sphere("a", far, (0, 0, 9))),
        ("size of 'a'", lambda far: pk.Scene().add_capsule("a", 1.0, far, (0, 0, 9))),
        ("offset of a half-space", lambda far: pk.Scene().add("a", HalfSpace(far))),
        ("position of 'a'", lambda far: pk.Scene().add_half_space("a", (1, 0, 0), -far)),
        ("vertices of a convex mesh", lambda far: pk.Scene().add_convex_mesh("a", far * CUBE)),
        ("vertices of a mesh", lambda far: pk.Scene().add_mesh("a", far * CUBE, [[0, 1, 2]])),
        ("points of a cloud", lambda far: pk.Scene().add_point_cloud("a", [[far, 0, 0]], 0.01)),
        ("point radius", lambda far: pk.Scene().add_point_cloud("a", [[1, 0, 0]], far)),
        ("position of 'a'", lambda far: pk.Scene().add_box("a", (1, 1, 1), (0, 0, 9)).move("a", (0, far, 0))),
        ("size of 'a'", lambda far: pk.Scene().add_box("a", (1, 1, 1), (0, 0, 9)).padded(far)),
    ],
)
def test_what_is_beyond_a_million_meters_is_refused_by_name(what, add, far):
    """At 1e300 m the compiled check said "in collision", and coal ended with a ValueError from 1e20 m on."""
    with pytest.raises(InvalidValueError, match=re.escape(what)) as caught:
        add(far * (10 if "vertices" in what else 1))
    assert "at most 1e+06 m" in str(caught.value)


@pytest.mark.parametrize("length", [1e1, 1e3, 1e5, 9e5])
def test_a_floor_of_any_length_answers_as_a_half_space(pepper, length):
    from pepper_kin.collision.fast import fast_checker_for

    rng = np.random.default_rng(3)
    q = rng.uniform(pepper.lower_limits, pepper.upper_limits, (200, pepper.n))
    for height in (0.3, 0.6):
        box = pk.Scene().add_box("floor", (length, length, 1.0), (0, 0, height - 0.5)).allow("floor", *BASE)
        plane = pk.Scene().add_half_space("floor", (0, 0, 1), height).allow("floor", *BASE)
        for checker_of in (fast_checker_for, pk.collision.checker_for):
            found, truth = (checker_of(pepper, scene).in_collision(q) for scene in (box, plane))
            np.testing.assert_array_equal(found, truth)


@pytest.mark.thorough
def test_thousands_of_boxes_are_added_and_checked_as_those_near_by_are(pepper):
    """Adding one does not cost more the more there are, nor do the checks: coal's model took hours."""
    rng, scene = np.random.default_rng(4), pk.Scene()
    places = rng.uniform([-2, -2, -1], [2, 2, 2], (3_000, 3))
    places = places[np.linalg.norm(places[:, :2], axis=1) > 0.5]
    for k, place in enumerate(places):
        scene = scene.add_box(f"box{k}", (0.03, 0.03, 0.03), place)
    states = rng.uniform(pepper.lower_limits, pepper.upper_limits, (12, pepper.n))
    states = np.concatenate([[pepper.posture("Stand")], states])
    exact = pk.collision.CollisionChecker(pepper, scene)
    found = pk.collision.in_collision(pepper, states, scene)
    np.testing.assert_array_equal(found, exact.in_collision(states))
    assert 0 < found.sum() < len(states)
    for q in states[:4]:
        near = {name for pair in exact.contact_points(q, 0.4) for name in pair.names}
        few = pk.Scene({name: item for name, item in scene.objects.items() if name in near})
        assert 3 < len(few.objects) < 450
        alone = pk.collision.CollisionChecker(pepper, few)
        assert exact.clearance(q) == pytest.approx(float(alone.clearance(q)), abs=1e-12)
        assert set(exact.contacts(q)) == set(alone.contacts(q))
        ours, theirs = exact.closest_pair(q), alone.closest_pair(q)
        assert ours.names == theirs.names
        np.testing.assert_allclose(ours.points, theirs.points, atol=1e-9)
    line = np.linspace(states[0], states[1], 20)
    along = pk.collision.least_clearance(pepper, line, scene)
    assert along.distance == pytest.approx(float(exact.clearance(line).min()), abs=4e-6)


MASS = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
CABINET = f"""<robot name="cabinet">
  <link name="body">
    <visual><geometry><sphere radius="1"/></geometry><material name="m"><color rgba="1 0 0 1"/></material></visual>
    <collision><origin xyz="0 0 0.1" rpy="0.1 0 0"/><geometry><box size="0.4 0.3 0.2"/></geometry></collision>
  </link>
  <link name="arm">{MASS}</link>
  <link name="drawer">{MASS}
    <collision name="knob"><origin xyz="0.2 0 0"/><geometry><sphere radius="0.02"/></geometry></collision></link>
  <joint name="hinge" type="fixed"><parent link="body"/><child link="arm"/>
    <origin xyz="0 0.1 0.3" rpy="0.3 0 1"/></joint>
  <joint name="slide" type="prismatic"><parent link="arm"/><child link="drawer"/>
    <origin xyz="0.1 0 0" rpy="0 1 0"/><limit lower="0" upper="0.3" effort="1" velocity="1"/></joint>
</robot>"""  # noqa: E501


def test_an_object_of_a_urdf_stands_where_the_kinematics_have_its_links():
    place = pk.model.pose((1.0, -0.5, 0.2), rpy=(0.1, 0.2, 0.3))
    scene = pk.Scene().add_urdf("cabinet", CABINET, (1.0, -0.5, 0.2), (0.1, 0.2, 0.3))
    assert scene.names == ("cabinet/body_collision_0", "cabinet/knob")
    robot = pk.load_robot(CABINET)
    for name, shape in zip(scene.names, robot.collision_shapes, strict=True):
        link = pk.kinematics.frame_pose(robot, robot.neutral(), shape.link)
        expected = place @ link @ shape.transform_shape_to_link
        np.testing.assert_allclose(scene.objects[name].transform_object_to_world, expected, atol=1e-12)
        assert scene.objects[name].geometry == shape.geometry
    assert scene.objects["cabinet/body_collision_0"].color == (1.0, 0.0, 0.0, 1.0)


@pytest.mark.parametrize(("meshes", "inside"), [("hull", True), ("surface", False)])
def test_an_object_of_a_urdf_without_joints_is_an_obstacle(tmp_path, meshes, inside):
    robot = pk.load_pepper()
    corners = " ".join(f"v {x} {y} {z}\n" for x, y, z in CUBE)
    (tmp_path / "cube.obj").write_text(
        corners.replace(" v", "v") + "f 1 2 4\nf 1 4 3\nf 5 7 8\nf 5 8 6\nf 1 5 6\nf 1 6 2\n"
        "f 3 4 8\nf 3 8 7\nf 1 3 7\nf 1 7 5\nf 2 6 8\nf 2 8 4\n"
    )
    text = (
        '<robot name="cube"><link name="cube"><collision><geometry>'
        '<mesh filename="cube.obj" scale="20 20 20"/></geometry></collision></link></robot>'
    )
    (tmp_path / "cube.urdf").write_text(text)
    scene = pk.Scene().add_urdf("cube", tmp_path / "cube.urdf", (0.0, 0.0, 0.5), meshes=meshes)
    assert scene.names == ("cube",)
    assert (
        pk.collision.in_collision(robot, robot.posture("Stand"), scene) == inside
    )  # the robot is in the cube


def test_objects_of_urdfs_are_refused_by_name():
    empty = '<robot name="none"><link name="a"/></robot>'
    with pytest.raises(ModelError, match="'none' has no collision shapes"):
        pk.Scene().add_urdf("none", empty)
    with pytest.raises(InvalidValueError, match="a new name; taken: none"):
        pk.Scene().add_box("none", (1, 1, 1), (0, 0, 0)).add_urdf("none", CABINET)
    with pytest.raises(InvalidValueError, match=r"meshes: got 'solid', expected .*hull.*surface"):
        pk.Scene().add_urdf("a", CABINET, meshes="solid")
