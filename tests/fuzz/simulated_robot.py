"""A robot of NAOqi's, its watchdog and a network in simulated time, on which anything can go wrong.

The simulated body, ALMotion, ALMemory, the watchdog, and on the client's side `Robot` are the library's own
code.  What is simulated is time, the turns of threads (each is a greenlet), and messages that are late, lost,
doubled or damaged.
"""

import heapq
import itertools
from collections.abc import Callable
from typing import Any

import greenlet
import numpy as np

from pepper_kin.naoqi import Broker, on_robot
from pepper_kin.naoqi.joint_names import ACTUATED
from pepper_kin.naoqi.simulated_time import CYCLE, SimulatedTime
from pepper_kin.naoqi.watchdog import MotionWatchdogModule
from pepper_kin.naoqi.wire import as_plain

INACTIVE = 15
"""Cycles after which a body that stood still, with nothing queued, is not computed any more."""


class World:
    """Simulated time: events, and threads that wait."""

    def __init__(self) -> None:
        self.time = 0.0
        self._events: list[tuple[float, int, Callable[[], object]]] = []
        self._number = itertools.count()
        self._waiting: list[tuple[Callable[[], bool], float, Any]] = []
        self._main = greenlet.getcurrent()

    def now(self) -> float:
        return self.time

    def sleep(self, seconds: float) -> None:
        self.block(lambda: False, max(seconds, 1e-6))

    def at(self, time: float, act: Callable[[], object]) -> None:
        heapq.heappush(self._events, (max(time, self.time), next(self._number), act))

    def spawn(self, function: Callable[[], object]) -> None:
        """Call a function on a thread."""
        self.at(self.time, greenlet.greenlet(function, self._main).switch)

    def block(self, done: Callable[[], bool], timeout: float | None) -> bool:
        """Wait on this thread until something is so; return whether it came to be."""
        end = float("inf") if timeout is None else self.time + timeout
        me = greenlet.getcurrent()
        if me is not self._main:
            if done():
                return True
            self._waiting.append((done, end, me))
            return bool(self._main.switch())
        while not done():
            if self.time >= end - 1e-12:
                return False
            self._next(end)
        return True

    def _next(self, end: float) -> None:
        """Let time pass to the next event, or to a time, and threads go on that waited for what is so now."""
        until = min([end, *(deadline for _, deadline, _ in self._waiting)])
        if self._events and self._events[0][0] <= until:
            self.time, _, act = heapq.heappop(self._events)
            act()
        else:
            self.time = until
        for entry in tuple(self._waiting):
            done, deadline, thread = entry
            if entry in self._waiting and (done() or self.time >= deadline - 1e-12):
                self._waiting.remove(entry)
                thread.switch(done())

    def forget(self) -> None:
        """End all threads."""
        for _, _, thread in self._waiting:
            thread.throw(greenlet.GreenletExit)
        self._waiting.clear()
        self._events.clear()


class WorldTime(SimulatedTime):
    """The body's clock on simulated time."""

    def __init__(self, world: World, on_cycle: Callable[[], None]) -> None:
        super().__init__(on_cycle, real_time=True)
        self.world = world

    def wait_until(self, done: Callable[[], bool], timeout: float | None = None) -> bool:
        return self.world.block(done, timeout)


class Slow:
    """ALMotion that takes its time to begin what is called."""

    def __init__(self, world: World, motion: Any) -> None:
        self._world, self._motion = world, motion
        self.delays: dict[str, float] = {}
        self.watch: Callable[[str, tuple[Any, ...]], object] | None = None

    def __getattr__(self, name: str) -> Any:
        method = getattr(self._motion, name)

        def call(*arguments: Any) -> Any:
            if self.delays.get(name):
                self._world.sleep(self.delays[name])
            if self.watch is not None:
                self.watch(name, arguments)
            return method(*arguments)

        return call


class SimulatedRobot:
    """The robot's side: body, modules, watchdog, and what was measured in each cycle."""

    def __init__(self, world: World, *, watchdog: bool = True) -> None:
        self.world = world
        self.broker = Broker(real_time=False)
        self.body = self.broker.body
        time = WorldTime(world, self.body._cycle)
        time.lock, self.body.time = self.body.time.lock, time
        self.motion = Slow(world, self.broker.motion)
        self.modules: dict[str, Any] = {"ALMemory": self.broker.module("ALMemory"), "ALMotion": self.motion}
        self.watchdog = on_robot.MotionWatchdog(self.motion, world.now, world.spawn, False)
        module = MotionWatchdogModule(self.broker)
        module.watchdog = self.watchdog
        if watchdog:
            self.modules[on_robot.NAME] = module
        self.rows = [self.body.index[name] for name in ACTUATED]
        self.times: list[float] = []
        self.measured: list[np.ndarray] = []
        self.calls = 0
        world.at(CYCLE, self._cycle)
        world.spawn(self._watch)

    @property
    def inactive(self) -> bool:
        """Whether nothing moves, and nothing is queued that could."""
        queued = list(self.body.tasks) or self.watchdog._stopping or self.watchdog._armed or self.calls
        if queued or np.any(self.body.controller.twist):
            return False
        return self._stood()

    def _cycle(self) -> None:
        body = self.body
        if list(body.tasks) or np.any(body.controller.twist) or not self._stood():
            body.time._advance()
        else:
            body.time._cycles += 1
            for listener in tuple(body.listeners):
                listener()
        self.times.append(self.world.time)
        position = np.array(body.state.position)
        self.measured.append(position)
        self.world.at(self.world.time + CYCLE, self._cycle)

    def _stood(self) -> bool:
        rows = self.measured[-INACTIVE:]
        return len(rows) == INACTIVE and float(np.ptp(np.array(rows), axis=0).max()) < 2e-3

    def _watch(self) -> None:
        while True:
            self.world.sleep(on_robot.PERIOD)
            self.watchdog.look()


