"""The viewer: a robot, its surroundings and its motion, live in a browser or kept as files."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.collision import Scene
from pepper_kin.exceptions import UnknownNameError
from pepper_kin.kinematics import frame_poses
from pepper_kin.model import PepperModel, Shape
from pepper_kin.viewer.browser import CameraView, screenshot
from pepper_kin.viewer.drawable import TARGET_COLOR, Color, Drawable, marker
from pepper_kin.viewer.joint_motion import JointMotion, Playable, joint_motion, still
from pepper_kin.viewer.live import LivePage
from pepper_kin.viewer.motion_frames import MotionFrames, frames_of_samples, kept_samples
from pepper_kin.viewer.recording import write_frames_page
from pepper_kin.viewer.video import check_video, write_video

Looks = Literal["visual", "collision", "spheres"]

OVER_COLOR = (0.20, 0.45, 0.90, 0.35)


class Viewer:
    """Shows a robot and its motions.

        viewer = Viewer(pepper).add_scene(scene).add_target("left hand", point)
        viewer.save_html("motion.html", run)      # one file, no server
        print(viewer.play(run))                   # address of a live page

    Drawing needs meshcat; pictures need a Chromium.  A live page is started by the first `show` or `play`.
    Use the viewer as a context manager, or call `close`, to end its server before Python ends.

    Args:
        pepper: The robot.
        looks: "visual" draws what it looks like, "collision" the shapes that may not touch, "spheres" the
            sphere set.
        over: Looks drawn on top as well, half transparent, such as "collision" over "visual".

    Raises:
        UnknownNameError: There are no such looks.
    """

    def __init__(self, pepper: PepperModel, *, looks: Looks = "visual", over: Looks | None = None) -> None:
        self._pepper = pepper
        shapes = _shapes(pepper, looks)
        drawn = [Drawable.from_shape(shape) for shape in shapes]
        if over is not None:
            on_top = _shapes(pepper, over)
            drawn += [
                replace(Drawable.from_shape(s), name=f"over/{s.name}", color=OVER_COLOR) for s in on_top
            ]
            shapes = (*shapes, *on_top)
        self._robot = tuple(drawn)
        self._drawn_links = tuple(dict.fromkeys(shape.link for shape in shapes))
        self._surroundings: dict[str, Drawable] = {}
        self._targets: dict[str, Drawable] = {}
        self._motion = still(pepper, pepper.neutral())
        self._page: LivePage | None = None

    def __enter__(self) -> Viewer:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    @property
    def url(self) -> str | None:
        """Address of the live page, or None while there is none."""
        return self._page.url if self._page else None

    def add_scene(self, scene: Scene) -> Viewer:
        """Draw a scene's objects; an object of the same name is replaced.

        What hangs on the robot moves with it.  Half-spaces are drawn as plates, clouds as little balls;
        paddings are not drawn.

        Returns:
            The viewer itself, so that calls can be chained.

        Raises:
            UnknownNameError: An object hangs on a frame that the robot lacks.
        """
        for name, thing in scene.objects.items():
            self._surroundings[name] = Drawable(
                name, None, thing.geometry, thing.transform_object_to_world, thing.color
            )
        for name, held in scene.attached.items():
            self._pepper.frame_id(held.frame)
            self._surroundings[name] = Drawable(
                name, held.frame, held.geometry, held.transform_object_to_frame, held.color
            )
        links = [thing.link for thing in (*self._robot, *self._surroundings.values())]
        self._drawn_links = tuple(dict.fromkeys(link for link in links if link is not None))
        self._redraw()
        return self

    def add_target(self, name: str, position: ArrayLike, color: Color = TARGET_COLOR) -> Viewer:
        """Mark a target by a ball that the page lists by name; one of the same name is replaced.

        Args:
            name: What to call it.
            position: Where it is in the world, shape (3,) [m].
            color: Red, green, blue and opacity, each in [0, 1].

        Returns:
            The viewer itself, so that calls can be chained.

        Raises:
            InvalidValueError: `position` is not three finite numbers, or `color` is not four in [0, 1].
        """
        self._targets[name] = marker(name, position, color=color)
        self._redraw()
        return self

    def show(self, q: ArrayLike) -> str:
        """Show joint positions in the live page.

        Args:
            q: Joint positions, shape (n,) [rad or m].

        Returns:
            The address of the page.

        Raises:
            InvalidValueError: for a q of wrong shape, or with NaN or infinity.
        """
        self._motion = still(self._pepper, q)
        page = self._live()
        page.pose(self._drawn_links, frame_poses(self._pepper, self._motion.positions[0], self._drawn_links))
        return page.url

    def play(self, motion: Playable, *, fps: float = 40.0) -> str:
        """Play a motion in the live page.

        Args:
            motion: A trajectory, a run of the twin, or a `JointMotion`.
            fps: Most frames per second to send.

        Returns:
            The address of the page.

        Raises:
            InvalidValueError: for a motion of another robot (joint count), or with NaN or infinity.
        """
        self._motion = joint_motion(self._pepper, motion)
        page = self._live()
        page.play(self._drawn_links, self._frames(self._motion, {}, fps))
        return page.url

    def save_html(
        self,
        path: str | Path,
        motion: Playable | None = None,
        *,
        title: str | None = None,
        series: Mapping[str, ArrayLike] | None = None,
        fps: float = 40.0,
    ) -> Path:
        """Save a page that plays and scrubs a motion in 3D: one file, no server, no network.

        Args:
            path: The file to write; it appears when it is whole.
            motion: A trajectory, a run of the twin, a `JointMotion`, or joint positions of shape (n,); None
                takes what was shown or played last, at first the robot standing.
            title: Title of the page; None takes the robot's name.
            series: Curves to plot beside the motion, name (with unit) to one value per sample; None plots
                what the motion brings along (a run: the torque of each joint).
            fps: Most frames per second to keep.

        Returns:
            The path of the file.

        Raises:
            InvalidValueError: for a motion of another robot, or with NaN or infinity.
            FileFormatError: A mesh of the robot cannot be read, or the path cannot be written.
        """
        chosen = self._motion if motion is None else joint_motion(self._pepper, motion)
        frames = self._frames(chosen, chosen.series if series is None else series, fps)
        return write_frames_page(
            path,
            (*self._robot, *self._surroundings.values()),
            self._drawn_links,
            frames,
            title=self._pepper.name if title is None else title,
            markers=tuple(self._targets.values()),
        )

    def save_image(
        self,
        path: str | Path,
        motion: Playable | None = None,
        *,
        at_time: float | None = None,
        size: tuple[int, int] = (1280, 800),
        view: CameraView = "three-quarter",
    ) -> Path:
        """Save a picture (PNG), drawn by a headless Chromium; the same input gives the same pixels.

        Args:
            path: The file to write; it appears when it is whole.
            motion: As for `save_html`.
            at_time: Time of the motion [s]; None takes its start.
            size: Width and height [pixel].
            view: "three-quarter", "front", "side" or "top".

        Returns:
            The path of the file.

        Raises:
            MissingDependencyError: No Chromium is installed.
            InvalidValueError: As for `save_html`, or a size that is not two positive whole numbers.
            UnknownNameError: There is no such view.
            InfeasibleError: The browser gave no picture.
            FileFormatError: A mesh of the robot cannot be read, or the path cannot be written.
        """
        with tempfile.TemporaryDirectory() as folder:
            page = self.save_html(Path(folder) / "scene.html", motion, series={})
            return screenshot(page, path, size, at_time, view=view)

    def save_video(
        self,
        path: str | Path,
        motion: Playable | None = None,
        *,
        fps: float = 30.0,
        size: tuple[int, int] = (1280, 800),
        view: CameraView = "three-quarter",
        on_frame: Callable[[int, int], None] = lambda done, total: None,
    ) -> Path:
        """Save a film (MP4 or GIF), drawn by a headless Chromium; the same input gives the same pixels.

        Args:
            path: The file to write, .mp4 or .gif; it appears when it is whole.
            motion: As for `save_html`.
            fps: Frames per second, in (0, 240], for .gif at most 50.
            size: Width and height [pixel]; even numbers for .mp4.
            view: "three-quarter", "front", "side" or "top".
            on_frame: Called with the number of frames done and of all.

        Returns:
            The path of the file.

        Raises:
            UnknownNameError: There is no such view or suffix.
            InvalidValueError: As for `save_html`, or an fps or size out of range.
            MissingDependencyError: No Chromium is installed, or for .mp4 no PyAV.
            InfeasibleError: The browser gave no picture.
            FileFormatError: A mesh of the robot cannot be read, or the path cannot be written.
        """
        check_video(Path(path).suffix.lower(), fps, size, view)
        with tempfile.TemporaryDirectory() as folder:
            # At least as many poses as frames: what is blended between two lies on the samples' way.
            page = self.save_html(Path(folder) / "scene.html", motion, series={}, fps=max(40.0, fps))
            return write_video(page, path, fps=fps, size=size, view=view, on_frame=on_frame)

    def close(self) -> None:
        """End the live page's server, if there is one."""
        if self._page is not None:
            self._page.close()
            self._page = None

    def _frames(self, motion: JointMotion, series: Mapping[str, ArrayLike], fps: float) -> MotionFrames:
        """Compute poses at the frames alone: those of every sample would cost most of the time."""
        kept = kept_samples(motion.times, fps)
        poses = frame_poses(self._pepper, motion.positions[kept], self._drawn_links)
        return frames_of_samples(motion.times, kept, poses, len(self._drawn_links), series)

    def _live(self) -> LivePage:
        if self._page is None:
            self._page = LivePage()
            self._redraw()
        return self._page

    def _redraw(self) -> None:
        if self._page is not None:
            self._page.draw((*self._robot, *self._surroundings.values(), *self._targets.values()))
            poses = frame_poses(self._pepper, self._motion.positions[0], self._drawn_links)
            self._page.pose(self._drawn_links, np.asarray(poses))


def _shapes(pepper: PepperModel, looks: str) -> tuple[Shape, ...]:
    if looks not in get_args(Looks):
        raise UnknownNameError("looks", looks, get_args(Looks))
    shapes = {
        "visual": pepper.visual_shapes,
        "collision": pepper.collision_shapes,
        "spheres": pepper.collision_spheres,
    }
    return shapes[looks]
