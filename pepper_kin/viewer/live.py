"""A live page on meshcat's own server, on this machine only."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pepper_kin.viewer.drawable import Drawable
from pepper_kin.viewer.drawing import LINK_ROOT, WORLD_ROOT, draw_commands, link_path
from pepper_kin.viewer.motion_frames import MotionFrames

_FINE_FPS = 1000.0


class LivePage:
    """A scene in a browser, updated over a web socket on the loopback address.

    The server is a process of its own: it starts with the first page and ends with `close` or with Python.

    Attributes:
        url: The address to open in a browser.
    """

    url: str

    def __init__(self) -> None:
        import meshcat

        # meshcat prints its address; here it is a value.
        with contextlib.redirect_stdout(io.StringIO()):
            self._visualizer: Any = meshcat.Visualizer()
        self.url = self._visualizer.url()
        background = self._visualizer["/Background"]
        background.set_property("top_color", [0.81, 0.85, 0.90])
        background.set_property("bottom_color", [0.93, 0.95, 0.96])

    def draw(self, drawables: Iterable[Drawable]) -> None:
        """Replace what is in the scene."""
        for root in (LINK_ROOT, WORLD_ROOT):
            self._visualizer["/" + root].delete()
        for command in draw_commands(drawables):
            self._visualizer.window.send(command)

    def pose(self, link_names: Sequence[str], poses: NDArray[np.float64]) -> None:
        """Move links: `poses` are transforms from link to world, shape (L, 4, 4) [m]."""
        from meshcat.commands import SetTransform
        from meshcat.path import Path as ScenePath

        for name, pose in zip(link_names, poses, strict=True):
            self._visualizer.window.send(SetTransform(pose, ScenePath(link_path(name))))

    def play(self, link_names: Sequence[str], frames: MotionFrames) -> None:
        """Play frames in every page that is open now or later; meshcat's own controls scrub them."""
        from meshcat.animation import Animation, AnimationClip, AnimationTrack
        from meshcat.path import Path as ScenePath

        # meshcat's keys count frames, fractions included; a fine grid keeps uneven times as they are.
        keys = ((frames.times - frames.times[0]) * _FINE_FPS).tolist()
        clips = {}
        for index, name in enumerate(link_names):
            tracks = {
                "position": AnimationTrack("position", "vector3", keys, frames.positions[:, index].tolist()),
                "quaternion": AnimationTrack(
                    "quaternion", "quaternion", keys, frames.quaternions_xyzw[:, index].tolist()
                ),
            }
            clips[ScenePath(link_path(name))] = AnimationClip(tracks, fps=_FINE_FPS)
        self._visualizer.set_animation(Animation(clips))

    def close(self) -> None:
        """End the server; open pages stay as they are."""
        process = self._visualizer.window.server_proc
        if process is not None:
            process.terminate()
            process.wait()
