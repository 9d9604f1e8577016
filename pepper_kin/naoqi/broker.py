"""All modules of one simulated robot, and the calls posted to them."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

from pepper_kin.collision import Scene
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.naoqi.body import MODES, Body
from pepper_kin.naoqi.memory import ALMemory
from pepper_kin.naoqi.module import Module
from pepper_kin.naoqi.motion import ALMotion
from pepper_kin.naoqi.posture import ALRobotPosture

MOST_CALLS = 1000
"""Largest number of posted calls kept, with their errors; the oldest call that has ended is removed first."""

POLL = 0.002
"""Time that one poll of a posted call takes [s]."""

TOUCH_EVERY = 10
"""Number of cycles between two polls of bumpers and touch sensors."""


class Broker:
    """A simulated Pepper with its modules.

    Args:
        mode: "robot" refuses the calls that Pepper refuses; "twin" executes them.
        real_time: Whether time follows the wall clock; otherwise it passes only while a caller waits, as
            fast as it can be computed.
        scene: Obstacles around the robot, and attached objects.
        response: How the joints follow their commands: as "measured" on a robot, with delay and lag
            (default in the mode "robot"), or "ideal" (default in the mode "twin").

    Attributes:
        body: The simulated body.
        logged: Time [s] and text of each line that modules would have said or shown.
        on_log: Called with the time and text of each line.

    Raises:
        InvalidValueError: for an unknown mode or response.
    """

    def __init__(
        self,
        *,
        mode: str = "twin",
        real_time: bool = True,
        scene: Scene | None = None,
        response: str | None = None,
    ) -> None:
        if mode not in MODES:
            raise InvalidValueError("mode", mode, f"one of {', '.join(MODES)}")
        usual = "measured" if mode == "robot" else "ideal"
        self.body = Body(mode=mode, real_time=real_time, scene=scene, response=response or usual)
        self.logged: list[tuple[float, str]] = []
        self.on_log: Callable[[float, str], object] | None = None
        self._began = time.time()
        self._modules: dict[str, Module | Any] = {}
        self._calls: dict[int, _Call] = {}
        self._posting = threading.Lock()
        self._number = 0
        self._memory, self._motion = ALMemory(self), ALMotion(self)
        for module in (self._memory, self._motion, ALRobotPosture(self)):
            self._modules[module.name] = module
        for kind in other_modules():
            self._modules[kind.name] = kind(self)
        self._cycles = 0
        if scene is not None:
            self.body.listeners.append(self._look_for_touches)
        self.body.time.start()

    def __enter__(self) -> Broker:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def motion(self) -> ALMotion:
        """ALMotion."""
        return self._motion

    @property
    def memory(self) -> ALMemory:
        """ALMemory."""
        return self._memory

    @property
    def module_names(self) -> tuple[str, ...]:
        """Names of all modules."""
        return tuple(self._modules)

    def module(self, name: str) -> Any:
        """Return a module by name.

        Raises:
            UnknownNameError: for an unknown module.
        """
        if name not in self._modules:
            raise UnknownNameError("module", name, self._modules)
        return self._modules[name]

    def add_module(self, name: str, module: object) -> None:
        """Register a module of a script, so that events can call its methods."""
        self._modules[name] = module

    def remove_module(self, name: str) -> None:
        """Remove a module of a script."""
        self._modules.pop(name, None)

    def log(self, text: str) -> None:
        """Log a line that a module would show or say, in `logged`."""
        self.logged.append((self.body.time.now, text))
        if self.on_log is not None:
            self.on_log(self.body.time.now, text)

    def wall_time(self) -> float:
        """Return the wall time of the simulation [s since 1970]."""
        return self._began + self.body.time.now

    def close(self) -> None:
        """Stop the simulation."""
        self.body.time.stop()

    # Asynchronous calls.

    def post(self, call: Callable[[], Any]) -> int:
        """Run a call in a thread; return the call's number."""
        entry = _Call(call, self.body)
        with self._posting:
            ended = (number for number, other in self._calls.items() if not other.is_alive())
            if len(self._calls) >= MOST_CALLS and (oldest := next(ended, None)) is not None:
                del self._calls[oldest]
            self._number += 1
            self._calls[self._number] = entry
            entry.start()
            return self._number

    def is_running(self, number: int) -> bool:
        """Return whether a posted call, or a motion task, is running."""
        entry = self._calls.get(number)
        if entry is None:
            with self.body.time.lock:
                return self.body.tasks.by_number(number) is not None
        if self.body.time.works:
            self.body.time.spend(POLL)
        elif not entry.over:
            entry.join(POLL)  # time passes for a caller that polls in a loop
        return not entry.over

    def wait_for(self, number: int, timeout: float | None) -> bool:
        """Wait for a posted call, at most `timeout` [s]; return whether it is still running."""
        entry = self._calls.get(number)
        if entry is None:
            return False
        if self.body.time.works:
            self.body.time.wait_until(lambda: entry.over, timeout)
        end = None if timeout is None else self.body.time.now + timeout
        while not entry.over and (end is None or self.body.time.now < end):
            entry.join(0.02)
        if entry.error is not None and entry.over:
            raise entry.error
        return not entry.over

    def stop_call(self, number: int) -> None:
        """End the motion tasks of a posted call."""
        entry = self._calls.get(number)
        if entry is None or not entry.is_alive():
            return
        with self.body.time.lock:
            entry.order.ticket = -1
            self.body.tasks.kill([t for t in self.body.tasks if t.thread == entry.ident], self.body)

    def _look_for_touches(self) -> None:
        self._cycles += 1
        if self._cycles % TOUCH_EVERY == 0:
            self._memory.look_for_touches()


class _Call(threading.Thread):
    """An asynchronous call, with its value or the error that ended it."""

    of_robot = True  # it goes on after the end of the script that posted it

    def __init__(self, call: Callable[[], Any], body: Body) -> None:
        super().__init__(daemon=True)
        self._call, self._body = call, body
        self.order = body.tasks.new_call()
        self.value: Any = None
        self.error: BaseException | None = None
        self.over = False

    def run(self) -> None:
        """Do the call."""
        try:
            with self._body.tasks.within(self.order):
                self.value = self._call()
        except Exception as error:
            self.error = error
        finally:
            self.over = True


def other_modules() -> tuple[type[Module], ...]:
    """Return all modules but memory, motion and postures."""
    from pepper_kin.naoqi import (
        animation,
        kept_states,
        leds,
        navigation,
        speech,
        states,
        tracker,
        video,
        watchdog,
    )

    return (
        *animation.MODULES,
        *leds.MODULES,
        *navigation.MODULES,
        *speech.MODULES,
        *states.MODULES,
        *kept_states.MODULES,
        *tracker.MODULES,
        *video.MODULES,
        *watchdog.MODULES,
    )
