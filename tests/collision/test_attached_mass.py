"""Objects that are attached with a mass: inertia of their shapes, files, copies and refusals."""

import copy
import json
import pickle

import numpy as np
import pinocchio
import pytest
import scipy.spatial
import trimesh

import pepper_kin as pk
from pepper_kin.collision import ConvexMesh, HalfSpace, PointCloud, TriangleMesh, loads_of
from pepper_kin.collision.loads import load_parameters
from pepper_kin.dynamics.load import Load
from pepper_kin.exceptions import FileFormatError, InvalidValueError, UnknownNameError
from pepper_kin.model import Box, Capsule, Cylinder, Mesh, Sphere

PEPPER = pk.load_pepper()
POINTS = np.random.default_rng(0).normal(size=(40, 3)) * (0.02, 0.04, 0.03) + (0.01, -0.02, 0.03)


def scene_of(geometry) -> pk.Scene:
    return pk.Scene().add("thing", geometry)


def attached(geometry, mass=2.0, pose=None, **more):
    pose = np.eye(4) if pose is None else pose
    return scene_of(geometry).attach("thing", "l_gripper", pose, mass=mass, **more).attached["thing"]


def some_pose(seed: int = 1) -> np.ndarray:
    return pinocchio.exp6(pinocchio.Motion(np.random.default_rng(seed).normal(size=6) * 0.5)).homogeneous


def sampled(inside, size, count=400_000):
    """Return center and inertia per kilogram of a shape from points drawn in its bounding box."""
    points = np.random.default_rng(3).uniform(-0.5, 0.5, (count, 3)) * size
    points = np.concatenate([part[inside(part)] for part in np.array_split(points, 20)])
    center = points.mean(axis=0)
    spread = (points - center).T @ (points - center) / len(points)
    return center, np.trace(spread) * np.eye(3) - spread


def test_simple_shapes_have_the_inertia_that_pinocchio_gives_them():
    for geometry, inertia in [
        (Sphere(0.07), pinocchio.Inertia.FromSphere(2.0, 0.07)),
        (Box((0.1, 0.2, 0.3)), pinocchio.Inertia.FromBox(2.0, 0.1, 0.2, 0.3)),
        (Cylinder(0.04, 0.2), pinocchio.Inertia.FromCylinder(2.0, 0.04, 0.2)),
        (Capsule(0.04, 0.2), pinocchio.Inertia.FromCapsule(2.0, 0.04, 0.2)),
    ]:
        pose = some_pose()
        load, expected = attached(geometry, pose=pose).load, pinocchio.SE3(pose).act(inertia)
        np.testing.assert_allclose(load.center, expected.lever, atol=1e-14)
        np.testing.assert_allclose(load.tensor, expected.inertia, rtol=1e-9, atol=1e-12)
        assert load.mass == 2.0


def test_a_capsule_has_the_inertia_of_points_drawn_inside():
    radius, length = 0.04, 0.1

    def inside(x):
        along = np.clip(x[:, 2], -length / 2, length / 2)
        return np.hypot(np.hypot(x[:, 0], x[:, 1]), x[:, 2] - along) <= radius

    _, inertia = sampled(inside, (2 * radius, 2 * radius, length + 2 * radius))
    np.testing.assert_allclose(attached(Capsule(radius, length), 1.0).load.tensor, inertia, atol=3e-6)


def test_a_mesh_has_the_inertia_of_what_it_encloses():
    hull = scipy.spatial.ConvexHull(POINTS)
    low, high = POINTS.min(axis=0), POINTS.max(axis=0)

    def inside(x):
        places = x + (low + high) / 2
        return (places @ hull.equations[:, :3].T + hull.equations[:, 3] <= 0).all(axis=1)

    center, expected = sampled(inside, high - low)
    center += (low + high) / 2
    mesh = ConvexMesh(POINTS)
    for geometry in (
        mesh,
        TriangleMesh(mesh.vertices, mesh.faces),
        TriangleMesh(mesh.vertices, mesh.faces[:, ::-1]),  # seen from inside
        TriangleMesh(mesh.vertices, mesh.faces[1:]),  # open: its convex hull
    ):
        load = attached(geometry, 1.0).load
        np.testing.assert_allclose(load.center, center, atol=3e-4)
        np.testing.assert_allclose(load.tensor, expected, atol=5e-3 * np.trace(expected))


