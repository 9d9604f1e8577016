"""The viewer: a robot, its surroundings and its motion, live in a browser or saved as files."""

from __future__ import annotations

import html
import tempfile
import threading
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.collision import Scene
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.kinematics import frame_poses
from pepper_kin.model import PepperModel, Shape
from pepper_kin.model.joint_vectors import as_finite
from pepper_kin.viewer.browser_session import screenshot
from pepper_kin.viewer.camera import CameraView, Viewpoint
from pepper_kin.viewer.drawable import TARGET_COLOR, Color, Drawable, marker
from pepper_kin.viewer.ghost import ghost_link, ghost_of
from pepper_kin.viewer.joint_motion import Playable, joint_motion, still
from pepper_kin.viewer.meshcat_scene import MeshcatScene
from pepper_kin.viewer.motion_frames import frames_of_samples, kept_samples, limited_series
from pepper_kin.viewer.recording import write_frames_page
from pepper_kin.viewer.server.layers import CAPSULES, SPHERES, VISUAL
from pepper_kin.viewer.target_listener import TargetListener
from pepper_kin.viewer.touching import touch_spans
from pepper_kin.viewer.video import check_video, save_video

if TYPE_CHECKING:
    from pepper_kin.viewer.server import ViewerServer
    from pepper_kin.viewer.server.board import Board
    from pepper_kin.viewer.server.session import LiveSession

GeometryType = Literal["visual", "collision", "spheres"]

OVER_COLOR = (0.20, 0.45, 0.90, 0.35)
_LAYERS = {"visual": VISUAL, "collision": CAPSULES, "spheres": SPHERES}


