"""The generated meshes: sound, in place, small, reproducible, and accepted by other programs."""

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import mujoco
import numpy as np
import pytest
import xacro

from pepper_kin.urdf.visuals.build import MACROS_FILE, MESH_FOLDER, files, visuals
from pepper_kin.urdf.visuals.measurements import features, link_shape
from pepper_kin.urdf.visuals.part import MATERIALS
from pepper_kin.urdf.visuals.stl import FACET

BUDGET_BYTES = 2_500_000
OUTSIDE, SHORT = 0.003, 0.005  # [m] beyond the measured box, and away from its faces
MESHES = sorted(MESH_FOLDER.glob("*.stl"))
LEFT = [path for path in MESHES if path.name.startswith("left_")]
SINGLE_LINKS = {
    *("Tibia", "Pelvis", "Hip", "torso", "Neck", "Head", "phalanx", "fingertip"),
    *("LShoulder", "LBicep", "LElbow", "LForeArm", "l_wrist"),
    *("RShoulder", "RBicep", "RElbow", "RForeArm", "r_wrist"),
    *("WheelFL_link", "WheelFR_link", "WheelB_link"),
}


def _corners(path: Path) -> np.ndarray:
    return np.fromfile(path, FACET, offset=84)["corners"].astype(float)


def _signed_volume(corners: np.ndarray) -> float:
    return float(np.linalg.det(corners).sum() / 6.0)


def _sorted_facets(corners: np.ndarray) -> np.ndarray:
    """Facets in an order that does not depend on where they stand in the file or which corner is first."""
    turned = np.stack([np.roll(corners, -k, axis=1) for k in range(3)], axis=1).reshape(len(corners), 3, 9)
    first = np.array([min(range(3), key=lambda k: tuple(facet[k])) for facet in turned])
    rows = turned[np.arange(len(corners)), first]
    return rows[np.lexsort(rows.T)]


@pytest.fixture(scope="module")
def links() -> dict:
    return visuals()


def test_every_link_has_a_look(links: dict) -> None:
    assert set(links) == SINGLE_LINKS
    assert all(parts for parts in links.values())


def test_mesh_is_closed_and_consistently_turned() -> None:
    for path in MESHES:
        corners = _corners(path)
        points, index = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
        faces = index.reshape(-1, 3)
        assert len(points) >= 4
        assert len(faces) < 200_000
        edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
        forward = edges[:, 0] * len(points) + edges[:, 1]
        backward = edges[:, 1] * len(points) + edges[:, 0]
        # Every directed edge once, and its reverse once: two faces per edge, all turned the same way.
        assert len(np.unique(forward)) == len(forward)
        assert np.array_equal(np.sort(forward), np.sort(backward))


def test_mesh_faces_outward_without_slivers() -> None:
    for path in MESHES:
        corners = _corners(path)
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        assert np.linalg.norm(normals, axis=1).min() > 1e-10  # twice the area [m^2]
        # A closed surface has no net area vector, and a positive volume when it is turned outward.
        assert np.linalg.norm(normals.sum(axis=0)) < 1e-6 * np.linalg.norm(normals, axis=1).sum()
        assert _signed_volume(corners) > 0.0


def test_stored_normals_are_those_of_the_facets() -> None:
    for path in MESHES:
        corners = _corners(path)
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        raw = np.frombuffer(path.read_bytes(), dtype=np.uint8)[84:].reshape(-1, 50)
        stored = np.frombuffer(raw[:, :12].tobytes(), dtype="<f4").reshape(-1, 3)
        # Corners are stored in 32 bits, so tiny facets turn a little.
        assert np.einsum("ij,ij->i", stored, normals).min() > 0.999


def test_every_piece_of_a_mesh_faces_outward(links: dict) -> None:
    for parts in links.values():
        for part in parts:
            faces = part.mesh.faces
            label = np.arange(len(part.mesh.vertices))
            while True:  # spread the lowest label over every connected piece
                lowest = label[faces].min(axis=1)
                spread = label.copy()
                np.minimum.at(spread, faces.ravel(), np.repeat(lowest, 3))
                if np.array_equal(spread, label):
                    break
                label = spread
            for mesh_part in np.unique(label):
                corners = part.mesh.corners[label[faces[:, 0]] == mesh_part]
                assert _signed_volume(corners) > 0.0, f"{part.name}: piece {part} is inside out"


