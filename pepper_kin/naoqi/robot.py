"""A robot that speaks NAOqi, seen from outside: its state, and motions with a certificate (extra `naoqi`)."""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.collision import Scene
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.file_access import atomic_file
from pepper_kin.files.certified import pepper_with_joints, refuse_unsafe
from pepper_kin.files.naoqi_file import naoqi_arguments
from pepper_kin.model import PepperModel, load_pepper
from pepper_kin.model.joint_vectors import as_finite, check_choice, check_positive
from pepper_kin.motion import LiveMotion
from pepper_kin.naoqi import on_robot
from pepper_kin.naoqi.errors import NaoqiError
from pepper_kin.naoqi.follow_motions import BezierMotion, StreamMotion
from pepper_kin.naoqi.following import SILENCE, FollowOptions, RobotMotionResult
from pepper_kin.naoqi.hosted_twin import hosted_twin
from pepper_kin.naoqi.joint_names import ACTUATED
from pepper_kin.naoqi.link import ANSWER, RobotLink
from pepper_kin.naoqi.live_stream import EachCycle, LiveStream
from pepper_kin.naoqi.robot_motion import BaseOptions, CommandedMotion, DriveMotion, MoveToMotion
from pepper_kin.naoqi.robot_state import BASE, RobotState, StateReader
from pepper_kin.naoqi.simulated_time import CYCLE
from pepper_kin.supervision import Clock, Supervisor
from pepper_kin.trajectory import Trajectory

METHODS = {"stream": StreamMotion, "bezier": BezierMotion}

AT_START = 0.03
"""How far joints may be from the start of a motion [rad or share]."""

STIFF = 0.5
"""Stiffness from which a motor counts as on."""

APPROACH = 0.4
"""Share of the fastest speed with which a dry run goes to the start."""


