"""The command `render`."""

import json

import numpy as np
import pytest
from PIL import Image

import pepper_kin as pk


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A gesture of the paper as trajectory, in two formats, and as run."""
    folder = tmp_path_factory.mktemp("render")
    pepper = pk.load_pepper()
    wave = pk.motion.gesture(pepper, "nod")
    pk.files.save(wave, folder / "nod.npz")
    pk.files.save(wave, folder / "nod.yaml", dt=0.02)
    pk.Twin(pepper, timestep=0.01).execute(wave).save(folder / "run.csv")
    return folder


@pytest.mark.thorough
@pytest.mark.browser
@pytest.mark.parametrize("source", ["nod.npz", "run.csv"])
def test_a_trajectory_or_a_run_becomes_a_film(run, chromium_path, folder, tmp_path, source):
    name = tmp_path / "film.mp4"
    done = run(
        "render", source, "-o", str(name), "--fps", "2", "--size", "96x64", "--view", "front", cwd=folder
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout == f"Written: {name}\n"
    import av

    with av.open(str(name)) as film:
        pictures = [frame.to_ndarray(format="rgb24") for frame in film.decode(video=0)]
    duration = pk.files.load(folder / "nod.npz").duration
    assert abs(len(pictures) - (2 * duration + 1)) <= 1.01
    assert pictures[0].shape == (64, 96, 3)


@pytest.mark.thorough
@pytest.mark.browser
def test_a_picture_of_a_time(run, chromium_path, folder, tmp_path):
    for time in ("0", "0.8"):
        arguments = ("-o", str(tmp_path / f"{time}.png"), "--size", "200x160", "--at-time", time)
        done = run("render", "nod.yaml", *arguments, cwd=folder)
        assert done.returncode == 0, done.stderr
    first, later = (np.asarray(Image.open(tmp_path / f"{time}.png")) for time in ("0", "0.8"))
    assert first.shape[:2] == (160, 200)
    assert (first != later).any()


def test_a_page_needs_no_browser_and_takes_the_scene(run, folder, tmp_path):
    pk.Scene().add_box("shelf-of-books", size=(0.2, 0.2, 0.2), position=(1, 0, 1)).save(folder / "scene.json")
    name = tmp_path / "page.html"
    done = run("render", "nod.npz", "-o", str(name), "--scene", "scene.json", "--json", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == {"written": [str(name)]}
    assert "shelf-of-books" in name.read_text(encoding="utf-8")


@pytest.mark.parametrize("source", ["nod.npz", "run.csv"])
def test_the_scene_in_the_folder_of_a_motion_is_shown(run, folder, tmp_path, source):
    pk.Scene().add_box("shelf-of-books", size=(0.2, 0.2, 0.2), position=(1, 0, 1)).save(
        tmp_path / "scene.json"
    )
    (tmp_path / source).write_bytes((folder / source).read_bytes())
    name = tmp_path / "page.html"
    for more, shown in (((), True), (("--no-scene",), False)):
        done = run("render", f"{tmp_path.name}/{source}", "-o", str(name), *more, cwd=tmp_path.parent)
        assert done.returncode == 0, done.stderr
        assert ("shelf-of-books" in name.read_text(encoding="utf-8")) is shown
    done = run("render", source, "-o", "b.html", "--no-scene", "--scene", "scene.json", cwd=tmp_path)
    assert done.returncode == 2
    assert "--scene: got scene.json, expected to be left out with --no-scene" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("nod.npz", "-o", "a.avi"), "unknown suffix '.avi'; available: .mp4, .gif, .png, .html"),
        (("none.csv", "-o", "a.mp4"), "none.csv: cannot be read"),
        (("nod.txt", "-o", "a.mp4"), "unknown suffix '.txt'"),
        (("nod.npz", "-o", "a.mp4", "--size", "big"), "--size: got 'big', expected WIDTHxHEIGHT"),
        (("nod.npz", "-o", "a.mp4", "--size", "301x200"), "even numbers"),
        (("nod.npz", "-o", "a.gif", "--fps", "0"), "fps: got 0.0"),
        (("nod.npz", "-o", "a.gif", "--view", "below"), "unknown camera view 'below'"),
    ],
)
def test_misuse_is_one_line_and_no_file(run, folder, arguments, message):
    before = sorted(folder.iterdir())
    done = run("render", *arguments, cwd=folder)
    assert done.returncode == 2
    said = [line for line in done.stderr.splitlines() if not line.endswith("...")]
    assert len(said) == 1
    assert message in said[0]
    assert sorted(folder.iterdir()) == before
