# -*- coding: utf-8 -*-
"""A watchdog beside ALMotion: it stops the robot when a client falls silent.

The simulated robot has it as a module.  A real one gets it by copying this file, which Python 2.7 and 3 run
without anything besides NAOqi's own package `qi`:

    python on_robot.py [--url tcp://127.0.0.1:9559]
"""
# ruff: noqa: UP004, UP009, UP010, UP030, UP032, SIM105 -- Python 2.7 runs this file on the robot

from __future__ import print_function

import threading
import time

try:
    from typing import Any  # noqa: F401 -- for the comments
except ImportError:  # Python 2.7
    pass

NAME = "MotionWatchdog"
"""Name of the service."""

PERIOD = 0.02
"""Time between two looks for silent clients [s]."""

HOLD = 0.3
"""Share of the fastest speed with which joints return to where they were stopped."""

LATE = 0.5
"""Time after a stop in which it is repeated: calls of the client that were under way may come late [s]."""

LATEST = 100
"""Clients whose end is remembered."""

now = getattr(time, "monotonic", time.time)


class MotionWatchdog(object):
    """Stops joints and base when a client that armed it sends no beat for some time.

    Args:
        motion: The ALMotion of the robot, or a proxy of it.
    """

    def __init__(self, motion):  # type: (object) -> None
        self._motion = motion  # type: Any
        self._lock = threading.Lock()
        self._armed = {}  # type: dict[int, list[Any]]
        self._ended = {}  # type: dict[int, str]
        self._number = 0
        self._thread = None  # type: Any
        self._stopped = []  # type: list[list[str]]
        self._late_until = 0.0

    def arm(self, seconds, joints):  # type: (float, Any) -> int
        """Watch a client from now on; return its number.

        Args:
            seconds: The longest silence [s], 0.05 to 10.
            joints: Names of the joints that it moves; no other watched client may move them. The base is
                stopped in any case.
        """
        limit = float(seconds)
        if not 0.05 <= limit <= 10.0:
            raise ValueError("seconds: got {0:g}, expected 0.05 to 10".format(limit))
        names = [str(name) for name in joints]
        with self._lock:
            moved = [name for _, _, others in self._armed.values() for name in others]
            taken = sorted(set(names).intersection(moved))
            if taken:
                raise ValueError("joints: another client moves {0}".format(", ".join(taken)))
            self._number += 1
            self._stopped = []  # whoever moves now is watched
            self._armed[self._number] = [limit, now(), names]
            if self._thread is None:
                self._thread = threading.Thread(target=self._watch)
                self._thread.daemon = True
                self._thread.start()
            return self._number

    def beat(self, number):  # type: (int) -> bool
        """Say that a client is there; return False where it is not watched any more."""
        with self._lock:
            entry = self._armed.get(int(number))
            if entry is None:
                return False
            entry[1] = now()
            return True

    def disarm(self, number):  # type: (int) -> bool
        """Watch a client no longer; return whether it was watched."""
        with self._lock:
            return self._end(int(number), "disarmed")

    def status(self, number):  # type: (int) -> str
        """Return "armed", "disarmed", "unknown", or why the robot was stopped."""
        with self._lock:
            return "armed" if int(number) in self._armed else self._ended.get(int(number), "unknown")

    def _end(self, number, why):  # type: (int, str) -> bool
        if self._armed.pop(number, None) is None:
            return False
        self._ended[number] = why
        for old in sorted(self._ended)[:-LATEST]:
            del self._ended[old]
        return True

    def _watch(self):  # type: () -> None
        while True:
            time.sleep(PERIOD)
            with self._lock:
                for number, (limit, last, joints) in list(self._armed.items()):
                    late = now() - last
                    if late > limit:
                        self._late_until = now() + LATE
                        self._stopped.append(joints)
                        self._end(number, "stopped: no beat for {0:.2f} s".format(late))
                if now() > self._late_until:
                    self._stopped = []
                stopped = list(self._stopped)
                if not self._armed and not stopped:
                    self._thread = None
                    return
            for joints in stopped:
                try:
                    hold(self._motion, joints)
                except Exception as error:  # the next look tries again
                    print("{0}: {1}".format(NAME, error))


def hold(motion, joints):  # type: (Any, Any) -> None
    """Stop the base, and joints where their commands are now."""
    motion.stopMove()
    if joints:
        motion.killTasksUsingResources(joints)
        motion.setAngles(joints, motion.getAngles(joints, False), HOLD)


def main():  # type: () -> None
    """Register the watchdog with the robot's NAOqi, until the process is ended."""
    import argparse

    import qi

    parser = argparse.ArgumentParser(description="Stops the robot when a client falls silent.")
    parser.add_argument("--url", default="tcp://127.0.0.1:9559")
    session = qi.Session()
    session.connect(parser.parse_args().url)
    session.registerService(NAME, MotionWatchdog(session.service("ALMotion")))
    print("{0} is registered; Ctrl-C ends it".format(NAME))
    while session.isConnected():
        time.sleep(1.0)


if __name__ == "__main__":
    main()
