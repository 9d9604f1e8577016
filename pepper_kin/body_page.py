"""A page in the browser that follows a simulated body."""

from __future__ import annotations

import sys
import webbrowser
from collections.abc import Callable

from pepper_kin.naoqi.body import Body
from pepper_kin.viewer import Viewer

EVERY = 2
"""Cycles of the body between two pictures: 25 of them a second."""


class BodyPage:
    """A page that shows where the joints of a body are.

    Args:
        body: The simulated body.

    Attributes:
        viewer: What draws it.
        url: Its address.
    """

    def __init__(self, body: Body) -> None:
        self._body, self._count, self._scene = body, 0, body.scene
        self.viewer = Viewer(body.pepper)
        if body.scene is not None:
            self.viewer.add_scene(body.scene)
        self.viewer.follow(False)
        self.url = self.viewer.show(body.configuration(True))
        self.on_picture: list[Callable[[Viewer], object]] = []
        body.listeners.append(self._show)

    def open(self) -> None:
        """Print the address, and open it in the browser."""
        print(self.url, file=sys.stderr)
        webbrowser.open(self.url)

    def close(self) -> None:
        """End the page."""
        with self._body.time.lock:
            if self._show in self._body.listeners:
                self._body.listeners.remove(self._show)
        self.viewer.close()

    def _show(self) -> None:
        self._count += 1
        if self._count % EVERY:
            return
        if self._body.scene is not self._scene:
            self._scene = self._body.scene
            if self._scene is not None:
                self.viewer.add_scene(self._scene)
        self.viewer.show(self._body.configuration(True))
        for draw in self.on_picture:
            draw(self.viewer)
