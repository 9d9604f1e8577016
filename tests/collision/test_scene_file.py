"""Scene files: they come back equal, and what is wrong with them is named with its place."""

import json

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import FileFormatError


def full_scene():
    """All kinds; the mesh file comes last, for padding would read it."""
    rng = np.random.default_rng(0)
    pepper = pk.load_pepper()
    return (
        pk.Scene()
        .add_box("table", (0.6, 1.0, 0.04), (0.55, 0.0, 0.70), (0.1, 0.2, 0.3))
        .add_sphere("ball", 0.1, (1 / 3, 0, 1))
        .add_cylinder("can", 0.03, 0.12, (0.4, 0, 0.8))
        .add_capsule("rod", 0.03, 0.12, (0.4, 0.1, 0.8), (np.pi, 0, 0))
        .add_half_space("floor", (0, 0, 1), -0.01)
        .add_half_space("slope", (1, 2, 3), -4.0)
        .add_convex_mesh("stone", rng.normal(size=(40, 3)), (3, 0, 0))
        .add_convex_mesh("die", np.stack(np.meshgrid(*3 * [[0, 0.1, 0.3]]), -1).reshape(-1, 3), (3, 1, 0))
        .add_mesh("net", rng.normal(size=(4, 3)), [[0, 1, 2], [2, 1, 3]], (4, 0, 0))
        .add_point_cloud("dust", rng.normal(size=(300, 3)), 0.01, (0, 5, 0))
        .add_point_cloud("nothing", [], 0.01)
        .attach("can", "l_gripper", pepper=pepper, q=pepper.neutral())
        .attach("ball", "torso", np.eye(4), touch_links=("Head", "Hip"))
        .allow("floor", "Tibia", "can")
        .padded(0.003)
        .add("drawing", pk.model.Mesh("/some/where.stl", (0.1, 0.1, 0.1)), color=(1, 0, 0, 0.5))
    )


def test_a_scene_comes_back_equal(tmp_path):
    path = tmp_path / "scene.json"
    scene = full_scene()
    scene.save(path)
    again = pk.Scene.load(path)
    assert again.equals(scene)
    assert tuple(again.names) == tuple(scene.names)
    first = path.read_bytes()
    again.save(path)
    assert path.read_bytes() == first


def test_the_file_is_readable_and_states_units(tmp_path):
    path = tmp_path / "scene.json"
    pk.Scene().add_box("table", (0.6, 1.0, 0.04), (0.55, 0.0, 0.70)).save(path)
    text = path.read_text(encoding="utf-8")
    assert '"size": [0.6, 1.0, 0.04]' in text
    assert '"position": [0.55, 0.0, 0.7]' in text
    assert json.loads(text)["units"].startswith("m; rpy in rad")
    assert json.loads(text)["version"] == 1


def test_files_written_by_hand_may_give_rpy_and_leave_things_out(tmp_path):
    path = tmp_path / "scene.json"
    path.write_text(
        '{"format": "pepper_kin scene", "version": 1, "objects": ['
        '{"name": "can", "kind": "cylinder", "radius": 1, "length": 2, "rpy": [0, 1.5, 0]}]}'
    )
    scene = pk.Scene().add_cylinder("can", 1, 2, (0, 0, 0), (0, 1.5, 0))
    assert pk.Scene.load(path).equals(scene)


def box(**changes):
    return {"name": "b", "kind": "box", "size": [1, 1, 1], "position": [0, 0, 0], **changes}


def content(**changes):
    return {"format": "pepper_kin scene", "version": 1, "objects": [box()], **changes}


def without(key, part):
    return {k: v for k, v in part.items() if k != key}


