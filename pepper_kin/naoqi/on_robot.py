# -*- coding: utf-8 -*-
"""A watchdog in front of ALMotion, which forwards commands of clients and stops the robot.

It stops a client's motion if the client's heartbeats are missing or it is asked to, and holds the joints and
the base until they are measured at rest.  Commands carry the number of a motion (a token): a command that
arrives after the end of its motion is dropped.

The simulated robot has the watchdog as a module.  For a real robot, copy this file, which needs Python 2.7 or
3 and no package but NAOqi's own `qi`:

    python on_robot.py [--url tcp://127.0.0.1:9559]
"""
# ruff: noqa: B905, UP004, UP009, UP010, UP030, UP032, SIM105 -- Python 2.7 runs this file on the robot

from __future__ import print_function

import random
import threading
import time

try:
    from typing import Any  # noqa: F401 -- for the comments
except ImportError:  # Python 2.7
    pass

NAME = "MotionWatchdog"
"""Name of the service."""

PROTOCOL = 2
"""Version of the service's methods."""

PERIOD = 0.02
"""Time between two polls [s]."""

HOLD = 0.3
"""Fraction of the maximum speed with which joints return to the position where they were stopped."""

REST_TIME, REST, BASE_REST = 0.2, 2e-3, 1e-3
"""Time window [s], and change of joints [rad] and base [m, rad] within it below which they are at rest."""

BRAKING = 0.3
"""Time in which joints brake; the command at its end is held afterwards [s]."""

LONGEST = 10.0
"""Maximum time of holding a motion that does not come to rest [s], after the end of its last call."""

BRAKE_EVERY, MOST_BRAKES = 0.1, 60
"""Time between two calls of `stopMove` [s], which may block, and maximum number of running calls."""

LATEST = 100
"""Number of ended motions whose state is kept."""

QUICK = ("setAngles", "move")
"""Methods of ALMotion for `command`, which return at once."""

LASTING = ("angleInterpolationBezier", "moveTo")
"""Methods of ALMotion for `start`, which last as long as the motion."""

now = getattr(time, "monotonic", time.time)


def in_thread(function):  # type: (Any) -> None
    """Run a function in a daemon thread."""
    thread = threading.Thread(target=function)
    thread.daemon = True
    thread.start()


class _Motion(object):
    """A motion of a client.

    The attribute `state` is "armed", "running", "finished: VALUE" or "failed: ERROR", and after the end
    "stopping: WHY", "at rest: WHY", "not at rest: WHY" or "released".
    """

    def __init__(self, limit, joints, base, at):  # type: (float, list[str], bool, float) -> None
        self.limit, self.joints, self.base, self.beat = limit, joints, base, at
        self.state, self.last, self.calls, self.brakes = "armed", 0, 0, 0
        self.parts = []  # type: list[Any]
        self.why, self.since, self.braked = "", 0.0, 0.0
        self.stopped, self.target = 0.0, None  # type: float, Any
        self.measured = []  # type: list[Any]


