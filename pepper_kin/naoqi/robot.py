"""Client of a robot with NAOqi: its state, and motions with a certificate (extra `naoqi`)."""

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
"""Largest deviation of a joint from the start of a motion [rad or fraction]."""

STIFF = 0.5
"""Stiffness from which a motor counts as on."""

APPROACH = 0.4
"""Fraction of the maximum speed with which a dry run goes to the start."""


class Robot:
    """Client of a robot, real or simulated, that runs NAOqi.

        with Robot("tcp://pepper.local:9559") as robot:
            state = robot.state()

    Args:
        url: Address of the robot's NAOqi.
        token: Token for the service "Access" of a simulated robot that requires one.
        pepper: Model with a planar base and hands of one joint; loaded by `load_pepper` if omitted.
        timeout: Timeout of each answer [s].

    Attributes:
        url: Address of the robot's NAOqi.
        pepper: Model of the robot; states have its joints in its order.
        has_watchdog: Whether a watchdog on the robot stops it when this process sends no heartbeats.

    Raises:
        MissingDependencyError: if `qi` is not installed.
        RobotConnectionError: if nothing answers.
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
        """Whether the session is connected, as far as libqi knows."""
        return self._link.alive

    def close(self) -> None:
        """Close the connection."""
        self._link.close()

    def state(self) -> RobotState:
        """Return the measured state of the robot.

        Raises:
            RobotConnectionError: if no answer comes in time.
        """
        return self._reader.read()

    def states(self, seconds: float | None = None, period: float = CYCLE) -> Iterator[RobotState]:
        """Yield measured states periodically.

        Args:
            seconds: Duration [s]; unlimited if omitted.
            period: Time between two states [s]; a late state delays the next one.

        Raises:
            RobotConnectionError: if no answer comes in time.
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
        """Move the robot to its rest posture, and switch the motors off."""
        self._link.call("ALMotion", "rest", timeout=60.0)

    def stop(self) -> None:
        """Stop joints and base; all motions of this object end with STOPPED.

        With a watchdog, motions of other clients end, too, and the robot is held until it is at rest.

        Raises:
            RobotConnectionError: if no answer comes in time.
        """
        with self._lock:
            motions = tuple(self._motions)
        for supervisor in motions:
            supervisor.request_stop()
        with contextlib.suppress(NaoqiError):  # if the watchdog is gone, stop without it
            if self.has_watchdog:
                self._link.call(on_robot.NAME, "halt", 0, "stop() was called")
                return
        supervised = [supervisor.motion.moved for supervisor in motions]  # held by their own supervisors
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
        """Follow a trajectory; return when the motion has ended.

        "stream" sends targets by `setAngles` at 50 Hz, and velocities of the base that correct its odometry;
        a delay makes the motion slower, not faster.  "bezier" hands the whole motion to
        `angleInterpolationBezier`, which moves joints only, and watches it.  A trajectory's base starts at
        the robot's pose.

        Args:
            trajectory: Trajectory of joints in the order of `load_pepper`; it must pass its certificate.
            scene: Obstacles and attached objects for the certificate.
            payload: Point masses for the certificate, by hand or frame [kg].
            method: "stream" or "bezier".
            options: Tolerances and times.
            unguarded: Whether to allow a moving base or "bezier" on a robot without a watchdog, which goes on
                moving when this process is lost.

        Returns:
            Outcome and measured motion.

        Raises:
            InvalidValueError: for a motion without a certificate, a start other than the robot's state,
                motors that are off, or a missing `unguarded`.
            RobotConnectionError: if the robot does not answer before the motion.
        """
        kind = METHODS[check_choice("method", method, tuple(METHODS))]
        robot = robot_of(trajectory)
        self._check_method(trajectory, method, unguarded)

        def check() -> RobotState:
            refuse_unsafe(trajectory, robot, scene, payload, False, advice="")
            if isinstance(motion, BezierMotion):  # ALMotion's interpolation is certified as well
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
        """Run a live motion of joints; return when it has ended.

            live = LiveMotion(pepper, robot.state().of(pepper.joint_names), delay=0.2)
            robot.follow_live(live, each_cycle)

        Targets are sent at 50 Hz, and measured states are fed back to the motion.

        Args:
            live: Live motion of Pepper without a moving base, which starts at the robot's state.
            each_cycle: Called before each cycle with the time of `time.monotonic` and the last `LiveState`,
                None at first.  It may set the goal and the scene, and returns whether to go on; the robot
                stops if it returns False or raises an error.
            options: Times; the live motion has its own tolerance.

        Returns:
            Outcome, COMPLETED if `each_cycle` ended it and the robot is at rest, and the measured motion.

        Raises:
            InvalidValueError: for joints that NAOqi does not have, a base, a start other than the robot's
                state, or motors that are off.
            RobotConnectionError: if the robot does not answer before the motion.
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
        """Drive to a pose in the robot's frame by its own `moveTo`.

        The robot avoids obstacles by itself; there is no certificate.

        Args:
            pose: Pose x, y [m], yaw [rad], shape (3,).
            timeout: Maximum time of the motion [s].
            silence: Time without a heartbeat after which the watchdog stops the robot [s].
            unguarded: Whether to allow a robot without a watchdog.

        Returns:
            Outcome, COMPLETED if the robot arrived, and the measured motion; true if it arrived.

        Raises:
            InvalidValueError: for a robot without a watchdog, unless `unguarded`.
        """
        goal = [float(x) for x in as_finite(pose, "pose", (3,))]
        limit = check_positive("timeout", timeout, "s")
        return self._supervised(MoveToMotion(*self._base_motion("move_to", silence, unguarded), goal, limit))

    def drive(
        self, twist: ArrayLike, seconds: float, *, silence: float = SILENCE, unguarded: bool = False
    ) -> RobotMotionResult:
        """Drive with a velocity for a duration, then stop; there is no certificate.

        Args:
            twist: Velocity v_x, v_y [m/s], omega [rad/s] in the robot's axes, shape (3,).
            seconds: Duration [s].
            silence: Time without a heartbeat after which the watchdog stops the robot [s].
            unguarded: Whether to allow a robot without a watchdog.

        Returns:
            Outcome, COMPLETED if it drove for the duration and is at rest, and the measured motion.

        Raises:
            InvalidValueError: for a robot without a watchdog, unless `unguarded`.
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
        """Run a motion, which `stop` can end from its check on."""
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
        """Follow a trajectory on a simulated robot, hosted by another process for the time of the motion.

        All messages are sent as to a real robot; arguments and results are the same as of `follow`.

        Raises:
            InfeasibleError: if the simulated robot does not start.
            InvalidValueError: for the reasons of `follow`.
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
        """Write the watchdog for the robot, a program in Python 2.7 and 3; run `python FILE` there."""
        return atomic_file.write_text(path, Path(on_robot.__file__).read_text("utf-8"))

    def _watchdog_is_there(self) -> bool:
        """Return whether the robot runs the watchdog in the present version of its protocol."""
        if on_robot.NAME not in self._link.names():
            return False
        try:
            return int(self._link.call(on_robot.NAME, "protocol")) == on_robot.PROTOCOL
        except NaoqiError:
            return False  # an earlier version, which cannot drop late commands

    def _need_guard(self, what: str, unguarded: bool) -> None:
        """Raise for a robot without a watchdog, unless `unguarded`."""
        if not self.has_watchdog and not unguarded:
            raise InvalidValueError(
                "robot",
                f"one without the service {on_robot.NAME!r}, version {on_robot.PROTOCOL}",
                f"the watchdog of `pepper-kin naoqi watchdog` running on it, or unguarded=True for {what}",
            )

    def _check_method(self, trajectory: Trajectory, method: str, unguarded: bool) -> None:
        """Raise if a method cannot make the motion, or needs a watchdog."""
        driven = any(name in BASE for name in trajectory.joint_names)
        if method == "bezier":
            if driven:
                raise InvalidValueError("method", "'bezier' for a motion of the base", "'stream'")
            if np.abs(trajectory(0.0).velocity).max(initial=0.0) > 1e-6:
                raise InvalidValueError("trajectory", "one that begins in motion", "'stream' for it")
        if driven or method == "bezier":
            self._need_guard(f"method={method!r}", unguarded)

    def _check_start(self, trajectory: Trajectory) -> RobotState:
        """Return the robot's state; raise unless the trajectory starts there and its motors are on."""
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
    """Return the model of a trajectory's robot.

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
    """Return the joints without the base, and their start [rad or fraction]."""
    pairs = [
        (name, float(x))
        for name, x in zip(trajectory.joint_names, trajectory.start, strict=True)
        if name not in BASE
    ]
    return [name for name, _ in pairs], [x for _, x in pairs]