def test_damaged_files_are_refused_with_place_and_reason(tmp_path):
    for text, message in [
        ("", r"scene\.json:1: is not complete JSON: Expecting value"),
        ('{"format":\n "pepper_kin scene",\n', r"scene\.json:3: is not complete JSON"),
        (json.dumps(content())[:-9], r"scene\.json:1: is not complete JSON"),
        ("[1, 2]", 'is not a scene: it lacks "format": "pepper_kin scene"'),
        ('{"robot": "pepper"}', "is not a scene"),
        ("[" * 100_000, "is nested too deep"),
        ('{"a": 1, "a": 2}', "field 'a' occurs twice"),
        (json.dumps(content(version=2)), "is a scene of version 2; this library reads version 1"),
        (json.dumps(content(objects=[box(position=[0, float("nan"), 0])])), "holds NaN, expected finite"),
        (json.dumps(content(objects=[box(size=[1, float("inf"), 1])])), "holds Infinity"),
        (json.dumps(content()).replace("[1, 1, 1]", "[1, 1e999, 1]"), r"scene\.json:1: holds 1e999"),
        (json.dumps(content(objects=[box(size=[1, 0, 1])])), r"objects\[0\] \('b'\): box size: got"),
        (json.dumps(content(objects=[box(size=["a", 0, 1])])), r"objects\[0\] \('b'\): size: got"),
        (json.dumps(content(objects=[box(kind="blob")])), r"\('b'\): kind is 'blob', not one of box"),
        (json.dumps(content(objects=[box(), box()])), r"objects\[1\] \('b'\): the name is taken"),
        (json.dumps(content(objects=[without("size", box())])), r"objects\[0\] \('b'\): lacks 'size'"),
        (json.dumps(content(objects=[box(radius=1)])), r"\('b'\): has a field 'radius' that is not known"),
        (json.dumps(content(objects=[without("name", box())])), r"objects\[0\] is not an object with a name"),
        (json.dumps(content(objects={"b": box()})), "objects is dict, not a list"),
        (json.dumps(without("objects", content())), "the scene: lacks 'objects'"),
        (json.dumps(content(objects=[box(rotation=[[2, 0, 0], [0, 1, 0], [0, 0, 1]])])), "not rigid"),
        (json.dumps(content(objects=[box(rotation=np.eye(3).tolist(), rpy=[0, 0, 0])])), "both a rotation"),
        (json.dumps(content(objects=[box(color=[1, 2, 3])])), "color of 'b': got shape"),
        (json.dumps(content(allowed=[["b"]])), r"allowed\[0\] is \['b'\], not two names"),
        (json.dumps(content(allowed=[["x", "y"]])), "one must be an object of the scene"),
        (json.dumps(content(attached=[box(name="c")])), r"attached\[0\] \('c'\): lacks 'frame'"),
        (
            json.dumps(
                content(
                    objects=[
                        {"name": "m", "kind": "triangle mesh", "vertices": [[0, 0, 0]], "faces": [[0, 1, 2]]}
                    ]
                )
            ),
            r"objects\[0\] \('m'\): faces of a mesh: got vertex 1 in face 0",
        ),
        *(
            (
                json.dumps(
                    content(
                        objects=[
                            {
                                "name": "m",
                                "kind": "triangle mesh",
                                "vertices": [[0] * 3] * 3,
                                "faces": [[0, 1, wrong]],
                            }
                        ]
                    )
                ),
                r"\('m'\): faces are not rows of three whole numbers",
            )
            for wrong in (2.5, 2.0, True, "2", None, 10**30)
        ),
        (json.dumps(content(objects=[box(size=[1, True, 1])])), r"objects\[0\] \('b'\): size: got"),
        (json.dumps(content(objects=[box(position=[0, "1", 0])])), r"objects\[0\] \('b'\): position: got"),
        (json.dumps(content(version=1.0)), "is a scene of version 1.0"),
        (json.dumps(content(units="mm")), r"units: 'mm' is neither \"m\" nor \"m; rpy in rad"),
        (json.dumps(content(units=None)), "units: None is neither"),
        (json.dumps(content()).replace("[1, 1, 1]", "[1, 1, 1" + "0" * 5000 + "]"), "expected finite"),
        (json.dumps(content(objects=[box(name="\ud800")])), "half of a surrogate pair"),
        (
            json.dumps(
                content(objects=[{"name": "m", "kind": "triangle mesh", "vertices": [], "faces": []}])
            ),
            r"\('m'\): faces of a mesh: got",
        ),
        (
            json.dumps(
                content(
                    objects=[
                        {
                            "name": "m",
                            "kind": "triangle mesh",
                            "vertices": [[0, 0, 0]],
                            "faces": [[0, 1], [2]],
                        }
                    ]
                )
            ),
            r"\('m'\): faces are not rows of three whole numbers",
        ),
    ]:
        path = tmp_path / "scene.json"
        path.write_text(text)
        with pytest.raises(FileFormatError, match=message) as caught:
            pk.Scene.load(path)
        assert str(path) in str(caught.value)


def test_files_that_are_not_there_or_not_text_are_named(tmp_path):
    with pytest.raises(FileFormatError, match=r"nowhere\.json: cannot be read: No such file"):
        pk.Scene.load(tmp_path / "nowhere.json")
    (tmp_path / "picture.json").write_bytes(b"\x89PNG\xff\xfe")
    with pytest.raises(FileFormatError, match=r"picture\.json: is not text"):
        pk.Scene.load(tmp_path / "picture.json")
    with pytest.raises(FileFormatError, match="cannot be written"):
        pk.Scene().save(tmp_path / "no" / "folder.json")