class MotionWatchdog(object):
    """Service that forwards commands of watched motions, and stops joints and base otherwise.

    Args:
        motion: ALMotion of the robot, or a proxy.
        clock: Returns the time [s].
        spawn: Runs a function asynchronously.
        watch: Whether a thread calls `look`; otherwise the caller does.
    """

    def __init__(self, motion, clock=now, spawn=in_thread, watch=True):  # type: (Any, Any, Any, bool) -> None
        self._motion = motion  # type: Any
        self._clock, self._spawn, self._watches = clock, spawn, watch
        self._lock = threading.RLock()
        self._armed = {}  # type: dict[int, _Motion]
        self._stopping = {}  # type: dict[int, _Motion]
        self._ended = {}  # type: dict[int, str]
        self._number = random.randrange(1, 1000000) * 1000  # unlike the tokens of an earlier watchdog
        self._thread = False
        self._said = ""

    def protocol(self):  # type: () -> int
        """Return the version of the methods."""
        return PROTOCOL

    def arm(self, seconds, joints, base):  # type: (float, Any, Any) -> int
        """Watch a motion from now on; return its token.

        Args:
            seconds: Maximum time without a heartbeat of the client [s], 0.05 to 10.
            joints: Names of the joints that the motion moves; no other watched motion may move them.
            base: Whether the motion moves the base.
        """
        limit = float(seconds)
        if not 0.05 <= limit <= 10.0:
            raise ValueError("seconds: got {0:g}, expected 0.05 to 10".format(limit))
        made = _Motion(limit, [str(name) for name in joints], bool(base), self._clock())
        with self._lock:
            for others, what in ((self._armed, "another client moves"), (self._stopping, "being stopped:")):
                for other in others.values():
                    taken = sorted(set(made.joints).intersection(other.joints))
                    taken += ["the base"] if made.base and other.base else []
                    if taken:
                        raise ValueError("joints: {0} {1}".format(what, ", ".join(taken)))
            self._number += 1
            self._armed[self._number] = made
            self._watch_on()
            return self._number

    def command(self, token, number, calls):  # type: (int, int, Any) -> str
        """Forward quick calls to ALMotion; return the motion's state.

        Args:
            token: Token of the motion; the command has no effect once the motion has ended.
            number: Increases from command to command; a command that arrives after a later one is dropped.
            calls: Pairs of a method's name, "setAngles" or "move", and its arguments.
        """
        with self._lock:
            motion = self._taken(token, number)
            if motion is None:
                return self.status(token)
            motion.calls += 1
        try:
            for method, arguments in calls:
                if method not in QUICK:
                    raise ValueError("calls: got {0}, expected one of {1}".format(method, ", ".join(QUICK)))
                getattr(self._motion, method)(*arguments)
        finally:
            self._done(motion)
        return self.status(token)

    def add(self, token, number, part):  # type: (int, int, Any) -> str
        """Store a part of the times and keys, by joint, for `start`; return the motion's state."""
        with self._lock:
            motion = self._taken(token, number)
            if motion is not None:
                motion.parts.append(part)
            return self.status(token)

    def start(self, token, number, method, arguments):  # type: (int, int, str, Any) -> str
        """Start a long call of ALMotion; return the motion's state.

        Args:
            token: Token of the motion.
            number: Increases from command to command.
            method: "moveTo" or "angleInterpolationBezier", with the times and keys of `add`.
            arguments: Arguments of the method, before the times and keys.
        """
        if method not in LASTING:
            raise ValueError("method: got {0}, expected one of {1}".format(method, ", ".join(LASTING)))
        with self._lock:
            motion = self._taken(token, number)
            if motion is None or motion.state != "armed":
                return self.status(token)
            motion.state = "running"
            motion.calls += 1
        values = list(arguments)
        if method == "angleInterpolationBezier":
            joints = range(len(motion.joints))
            values += [[[x for part in motion.parts for x in part[k][j]] for j in joints] for k in (0, 1)]

        def call():  # type: () -> None
            try:
                state = "finished: {0}".format(getattr(self._motion, method)(*values))
            except Exception as error:
                state = "failed: {0}".format(error)
            with self._lock:
                motion.state = state
                self._done(motion)

        self._spawn(call)
        return self.status(token)

    def beat(self, token):  # type: (int) -> str
        """Record a heartbeat of the client; return the motion's state."""
        with self._lock:
            motion = self._armed.get(int(token))
            if motion is not None:
                motion.beat = self._clock()
            return self.status(token)

    def release(self, token):  # type: (int) -> str
        """Stop watching a complete motion; return its state."""
        with self._lock:
            if self._armed.pop(int(token), None) is not None:
                self._remember(int(token), "released")
            return self.status(token)

    def halt(self, token, why):  # type: (int, str) -> str
        """End a motion, or all motions (token 0), and hold the robot until it is at rest; return the state.

        With token 0 all joints and the base are held, and the returned text is the token of that hold.
        """
        with self._lock:
            if int(token):
                self._end(int(token), str(why))
                return self.status(token)
            for one in list(self._armed):
                self._end(one, str(why))
            held = [name for motion in self._stopping.values() for name in motion.joints]
            body = [str(name) for name in self._motion.getBodyNames("Body")]
            joints = [name for name in body if not name.startswith("Wheel") and name not in held]
            base = not any(motion.base for motion in self._stopping.values())
            self._number += 1
            everything = _Motion(1.0, joints, base, self._clock())
            self._armed[self._number] = everything
            self._end(self._number, str(why))
            self._watch_on()
            return "{0}".format(self._number)

    def status(self, token):  # type: (int) -> str
        """Return the state of a motion; "unknown" for an unknown token."""
        with self._lock:
            token = int(token)
            if token in self._armed:
                return self._armed[token].state
            if token in self._stopping:
                return "stopping: {0}".format(self._stopping[token].why)
            return self._ended.get(token, "unknown")

    def look(self):  # type: () -> bool
        """End motions without heartbeats, and hold the stopping ones; return whether any motion is left."""
        with self._lock:
            at = self._clock()
            for token, motion in list(self._armed.items()):
                if at - motion.beat > motion.limit:
                    self._end(token, "no beat for {0:.2f} s".format(at - motion.beat))
            stopping = list(self._stopping.items())
        for token, motion in stopping:
            try:
                self._hold(token, motion)
            except Exception as error:  # the next poll tries again
                if str(error) != self._said:
                    self._said = str(error)
                    print("{0}: {1}".format(NAME, error))
        with self._lock:
            return bool(self._armed or self._stopping)

    def _taken(self, token, number):  # type: (int, int) -> Any
        """Return the motion of a command, which counts as a heartbeat; None if it is late or repeated."""
        motion = self._armed.get(int(token))
        if motion is None or int(number) <= motion.last:
            return None
        motion.last, motion.beat = int(number), self._clock()
        return motion

    def _done(self, motion):  # type: (_Motion) -> None
        with self._lock:
            motion.calls -= 1
            motion.since = self._clock()

    def _end(self, token, why):  # type: (int, str) -> None
        motion = self._armed.pop(token, None)
        if motion is not None:
            motion.why, motion.since = why, self._clock()
            motion.stopped = motion.since
            self._stopping[token] = motion

    def _remember(self, token, state):  # type: (int, str) -> None
        self._ended[token] = state
        for old in sorted(self._ended)[:-LATEST]:
            del self._ended[old]

    def _hold(self, token, motion):  # type: (int, _Motion) -> None
        """Hold a motion's joints and base; end it once they are at rest, or after LONGEST."""
        at = self._clock()
        if motion.joints:
            target = motion.target if at > motion.stopped + BRAKING else None
            motion.target = hold_joints(self._motion, motion.joints, target)
        if motion.base and motion.brakes < MOST_BRAKES and at >= motion.braked + BRAKE_EVERY:
            motion.brakes, motion.braked = motion.brakes + 1, at
            self._spawn(lambda: self._brake(motion))
        measured = list(self._motion.getAngles(motion.joints, True)) if motion.joints else []
        measured += list(self._motion.getRobotPosition(True)) if motion.base else []
        since = max(at - REST_TIME - 2 * PERIOD, motion.since)  # no measurement from before the end of a call
        motion.measured = [row for row in motion.measured if row[0] >= since] + [(at, measured)]
        resting = motion.measured[-1][0] - motion.measured[0][0] >= REST_TIME and still(
            [row for _, row in motion.measured], len(motion.joints)
        )
        with self._lock:
            if motion.calls == 0 and (resting or at - motion.since > LONGEST):
                self._stopping.pop(token, None)
                self._remember(token, "{0}: {1}".format("at rest" if resting else "not at rest", motion.why))

    def _brake(self, motion):  # type: (_Motion) -> None
        try:
            self._motion.stopMove()
        except Exception as error:
            print("{0}: stopMove: {1}".format(NAME, error))
        finally:
            motion.brakes -= 1

    def _watch_on(self):  # type: () -> None
        if self._watches and not self._thread:
            self._thread = True
            in_thread(self._watch)

    def _watch(self):  # type: () -> None
        while True:
            time.sleep(PERIOD)
            if not self.look():
                with self._lock:
                    if not self._armed and not self._stopping:
                        self._thread = False
                        return