class Robot:
    """A robot, or a simulated one, by its NAOqi.

        with Robot("tcp://pepper.local:9559") as robot:
            state = robot.state()

    Args:
        url: Where its NAOqi listens.
        token: What the service "Access" of a simulated robot takes, where it needs one.
        pepper: Model with a planar base and hands of one joint; `load_pepper` makes it if omitted.
        timeout: The longest time that an answer takes [s].

    Attributes:
        url: Where its NAOqi listens.
        pepper: The model, whose order and names the states have.
        has_watchdog: Whether something on the robot stops it when this process falls silent.

    Raises:
        MissingDependencyError: where `qi` is not installed.
        RobotConnectionError: where nobody answers.
        InvalidValueError: for a model with joints that NAOqi does not know.
    """

    def __init__(
        self,
        url: str,
        *,
        token: str | None = None,
        pepper: PepperModel | None = None,
        timeout: float = ANSWER,
    ) -> None:
        self.url = url
        self.pepper = load_pepper(base="planar", hands="mimic") if pepper is None else pepper
        self._link = RobotLink(url, token, check_positive("timeout", timeout, "s"))
        self._clock = Clock()
        self._reader = StateReader(self._link, self.pepper, self._clock)
        self._motions: set[Supervisor[CommandedMotion]] = set()
        self._lock = threading.Lock()
        self.has_watchdog = self._watchdog_is_there()

    def __enter__(self) -> Robot:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def connected(self) -> bool:
        """Whether the connection stands, as far as the system knows."""
        return self._link.alive

    def close(self) -> None:
        """End the connection."""
        self._link.close()

    def state(self) -> RobotState:
        """Return what the robot measures now.

        Raises:
            RobotConnectionError: where no answer comes.
        """
        return self._reader.read()

    def states(self, seconds: float | None = None, period: float = CYCLE) -> Iterator[RobotState]:
        """Yield what the robot measures, again and again.

        Args:
            seconds: How long [s]; without an end if omitted.
            period: Time between two states [s]; a late one delays the next.

        Raises:
            RobotConnectionError: where no answer comes.
            InvalidValueError: for a time that is not above zero.
        """
        check_positive("period", period, "s")
        end = math.inf if seconds is None else time.monotonic() + check_positive("seconds", seconds, "s")
        due = time.monotonic()
        while time.monotonic() < end:
            yield self.state()
            due = max(due + period, time.monotonic())
            time.sleep(max(due - time.monotonic(), 0.0))

    def wake_up(self) -> None:
        """Switch the motors on; the robot stands up."""
        self._link.call("ALMotion", "wakeUp", timeout=60.0)

    def rest(self) -> None:
        """Let the robot go to its rest posture and switch the motors off."""
        self._link.call("ALMotion", "rest", timeout=60.0)

    def stop(self) -> None:
        """Stop joints and base; motions of this object, in whatever state, end with STOPPED.

        With a watchdog motions of other clients end, too, and it holds the robot until it is at rest.

        Raises:
            RobotConnectionError: where no answer comes.
        """
        with self._lock:
            motions = tuple(self._motions)
        for supervisor in motions:
            supervisor.request_stop()
        with contextlib.suppress(NaoqiError):  # it may be gone: then without it
            if self.has_watchdog:
                self._link.call(on_robot.NAME, "halt", 0, "stop() was called")
                return
        supervised = [supervisor.motion.moved for supervisor in motions]  # each holds what it moves
        taken = {name for moved in supervised for name in moved.joints}
        joints = [name for name in self.pepper.joint_names if name in ACTUATED and name not in taken]
        if joints:
            on_robot.hold_joints(self._link.proxy("ALMotion"), joints)
        if not any(moved.base for moved in supervised):
            self._link.call("ALMotion", "stopMove")

    def follow(
        self,
        trajectory: Trajectory,
        *,
        scene: Scene | None = None,
        payload: Mapping[str, float] | None = None,
        method: str = "stream",
        options: FollowOptions | None = None,
        unguarded: bool = False,
    ) -> RobotMotionResult:
        """Make the motion of a trajectory; returns when it is over.

        "stream" sends targets by `setAngles` at 50 Hz, and velocities of the base that correct its odometry;
        a delay makes the motion slower, not faster.  "bezier" hands the whole motion to
        `angleInterpolationBezier`, which moves joints only, and watches it.  A trajectory's base begins where
        the robot stands.

        Args:
            trajectory: With joints of Pepper in the order of `load_pepper`; it must pass its certificate.
            scene: What the certificate looks at around the robot.
            payload: Point masses that the certificate counts with, by hand or frame [kg].
            method: "stream" or "bezier".
            options: Tolerances and times.
            unguarded: Whether to drive the base or use "bezier" on a robot without a watchdog, which goes on
                when this process is lost.

        Returns:
            How it ended and what was measured.

        Raises:
            InvalidValueError: for a motion without a certificate, one that begins elsewhere, motors that are
                off, or where `unguarded` would be needed.
            RobotConnectionError: where the robot does not answer before the motion.
        """
        kind = METHODS[check_choice("method", method, tuple(METHODS))]
        robot = robot_of(trajectory)
        self._check_method(trajectory, method, unguarded)

        def check() -> RobotState:
            refuse_unsafe(trajectory, robot, scene, payload, False, advice="")
            if isinstance(motion, BezierMotion):  # what ALMotion interpolates is certified as well
                motion.curves = naoqi_arguments(trajectory, pepper=robot, scene=scene, payload=payload)
            return self._check_start(trajectory)

        chosen = FollowOptions() if options is None else options
        motion: CommandedMotion = kind(
            self._link, robot, trajectory, chosen, self.has_watchdog, self._clock, check
        )
        return self._supervised(motion)

    def follow_live(
        self, live: LiveMotion, each_cycle: EachCycle, *, options: FollowOptions | None = None
    ) -> RobotMotionResult:
        """Make a live motion of joints; returns when it is over.

            live = LiveMotion(pepper, robot.state().of(pepper.joint_names), delay=0.2)
            robot.follow_live(live, each_cycle)

        Targets are sent at 50 Hz, and measured states reported to the motion.

        Args:
            live: The motion, of Pepper without a base that drives, from where the robot is.
            each_cycle: Called before each cycle with the time of `time.monotonic` and the last `LiveState`,
                None at first: it may set the goal and the scene, and returns whether to go on.  Where it says
                no, or raises an error, the robot stops.
            options: Times; the tolerance is that of the live motion.

        Returns:
            How it ended, COMPLETED where `each_cycle` ended it and the robot stands, and what was measured.

        Raises:
            InvalidValueError: for joints that NAOqi has not, or a base; a motion that begins elsewhere; or
                motors that are off.
            RobotConnectionError: where the robot does not answer before the motion.
        """
        robot_of(live.trajectory)
        if any(name in BASE for name in live.pepper.joint_names):
            raise InvalidValueError("live", "a motion of a base", "one of joints: load_pepper(base='fixed')")
        chosen = FollowOptions() if options is None else options

        def check() -> RobotState:
            return self._check_start(live.trajectory)

        base = BaseOptions(chosen, self.has_watchdog, self._clock)
        return self._supervised(LiveStream(self._link, self.pepper, base, live, each_cycle, check))

    def move_to(
        self,
        pose: ArrayLike,
        *,
        timeout: float = 60.0,
        silence: float = SILENCE,
        unguarded: bool = False,
    ) -> RobotMotionResult:
        """Drive to a pose in the robot's own axes by its `moveTo`.

        The robot avoids obstacles by itself; there is no certificate.

        Args:
            pose: x, y [m], yaw [rad], shape (3,).
            timeout: The longest time [s].
            silence: As in `FollowOptions` [s].
            unguarded: Whether to do it on a robot without a watchdog.

        Returns:
            How it ended, COMPLETED where it arrived, and what was measured; true where it arrived.

        Raises:
            InvalidValueError: where `unguarded` would be needed.
        """
        goal = [float(x) for x in as_finite(pose, "pose", (3,))]
        limit = check_positive("timeout", timeout, "s")
        return self._supervised(MoveToMotion(*self._base_motion("move_to", silence, unguarded), goal, limit))

    def drive(
        self, twist: ArrayLike, seconds: float, *, silence: float = SILENCE, unguarded: bool = False
    ) -> RobotMotionResult:
        """Drive with a velocity for some time, then stop; there is no certificate.

        Args:
            twist: v_x, v_y [m/s], omega [rad/s] in the robot's axes, shape (3,).
            seconds: How long [s].
            silence: As in `FollowOptions` [s].
            unguarded: Whether to do it on a robot without a watchdog.

        Returns:
            How it ended, COMPLETED where it drove for that time and stands, and what was measured.

        Raises:
            InvalidValueError: where `unguarded` would be needed.
        """
        velocity = [float(x) for x in as_finite(twist, "twist", (3,))]
        time = check_positive("seconds", seconds, "s")
        return self._supervised(DriveMotion(*self._base_motion("drive", silence, unguarded), velocity, time))

    def _base_motion(
        self, what: str, silence: float, unguarded: bool
    ) -> tuple[RobotLink, PepperModel, BaseOptions]:
        self._need_guard(what, unguarded)
        options = FollowOptions(silence=check_positive("silence", silence, "s"))
        return self._link, self.pepper, BaseOptions(options, self.has_watchdog, self._clock)

    def _supervised(self, motion: CommandedMotion) -> RobotMotionResult:
        """Make a motion, which `stop` knows from its check on."""
        supervisor = Supervisor(motion, self._clock)
        with self._lock:
            self._motions.add(supervisor)
        try:
            return motion.result(supervisor.run())
        finally:
            with self._lock:
                self._motions.discard(supervisor)

    @staticmethod
    def dry_run(
        trajectory: Trajectory,
        *,
        scene: Scene | None = None,
        payload: Mapping[str, float] | None = None,
        method: str = "stream",
        options: FollowOptions | None = None,
    ) -> RobotMotionResult:
        """Make the motion on a simulated robot that is hosted meanwhile by another process.

        All messages travel as to the robot: see `follow`, whose arguments and results these are.

        Raises:
            InfeasibleError: where the simulated robot does not start.
            InvalidValueError: as `follow` does.
        """
        refuse_unsafe(trajectory, robot_of(trajectory), scene, payload, False, advice="")
        with hosted_twin(scene) as (url, _), Robot(url) as robot:
            joints, start = _joints_of(trajectory)
            if joints:
                arguments = (joints, start, APPROACH)
                robot._link.call("ALMotion", "angleInterpolationWithSpeed", *arguments, timeout=60.0)
            return robot.follow(trajectory, scene=scene, payload=payload, method=method, options=options)

    @staticmethod
    def write_watchdog(path: str | Path) -> Path:
        """Write the watchdog that runs on the robot, in Python 2.7 or 3: `python FILE` there."""
        return atomic_file.write_text(path, Path(on_robot.__file__).read_text("utf-8"))

    def _watchdog_is_there(self) -> bool:
        if on_robot.NAME not in self._link.names():
            return False
        try:
            return int(self._link.call(on_robot.NAME, "protocol")) == on_robot.PROTOCOL
        except NaoqiError:
            return False  # of an earlier version, which cannot end what arrives late

    def _need_guard(self, what: str, unguarded: bool) -> None:
        if not self.has_watchdog and not unguarded:
            raise InvalidValueError(
                "robot",
                f"one without the service {on_robot.NAME!r}, version {on_robot.PROTOCOL}",
                f"the watchdog of `pepper-kin naoqi watchdog` running on it, or unguarded=True for {what}",
            )

    def _check_method(self, trajectory: Trajectory, method: str, unguarded: bool) -> None:
        driven = any(name in BASE for name in trajectory.joint_names)
        if method == "bezier":
            if driven:
                raise InvalidValueError("method", "'bezier' for a motion of the base", "'stream'")
            if np.abs(trajectory(0.0).velocity).max(initial=0.0) > 1e-6:
                raise InvalidValueError("trajectory", "one that begins in motion", "'stream' for it")
        if driven or method == "bezier":
            self._need_guard(f"method={method!r}", unguarded)

    def _check_start(self, trajectory: Trajectory) -> RobotState:
        """Return where the robot is, if that is where a trajectory begins and its motors are on."""
        state = self.state()
        joints, start = _joints_of(trajectory)
        off = np.abs(state.of(joints) - start)
        if not off.max(initial=0.0) <= AT_START:
            k = int(np.argmax(off))
            raise InvalidValueError(
                f"start of {joints[k]}",
                f"{start[k]:.3f}, where the robot is at {state.of(joints)[k]:.3f}",
                f"a motion from where the robot is, within {AT_START} rad: plan from state().q",
            )
        limp = [n for n in joints if not state.stiffness[self.pepper.joint_index(n)] >= STIFF]
        if limp:
            raise InvalidValueError("motors", f"{', '.join(limp)} off", "motors that are on: wake_up()")
        return state


def robot_of(trajectory: Trajectory) -> PepperModel:
    """Return the robot of a trajectory.

    Raises:
        InvalidValueError: for joints that NAOqi does not know.
    """
    robot = pepper_with_joints(trajectory.joint_names)
    if robot is None or any(name not in (*ACTUATED, *BASE) for name in trajectory.joint_names):
        raise InvalidValueError(
            "joints of the trajectory",
            ", ".join(trajectory.joint_names),
            "those of load_pepper with hands='locked' or hands='mimic'",
        )
    return robot


def _joints_of(trajectory: Trajectory) -> tuple[Sequence[str], list[float]]:
    """Return the joints besides the base, and where they begin [rad or share]."""
    pairs = [
        (name, float(x))
        for name, x in zip(trajectory.joint_names, trajectory.start, strict=True)
        if name not in BASE
    ]
    return [name for name, _ in pairs], [x for _, x in pairs]
