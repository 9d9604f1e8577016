"""The state of the pages: a robot with its targets, scene and motion.

All of it belongs to the thread of the server's loop; long tasks are done by the worker.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array
from pepper_kin.collision import Scene
from pepper_kin.exceptions import InvalidValueError, PepperKinError, UnknownNameError
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_joint_vector, check_within_limits
from pepper_kin.viewer.drawable import Drawable
from pepper_kin.viewer.server import obstacles
from pepper_kin.viewer.server.alerts import Alerts
from pepper_kin.viewer.server.board import Board
from pepper_kin.viewer.server.body_poses import BodyPoses
from pepper_kin.viewer.server.document import blank_document
from pepper_kin.viewer.server.explaining import at_target, on_the_way
from pepper_kin.viewer.server.follower import RATE, Follower
from pepper_kin.viewer.server.layers import LAYERS, TARGETS, VISUAL, layers_of
from pepper_kin.viewer.server.live_run import LiveRun
from pepper_kin.viewer.server.planning import Shown
from pepper_kin.viewer.server.playback import Playback
from pepper_kin.viewer.server.readings import Readings
from pepper_kin.viewer.server.robot_facts import robot_facts
from pepper_kin.viewer.server.sketches import SKETCHES, sketches_of
from pepper_kin.viewer.server.targets import SharedTargets
from pepper_kin.viewer.server.tasks import LongTasks
from pepper_kin.viewer.server.world import DrawnScene

FREE, FOLLOWING, MOTION, LIVE = "free", "follow", "motion", "live"
READING_STEP = 0.05  # [s]; time between two samples of the plots
ON_THE_WAY = 0.4  # [s]; time after which the message says that the robot follows
SCENE_STEP = 0.04  # [s]; time between two scenes for the servo while an obstacle is dragged
ROBOT_ROOT, OBSTACLE_ROOT, MARKER_ROOT, GHOST_ROOT = ("robot",), ("obstacles",), ("markers",), ("ghost",)


class LiveSession:
    """The state that all pages show and change.

    Args:
        pepper: Model of the robot.
        send: Sends a drawing command to all open pages.
        tasks: Executes long tasks.
    """

    def __init__(self, pepper: PepperModel, send: Callable[[bytes], None], tasks: LongTasks) -> None:
        self.pepper = pepper
        self.document = blank_document()
        self.board = Board(send)
        self.targets = SharedTargets(pepper)
        self.readings = Readings(pepper)
        self.alerts = Alerts(pepper)
        self._world = DrawnScene(pepper, self.board, OBSTACLE_ROOT, (*ROBOT_ROOT, "held"))
        self.mode = FREE
        self.stamp = 0
        self.target_revision = 0
        self.on_target: Callable[[str, Array], None] = lambda name, position: None
        self._tasks = tasks
        self._q = pepper.default_posture()
        self._v = self._a = np.zeros(pepper.n)
        self._follow, self._servo_ready = True, False
        self._follower: Follower | None = None
        self._playback: Playback | None = None
        self._run: LiveRun | None = None
        self._now, self._read_at, self._aimed_at, self._scene_at = 0.0, -1.0, -1.0, -1.0
        self._scene_waits = self._unread = False
        self._answered = True
        self._messages = 0
        self._draw_robot()
        self.touch()

    def _draw_robot(self) -> None:
        layers = layers_of(self.pepper, self.targets)
        for layer, drawables in layers.items():
            self.board.draw((*ROBOT_ROOT, layer), drawables)
        for layer, drawables in sketches_of(self.pepper, layers).items():
            self.board.draw((*ROBOT_ROOT, SKETCHES, layer), drawables)
        self.available = tuple(layer for layer in LAYERS if layers[layer])
        bodies = {d.link for drawables in layers.values() for d in drawables if d.link is not None}
        self._links = tuple(name for name in self.pepper.frame_names if name in bodies)
        self._poses = BodyPoses(self.pepper, self._links, self.targets)
        self.document.set("show", {layer: layer == VISUAL for layer in self.available})
        for layer in (*self.available, SKETCHES):
            self.board.show((*ROBOT_ROOT, layer), layer == VISUAL)
        self.document.set("bodies", list(self._poses.names))

    @property
    def q(self) -> Array:
        """Present joint positions, shape (n,) [rad or m]."""
        return self._q

    @property
    def scene(self) -> Scene:
        """Scene around the robot."""
        return self._world.scene

    def touch(self) -> None:
        """Record a change that affects poses and readings."""
        self.targets.keep_with(self._q)
        self._unread = True

    # ---- joints

    def set_joint(self, name: str, value: float) -> None:
        """Set a joint's position; the targets are released.

        Raises:
            UnknownNameError: for an unknown joint.
            LimitError: for a value beyond the joint's limits.
        """
        q = self._q.copy()
        q[self.pepper.joint_index(name)] = value
        check_within_limits(self.pepper, q, "joint position")
        self.set_joints(q)

    def set_joints(self, q: ArrayLike) -> None:
        """Set all joint positions, shape (n,) [rad or m]; the targets are released.

        Raises:
            InvalidValueError: for a wrong shape, NaN or infinity.
        """
        positions = as_joint_vector(self.pepper, q, "q")
        self.targets.release()
        self._leave(FREE)
        self._retract()
        self._q, self._v, self._a = positions.copy(), np.zeros(self.pepper.n), np.zeros(self.pepper.n)
        self.touch()

    def posture(self, name: str) -> None:
        """Set a named posture.

        Raises:
            UnknownNameError: for an unknown posture.
        """
        self.set_joints(self.pepper.posture(name))

    # ---- display

    def show(self, layer: str, on: bool) -> None:
        """Show or hide a layer.

        Raises:
            UnknownNameError: for a layer that the robot does not have.
        """
        if layer not in self.available:
            raise UnknownNameError("layer", layer, self.available)
        self.document.set("show", {**self.document["show"], layer: on})
        self.board.show((*ROBOT_ROOT, layer), on)
        self.touch()

    def set_markers(self, markers: tuple[Drawable, ...]) -> None:
        """Replace the markers."""
        self.board.draw(MARKER_ROOT, markers)

    def say(self, text: str, kind: str = "info") -> None:
        """Show a text in the message line; `kind` is "info", "good" or "bad"."""
        self._messages += 1
        self.document.set("message", {"text": text, "kind": kind, "count": self._messages})

    def answer(self, text: str, kind: str) -> None:
        """Show the outcome of a command, until the targets change."""
        self._answered = True
        self.say(text, kind)

    def _retract(self) -> None:
        """Clear the message about former targets, and invalidate pending results about them."""
        self.target_revision += 1
        self._answered = True
        self.say("")

    # ---- targets

    def move_target(self, name: str, position: Array, stamp: int = 0) -> None:
        """Move a target to a position, shape (3,) [m]; the robot follows it if following is on.

        Raises:
            UnknownNameError: for an unknown target.
        """
        target = self.targets[name]
        target.position, target.on = np.array(position), True
        if stamp:
            self.stamp = stamp
        self.on_target(name, target.position)
        self._pursue()

    def release(self, name: str | None = None) -> None:
        """Release a target, or all targets, which return to the hand or gaze.

        Raises:
            UnknownNameError: for an unknown target.
        """
        if name is None:
            self.targets.release()
        else:
            self.targets[name].on = False
        self._retract()
        self.touch()
        if self.mode in (FOLLOWING, LIVE):
            self._pursue()

    def set_follow(self, on: bool) -> None:
        """Set whether the robot follows targets at once, or waits for a plan."""
        self._follow = on
        if on and self.targets.any_on:
            self._pursue()
        elif not on and self.mode == FOLLOWING:
            self._leave(FREE)
            self._retract()

    def servo_ready(self) -> None:
        """Start to follow, as the servo is loaded."""
        self._servo_ready = True
        if self.targets.any_on:
            self._pursue()

    def _pursue(self) -> None:
        """Aim the live run or the follower at the present targets."""
        self.touch()
        if self._run is not None:
            self._run.aim(self.targets.tasks())
            return
        if not self._follow:
            return
        if not self._servo_ready:
            self._tasks.warm_up(self)
            return
        if self.mode != FOLLOWING or self._follower is None:
            self._leave(FOLLOWING)
            self._follower = Follower(self.pepper, self._q, self.scene)
        if self._answered:
            self._answered, self._aimed_at = False, self._now
        self._follower.aim(self.targets.tasks())

    def _leave(self, mode: str) -> None:
        """Change the mode: free, following targets, playing a motion, or a live run."""
        if self._playback is not None:
            self._playback.playing = False
        if mode != FOLLOWING:
            self._follower = None
        if mode != LIVE:
            self._run = None
        self.mode = mode

    # ---- the scene

    def set_scene(self, scene: Scene) -> None:
        """Replace the scene.

        Raises:
            UnknownNameError: for an object on a frame that the robot does not have.
        """
        self._world.replace(scene)
        for held in scene.attached.values():
            self._carry(held.frame)
        self._scene_waits = True
        if self.mode == FOLLOWING and self._answered:
            self._answered, self._aimed_at = False, self._now
        self.touch()

    def _carry(self, frame: str) -> None:
        """Add a frame to the sent poses."""
        if frame not in self._links:
            self._links = (*self._links, frame)
            self._poses = BodyPoses(self.pepper, self._links, self.targets)
            self.document.set("bodies", list(self._poses.names))

    def add_obstacle(self, kind: str, position: Array | None = None, size: Array | None = None) -> str:
        """Add an obstacle at a position, shape (3,) [m]; return its name.  See `obstacles.added`."""
        scene, name = obstacles.added(self.scene, kind, position, size)
        self.set_scene(scene)
        return name

    def change_obstacle(
        self, name: str, position: Array | None = None, size: Array | None = None, color: Array | None = None
    ) -> None:
        """Move (position of shape (3,) [m]), size or color an obstacle.  See `obstacles.changed`."""
        self.set_scene(obstacles.changed(self.scene, name, position, size, color))

    def remove_obstacle(self, name: str) -> None:
        """Remove an obstacle or an attached object.

        Raises:
            UnknownNameError: for an unknown object.
        """
        self.set_scene(self.scene.remove(name))

    # ---- motions

    def plan(self) -> None:
        """Plan from the present posture to the set targets; the outcome comes later, in the message line."""
        tasks = self.targets.tasks()
        if not tasks:
            self.answer("Nothing to plan to: set a target first, by dragging a colored ball.", "bad")
            return
        self._tasks.plan(self, tasks)

    def go(self) -> None:
        """Start a live run to the set targets, around obstacles, until they are released."""
        if not self.targets.any_on:
            self.answer("Nowhere to go: set a target first, by dragging a colored ball.", "bad")
            return
        if self._run is None:
            self._leave(LIVE)
            self._run = LiveRun(self.pepper, self._q)
        self._pursue()

    def load(self, shown: Shown, play: bool) -> None:
        """Load a motion at its start, and play it if `play`."""
        self._leave(MOTION)
        self._retract()
        self._playback = playback = Playback(shown.motion)
        self.document.set(
            "motion",
            {
                "title": shown.title, "start": playback.start, "end": playback.end,
                "way": np.round(shown.way, 3).tolist(), **shown.curves.as_dict(),
            },
        )  # fmt: skip
        self.board.draw(GHOST_ROOT, shown.ghost)
        if play:
            playback.play()
        self._take_motion()

    def play(self) -> None:
        """Play the motion."""
        self._moving().play()

    def pause(self) -> None:
        """Stop playing."""
        self._moving().playing = False

    def seek(self, time: float) -> None:
        """Go to a time of the motion [s]."""
        self._moving().seek(time)

    def set_speed(self, value: float) -> None:
        """Set the speed of the playback."""
        self._moving(enter=False).set_speed(value)

    def set_loop(self, on: bool) -> None:
        """Set whether the motion repeats."""
        self._moving(enter=False).loop = on

    def clear(self) -> None:
        """Remove the motion; the robot stays where it is."""
        self._leave(FREE)
        self._retract()
        self._playback = None
        self.document.set("motion", None)
        self.board.erase(GHOST_ROOT)
        self.touch()

    def _moving(self, enter: bool = True) -> Playback:
        if self._playback is None:
            raise InvalidValueError("motion", "none", "a planned or loaded motion: plan to a target first")
        if enter and self.mode != MOTION:
            if self.mode == FOLLOWING:
                self._retract()
            self._leave(MOTION)
        self._unread = True
        return self._playback

    def _take_motion(self) -> None:
        assert self._playback is not None
        self._q, self._v, self._a = self._playback.state()
        self.touch()

    # ---- time

    @property
    def resting(self) -> bool:
        """Whether nothing changes until the next command."""
        if self._unread or self._scene_waits or self.alerts.pending:
            return False
        if self.mode == FOLLOWING and self._follower is not None:
            return self._follower.resting
        if self._run is not None:
            return self._run.resting
        return not (self.mode == MOTION and self._playback is not None and self._playback.playing)

    @property
    def wait(self) -> float:
        """Time until the next tick is due [s]."""
        follower = self._follower
        return 1.0 / RATE if follower is None or follower.resting else follower.wait

    def tick(self, seconds: float) -> None:
        """Advance the state by wall time [s]."""
        self._now += seconds
        if self._scene_waits and self._now - self._scene_at >= SCENE_STEP:
            self._scene_waits, self._scene_at = False, self._now
            if self._follower is not None:
                self._follower.set_scene(self.scene)
        if self.mode == FOLLOWING and self._follower is not None:
            self._tick_follower(self._follower, seconds)
        elif self._run is not None:
            self._tick_run(self._run, seconds)
        elif self.mode == MOTION and self._playback is not None:
            self._playback.advance(seconds)
            self._take_motion()
        if self._unread and self._now - self._read_at >= READING_STEP:
            self._read_at, self._unread = self._now, False
            self._read()
        self.alerts.pass_time(self._now)
        self.document.set("alerts", self.alerts.as_list())

    def _read(self) -> None:
        self.document.set("live", self.readings.take(self._now, self._q, self._v, self._a, self.scene))
        self.alerts.touch(self._q, self.scene)
        self.document.set("touching", self.alerts.touching(self.scene))
        if self.mode == FREE:
            still = np.zeros_like(self._q)
            self.alerts.strain(self._now, self._q, still, still, self.scene)
        elif self.mode == MOTION:
            self.alerts.calm()

    def _tick_follower(self, follower: Follower, seconds: float) -> None:
        done = follower.advance(seconds)
        if done is None:
            return
        state, self._a = done
        self._q, self._v = np.array(state.q), np.array(state.v)
        self.alerts.strain(self._now, self._q, self._v, self._a, self.scene)
        self.touch()
        tasks = self.targets.tasks()
        if self._answered or not tasks:
            return
        if follower.arrived:
            self.answer(at_target(tasks), "good")
        elif follower.stalled:
            self._answered = True
            self._tasks.explain(self, tasks)
        elif self._now - self._aimed_at >= ON_THE_WAY:
            text = on_the_way(tasks)
            if self.document["message"]["text"] != text:
                self.say(text)

    def _tick_run(self, run: LiveRun, seconds: float) -> None:
        since = run.advance(seconds)
        if since is not None:
            if self.scene.movers:
                self._world.replace(self.scene.at(since, enlarged=False))
            run.begin(self.scene)
        if run.state is None:
            return
        q, self._v, self._a = run.shown
        if not np.array_equal(q, self._q):
            self._q = q
            self.touch()
            self.alerts.strain(self._now, self._q, self._v, self._a, self.scene)
        text, kind = run.report()
        if self.document["message"]["text"] != text:
            self.answer(text, kind)
        if run.stopped:
            self._leave(FREE)

    # ---- for the pages

    def refresh(self) -> None:
        """Update the document."""
        document = self.document
        document.set("q", np.round(self._q, 5).tolist())
        document.set("mode", self.mode)
        document.set("follow", self._follow)
        document.set("targets", self.targets.as_dict())
        document.set("obstacles", obstacles.as_list(self.scene))
        document.set("held", list(self.scene.attached))
        document.set("play", None if self._playback is None else self._playback.as_dict())

    def poses(self) -> bytes:
        """Return the packed poses of all bodies; see `BodyPoses`."""
        shown = self.document["show"]
        return self._poses.packed(self._q, self._v, self._a, shown, self.stamp, self.scene)

    def about(self) -> dict[str, Any]:
        """Return the constant data: joints, limits, groups, postures, layers and targets."""
        return robot_facts(self.pepper, self.available) | {
            "targets": list(self.targets.names),
            "kinds": {kind: list(obstacles.size_names(kind)) for kind in obstacles.KINDS},
            "roots": {"robot": list(ROBOT_ROOT), "targets": TARGETS, "obstacles": list(OBSTACLE_ROOT)},
            "sketches": SKETCHES,
        }

    def fail(self, error: Exception) -> None:
        """Show an error in the message line."""
        known = isinstance(error, PepperKinError)
        self.say(str(error) if known else f"{type(error).__name__}: {error}", "bad")