class Future:
    """A future of libqi's on simulated time."""

    def __init__(self, world: World) -> None:
        self._world = world
        self.done, self._value, self._error = False, None, ""

    def set(self, value: Any, error: str = "") -> None:
        if not self.done:  # a doubled answer is the first one
            self.done, self._value, self._error = True, value, error

    def isFinished(self) -> bool:  # noqa: N802
        return self.done

    def wait(self, milliseconds: int) -> int:
        return 1 if self._world.block(lambda: self.done, milliseconds / 1000.0) else 0

    def hasError(self, _: int) -> bool:  # noqa: N802
        return bool(self._error)

    def error(self, _: int) -> str:
        return self._error

    def value(self, _: int) -> Any:
        return self._value

    def cancel(self) -> None:
        pass


class Network:
    """Messages between one client and the robot.

    Attributes:
        delay: Returns the time that a message takes [s]; infinite for one that is lost.
        twice: Returns whether a request arrives twice.
        damage: Maps module, method and value of an answer to what arrives.
        cut: Whether nothing travels any more.
    """

    def __init__(self, world: World, robot: SimulatedRobot) -> None:
        self.world, self.robot = world, robot
        self.delay: Callable[[], float] = lambda: 0.002
        self.twice: Callable[[], bool] = lambda: False
        self.damage: Callable[[str, str, Any], Any] = lambda module, method, value: value
        self.connected = True
        self.dead = False
        self._open: list[Future] = []

    def call(self, module: str, method: str, arguments: tuple[Any, ...]) -> Future:
        future = Future(self.world)
        if not self.connected:
            raise RuntimeError("not connected")
        self._open = [one for one in self._open if not one.done] + [future]
        for _ in range(2 if self.twice() else 1):
            late = self.delay()
            if not self.dead and np.isfinite(late):
                self.robot.calls += 1
                self.world.at(
                    self.world.time + late,
                    lambda: self.world.spawn(lambda: self._serve(module, method, arguments, future)),
                )
        return future

    def _serve(self, module: str, method: str, arguments: tuple[Any, ...], future: Future) -> None:
        value, error = None, ""
        try:
            value = getattr(self.robot.modules[module], method)(*map(as_plain, arguments))
        except Exception as failure:
            error = str(failure) or repr(failure)
        finally:
            self.robot.calls -= 1
        try:
            value = self.damage(module, method, value)
        except RuntimeError as failure:
            error = str(failure)
        late = self.delay()
        if not self.dead and np.isfinite(late):
            self.world.at(self.world.time + late, lambda: self.connected and future.set(value, error))

    def disconnect(self) -> None:
        self.connected = False
        for future in self._open:
            future.set(None, "disconnected")


class Session:
    """A session of libqi's over a network."""

    network: Network

    def connect(self, url: str, _async: bool) -> Future:
        return self._now(None)

    def isConnected(self) -> bool:  # noqa: N802
        return self.network.connected

    def services(self, _async: bool) -> Future:
        return self._now([{"name": name} for name in self.network.robot.modules])

    def service(self, name: str, _async: bool) -> Future:
        if name not in self.network.robot.modules:
            future = Future(self.network.world)
            future.set(None, f"no service {name}")
            return future
        return self._now(_Service(self.network, name))

    def close(self, _async: bool) -> Future:
        return self._now(None)

    def _now(self, value: Any) -> Future:
        future = Future(self.network.world)
        future.set(value)
        return future


class _Service:
    def __init__(self, network: Network, name: str) -> None:
        self._network, self._name = network, name

    def __getattr__(self, method: str) -> Any:
        return lambda *arguments, _async: self._network.call(self._name, method, arguments)


class FakeQi:
    """What `pepper_kin.naoqi.link` uses of the module `qi`."""

    class FutureState:
        Running = 0

    def __init__(self, network: Network) -> None:
        self._network = network

    def Session(self) -> Session:  # noqa: N802 -- the name of libqi's class
        made = Session()
        made.network = self._network
        return made
