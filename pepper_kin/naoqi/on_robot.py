# -*- coding: utf-8 -*-
"""A watchdog beside ALMotion: commands of clients pass through it, and it stops the robot.

It stops what a client moves when that falls silent, or is asked to, and holds it until it is measured at
rest.  Commands carry the number of a motion (a token): those that arrive after its end are dropped, however
late.

The simulated robot has it as a module.  A real one gets it by copying this file, which Python 2.7 and 3 run
without anything besides NAOqi's own package `qi`:

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
"""Version of its methods."""

PERIOD = 0.02
"""Time between two looks [s]."""

HOLD = 0.3
"""Share of the fastest speed with which joints return to where they were stopped."""

REST_TIME, REST, BASE_REST = 0.2, 2e-3, 1e-3
"""At rest measured positions differ by less [rad; m, rad of the base] within this time [s]."""

BRAKING = 0.3
"""Time in which joints brake; afterwards they are held where they were then [s]."""

LONGEST = 10.0
"""The longest time in which what still moves is held [s]; calls under way are waited for however long."""

BRAKE_EVERY, MOST_BRAKES = 0.1, 60
"""Time between two calls of `stopMove` [s], which may block, and how many may be under way."""

LATEST = 100
"""Motions whose end is remembered."""

QUICK = ("setAngles", "move")
"""Methods of ALMotion that clients may call and that return at once."""

LASTING = ("angleInterpolationBezier", "moveTo")
"""Those that last as long as the motion."""

now = getattr(time, "monotonic", time.time)


def in_thread(function):  # type: (Any) -> None
    """Call a function in a thread."""
    thread = threading.Thread(target=function)
    thread.daemon = True
    thread.start()


class _Motion(object):
    """A motion of a client.

    Attributes are: state, "armed", "running", "finished: VALUE", "failed: ERROR", and after its end
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
    """Passes commands on while their motion is watched; stops joints and base otherwise.

    Args:
        motion: The ALMotion of the robot, or a proxy of it.
        clock: Returns the time [s].
        spawn: Calls a function beside the caller.
        watch: Whether a thread looks by itself; otherwise `look` is called.
    """

    def __init__(self, motion, clock=now, spawn=in_thread, watch=True):  # type: (Any, Any, Any, bool) -> None
        self._motion = motion  # type: Any
        self._clock, self._spawn, self._watches = clock, spawn, watch
        self._lock = threading.RLock()
        self._armed = {}  # type: dict[int, _Motion]
        self._stopping = {}  # type: dict[int, _Motion]
        self._ended = {}  # type: dict[int, str]
        self._number = random.randrange(1, 1000000) * 1000  # not one of a watchdog that ran before
        self._thread = False
        self._said = ""

    def protocol(self):  # type: () -> int
        """Return the version of these methods."""
        return PROTOCOL

    def arm(self, seconds, joints, base):  # type: (float, Any, Any) -> int
        """Watch a motion from now on; return its token.

        Args:
            seconds: The longest silence of its client [s], 0.05 to 10.
            joints: Names of the joints that it moves; no other watched motion may move them.
            base: Whether it moves the base.
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
        """Pass quick calls on to ALMotion; return the motion's state.

        Args:
            token: Of the motion; without effect once it has ended.
            number: Rises from command to command; those that come after a later one are dropped.
            calls: Pairs of a method, "setAngles" or "move", and its arguments.
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
        """Keep a part of the arguments of `start`, times and keys by joint; return the motion's state."""
        with self._lock:
            motion = self._taken(token, number)
            if motion is not None:
                motion.parts.append(part)
            return self.status(token)

    def start(self, token, number, method, arguments):  # type: (int, int, str, Any) -> str
        """Begin a call of ALMotion that lasts; return the motion's state.

        Args:
            token: As in `command`.
            number: As in `command`.
            method: "moveTo" or "angleInterpolationBezier", whose times and keys are the parts.
            arguments: Of the method, before those.
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
        """Say that a client is there; return the motion's state."""
        with self._lock:
            motion = self._armed.get(int(token))
            if motion is not None:
                motion.beat = self._clock()
            return self.status(token)

    def release(self, token):  # type: (int) -> str
        """Watch a motion no longer that has come to its end; return its state."""
        with self._lock:
            if self._armed.pop(int(token), None) is not None:
                self._remember(int(token), "released")
            return self.status(token)

    def halt(self, token, why):  # type: (int, str) -> str
        """End a motion, or all of them (0), and hold the robot until it is at rest; return the state.

        With 0 all joints and the base are held, whoever moves them.
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
        """Return the state of a motion; "unknown" for none."""
        with self._lock:
            token = int(token)
            if token in self._armed:
                return self._armed[token].state
            if token in self._stopping:
                return "stopping: {0}".format(self._stopping[token].why)
            return self._ended.get(token, "unknown")

    def look(self):  # type: () -> bool
        """Stop silent clients' motions, and hold what is being stopped; return whether more is to come."""
        with self._lock:
            at = self._clock()
            for token, motion in list(self._armed.items()):
                if at - motion.beat > motion.limit:
                    self._end(token, "no beat for {0:.2f} s".format(at - motion.beat))
            stopping = list(self._stopping.items())
        for token, motion in stopping:
            try:
                self._hold(token, motion)
            except Exception as error:  # the next look tries again
                if str(error) != self._said:
                    self._said = str(error)
                    print("{0}: {1}".format(NAME, error))
        with self._lock:
            return bool(self._armed or self._stopping)

    def _taken(self, token, number):  # type: (int, int) -> Any
        """Return the motion of a command that is neither late nor doubled, or None; it counts as a beat."""
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
        """Hold a motion's joints and base, and note whether they are at rest."""
        at = self._clock()
        if motion.joints:
            target = motion.target if at > motion.stopped + BRAKING else None
            motion.target = hold_joints(self._motion, motion.joints, target)
        if motion.base and motion.brakes < MOST_BRAKES and at >= motion.braked + BRAKE_EVERY:
            motion.brakes, motion.braked = motion.brakes + 1, at
            self._spawn(lambda: self._brake(motion))
        measured = list(self._motion.getAngles(motion.joints, True)) if motion.joints else []
        measured += list(self._motion.getRobotPosition(True)) if motion.base else []
        since = max(at - REST_TIME - 2 * PERIOD, motion.since)  # what a call moves is seen after its end only
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
    """Return whether positions of joints, then of the base, differ by no more than at rest; NaN does."""
    return all(
        all(value == value for value in column)
        and max(column) - min(column) <= (REST if k < joints else BASE_REST)
        for k, column in enumerate(zip(*rows))
    )


def hold_joints(motion, joints, target=None):  # type: (Any, Any, Any) -> Any
    """End what moves joints, and keep them at a target, or where they are commanded now; return where."""
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
