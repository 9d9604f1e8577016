"""Meshes of formats that need a process of their own: read right, and never at the caller's cost."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from pepper_kin.collision import mesh_process
from pepper_kin.collision.mesh_file import read_mesh
from pepper_kin.exceptions import FileFormatError

# A tetrahedron of 1, 2 and 3 units along x, y and z; all normals point outward.
POINTS = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 3.0]])
FACES = ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))
VOLUME = 1.0


def collada(
    nodes: str, *, unit: str = "", library: str = "", color: str = "1 0 0 1", effect: str = "paint"
) -> str:
    """Return a COLLADA document with the tetrahedron `#shape` of one material."""
    return f"""<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><created>2020-01-01T00:00:00</created><modified>2020-01-01T00:00:00</modified>{unit}
<up_axis>Y_UP</up_axis></asset>
<library_effects><effect id="paint"><profile_COMMON><technique sid="common"><lambert>
<diffuse><color>{color}</color></diffuse></lambert></technique></profile_COMMON></effect></library_effects>
<library_materials><material id="red"><instance_effect url="#{effect}"/></material></library_materials>
<library_geometries><geometry id="shape"><mesh>
<source id="p"><float_array id="pa" count="12">{" ".join(map(str, POINTS.ravel()))}</float_array>
<technique_common><accessor source="#pa" count="4" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="4" material="m"><input semantic="VERTEX" source="#v" offset="0"/>
<p>{" ".join(str(k) for face in FACES for k in face)}</p></triangles></mesh></geometry></library_geometries>
{library}
<library_visual_scenes><visual_scene id="s">{nodes}</visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


SHAPE = (
    '<instance_geometry url="#shape"><bind_material><technique_common>'
    '<instance_material symbol="m" target="#red"/></technique_common></bind_material></instance_geometry>'
)


def volume(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> float:
    """Return the volume inside a closed surface whose normals point outward, by the divergence theorem."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


def written(folder: Path, text: str, name: str = "mesh.dae") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def test_collada_has_its_unit_its_transforms_and_its_colors(tmp_path: Path) -> None:
    moved = f"<node><translate>10 20 30</translate><rotate>0 0 1 90</rotate>{SHAPE}</node>"
    path = written(tmp_path, collada(moved, unit='<unit meter="0.01" name="cm"/>'))
    vertices, faces, colors = mesh_process.mesh_of_other_format(path)
    turned = POINTS @ np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(vertices, 0.01 * (turned + np.array([10.0, 20.0, 30.0])), atol=1e-9)
    np.testing.assert_array_equal(colors, [[255, 0, 0, 255]] * len(faces))
    assert volume(vertices, faces) == pytest.approx(1e-6 * VOLUME, rel=1e-6)


def test_the_up_axis_is_left_as_ros_leaves_it(tmp_path: Path) -> None:
    vertices, _ = read_mesh(written(tmp_path, collada(f"<node>{SHAPE}</node>")))
    np.testing.assert_allclose(vertices.max(axis=0), [1.0, 2.0, 3.0])


def test_a_mirrored_part_keeps_its_outside(tmp_path: Path) -> None:
    mirrored = f"<node>{SHAPE}</node><node><scale>-2 1 1</scale>{SHAPE}</node>"
    vertices, faces = read_mesh(written(tmp_path, collada(mirrored)))
    assert len(faces) == 8
    assert volume(vertices, faces) == pytest.approx(3.0 * VOLUME)


def test_broken_materials_do_not_cost_the_shape(tmp_path: Path) -> None:
    path = written(tmp_path, collada(f"<node>{SHAPE}</node>", effect="lost"))
    vertices, faces, colors = mesh_process.mesh_of_other_format(path)
    assert volume(vertices, faces) == pytest.approx(VOLUME)
    assert not len(colors)


def test_other_formats_are_read(tmp_path: Path) -> None:
    lines = ["ply", "format ascii 1.0", "element vertex 4", *(f"property float {x}" for x in "xyz")]
    lines += ["element face 4", "property list uchar int vertex_indices", "end_header"]
    lines += [" ".join(map(str, point)) for point in POINTS] + [f"3 {a} {b} {c}" for a, b, c in FACES]
    vertices, faces = read_mesh(written(tmp_path, "\n".join(lines) + "\n", "mesh.ply"), scale=2.0)
    assert volume(vertices, faces) == pytest.approx(8.0 * VOLUME)


def doubled(levels: int) -> str:
    """Return nodes of which each names the next one twice: 2**levels copies of the shape."""
    nodes = [f'<node id="n{levels}">{SHAPE}</node>']
    for k in reversed(range(levels)):
        nodes.append(f'<node id="n{k}">' + 2 * f'<instance_node url="#n{k + 1}"/>' + "</node>")
    return f"<library_nodes>{''.join(nodes)}</library_nodes>"


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["node of itself", "exponential copies", "half a file", "no mesh"])
def test_a_bad_file_is_refused_by_name_and_the_next_is_read(
    tmp_path: Path, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    good = written(tmp_path, collada(f"<node>{SHAPE}</node>"), "good.dae")
    read_mesh(good)  # the process has started
    monkeypatch.setattr(mesh_process, "SECONDS", 2.0)
    itself = '<library_nodes><node id="a"><instance_node url="#a"/></node></library_nodes>'
    text = {
        "node of itself": collada('<node><instance_node url="#a"/></node>', library=itself),
        "exponential copies": collada('<node><instance_node url="#n0"/></node>', library=doubled(40)),
        "half a file": collada(f"<node>{SHAPE}</node>")[:900],
        "no mesh": collada("<node/>"),
    }[kind]
    bad = written(tmp_path, text, "bad.dae")
    with pytest.raises(FileFormatError, match=r"bad\.dae") as caught:
        read_mesh(bad)
    assert "mesh" in caught.value.reason
    assert len(caught.value.reason) < 300
    assert len(read_mesh(good)[1]) == 4


@pytest.mark.thorough
def test_memory_is_limited(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = collada('<node><instance_node url="#n0"/></node>', library=doubled(18))
    bad = written(tmp_path, text, "bad.dae")
    monkeypatch.setattr(mesh_process, "SECONDS", 60.0)
    monkeypatch.setattr(mesh_process, "MEMORY", 340_000_000)
    with pytest.raises(FileFormatError, match=r"too much memory|process that read it ended"):
        read_mesh(bad)


def test_a_process_that_was_killed_is_replaced(tmp_path: Path) -> None:
    good = written(tmp_path, collada(f"<node>{SHAPE}</node>"))
    read_mesh(good)
    first = mesh_process._process
    assert first is not None
    os.kill(first.pid, signal.SIGKILL)
    first.wait()
    assert len(read_mesh(good)[1]) == 4


@pytest.mark.thorough
def test_after_a_fork_both_sides_read(tmp_path: Path) -> None:
    good = written(tmp_path, collada(f"<node>{SHAPE}</node>"))
    script = f"""
import os
from pepper_kin.collision.mesh_file import read_mesh
from pepper_kin.exceptions import FileFormatError
read_mesh({str(good)!r})
child = os.fork()
for _ in range(20):
    assert len(read_mesh({str(good)!r})[1]) == 4
if child:
    assert os.waitpid(child, 0)[1] == 0
"""
    done = subprocess.run([sys.executable, "-W", "ignore", "-c", script], capture_output=True, timeout=120)
    assert done.returncode == 0, done.stderr.decode()[-500:]
