"""Films of a motion page: as many frames as asked for, of the size asked for, the same twice, and moving."""

import io
import sys

import numpy as np
import pytest
from PIL import Image, ImageSequence

import pepper_kin as pk
from pepper_kin.exceptions import InfeasibleError, InvalidValueError, MissingDependencyError, UnknownNameError
from pepper_kin.viewer import JointMotion, save_motion_page, save_video
from pepper_kin.viewer.browser_session import BrowserSession
from pepper_kin.viewer.video import frame_times

SIZE = (160, 120)


@pytest.fixture
def page(machine, tmp_path):
    return save_motion_page(
        machine.drawables, machine.links, machine.times, machine.poses, tmp_path / "motion.html", title="x"
    )


def frames_of(path):
    """Frames of a film, shape (F, height, width, 3), and how long each is shown [s]."""
    if path.suffix == ".gif":
        with Image.open(path) as film:
            frames = [
                (np.asarray(f.convert("RGB")), f.info["duration"] / 1000)
                for f in ImageSequence.Iterator(film)
            ]
        return np.stack([f for f, _ in frames]), [shown for _, shown in frames]
    import av

    with av.open(str(path)) as film:
        stream = film.streams.video[0]
        pictures = [frame.to_ndarray(format="rgb24") for frame in film.decode(stream)]
        return np.stack(pictures), [float(1 / stream.average_rate)] * len(pictures)


def red_column(picture):
    red = picture.astype(int)
    return np.nonzero((red[..., 0] > 1.7 * red[..., 1]) & (red[..., 0] > 60))[1].mean()


@pytest.mark.thorough
@pytest.mark.browser
@pytest.mark.parametrize("suffix", [".mp4", ".gif"])
def test_a_film_has_the_frames_asked_for_and_they_move(chromium_path, page, tmp_path, suffix):
    calls = []
    path = save_video(
        page, tmp_path / f"film{suffix}", fps=5, size=SIZE, view="front",
        on_frame=lambda done, total: calls.append((done, total)),
    )  # fmt: skip
    pictures, shown = frames_of(path)
    assert pictures.shape == (11, 120, 160, 3)  # two seconds at five a second, both ends
    np.testing.assert_allclose(shown, 0.2, atol=1e-6)
    assert calls == [(k, 11) for k in range(1, 12)]
    # From the front the robot's left (+y) is on the right: the cube slides evenly from left to right.
    columns = np.array([red_column(picture) for picture in pictures])
    steps = np.diff(columns)
    assert (steps > 0).all()
    assert steps.max() < 2 * steps.mean()
    again = save_video(page, tmp_path / f"again{suffix}", fps=5, size=SIZE, view="front")
    np.testing.assert_array_equal(frames_of(again)[0], pictures)
    assert again.read_bytes() == path.read_bytes()


@pytest.mark.thorough
@pytest.mark.browser
def test_one_browser_draws_the_same_pixels_in_any_order(chromium_path, page):
    with BrowserSession(page, SIZE, view="front") as session:
        assert session.span() == (0.0, 2.0)
        pictures = {t: session.picture(t) for t in (0.0, 0.7, 2.0)}
        assert [session.picture(t) == pictures[t] for t in (2.0, 0.7, 0.0)] == [True] * 3
        assert len(set(pictures.values())) == 3
        assert Image.open(io.BytesIO(pictures[0.7])).size == SIZE


@pytest.mark.thorough
@pytest.mark.browser
def test_the_arm_of_pepper_moves_in_a_film(chromium_path, tmp_path):
    pepper = pk.load_pepper()
    raised = pepper.joint_vector({"RShoulderPitch": -1.0})
    motion = JointMotion(np.array([0.0, 1.0]), np.stack([pepper.posture("Stand"), raised]))
    path = pk.Viewer(pepper).save_video(tmp_path / "arm.mp4", motion, fps=2, size=(200, 150), view="front")
    pictures, _ = frames_of(path)
    assert pictures.shape == (3, 150, 200, 3)
    changed = np.abs(np.diff(pictures.astype(int), axis=0)).max(axis=-1) > 40
    rows, columns = np.nonzero(changed.any(axis=0))
    assert len(rows) > 100
    assert columns.max() < 110  # the right arm, on the left of the picture; the left half of Pepper stands


@pytest.mark.parametrize(
    ("end", "fps", "count"), [(0.0, 30, 1), (1.0, 30, 31), (1.01, 30, 32), (10.0, 24, 241)]
)
def test_frame_times_are_even_and_show_the_end(end, fps, count):
    times = frame_times(2.0, 2.0 + end, fps)
    assert len(times) == count
    assert times[0] == 2.0
    assert times[-1] == 2.0 + end
    np.testing.assert_allclose(np.diff(times)[:-1], 1 / fps)


@pytest.mark.parametrize(
    ("name", "changes", "error", "message"),
    [
        ("a.avi", {}, UnknownNameError, "unknown video suffix '.avi'; available: .mp4, .gif"),
        ("a.mp4", {"fps": 0.0}, InvalidValueError, "fps: got 0.0, expected frames per second above 0"),
        ("a.mp4", {"fps": float("nan")}, InvalidValueError, "fps: got nan"),
        ("a.gif", {"fps": 60.0}, InvalidValueError, "at most 50 for .gif"),
        ("a.mp4", {"size": (321, 200)}, InvalidValueError, "even numbers in 2"),
        ("a.gif", {"size": (0, 200)}, InvalidValueError, "size: got"),
        ("a.gif", {"view": "below"}, UnknownNameError, "unknown camera view 'below'"),
        ("a.gif", {"html_path": "nowhere.html"}, InvalidValueError, "html_path: got nowhere.html"),
    ],
)
def test_what_cannot_be_filmed_is_refused_at_once(page, tmp_path, name, changes, error, message):
    arguments = {"html_path": page, "video_path": tmp_path / name} | changes
    with pytest.raises(error, match=message):
        save_video(arguments.pop("html_path"), arguments.pop("video_path"), **arguments)
    assert [item.name for item in tmp_path.iterdir()] == ["motion.html"]


def test_without_pyav_the_message_says_how_to_get_it(page, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(
        MissingDependencyError, match=r'an MP4 film needs .av.*pip install "pepper_kin\[video\]"'
    ):
        save_video(page, tmp_path / "a.mp4")


def test_without_a_chromium_the_message_says_so(page, tmp_path, monkeypatch):
    monkeypatch.setattr("pepper_kin.viewer.browser_session.find_chromium", lambda: None)
    with pytest.raises(MissingDependencyError, match="apt-get install chromium"):
        save_video(page, tmp_path / "a.gif")


@pytest.mark.parametrize(
    ("script", "timeout", "message"),
    [("exit 0", 60.0, "ended with code 0"), ("exec sleep 30", 1.0, "did not answer in 1 s")],
)
def test_a_browser_that_fails_leaves_no_film(page, tmp_path, monkeypatch, script, timeout, message):
    program = tmp_path / "browser"
    program.write_text(f"#!/bin/sh\n{script}\n")
    program.chmod(0o755)
    monkeypatch.setenv("PEPPER_KIN_CHROMIUM", str(program))
    with pytest.raises(InfeasibleError, match=f"no picture: the browser {message}"):
        save_video(page, tmp_path / "a.gif", timeout=timeout)
    assert sorted(item.name for item in tmp_path.iterdir()) == ["browser", "motion.html"]