def test_every_cut_of_a_file_is_refused(tmp_path):
    path = tmp_path / "scene.json"
    full_scene().remove("dust").remove("stone").save(path)
    whole = path.read_text(encoding="utf-8")
    for end in range(0, len(whole) - 3, 97):
        path.write_text(whole[:end])
        with pytest.raises(FileFormatError):
            pk.Scene.load(path)


CUBE_STL = """solid cube
facet normal 0 0 1
 outer loop
  vertex 0 0 0
  vertex 1 0 0
  vertex 0 1 0
 endloop
endfacet
endsolid
"""
CUBE_OBJ = "# a square\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1/1 2/2 3//3 4\n"


def test_mesh_files_are_read(tmp_path):
    (tmp_path / "a.stl").write_text(CUBE_STL)
    (tmp_path / "a.obj").write_text(CUBE_OBJ)
    own = next(s for s in pk.load_pepper().visual_shapes if s.link == "Head").geometry.path
    scene = pk.Scene().add_mesh("text", tmp_path / "a.stl", scale=0.1).add_mesh("obj", tmp_path / "a.obj")
    scene = scene.add_mesh("head", own).add_convex_mesh("hull", own, (1, 0, 0), scale=[1, 2, 1])
    text, square = scene.objects["text"].geometry, scene.objects["obj"].geometry
    assert np.array_equal(np.sort(text.vertices, axis=0), [[0, 0, 0], [0, 0, 0], [0.1, 0.1, 0]])
    assert np.array_equal(square.faces, [[0, 1, 2], [0, 2, 3]])
    import coal

    loaded = coal.MeshLoader().load(str(own), np.ones(3))
    loaded.computeLocalAABB()
    mesh, hull = scene.objects["head"].geometry, scene.objects["hull"].geometry
    assert len(mesh.faces) == loaded.num_tris
    np.testing.assert_allclose(mesh.vertices.max(axis=0), loaded.aabb_local.max_, atol=1e-7)
    np.testing.assert_allclose(hull.vertices.min(axis=0), loaded.aabb_local.min_ * [1, 2, 1], atol=1e-7)


def test_damaged_mesh_files_are_named(tmp_path):
    for name, text, message in [
        ("a.stl", "solid x\nvertex 1 2\n", r"a\.stl:2: a vertex is '1 2', not three finite numbers"),
        ("a.stl", "solid x\nvertex 1 2 3\n", "1 vertices do not make whole triangles"),
        ("a.stl", "solid x\nendsolid\n", "the mesh holds no triangle"),
        ("a.stl", "nothing", "not an STL file: 7 bytes do not hold the 0 triangles"),
        (
            "a.stl",
            "solid x\nvertex nan 0 0\nvertex 0 0 0\nvertex 0 1 0\n",
            "a vertex is 'nan 0 0', not three finite numbers",
        ),
        ("a.obj", "v 0 0 0\nf 1 2 3\n", r"a\.obj:2: face corner 2 names none of the 1 vertices so far"),
        ("a.obj", "v 0 0 x\n", r"a\.obj:1: a vertex is '0 0 x'"),
        ("a.obj", "v 0 0 0\nv 1 1 1\nf 1 2\n", "the mesh holds no triangle"),
        ("a.obj", "v 0 0 0\nf a b c\n", r"a\.obj:2: face corner 'a' is not a whole number"),
        ("a.obj", "", "the mesh holds no triangle"),
        ("a.dae", "<nothing/>", r"a\.dae: cannot be read as a mesh"),
    ]:
        path = tmp_path / name
        path.write_text(text)
        with pytest.raises(FileFormatError, match=message):
            pk.Scene().add_mesh("m", path)


def test_missing_mesh_files_are_named(tmp_path):
    for name in ["a.stl", "a.obj", "a.dae"]:
        with pytest.raises(
            FileFormatError, match=rf"{name}: cannot be read as a mesh: (No|there is no) such file"
        ):
            pk.Scene().add_mesh("m", tmp_path / name)
        pepper = pk.load_pepper()
        scene = pk.Scene().add("m", pk.model.Mesh(tmp_path / name))
        with pytest.raises(FileFormatError, match="there is no such file"):
            pk.collision.in_collision(pepper, pepper.neutral(), scene)
