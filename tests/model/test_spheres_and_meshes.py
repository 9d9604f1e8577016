import json
from pathlib import Path

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import FileFormatError
from pepper_kin.urdf.visuals.stl import FACET


def vertices_of(shape):
    """Corners of a visual mesh in its link's frame."""
    corners = np.fromfile(shape.geometry.path, FACET, offset=84)["corners"].astype(float).reshape(-1, 3)
    pose = shape.transform_shape_to_link
    return corners @ pose[:3, :3].T + pose[:3, 3]


def outside_spheres(points, spheres):
    gaps = [
        np.linalg.norm(points - s.transform_shape_to_link[:3, 3], axis=1) - s.geometry.radius for s in spheres
    ]
    return np.min(gaps, axis=0)


def outside_shape(points, shape):
    local = (points - shape.transform_shape_to_link[:3, 3]) @ shape.transform_shape_to_link[:3, :3]
    g = shape.geometry
    if isinstance(g, pk.model.Box):
        return np.max(np.abs(local) - np.array(g.size) / 2, axis=1)
    if isinstance(g, pk.model.Sphere):
        return np.linalg.norm(local, axis=1) - g.radius
    along = np.clip(local[:, 2], -g.length / 2, g.length / 2)
    return np.linalg.norm(local - along[:, None] * [0, 0, 1], axis=1) - g.radius


WRISTS = {f"{side}{finger}_link": f"{side.lower()}_wrist" for side in "LR" for finger in (
    *(f"Finger{i}{j}" for i in range(1, 5) for j in range(1, 4)), "Thumb1", "Thumb2")}  # fmt: skip


DRUM = "hip_drum"
"""A part of the hip that turns inside the pelvis: the shapes of both stand for it."""


def visuals_by_body(pepper):
    """Vertices of our visual meshes by the link of their collision shapes; fingers count to the wrist."""
    q = pepper.neutral()
    bodies = {}
    for shape in pepper.visual_shapes:
        if shape.name == DRUM:
            continue
        body = WRISTS.get(shape.link, shape.link)
        points = vertices_of(shape)
        if body != shape.link:
            there, here = (pk.kinematics.frame_pose(pepper, q, x) for x in (shape.link, body))
            move = np.linalg.inv(here) @ there
            points = points @ move[:3, :3].T + move[:3, 3]
        bodies.setdefault(body, []).append(points)
    return {body: np.concatenate(parts) for body, parts in bodies.items()}


@pytest.mark.parametrize("kind", ["spheres", "shapes"])
def test_collision_sets_contain_the_visual_meshes(kind):
    """To what the measured surface sticks out itself (at most 6.7 mm), and our lofts beyond it (3 mm)."""
    pepper = pk.load_pepper()
    for body, points in visuals_by_body(pepper).items():
        own = pepper.collision_spheres if kind == "spheres" else pepper.collision_shapes
        gaps = np.min([outside_shape(points, s) for s in own if s.link == body], axis=0)
        assert gaps.max() < 0.0097, (body, gaps.max())


def test_the_drum_of_the_hip_is_inside_hip_and_pelvis():
    pepper = pk.load_pepper()
    drum = next(s for s in pepper.visual_shapes if s.name == DRUM)
    for pitch in (-1.0, 0.0, 1.0):
        q = pepper.joint_vector({"HipPitch": pitch})
        hip, pelvis = (pk.kinematics.frame_pose(pepper, q, link) for link in ("Hip", "Pelvis"))
        move = np.linalg.inv(pelvis) @ hip
        points = vertices_of(drum) @ move[:3, :3].T + move[:3, 3]
        gaps = [outside_shape(points, s) for s in pepper.collision_shapes if s.link == "Pelvis"]
        gaps += [outside_shape(vertices_of(drum), s) for s in pepper.collision_shapes if s.link == "Hip"]
        assert np.min(gaps, axis=0).max() < 0.0097


def test_there_are_at_most_64_spheres_and_all_bodies_have_some():
    for hands in ("locked", "mimic", "independent"):
        pepper = pk.load_pepper(hands=hands)
        assert len(pepper.collision_spheres) <= 64
        assert {s.link for s in pepper.collision_spheres} == {
            s.link for s in pepper.collision_shapes if s.link not in WRISTS
        }


def test_moving_fingers_stay_inside_their_sphere():
    pepper = pk.load_pepper(hands="mimic")
    sphere = pepper.collision_spheres
    for opening in np.linspace(0.02, 0.98, 9):
        q = pepper.joint_vector({"LHand": opening, "RHand": opening})
        for finger, wrist in WRISTS.items():
            tip = pk.kinematics.frame_pose(pepper, q, finger)[:3, 3]
            here = np.linalg.inv(pk.kinematics.frame_pose(pepper, q, wrist))
            local = here[:3, :3] @ tip + here[:3, 3]
            assert outside_spheres(local[None], [s for s in sphere if s.link == wrist])[0] < 0


def test_vendor_meshes_replace_the_visual_meshes_of_their_links(tmp_path):
    own = next(s for s in pk.load_pepper().visual_shapes if s.link == "Head").geometry.path
    folder = tmp_path / "vendor" / "meshes"
    folder.mkdir(parents=True)
    (folder / "HEAD.stl").write_bytes(Path(own).read_bytes())
    (folder / "torso.STL").write_bytes(Path(own).read_bytes())
    pepper = pk.load_pepper(meshes=tmp_path, mesh_scale=0.1)
    heads = [s for s in pepper.visual_shapes if s.link == "Head"]
    assert [s.geometry.scale for s in heads] == [(0.1, 0.1, 0.1)]
    assert heads[0].geometry.path == (folder / "HEAD.stl").resolve()
    torso = next(s for s in pepper.visual_shapes if s.link == "torso")
    assert torso.transform_shape_to_link[2, 3] == 0.139
    assert any(s.link == "Pelvis" and s.geometry.scale == (1, 1, 1) for s in pepper.visual_shapes)


def test_folders_without_meshes_are_refused(tmp_path):
    with pytest.raises(FileFormatError, match="is not a folder"):
        pk.load_pepper(meshes=tmp_path / "nowhere")
    with pytest.raises(FileFormatError, match=r"holds no mesh named after a link, such as Head\.stl"):
        pk.load_pepper(meshes=tmp_path)


def test_xacro_takes_name_and_prefix():
    urdf = pk.model.pepper_urdf(name="salt", prefix="left_", hands="mimic", base="planar")
    robot = pk.load_robot(urdf)
    assert robot.name == "salt"
    assert robot.n == 20
    assert all(name.startswith("left_") for name in (*robot.joint_names, *robot.link_names))


def test_all_published_sensor_frames_are_there():
    names = json.loads((Path(__file__).parents[1] / "data" / "sensor_frames.json").read_text())
    pepper = pk.load_pepper()
    assert len(names) == 33
    for name, position in names.items():
        pose = pk.kinematics.frame_pose(pepper, np.zeros(15), name)
        # The list is of the newest URDF; the two cameras are where NAOqi on a robot has them.
        near = 1e-3 if name.startswith(("CameraTop", "CameraBottom")) else 2e-5
        np.testing.assert_allclose(pose[:3, 3], position, atol=near)
