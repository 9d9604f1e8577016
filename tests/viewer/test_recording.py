"""The page as a file: whole, self-contained, small, safe, and holding what was put in."""

import re
from html.parser import HTMLParser

import numpy as np
import pytest

from pepper_kin.exceptions import FileFormatError, InvalidValueError, UnknownNameError
from pepper_kin.model.shapes import Box, Mesh
from pepper_kin.viewer import Drawable, marker, save_motion_page
from pepper_kin.viewer.surface import capsule_surface

VOID = {"meta", "link", "input", "path"}


class Reader(HTMLParser):
    """Collects elements, checks that they close in order, and gathers what a browser would fetch."""

    def __init__(self):
        super().__init__()
        self.open, self.addresses, self.scripts, self.ids = [], [], 0, []

    def handle_starttag(self, tag, attributes):
        values = dict(attributes)
        self.addresses += [values[key] for key in ("src", "href", "srcset", "data") if key in values]
        self.ids += [values["id"]] if "id" in values else []
        self.scripts += tag == "script"
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert tag in VOID or self.open.pop() == tag


def read_elements(path):
    reader = Reader()
    reader.feed(path.read_text(encoding="utf-8"))
    reader.close()
    assert reader.open == []
    return reader


def write(machine, path, **changes):
    arguments = {
        "drawables": machine.drawables, "link_names": machine.links, "times": machine.times,
        "link_poses": machine.poses, "title": "A little machine",
    }  # fmt: skip
    return save_motion_page(path=path, **(arguments | changes))


def test_the_page_is_well_formed_and_refers_to_nothing_outside(machine, tmp_path):
    path = write(machine, tmp_path / "motion.html")
    text = path.read_text(encoding="utf-8")
    reader = read_elements(path)
    assert reader.addresses == ["data:,"]
    assert {"scrub", "play", "speed", "panel", "plots", "content"} <= set(reader.ids)
    assert len(set(reader.ids)) == len(reader.ids)
    assert "default-src 'none'" in text
    addresses = set(re.findall(r"(?:https?|wss?)://[^\s\"'`)<$]+", text))
    assert addresses <= {"http://www.w3.org/1999/xhtml"}  # a namespace inside three.js, never fetched


def test_the_page_holds_the_poses_and_the_objects(machine, tmp_path, content_of):
    content = content_of(write(machine, tmp_path / "motion.html", series={"y [m]": np.arange(5.0)}))
    motion = content["motion"]
    np.testing.assert_array_equal(motion["times"], machine.times)
    assert [link["name"] for link in motion["links"]] == list(machine.links)
    positions = motion["positions"].reshape(5, 3, 3)
    np.testing.assert_allclose(positions, machine.poses[..., :3, 3], atol=1e-7)
    np.testing.assert_array_equal(motion["series"][0]["value"], np.arange(5.0))
    kinds = [c["object"]["geometries"][0]["type"] for c in content["commands"] if c["type"] == "set_object"]
    assert kinds == ["CylinderGeometry", "BoxGeometry", "BufferGeometry", "SphereGeometry"]


def test_links_that_carry_nothing_take_no_memory(machine, tmp_path, content_of):
    bare = content_of(write(machine, tmp_path / "a.html", drawables=machine.drawables[:1]))
    assert [link["name"] for link in bare["motion"]["links"]] == ["base"]
    assert bare["motion"]["positions"].size == 5 * 3


def test_the_same_input_gives_the_same_bytes(machine, tmp_path):
    first = write(machine, tmp_path / "a.html").read_bytes()
    assert write(machine, tmp_path / "b.html").read_bytes() == first


def mesh_file(path):
    surface = capsule_surface(0.1, 0.3, segments=100, rings=25)
    record = np.zeros(len(surface.faces), dtype=[("n", "<f4", 3), ("c", "<f4", (3, 3)), ("a", "<u2")])
    record["c"] = surface.vertices[surface.faces]
    path.write_bytes(b"".ljust(80) + len(record).to_bytes(4, "little") + record.tobytes())
    return path


