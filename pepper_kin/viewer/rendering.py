"""A motion to a film, a picture or a page, as the file's suffix says."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from pepper_kin.collision import Scene
from pepper_kin.exceptions import UnknownNameError
from pepper_kin.model import PepperModel
from pepper_kin.viewer.browser import CameraView
from pepper_kin.viewer.joint_motion import Playable
from pepper_kin.viewer.video import VIDEO_SUFFIXES
from pepper_kin.viewer.viewer import Viewer

RENDER_SUFFIXES = (*VIDEO_SUFFIXES, ".png", ".html")


def render_motion(
    pepper: PepperModel,
    motion: Playable,
    path: str | Path,
    *,
    scene: Scene | None = None,
    fps: float = 30.0,
    size: tuple[int, int] = (1280, 800),
    view: CameraView = "three-quarter",
    at_time: float | None = None,
    on_frame: Callable[[int, int], None] = lambda done, total: None,
) -> Path:
    """Render a motion to a file.

    Args:
        pepper: The robot.
        motion: A trajectory, a run of the twin, a `JointMotion`, or joint positions of shape (n,).
        path: .mp4 or .gif (a film), .png (a picture) or .html (a page that plays and scrubs).
        scene: What stands around the robot.
        fps: Frames per second of a film.
        size: Width and height of a film or picture [pixel].
        view: "three-quarter", "front", "side" or "top"; not for a page, which has all of them.
        at_time: Time that a picture shows [s]; None for the start.
        on_frame: Called with the number of a film's frames done and of all.

    Returns:
        The path of the file.

    Raises:
        UnknownNameError: for another suffix.
        PepperKinError: as `Viewer.save_video`, `Viewer.save_image` and `Viewer.save_html`.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in RENDER_SUFFIXES:
        raise UnknownNameError("suffix", suffix, RENDER_SUFFIXES)
    with Viewer(pepper) as viewer:
        if scene is not None:
            viewer.add_scene(scene)
        if suffix in VIDEO_SUFFIXES:
            return viewer.save_video(path, motion, fps=fps, size=size, view=view, on_frame=on_frame)
        if suffix == ".png":
            return viewer.save_image(path, motion, at_time=at_time, size=size, view=view)
        return viewer.save_html(path, motion, title=Path(path).stem)
