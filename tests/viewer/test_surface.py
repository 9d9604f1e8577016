"""Surfaces: closed forms of capsules, shading of cubes and balls, refusal of broken files."""

import numpy as np
import pytest

from pepper_kin.collision.mesh_file import unique_rows
from pepper_kin.exceptions import FileFormatError
from pepper_kin.viewer.surface import capsule_surface, read_surface, split_at_creases

CUBE_CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
CUBE_FACES = np.array(
    [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]
)  # fmt: skip


def volume(vertices, faces):
    """Volume by the divergence theorem: sum of signed tetrahedra from the origin."""
    a, b, c = (vertices.astype(float)[faces[:, k]] for k in range(3))
    return np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6


COLLADA = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><created>2020-01-01</created><modified>2020-01-01</modified><unit name="cm" meter="0.01"/>
<up_axis>Y_UP</up_axis></asset>
<library_geometries><geometry id="cube"><mesh>
<source id="places"><float_array id="numbers" count="24">{positions}</float_array><technique_common>
<accessor source="#numbers" count="8" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
<param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="corners"><input semantic="POSITION" source="#places"/></vertices>
<triangles count="12"><input semantic="VERTEX" source="#corners" offset="0"/><p>{faces}</p></triangles>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="scene"><node id="node"><instance_geometry url="#cube"/></node>
</visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#scene"/></scene></COLLADA>
"""


def stl_bytes(triangles):
    record = np.zeros(
        len(triangles), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")]
    )
    record["corners"] = triangles
    return b"made by a test".ljust(80) + len(triangles).to_bytes(4, "little") + record.tobytes()


def test_capsule_vertices_lie_at_the_radius_from_the_segment():
    surface = capsule_surface(0.07, 0.3)
    points = surface.vertices.astype(float)
    nearest = np.zeros_like(points)
    nearest[:, 2] = np.clip(points[:, 2], -0.15, 0.15)
    np.testing.assert_allclose(np.linalg.norm(points - nearest, axis=1), 0.07, atol=1e-7)


@pytest.mark.parametrize(("radius", "length"), [(0.05, 0.3), (0.2, 0.01)])
def test_capsule_encloses_the_volume_of_the_closed_form(radius, length):
    surface = capsule_surface(radius, length, segments=96, rings=48)
    exact = np.pi * radius**2 * length + 4 / 3 * np.pi * radius**3
    inside = volume(surface.vertices, surface.faces)
    assert 0.995 * exact < inside < exact


def test_capsule_is_closed():
    faces = capsule_surface(0.1, 0.2).faces.astype(int)
    edges = [(face[k], face[(k + 1) % 3]) for face in faces for k in range(3)]
    assert len(set(edges)) == len(edges)
    assert {(b, a) for a, b in edges} == set(edges)


def test_a_cube_keeps_its_sharp_edges():
    surface = split_at_creases(CUBE_CORNERS, CUBE_FACES, np.deg2rad(35))
    assert len(surface.vertices) == 24  # four corners for each of six sides
    np.testing.assert_array_equal(surface.vertices[surface.faces], CUBE_CORNERS[CUBE_FACES])


def test_a_round_body_shares_all_its_vertices():
    ball = capsule_surface(0.1, 0.05)
    surface = split_at_creases(ball.vertices, ball.faces, np.deg2rad(35))
    assert len(surface.vertices) == len(ball.vertices)


def test_reading_keeps_every_triangle_and_joins_equal_corners(tmp_path):
    path = tmp_path / "cube.stl"
    path.write_bytes(stl_bytes(CUBE_CORNERS[CUBE_FACES]))
    surface = read_surface(path)
    assert surface.faces.shape == (12, 3)
    assert len(surface.vertices) == 24
    assert volume(surface.vertices, surface.faces) == pytest.approx(1.0)


def test_a_collada_file_is_read_by_its_numbers(tmp_path):
    """Its unit is applied; its upward axis is not, as in ROS."""
    path = tmp_path / "cube.dae"
    corners = CUBE_CORNERS * [10.0, 30.0, 20.0]
    path.write_text(COLLADA.format(
        positions=" ".join(f"{x:g}" for x in corners.ravel()), faces=" ".join(map(str, CUBE_FACES.ravel())),
    ))  # fmt: skip
    surface = read_surface(path)
    assert surface.faces.shape == (12, 3)
    assert volume(surface.vertices, surface.faces) == pytest.approx(0.1 * 0.2 * 0.3)
    np.testing.assert_allclose(np.ptp(surface.vertices, axis=0), [0.1, 0.3, 0.2], rtol=1e-5)


def test_flat_triangles_are_dropped(tmp_path):
    path = tmp_path / "cube.stl"
    line = np.array([[[0, 0, 0], [1, 0, 0], [1, 0, 0]]], dtype=float)
    path.write_bytes(stl_bytes(np.concatenate([CUBE_CORNERS[CUBE_FACES], line])))
    assert read_surface(path).faces.shape == (12, 3)


def test_a_surface_is_read_only():
    surface = capsule_surface(0.1, 0.2)
    with pytest.raises(ValueError, match="read-only"):
        surface.vertices[0, 0] = 1.0


def test_a_broken_file_is_refused_with_the_reason(tmp_path):
    for data, message in [
        (b"short", "5 bytes do not hold"),
        (stl_bytes(CUBE_CORNERS[CUBE_FACES])[:-7], "677 bytes do not hold the 12 triangles announced"),
        (stl_bytes(np.full((1, 3, 3), np.nan)), "NaN or infinite"),
        (stl_bytes(np.zeros((0, 3, 3))), "holds no triangle"),
        (stl_bytes(np.ones((2, 3, 3))), "holds no triangle"),
    ]:
        path = tmp_path / "broken.stl"
        path.write_bytes(data)
        with pytest.raises(FileFormatError, match=message) as caught:
            read_surface(path)
        assert caught.value.path == str(path)


def test_a_missing_file_is_refused_by_name(tmp_path):
    with pytest.raises(FileFormatError, match=r"nowhere\.stl: cannot be read as a mesh"):
        read_surface(tmp_path / "nowhere.stl")


@pytest.mark.parametrize("kind", [np.float32, np.float64])
@pytest.mark.parametrize("count", [0, 1, 2000])
def test_rows_are_joined_as_numpy_joins_them(kind, count):
    grid = np.random.default_rng(1).integers(-4, 5, (count, 3)).astype(kind) * kind(0.1)
    theirs, index = np.unique(grid, axis=0, return_inverse=True)
    ours, places = unique_rows(grid)
    np.testing.assert_array_equal(ours, theirs)
    np.testing.assert_array_equal(places, index.reshape(-1))
    assert ours.dtype == kind