def still(rows, joints):  # type: (Any, int) -> bool
    """Return whether positions of joints, then of the base, are at rest; NaN counts as moving."""
    return all(
        all(value == value for value in column)
        and max(column) - min(column) <= (REST if k < joints else BASE_REST)
        for k, column in enumerate(zip(*rows))
    )


def hold_joints(motion, joints, target=None):  # type: (Any, Any, Any) -> Any
    """End the tasks of joints, and hold a target, or the present command if None; return the target."""
    motion.killTasksUsingResources(joints)
    angles = motion.getAngles(joints, False) if target is None else target
    motion.setAngles(joints, angles, HOLD)
    return angles


def main():  # type: () -> None
    """Register the watchdog with the robot's NAOqi, until the process is ended."""
    import argparse

    import qi

    parser = argparse.ArgumentParser(
        description="Passes commands on; stops the robot when a client falls silent."
    )
    parser.add_argument("--url", default="tcp://127.0.0.1:9559")
    session = qi.Session()
    session.connect(parser.parse_args().url)
    session.registerService(NAME, qi.multiThreaded()(MotionWatchdog)(session.service("ALMotion")))
    print("{0} is registered; Ctrl-C ends it".format(NAME))
    while session.isConnected():
        time.sleep(1.0)


if __name__ == "__main__":
    main()
