"""Rendering of a motion to a video, an image or a page, by the file's suffix."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from pepper_kin.collision import Scene
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.model import PepperModel
from pepper_kin.viewer.camera import CameraView, Viewpoint
from pepper_kin.viewer.joint_motion import Playable
from pepper_kin.viewer.video import VIDEO_SUFFIXES
from pepper_kin.viewer.viewer import Viewer

PICTURE_SUFFIX = ".png"
RENDER_SUFFIXES = (*VIDEO_SUFFIXES, PICTURE_SUFFIX, ".html")

FPS = 30.0
"""Default frames per second of a video."""
SIZE = (1280, 800)
"""Default width and height of a video or an image [pixel]."""
VIEW: CameraView = "three-quarter"
"""Default view of a video or an image."""


def render_motion(
    pepper: PepperModel,
    motion: Playable,
    path: str | Path,
    *,
    scene: Scene | None = None,
    fps: float | None = None,
    size: tuple[int, int] | None = None,
    view: CameraView | Viewpoint | None = None,
    at_time: float | None = None,
    on_frame: Callable[[int, int], None] = lambda done, total: None,
) -> Path:
    """Render a motion to a file.

    Args:
        pepper: Model of the robot.
        motion: Motion: a trajectory, a run of the twin, a `JointMotion`, or joint positions of shape (n,).
        path: File to write: .mp4 or .gif (a video), .png (an image) or .html (a page with a time slider).
        scene: Obstacles around the robot, and attached objects.
        fps: Frames per second of a video, `FPS` if omitted.
        size: Width and height of a video or an image [pixel], `SIZE` if omitted.
        view: View of a video or an image: "three-quarter" (default), "front", "side", "top" or `Viewpoint`.
        at_time: Time of an image [s]; the start if omitted.
        on_frame: Called with the numbers of rendered frames and of all frames of a video.

    Returns:
        The path of the file.

    Raises:
        UnknownNameError: for another suffix.
        InvalidValueError: for an option that does not apply to this kind of file.
        PepperKinError: the errors of `Viewer.save_video`, `Viewer.save_image` and `Viewer.save_html`.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in RENDER_SUFFIXES:
        raise UnknownNameError("suffix", suffix, RENDER_SUFFIXES)
    _refuse_what_has_no_effect(suffix, fps=fps, size=size, view=view, at_time=at_time)
    fps, size, view = FPS if fps is None else fps, size or SIZE, VIEW if view is None else view
    with Viewer(pepper) as viewer:
        if scene is not None:
            viewer.add_scene(scene)
        if suffix in VIDEO_SUFFIXES:
            return viewer.save_video(path, motion, fps=fps, size=size, view=view, on_frame=on_frame)
        if suffix == ".png":
            return viewer.save_image(path, motion, at_time=at_time, size=size, view=view)
        return viewer.save_html(path, motion, title=Path(path).stem)


def _refuse_what_has_no_effect(suffix: str, **options: object) -> None:
    """Refuse options that do not apply to a file with this suffix."""
    takers = {
        "fps": (VIDEO_SUFFIXES, "a film's frames per second; a page plays as smoothly as the browser can"),
        "size": ((*VIDEO_SUFFIXES, PICTURE_SUFFIX), "the size of a film or picture; a page fills its window"),
        "view": ((*VIDEO_SUFFIXES, PICTURE_SUFFIX), "the view of a film or picture; a page has all of them"),
        "at_time": ((PICTURE_SUFFIX,), "the time of a picture; films and pages show the whole motion"),
    }
    for name, value in options.items():
        suffixes, meaning = takers[name]
        if value is not None and suffix not in suffixes:
            raise InvalidValueError(
                name, value, f"nothing for {suffix}: it is {meaning} (it goes with {', '.join(suffixes)})"
            )