def test_a_closed_surface_that_is_not_convex_counts_as_it_is(tmp_path):
    ell = trimesh.util.concatenate(
        [
            trimesh.creation.box((0.2, 0.1, 0.1)),
            trimesh.creation.box((0.1, 0.1, 0.2)).apply_translation((0.05, 0.0, 0.15)),
        ]
    )
    ell.export(tmp_path / "ell.stl")
    parts = [
        pinocchio.Inertia.FromBox(0.5, 0.2, 0.1, 0.1),
        pinocchio.SE3(np.eye(3), np.array([0.05, 0.0, 0.15])).act(
            pinocchio.Inertia.FromBox(0.5, 0.1, 0.1, 0.2)
        ),
    ]
    expected = parts[0] + parts[1]
    for geometry in (TriangleMesh(ell.vertices, ell.faces), Mesh(tmp_path / "ell.stl", (1.0, 1.0, 1.0))):
        load = attached(geometry, 1.0).load
        np.testing.assert_allclose(load.center, expected.lever, atol=1e-7)
        np.testing.assert_allclose(load.tensor, expected.inertia, atol=1e-8)


def test_a_cloud_is_balls_around_its_points():
    parts = [
        pinocchio.SE3(np.eye(3), point).act(pinocchio.Inertia.FromSphere(1.0 / len(POINTS), 0.01))
        for point in POINTS
    ]
    expected = parts[0]
    for part in parts[1:]:
        expected = expected + part
    load = attached(PointCloud(POINTS, 0.01), 1.0).load
    np.testing.assert_allclose(load.center, expected.lever, atol=1e-14)
    np.testing.assert_allclose(load.tensor, expected.inertia, atol=1e-14)


def test_a_center_of_mass_that_is_given_moves_the_inertia_there():
    pose, center = some_pose(), (0.01, 0.02, -0.03)
    load = attached(Box((0.1, 0.2, 0.3)), pose=pose, center_of_mass=center).load
    np.testing.assert_allclose(load.center, pose[:3, :3] @ center + pose[:3, 3], atol=1e-14)
    np.testing.assert_allclose(load.tensor, attached(Box((0.1, 0.2, 0.3)), pose=pose).load.tensor)


def test_what_is_no_mass_is_refused_by_name():
    for mass in [-1.0, float("nan"), float("inf"), True, "1", None, [1.0]]:
        with pytest.raises(InvalidValueError, match="mass of 'thing'"):
            attached(Sphere(0.1), mass)


def test_what_is_no_center_of_mass_is_refused_by_name():
    for center in [(0.0, 0.0), (0.0, np.nan, 0.0), (1e9, 0.0, 0.0)]:
        with pytest.raises(InvalidValueError, match="center_of_mass of 'thing'"):
            attached(Sphere(0.1), 1.0, center_of_mass=center)


def test_a_shape_without_a_volume_takes_no_mass():
    for geometry in [
        TriangleMesh([[0, 0, 0], [1, 0, 0], [0, 1, 0.0]], [[0, 1, 2]]),
        PointCloud(np.empty((0, 3)), 0.01),
        HalfSpace(),
    ]:
        with pytest.raises(InvalidValueError, match="geometry of 'thing'"):
            attached(geometry)


def test_without_a_mass_nothing_counts():
    scene = scene_of(Sphere(0.1)).attach("thing", "l_gripper", np.eye(4))
    assert scene.attached["thing"].load is None
    assert loads_of(PEPPER, scene) == ()
    assert loads_of(PEPPER, scene, {"left": 0.3}) == (Load("LArm_effector", 0.3),)


