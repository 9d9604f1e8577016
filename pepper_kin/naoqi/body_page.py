"""Browser pages that show a simulated body with its lights and beams, or a robot and its twin."""

from __future__ import annotations

import sys
import webbrowser
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.collision import PointCloud
from pepper_kin.kinematics import frame_poses
from pepper_kin.model import PepperModel
from pepper_kin.naoqi.body import Body
from pepper_kin.viewer import Drawable, Viewer
from pepper_kin.viewer.drawable import Color
from pepper_kin.viewer.lights import OFF, pepper_lights

if TYPE_CHECKING:
    from pepper_kin.viewer.server.board import Board

EVERY = 2
"""Number of cycles between two updates of the page: 25 updates a second."""

LIGHTS = ("robot", "lights")
POINTS = ("markers", "ends of beams")
POINT_COLOR: Color = (0.86, 0.16, 0.16, 1.0)
POINT_RADIUS = 0.012
TWIN = ("markers", "twin")
TWIN_COLOR: Color = (0.20, 0.45, 0.90, 1.0)

Light = tuple[float, float, float]


class BodyPage:
    """A page that shows a simulated body.

    Args:
        body: The simulated body.
        lights: Returns red, green and blue, 0 to 1 each, of every light by name; no lights if omitted.
        points: Returns points to mark in the world [m], shape (k, 3); no marks if omitted.

    Attributes:
        viewer: The viewer.
        url: Address of the page.
    """

    def __init__(
        self,
        body: Body,
        *,
        lights: Callable[[], Mapping[str, Light]] | None = None,
        points: Callable[[], ArrayLike] | None = None,
    ) -> None:
        self._body, self._count, self._scene = body, 0, body.scene
        self._lights, self._points = lights, points
        self._painted: dict[str, Light] = {}
        self._marked = b""
        self.viewer = Viewer(body.pepper)
        if body.scene is not None:
            self.viewer.add_scene(body.scene)
        self.viewer.follow(False)
        self.url = self.viewer.show(body.configuration(True))
        self._drawn = pepper_lights(body.pepper) if lights is not None else {}
        for name, drawable in self._drawn.items():
            self.viewer.draw(lambda board, n=name, d=drawable: board.draw((*LIGHTS, n), [d]))  # type: ignore[misc]
        body.listeners.append(self._show)

    def open(self) -> None:
        """Print the address, and open it in the browser."""
        print(self.url, file=sys.stderr)
        webbrowser.open(self.url)

    def close(self) -> None:
        """Close the page."""
        with self._body.time.lock:
            if self._show in self._body.listeners:
                self._body.listeners.remove(self._show)
        self.viewer.close()

    def _show(self) -> None:
        """Draw the changes; the lock of the body is held."""
        self._count += 1
        if self._count % EVERY:
            return
        if self._body.scene is not self._scene:
            self._scene = self._body.scene
            if self._scene is not None:
                self.viewer.add_scene(self._scene)
        self.viewer.show(self._body.configuration(True))
        if self._lights is not None:
            self._paint(self._lights())
        if self._points is not None:
            self._mark(np.asarray(self._points(), dtype=float).reshape(-1, 3))

    def _paint(self, lights: Mapping[str, Light]) -> None:
        """Paint the lights whose color has changed."""
        changed = {n: c for n, c in lights.items() if n in self._drawn and self._painted.get(n) != c}
        if changed:
            self._painted.update(changed)
            self.viewer.draw(lambda board: _paint_all(board, changed))

    def _mark(self, points: np.ndarray) -> None:
        """Mark points of the world [m], shape (k, 3), if they have changed."""
        if points.tobytes() == self._marked:
            return
        self._marked = points.tobytes()
        _mark(self.viewer, POINTS, points, POINT_COLOR)


class MirrorPage:
    """A page that shows a robot, and the origins of its twin's links as spheres.

    Args:
        pepper: Model of the robot.

    Attributes:
        viewer: The viewer.
        url: Address of the page.
    """

    def __init__(self, pepper: PepperModel) -> None:
        self._pepper = pepper
        self._links = list(dict.fromkeys(shape.link for shape in pepper.visual_shapes))
        self.viewer = Viewer(pepper)
        self.viewer.follow(False)
        self.url = self.viewer.show(pepper.neutral())

    def open(self) -> None:
        """Print the address, and open it in the browser."""
        print(self.url, file=sys.stderr)
        webbrowser.open(self.url)

    def close(self) -> None:
        """Close the page."""
        self.viewer.close()

    def show(self, measured: ArrayLike, simulated: ArrayLike) -> None:
        """Show the joint positions of the robot and of its twin [rad or m], shape (n,) each."""
        self.viewer.show(measured)
        poses = frame_poses(self._pepper, simulated, self._links)
        _mark(self.viewer, TWIN, np.asarray(poses)[:, :3, 3], TWIN_COLOR)


def _mark(viewer: Viewer, group: tuple[str, ...], points: np.ndarray, color: Color) -> None:
    """Mark points of the world [m], shape (k, 3), in place of the group's previous points."""
    cloud = [Drawable("points", None, PointCloud(points, POINT_RADIUS), np.eye(4), color)]
    viewer.draw(lambda board: board.draw(group, cloud if len(points) else []))


def shade(light: Light) -> Color:
    """Return the drawn color of a light of red, green and blue; dark glass if it is off."""
    red, green, blue = (OFF[k] + (1.0 - OFF[k]) * light[k] for k in range(3))
    return red, green, blue, 1.0


def _paint_all(board: Board, lights: Mapping[str, Light]) -> None:
    for name, light in lights.items():
        board.paint((*LIGHTS, name), shade(light))