def test_meshes_fill_the_measured_box(links: dict) -> None:
    for name, parts in links.items():
        known = "wheel" if name.startswith("Wheel") else name
        mirror = known not in features()["links"]
        box = link_shape(known.replace("R", "L", 1).replace("r_", "l_", 1) if mirror else known).bounds.copy()
        if mirror:
            box[:, 1] = -box[::-1, 1]
        low = np.min([part.mesh.bounds[0] for part in parts], axis=0)
        high = np.max([part.mesh.bounds[1] for part in parts], axis=0)
        assert np.all(box[0] - low < OUTSIDE), f"{name} reaches {box[0] - low} m below its box"
        assert np.all(high - box[1] < OUTSIDE), f"{name} reaches {high - box[1]} m above its box"
        assert np.all(low - box[0] < SHORT), f"{name} ends {low - box[0]} m above the bottom of its box"
        assert np.all(box[1] - high < SHORT), f"{name} ends {box[1] - high} m below the top of its box"


def test_skirt_follows_the_measured_footprint() -> None:
    hull = np.array(features()["footprint_hull_xy"])
    points = _corners(MESH_FOLDER / "tibia_shell.stl").reshape(-1, 3)[:, :2]
    for direction in np.linspace(0.0, 2.0 * np.pi, 90, endpoint=False):
        along = np.array([np.cos(direction), np.sin(direction)])
        # Support functions of two convex sets differ by at most their Hausdorff distance.
        assert abs((hull @ along).max() - (points @ along).max()) < 0.007


def test_eyes_sit_where_they_were_measured() -> None:
    _, y, z = features()["head"]["eyes"]["center_left"]
    points = _corners(MESH_FOLDER / "head_eyes.stl").reshape(-1, 3)
    for side in (1.0, -1.0):
        eye = points[side * points[:, 1] > 0.0]
        middle = 0.5 * (eye.min(axis=0) + eye.max(axis=0))
        assert np.allclose(middle[1:], [side * y, z], atol=0.001)
        front = eye[np.hypot(eye[:, 1] - side * y, eye[:, 2] - z) < 0.003, 0].max()
        low, high = 0.0776 - 0.005, 0.0819 + 0.005  # measured extent in x, and how far a decal may stand off
        assert low < front < high


@pytest.mark.parametrize("path", LEFT, ids=lambda path: path.stem)
def test_right_mesh_mirrors_left_mesh(path: Path) -> None:
    right = _corners(path.with_name(path.name.replace("left_", "right_")))
    mirrored = (_corners(path) * [1.0, -1.0, 1.0])[:, ::-1] + 0.0
    assert np.array_equal(_sorted_facets(mirrored), _sorted_facets(right + 0.0))


def test_there_are_mirrored_pairs_and_no_orphans() -> None:
    assert len(LEFT) >= 3
    assert len([path for path in MESHES if path.name.startswith("right_")]) == len(LEFT)


def test_total_size_stays_within_the_budget() -> None:
    assert sum(path.stat().st_size for path in MESHES) < BUDGET_BYTES


def test_committed_files_are_the_generated_ones() -> None:
    generated = files()
    assert {path for path in generated if path.suffix == ".stl"} == set(MESHES)
    stale = [path.name for path, content in generated.items() if path.read_bytes() != content]
    assert not stale, f"run `python -m pepper_kin.urdf.visuals`; these files differ: {stale}"


def test_mujoco_loads_every_mesh() -> None:
    assets = {path.name: path.read_bytes() for path in MESHES}
    lines = [f'<mesh name="{path.stem}" file="{path.name}"/>' for path in MESHES]
    geoms = [f'<geom type="mesh" mesh="{path.stem}"/>' for path in MESHES]
    text = f"<mujoco><asset>{''.join(lines)}</asset><worldbody>{''.join(geoms)}</worldbody></mujoco>"
    model = mujoco.MjModel.from_xml_string(text, assets)
    assert model.nmesh == len(MESHES)
    for path in MESHES:
        assert model.mesh(path.stem).facenum[0] == len(_corners(path))


def test_macros_expand_to_existing_meshes_and_materials(tmp_path: Path) -> None:
    calls = "".join(f'<link name="{name}"><xacro:visual_{name}/></link>' for name in sorted(SINGLE_LINKS))
    text = (
        '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="visuals">'
        '<xacro:property name="mesh_dir" value="package://somewhere"/>'
        f'<xacro:include filename="{MACROS_FILE}"/><xacro:visual_materials/>{calls}</robot>'
    )
    source = tmp_path / "all.xacro"
    source.write_text(text)
    robot = ElementTree.fromstring(xacro.process_file(str(source)).toxml())
    colors = {item.get("name"): item.find("color").get("rgba") for item in robot.findall("material")}
    assert {name: tuple(map(float, rgba.split())) for name, rgba in colors.items()} == MATERIALS
    used = set()
    for visual in robot.iter("visual"):
        assert visual.find("material").get("name") in colors
        address = visual.find("geometry/mesh").get("filename")
        assert address.startswith("package://somewhere/")
        used.add(MESH_FOLDER / address.removeprefix("package://somewhere/"))
    assert used == set(MESHES)