def test_a_payload_and_what_is_attached_add_up():
    scene = scene_of(Sphere(0.1)).attach("thing", "l_gripper", np.eye(4), mass=0.2)
    loads = loads_of(PEPPER, scene, {"left": 0.3, "right": 0.1})
    assert [(load.frame, load.mass) for load in loads] == [
        ("LArm_effector", 0.3), ("RArm_effector", 0.1), ("l_gripper", 0.2),
    ]  # fmt: skip
    found = load_parameters(PEPPER, loads)
    assert found.frames == ("LArm_effector", "RArm_effector")  # one body, one set of parameters
    np.testing.assert_allclose(found.values[:, 0], [0.5, 0.1])
    with pytest.raises(UnknownNameError, match="tail"):
        loads_of(PEPPER, scene_of(Sphere(0.1)).attach("thing", "tail", np.eye(4), mass=0.2))
    with pytest.raises(InvalidValueError, match="scene"):
        loads_of(PEPPER, {"left": 0.3})


def test_parameters_are_those_of_pinocchio_about_the_effector():
    scene = scene_of(Box((0.1, 0.2, 0.3))).attach("thing", "l_gripper", some_pose(), mass=0.7)
    frames, values = load_parameters(PEPPER, loads_of(PEPPER, scene))
    model = PEPPER.inner_model
    placed = [model.frames[PEPPER.frame_id(name)].placement for name in ("LArm_effector", "l_gripper")]
    body = (placed[0].actInv(placed[1]) * pinocchio.SE3(some_pose())).act(
        pinocchio.Inertia.FromBox(0.7, 0.1, 0.2, 0.3)
    )
    pseudo = body.toPseudoInertia()
    assert frames == ("LArm_effector",)
    np.testing.assert_allclose(values[0, :4], [body.mass, *(body.mass * body.lever)], atol=1e-14)
    np.testing.assert_allclose(values[0, 4:], pseudo.sigma[np.triu_indices(3)], atol=1e-14)


def test_files_copies_and_words_keep_the_mass(tmp_path):
    scene = scene_of(Box((0.1, 0.2, 0.3))).attach(
        "thing", "l_gripper", some_pose(), mass=0.3, center_of_mass=(0.01, 0.0, 0.0)
    )
    scene.save(tmp_path / "scene.json")
    for other in (
        pk.Scene.load(tmp_path / "scene.json"),
        pickle.loads(pickle.dumps(scene)),
        copy.deepcopy(scene),
    ):
        assert other.equals(scene)
        assert other.attached["thing"].load == scene.attached["thing"].load
    assert repr(scene) == "Scene(thing on l_gripper, 0.3 kg)"
    lighter = scene_of(Box((0.1, 0.2, 0.3))).attach("thing", "l_gripper", some_pose())
    assert not lighter.equals(scene)
    released = scene.release(PEPPER, "thing", PEPPER.posture("Stand"))
    assert loads_of(PEPPER, released) == ()
    assert scene.padded(0.01).attached["thing"].load == scene.attached["thing"].load
    assert loads_of(PEPPER, scene.remove("thing")) == ()


def test_a_file_with_another_mass_is_refused(tmp_path):
    for field, value in [
        ("mass", -1),
        ("mass", "heavy"),
        ("mass", None),
        ("mass", True),
        ("center_of_mass", [0, 1]),
        ("weight", 1),
    ]:
        path = tmp_path / "scene.json"
        scene_of(Box((0.1, 0.2, 0.3))).attach("thing", "l_gripper", np.eye(4), mass=0.3).save(path)
        content = json.loads(path.read_text())
        content["attached"][0][field] = value
        path.write_text(json.dumps(content))
        with pytest.raises(FileFormatError, match=f"scene.json.*thing.*{field}"):
            pk.Scene.load(path)