class Viewer:
    """Viewer of a robot and its motions.

        viewer = Viewer(pepper).add_scene(scene).add_target("left hand", point)
        viewer.save_html("motion.html", run)      # one file, no server
        print(viewer.play(run))                   # address of a live page

    Images and videos need a Chromium.  A live page is started by the first `show`, `play` or `on_target`; in
    a notebook, a viewer at the end of a cell shows the page in a frame.  The page has the panel of
    `pepper-kin view`.  Use the viewer as a context manager, or call `close`, to stop its server before Python
    ends.

    Args:
        pepper: Model of the robot.
        geometry_type: "visual" draws the visual meshes, "collision" the collision shapes, "spheres"
            the sphere set.
        over: Second geometry, drawn translucent over the first, such as "collision" over "visual".
        port: Port of the live page; None takes the first free one from 7878 on, 0 any free one.

    Raises:
        UnknownNameError: for an unknown geometry type.
    """

    def __init__(
        self,
        pepper: PepperModel,
        *,
        geometry_type: GeometryType = "visual",
        over: GeometryType | None = None,
        port: int | None = None,
    ) -> None:
        self._pepper = pepper
        self._port = port
        self._layers = tuple(_LAYERS[name] for name in (geometry_type, over) if name in _LAYERS)
        shapes = _shapes(pepper, geometry_type)
        drawn = [drawable for shape in shapes for drawable in Drawable.all_of_shape(shape)]
        self._ghost = ghost_of(drawn)
        if over is not None:
            on_top = _shapes(pepper, over)
            drawn += [
                replace(Drawable.from_shape(s), name=f"over/{s.name}", color=OVER_COLOR) for s in on_top
            ]
            shapes = (*shapes, *on_top)
        self._robot = tuple(drawn)
        self._drawn_links = tuple(dict.fromkeys(shape.link for shape in shapes))
        self._surroundings: dict[str, Drawable] = {}
        self._scene = Scene()
        self._targets: dict[str, Drawable] = {}
        self._motion = still(pepper, pepper.default_posture())
        self._server: ViewerServer | None = None
        self._starting = threading.Lock()
        self._listener: TargetListener | None = None

    def __enter__(self) -> Viewer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def url(self) -> str | None:
        """Address of the live page, or None before it is started."""
        return server.url if (server := self._server) else None

    @property
    def q(self) -> NDArray[np.float64]:
        """Joint positions shown on the live page, shape (n,) [rad or m]; initially the posture Ready."""
        if (server := self._server) is None:
            return self._motion.positions[0].copy()
        return server.call(lambda session: session.q.copy())

    def _repr_html_(self) -> str:
        """Show the live page in a notebook."""
        return (
            f'<iframe src="{html.escape(self._live().url)}" title="{html.escape(self._pepper.name)}" '
            'style="width: 100%; height: 640px; border: 0"></iframe>'
        )

    def add_scene(self, scene: Scene) -> Viewer:
        """Draw a scene's objects; an object of the same name is replaced.

        Attached objects move with the robot.  Half-spaces are drawn as plates, clouds as small spheres;
        paddings are not drawn.  Moving obstacles move in recordings, images and videos, from the motion's
        start on; on the live page they are static.

        Returns:
            The viewer itself, so that calls can be chained.

        Raises:
            UnknownNameError: An object is attached to a frame that the robot does not have.
        """
        for held in scene.attached.values():
            self._pepper.frame_id(held.frame)
        for name, thing in scene.objects.items():
            self._surroundings[name] = Drawable(
                name, None, thing.geometry, thing.transform_object_to_world, thing.color
            )
        for name, held in scene.attached.items():
            self._surroundings[name] = Drawable(
                name, held.frame, held.geometry, held.transform_object_to_frame, held.color
            )
        links = [thing.link for thing in (*self._robot, *self._surroundings.values())]
        self._drawn_links = tuple(dict.fromkeys(link for link in links if link is not None))
        known = self._scene if self._server is None else self._server.call(lambda session: session.scene)
        self._scene = _joined(known, scene)
        self._tell(lambda session: session.set_scene(self._scene))
        return self

    def add_target(self, name: str, position: ArrayLike, color: Color = TARGET_COLOR) -> Viewer:
        """Mark a target by a sphere that the page lists by name; a target of the same name is replaced.

        Args:
            name: Name of the target.
            position: Position in the world, shape (3,) [m].
            color: Red, green, blue and opacity, each in [0, 1].

        Returns:
            The viewer itself, so that calls can be chained.

        Raises:
            InvalidValueError: `position` is not three finite numbers, or `color` is not four in [0, 1].
        """
        self._targets[name] = marker(name, position, color=color)
        self._tell(lambda session: session.set_markers(tuple(self._targets.values())))
        return self

    def on_target(self, callback: Callable[[str, NDArray[np.float64]], object] | None) -> Viewer:
        """Subscribe a callback to dragged targets of the live page; starts the page.

            viewer.on_target(lambda name, position: print(name, position))

        The callback gets the target's name ("left hand", "right hand" or "gaze") and its position in the
        world, shape (3,) [m].  It runs in a separate thread; while it runs, only the newest position of each
        target is kept for it.  It may call the viewer, for instance `show`.  The body continues to follow
        unless the page's "Follow live" is off; see `follow`.

        Args:
            callback: Function to call; None ends the subscription.

        Returns:
            The viewer itself, so that calls can be chained.
        """
        if self._listener is not None:
            self._listener.stop()
        self._listener = None if callback is None else TargetListener(callback)
        heard = self._listener.hear if self._listener else (lambda name, position: None)
        self._live().call(lambda session: setattr(session, "on_target", heard))
        return self

    def follow(self, on: bool = True) -> Viewer:
        """Set whether the body on the live page follows dragged targets.

        Returns:
            The viewer itself, so that calls can be chained.
        """
        self._live().call(lambda session: session.set_follow(bool(on)))
        return self

    def move_target(self, name: str, position: ArrayLike) -> Viewer:
        """Move a target of the live page, as if dragged; the body follows by the servo.

        Returns at once, while the body moves; `q` is its present state.  On the first use on a machine, the
        servo is compiled first, which takes a minute or two.

        Args:
            name: Name of the target: "left hand", "right hand" or "gaze".
            position: Position in the world, shape (3,) [m].

        Returns:
            The viewer itself, so that calls can be chained.

        Raises:
            InvalidValueError: `position` is not three finite numbers.
            UnknownNameError: for an unknown target.
        """
        place = as_finite(position, f"position of target {name!r}", (3,))
        self._live().call(lambda session: session.move_target(name, place))
        return self

    def show(self, q: ArrayLike) -> str:
        """Show joint positions on the live page.

        Args:
            q: Joint positions, shape (n,) [rad or m].

        Returns:
            The address of the page.

        Raises:
            InvalidValueError: for a q of wrong shape, or with NaN or infinity.
        """
        self._motion = motion = still(self._pepper, q)
        server = self._live()
        server.call(lambda session: session.set_joints(motion.positions[0]))
        return server.url

    def play(self, motion: Playable, *, title: str = "Motion", loop: bool = False) -> str:
        """Play a motion on the live page, with its torques and clearance; return at once.

        Args:
            motion: Motion: a trajectory, a run of the twin, or a `JointMotion`.
            title: Title on the page.
            loop: Whether the motion repeats.

        Returns:
            The address of the page.

        Raises:
            InvalidValueError: for a motion of another robot (joint count), or with NaN or infinity; or one
                that tilts, which only recordings can show.
        """
        from pepper_kin.viewer.server.planning import show_motion

        chosen = joint_motion(self._pepper, motion)
        if chosen.tilts is not None:
            raise InvalidValueError("motion", "a robot that tilts", "a level one; save_html shows a fall")
        self._motion = chosen
        server = self._live()
        scene = server.call(lambda session: session.scene)
        shown = show_motion(self._pepper, motion, scene, title)

        def begin(session: LiveSession) -> None:
            session.load(shown, play=True)
            session.set_loop(loop)

        server.call(begin)
        return server.url

    def draw(self, do: Callable[[Board], object]) -> Viewer:
        """Draw on the live page, which is started if needed: `do` is called with the board of its groups.

        Returns:
            The viewer itself, so that calls can be chained.
        """
        self._live().call(lambda session: do(session.board))
        return self

    def in_meshcat(self, visualizer: Any) -> MeshcatScene:
        """Draw robot, scene and targets into an open `meshcat.Visualizer`, also in a notebook.

            visualizer = meshcat.Visualizer()
            scene = pk.Viewer(pepper).add_scene(table).in_meshcat(visualizer["pepper"])
            scene.display(q)
            scene.play(trajectory)

        Args:
            visualizer: `meshcat.Visualizer`, or a part of it, which is emptied.

        Returns:
            A drawing that shows joint positions and motions there.

        Raises:
            InvalidValueError: for an object that is no visualizer.
            FileFormatError: A mesh of the robot cannot be read.
        """
        drawn = (*self._robot, *self._surroundings.values(), *self._targets.values())
        return MeshcatScene(visualizer, self._pepper, drawn, self._drawn_links)

    def save_html(
        self,
        path: str | Path,
        motion: Playable | None = None,
        *,
        title: str | None = None,
        series: Mapping[str, ArrayLike] | None = None,
        limits: Mapping[str, float] | None = None,
        fps: float = 40.0,
        view: CameraView | Viewpoint = "three-quarter",
    ) -> Path:
        """Save a page that plays a motion in 3D, with a time slider: one file, no server, no network.

        Args:
            path: File to write; it appears when it is complete.
            motion: A trajectory, a run of the twin, one that tilts (`TippingRun`), a `JointMotion`, or joint
                positions of shape (n,); None takes the motion that was shown or played last, initially the
                robot standing.
            title: Title of the page; None takes the robot's name.
            series: Name of a curve to plot (with unit) -> values of shape (T,); None plots
                the motion's own curves (a run: the torque of each joint; a trajectory: its velocity).
            limits: Largest allowed magnitude of a curve of `series`, by its name, in its unit; its axis
                then shows fractions of the limit.  The motion's own curves have limits already.
            fps: Maximum frames per second to keep.
            view: Initial view of the page: "three-quarter", "front", "side" or "top", or a `Viewpoint`.

        Returns:
            The path of the file.

        Raises:
            InvalidValueError: for a motion of another robot, or with NaN or infinity.
            UnknownNameError: for an unknown view.
            FileFormatError: A mesh of the robot cannot be read, or the path cannot be written.
        """
        chosen = self._motion if motion is None else joint_motion(self._pepper, motion)
        curves = chosen.curves if series is None else limited_series(series, limits or {})
        kept, links, drawn = kept_samples(chosen.times, fps), self._drawn_links, self._robot
        # Only at the frames: poses of every sample would take most of the time.
        poses = frame_poses(self._pepper, chosen.positions[kept], links)
        if chosen.tilts is not None:
            poses = chosen.tilts[kept][:, None] @ poses
        if chosen.ghost is not None:
            there = frame_poses(self._pepper, chosen.ghost.positions[kept], links)
            poses = np.concatenate([poses, there], axis=1)
            links, drawn = (*links, *map(ghost_link, links)), (*drawn, *self._ghost)
        surroundings, movers = dict(self._surroundings), self._scene.movers
        for item in movers:
            moving = item.poses(np.asarray(chosen.times)[kept])[:, None]
            poses, links = np.concatenate([poses, moving], axis=1), (*links, f"obstacle {item.name}")
            still = replace(surroundings[item.name], link=links[-1], transform_shape_to_link=np.eye(4))
            surroundings[item.name] = still
        frames = frames_of_samples(chosen.times, kept, poses, len(links), curves)
        return write_frames_page(
            path,
            (*drawn, *surroundings.values()),
            links,
            frames,
            title=self._pepper.name if title is None else title,
            markers=tuple(self._targets.values()),
            touches=touch_spans(
                self._pepper,
                frames.times,
                chosen.positions[kept],
                self._scene if chosen.tilts is None else Scene(),
                self._drawn_links,
            ),
            notes=chosen.notes,
            ghost=chosen.ghost,
            view=view,
        )

    def save_image(
        self,
        path: str | Path,
        motion: Playable | None = None,
        *,
        at_time: float | None = None,
        size: tuple[int, int] = (1280, 800),
        view: CameraView | Viewpoint = "three-quarter",
    ) -> Path:
        """Save an image (PNG), rendered by a headless Chromium; the same input gives the same pixels.

        Args:
            path: File to write; it appears when it is complete.
            motion: Motion, of the types of `save_html`; None takes the one that was shown or played last.
            at_time: Time of the motion [s], within it; None takes its start.
            size: Width and height [pixel].
            view: View: "three-quarter", "front", "side" or "top", or a `Viewpoint`.

        Returns:
            The path of the file.

        Raises:
            MissingDependencyError: No Chromium is installed.
            InvalidValueError: for a motion of another robot, a time outside the motion, or a size that is not
                two positive whole numbers.
            UnknownNameError: for an unknown view.
            InfeasibleError: The browser rendered no image.
            FileFormatError: A mesh of the robot cannot be read, or the path cannot be written.
        """
        if at_time is not None:
            times = (self._motion if motion is None else joint_motion(self._pepper, motion)).times
            if not times[0] <= at_time <= times[-1]:
                raise InvalidValueError("at_time", at_time, f"a time from {times[0]:g} to {times[-1]:g} s")
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
        view: CameraView | Viewpoint = "three-quarter",
        on_frame: Callable[[int, int], None] = lambda done, total: None,
    ) -> Path:
        """Save a video (MP4 or GIF), rendered by a headless Chromium; the same input gives the same pixels.

        Args:
            path: File to write, .mp4 or .gif; it appears when it is complete.
            motion: Motion, of the types of `save_html`; None takes the one that was shown or played last.
            fps: Frames per second, in (0, 240], for .gif at most 50.
            size: Width and height [pixel]; even numbers for .mp4.
            view: View: "three-quarter", "front", "side" or "top", or a `Viewpoint`.
            on_frame: Called with the numbers of rendered frames and of all frames.

        Returns:
            The path of the file.

        Raises:
            UnknownNameError: for an unknown view or suffix.
            InvalidValueError: for a motion of another robot, or an fps or size out of range.
            MissingDependencyError: No Chromium is installed, or for .mp4 no PyAV.
            InfeasibleError: The browser rendered no image.
            FileFormatError: A mesh of the robot cannot be read, or the path cannot be written.
        """
        check_video(Path(path).suffix.lower(), fps, size, view)
        with tempfile.TemporaryDirectory() as folder:
            # At least as many poses as frames: interpolations between two poses are close to the samples.
            page = self.save_html(Path(folder) / "scene.html", motion, series={}, fps=max(40.0, fps))
            return save_video(page, path, fps=fps, size=size, view=view, on_frame=on_frame)

    def close(self) -> None:
        """Stop the live page's server, if there is one."""
        if self._listener is not None:
            self._listener.stop()
            self._listener = None
        server, self._server = self._server, None
        if server is not None:
            server.close()

    def _live(self) -> ViewerServer:
        with self._starting:  # all threads share one server
            server = self._server
            if server is None:
                from pepper_kin.viewer.server import ViewerServer

                server = ViewerServer(self._pepper, port=self._port)
                server.call(self._furnish)
                self._server = server
        return server

    def _furnish(self, session: LiveSession) -> None:
        """Set up a new session with the viewer's robot, scene, targets and posture."""
        for layer in session.available:
            if layer == VISUAL or layer in self._layers:
                session.show(layer, layer in self._layers)
        session.set_scene(self._scene)
        session.set_markers(tuple(self._targets.values()))
        session.set_joints(self._motion.positions[0])

    def _tell(self, do: Callable[[LiveSession], None]) -> None:
        if (server := self._server) is not None:
            server.call(do)


def _joined(known: Scene, more: Scene) -> Scene:
    """Join two scenes; objects of the second replace objects of the same name in the first."""
    kept = {name: thing for name, thing in known.objects.items() if name not in more.attached}
    held = {name: thing for name, thing in known.attached.items() if name not in more.objects}
    return Scene({**kept, **more.objects}, {**held, **more.attached}, [*known.allowed, *more.allowed])


def _shapes(pepper: PepperModel, geometry_type: str) -> tuple[Shape, ...]:
    if geometry_type not in get_args(GeometryType):
        raise UnknownNameError("geometry_type", geometry_type, get_args(GeometryType))
    shapes = {
        "visual": pepper.visual_shapes,
        "collision": pepper.collision_shapes,
        "spheres": pepper.collision_spheres,
    }
    return shapes[geometry_type]