def test_a_mesh_is_embedded_once_and_ten_seconds_stay_small(tmp_path, content_of):
    mesh = mesh_file(tmp_path / "part.stl")
    links = [f"link{k}" for k in range(40)]
    shell = [Drawable("shell", link, Mesh(mesh, (1, 1, 1)), np.eye(4), (1, 1, 1, 1)) for link in links]
    times = np.linspace(0.0, 10.0, 2001)
    poses = np.broadcast_to(np.eye(4), (2001, 40, 4, 4)).copy()
    poses[:, :, 0, 3] = np.sin(times)[:, None]
    path = save_motion_page(shell, links, times, poses, tmp_path / "motion.html", title="Forty links")
    content = content_of(path)
    assert content["motion"]["times"].size == 401
    assert len(content["commands"]) == 80
    assert mesh.stat().st_size > 450_000
    assert path.stat().st_size < 3_000_000


def test_mirrored_meshes_are_drawn_by_their_scale(tmp_path, content_of):
    mesh = mesh_file(tmp_path / "part.stl")
    shell = Drawable("shell", "a", Mesh(mesh, (0.5, -0.5, 0.5)), np.eye(4), (1, 1, 1, 1))
    content = content_of(
        save_motion_page([shell], ["a"], [0.0], np.eye(4)[None, None], tmp_path / "m.html", title="")
    )
    np.testing.assert_array_equal(
        np.reshape(content["commands"][1]["matrix"], (4, 4)), np.diag([0.5, -0.5, 0.5, 1.0])
    )


@pytest.mark.parametrize("text", ["</script><script>alert(1)</script>", "<!--<script>", "{{content}} & \"'"])
def test_names_and_titles_cannot_break_out_of_the_page(machine, tmp_path, content_of, text):
    path = write(
        machine,
        tmp_path / "motion.html",
        title=text,
        series={text: np.zeros(5)},
        markers=[marker(text, [0, 0, 0])],
    )
    plain = read_elements(write(machine, tmp_path / "plain.html"))
    loaded = read_elements(path)
    assert (loaded.scripts, loaded.ids) == (plain.scripts, plain.ids)
    content = content_of(path)
    assert content["title"] == content["markers"][0]["name"] == content["motion"]["series"][0]["name"] == text


def test_a_failure_leaves_the_old_page_and_nothing_else(machine, tmp_path):
    path = write(machine, tmp_path / "motion.html")
    before = path.read_bytes()
    broken = Drawable("x", "base", Mesh(tmp_path / "nowhere.stl"), np.eye(4), (1, 1, 1, 1))
    with pytest.raises(FileFormatError, match=r"nowhere\.stl"):
        write(machine, path, drawables=[broken])
    with pytest.raises(InvalidValueError, match="link_poses: got nan"):
        write(machine, path, link_poses=np.full((5, 3, 4, 4), np.nan))
    assert path.read_bytes() == before
    assert [item.name for item in tmp_path.iterdir()] == ["motion.html"]


def test_a_write_that_breaks_off_leaves_nothing(machine, tmp_path, monkeypatch):
    def disk_full(_handle):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", disk_full)
    with pytest.raises(FileFormatError, match="cannot be written: No space left"):
        write(machine, tmp_path / "motion.html")
    assert list(tmp_path.iterdir()) == []


def test_bad_arguments_are_refused_by_name(machine, tmp_path):
    stray = Drawable("box", "tail", Box((1, 1, 1)), np.eye(4), (1, 1, 1, 1))
    with pytest.raises(UnknownNameError, match="unknown link 'tail'; available: base, slide, arm"):
        write(machine, tmp_path / "a.html", drawables=[stray])
    with pytest.raises(InvalidValueError, match="link_names: got a name twice"):
        write(machine, tmp_path / "a.html", link_names=("base", "slide", "slide"), drawables=[])
    with pytest.raises(FileFormatError, match=r"missing.*a\.html: cannot be written: No such file"):
        write(machine, tmp_path / "missing" / "a.html")
    with pytest.raises(FileFormatError, match="cannot be written: it is a folder"):
        write(machine, tmp_path)
    assert list(tmp_path.iterdir()) == []
