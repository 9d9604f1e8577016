"""Behaviors of Choregraphe, run against the twin: boxes, their scripts, signals and timelines.

The boxes of a diagram are loaded with the diagram.  A box that is started loads its own diagram, or plays
its timeline, whose keyframes load diagrams; when the box stops, the diagrams are unloaded.  Signals run
concurrently.
"""

from __future__ import annotations

import functools
import tempfile
import threading
import traceback
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.file_access.atomic_file import as_path
from pepper_kin.files import choregraphe_boxes as files
from pepper_kin.files.choregraphe_boxes import ChoregrapheBox, Diagram, find_behaviors, read_behavior
from pepper_kin.naoqi.broker import Broker
from pepper_kin.naoqi.joint_tasks import CurveTask
from pepper_kin.naoqi.python2 import begin, old_program
from pepper_kin.naoqi.scripts import ScriptResult, check_longest, run_program
from pepper_kin.naoqi.shims import naoqi, qi, qi_logging
from pepper_kin.naoqi.shims.proxy import CALL
from pepper_kin.naoqi.simulated_time import TimeIsUp
from pepper_kin.naoqi.tasks import BodyTask
from pepper_kin.trajectory.key_curve import Handle, Key

TIMELINE = "timeline"
"""Name of the tasks that play timelines."""

PROJECTS = (".pml", ".xar", ".pkg")
"""File extensions that `run_behavior` takes, in addition to folders."""


@dataclass(frozen=True)
class BehaviorResult(ScriptResult):
    """Outcome of a behavior.

    Attributes:
        behavior: Name of the behavior.
        behaviors: Names of all behaviors of its project.
        failures: Path of each box that failed, and the reason.
    """

    behavior: str = ""
    behaviors: tuple[str, ...] = ()
    failures: tuple[tuple[str, str], ...] = ()


def run_behavior(
    path: str | Path, name: str | None = None, *, broker: Broker, longest: float | None = None
) -> BehaviorResult:
    """Run a behavior of a project against the twin of this process.

    The behavior ends with its root box, or when nothing runs and nothing can start any more; in simulated
    time also when boxes still wait for events.

    Args:
        path: A project (.pml), a behavior (.xar), an application (.pkg) or a folder that holds one.
        name: Name of the behavior; the first of the project if omitted.
        broker: The simulated robot.
        longest: Simulated time after which the behavior is interrupted [s].

    Raises:
        FileFormatError: for a file that is no project, or a box that cannot be read.
        InvalidValueError: for a behavior that is not in the project, or a time that is not above 0.
    """
    check_longest(longest)
    with tempfile.TemporaryDirectory() as unpacked:
        found = find_behaviors(as_path(path), Path(unpacked))
        chosen = next(iter(found)) if name is None else name
        if chosen not in found:
            raise InvalidValueError("behavior", chosen, f"one of {', '.join(found)}")
        file = found[chosen].resolve()
        behavior = Behavior(read_behavior(file), file, broker)
        for box in _boxes(behavior.root):
            if box.script:  # all, before anything moves
                old_program(file, box.script, box.line)
        folder = file.parent if file.parent == as_path(path).resolve().parent else file.parent.parent
        result = run_program(behavior.run, folder, broker, longest)
    failures = tuple(behavior.failures)
    code = result.code or int(bool(failures))
    ended = "failed" if failures and result.ended == "completed" else result.ended
    return BehaviorResult(ended, code, result.duration, result.error, chosen, tuple(found), failures)


def _boxes(box: ChoregrapheBox) -> list[ChoregrapheBox]:
    inner = [] if box.timeline is None else [d for layer in box.timeline.layers for d in layer]
    return [box, *(b for diagram in inner for one in diagram.boxes.values() for b in _boxes(one))]


class Behavior:
    """A running behavior.

    Args:
        root: Root box of the behavior.
        file: File of the behavior.
        broker: The simulated robot.

    Attributes:
        failures: Path of each box that failed, and the reason.
    """

    def __init__(self, root: ChoregrapheBox, file: Path, broker: Broker) -> None:
        self.root, self.file, self.broker = root, file, broker
        self.failures: list[tuple[str, str]] = []
        self.reads: Callable[..., str] = input
        self.session = qi.Session()
        self.ended = False
        self.waits_for = 0  # number of events that inputs are subscribed to
        self._number = 0

    def run(self, reads: Callable[..., str]) -> None:
        """Run the behavior to its end."""
        self.reads = reads
        clock, manager = self.broker.body.time, self.broker.module("ALFrameManager")
        self.session.connect()
        self.broker.add_module("ALFrameManager", _FrameManager(self))
        root = RunningBox(self.root, None, self)
        try:
            root.load()
            root.start()
            clock.wait_until(self._is_over)
        finally:
            with suppress(Exception, TimeIsUp):
                root.unload()
            self._end_timelines()  # even if a box failed to unload
            self.broker.add_module("ALFrameManager", manager)

    def _end_timelines(self) -> None:
        body = self.broker.body
        with body.time.lock:
            body.tasks.kill([task for task in body.tasks if task.name == TIMELINE], body)

    def beside(self, does: Callable[[], None]) -> None:
        """Run a function in a thread whose start the simulated time waits for."""
        thread = threading.Thread(target=does, daemon=True)
        thread.start()
        self.broker.body.time.follow(vars(thread).get("worker"))

    def unique_name(self, box: ChoregrapheBox) -> str:
        """Return a unique module name for a box."""
        self._number += 1
        return f"{box.path.replace('/', '__').replace(' ', '')}_{self._number}"

    def failed(self, box: ChoregrapheBox, error: BaseException) -> None:
        """Record why a box failed."""
        frames = traceback.extract_tb(error.__traceback__)
        lines = [f"line {one.lineno}: " for one in frames if one.filename == str(self.file)]
        said = f"{lines[-1] if lines else ''}{type(error).__name__}: {' '.join(str(error).split())}"
        self.failures.append((box.path, said))
        self.broker.log(f"{box.path}: {said}")

    def _is_over(self) -> bool:
        """Return whether the behavior has ended, or nothing can happen any more."""
        if self.ended:
            return True
        time, tasks = self.broker.body.time, self.broker.body.tasks
        if time.is_up or time.worker_count > 1 or next(iter(tasks), None) is not None:
            return False
        return not (self.waits_for and time.real_time)


class _FrameManager:
    """The part of ALFrameManager that boxes call for their folder."""

    def __init__(self, behavior: Behavior) -> None:
        self._behavior = behavior

    def getBehaviorPath(self, id: str) -> str:
        """Return the folder of a behavior."""
        return str(self._behavior.file.parent)


class RunningBox:
    """A box and its state: loaded or not.

    Args:
        box: Content of the box.
        around: Parent box, the parent's diagram, and the box's number in the diagram; None for the root.
        behavior: The behavior that the box belongs to.
    """

    def __init__(
        self, box: ChoregrapheBox, around: tuple[RunningBox, _Loaded, int] | None, behavior: Behavior
    ) -> None:
        self.box, self.around, self.behavior = box, around, behavior
        self.name = behavior.unique_name(box)
        self.player = None if box.timeline is None or not box.timeline.plays else Player(self)
        self._layers: dict[int, _Loaded] = {}
        self._events: list[tuple[Any, int]] = []
        self._script: Any = None
        self.loaded = False

    # Life cycle and signals.

    def load(self) -> None:
        """Create the script's object, and call `onLoad`."""
        self.loaded = True
        outputs = {port.name: self._emitter(number) for number, port in self.box.outputs.items()}
        generated = type("GeneratedClass", (BoxScript,), outputs | {"_box": self, "_name": self.name})
        space: dict[str, Any] = {name: getattr(naoqi, name) for name in naoqi.__all__}
        space |= {"GeneratedClass": generated, "__file__": str(self.behavior.file), "__name__": self.name}
        if self.box.script:
            exec("import os, sys, time", space)
            modules = [name for name in self.behavior.broker.module_names if name in self.box.script]
            space |= {name: naoqi.ALProxy(name) for name in modules}
            code = old_program(self.behavior.file, self.box.script, self.box.line)
            self._guarded(lambda: begin(code, True, space, self.behavior.reads))
        own = space.get("MyClass", generated)
        self._guarded(lambda: self._take_script(own))
        self._call("onLoad")

    def _take_script(self, own: Any) -> None:
        self._script = own()
        self.behavior.broker.add_module(self.name, self._script)

    def unload(self) -> None:
        """Unload the diagrams of the box, and call `onUnload`."""
        if self.loaded:
            self.loaded = False
            self._close()
            self._call("onUnload")
            self.behavior.broker.memory.unregisterModuleReference(self.name)
            self.behavior.broker.remove_module(self.name)

    def start(self) -> None:
        """Send a signal to the first input of the kind START."""
        numbers = [number for number, port in self.box.inputs.items() if port.kind == files.START]
        if numbers:
            self.receive(numbers[0], None)

    def receive(self, number: int, value: Any) -> None:
        """Handle a signal at an input, in a thread."""
        self.behavior.beside(lambda: self._take(number, value))

    def _take(self, number: int, value: Any) -> None:
        """Handle a signal at an input: start or stop the box, call its script, and pass it on inside."""
        port = self.box.inputs.get(number)
        if port is None or not self.loaded:
            return
        if port.kind == files.START:
            self._open()
        if not self._call(f"onInput_{port.name}", value):
            return
        self._within(number, value)
        if port.kind == files.STOP and (self._layers or self.player is not None):
            self.stop()

    def stop(self) -> None:
        """Unload the diagrams of the box, and emit its first output of the kind STOPPED."""
        numbers = [number for number, port in self.box.outputs.items() if port.kind == files.STOPPED]
        self._close()
        if numbers:
            self.emit(numbers[0], None)

    def emit(self, number: int, value: Any) -> None:
        """Send a signal from an output."""
        port = self.box.outputs.get(number)
        if port is None:
            return
        self.behavior.broker.body.time.spend(CALL)
        if port.kind == files.STOPPED:
            self._close()
        if self.around is not None:
            box, diagram, own = self.around
            box.pass_on(diagram, own, number, value)
        elif port.kind == files.STOPPED:
            self.behavior.ended = True

    def pass_on(self, within: _Loaded, source: int, output: int, value: Any) -> None:
        """Send a signal along the links of a diagram of this box; source 0 is the box itself."""
        for link in within.diagram.links:
            if (link.source, link.output) != (source, output):
                continue
            if link.target == 0:
                self.emit(link.input, value)
            elif link.target in within.boxes:
                within.boxes[link.target].receive(link.input, value)

    # Diagrams and timeline.

    def _open(self) -> None:
        """Load the diagrams, or play the timeline, from the beginning."""
        self._close()
        for number, port in self.box.inputs.items():
            if port.kind == files.MEMORY and port.event:
                signal = self.behavior.broker.memory.subscriber(port.event).signal
                taker = functools.partial(self._within, number)
                self._events.append((signal, signal.connect(taker)))
        self.behavior.waits_for += len(self._events)
        if self.player is not None:
            self.player.play()
        elif self.box.timeline is not None:
            for k, layer in enumerate(self.box.timeline.layers):
                for diagram in layer[:1]:
                    self.show(k, diagram)
        if self.box.dialog:
            self.behavior.broker.log(f"{self.box.path}: dialogues are not simulated; it waits for ever")

    def show(self, layer: int, diagram: Diagram) -> None:
        """Load a diagram of a layer; the layer's previous diagram is unloaded."""
        self._hide(layer)
        loaded = self._layers[layer] = _Loaded(diagram, {})
        for number, box in diagram.boxes.items():
            loaded.boxes[number] = RunningBox(box, (self, loaded, number), self.behavior)
        for one in tuple(loaded.boxes.values()):
            one.load()
        for number, port in self.box.inputs.items():
            if port.kind == files.ON_LOAD:
                self.pass_on(loaded, 0, number, None)

    def _hide(self, layer: int) -> None:
        before = self._layers.pop(layer, None)
        for one in () if before is None else tuple(before.boxes.values()):
            one.unload()

    def _close(self) -> None:
        """Stop the timeline, unload all diagrams and end the subscriptions to events."""
        if self.player is not None:
            self.player.stop()
        for layer in tuple(self._layers):
            self._hide(layer)
        for signal, number in self._events:
            signal.disconnect(number)
        self.behavior.waits_for -= len(self._events)
        self._events = []

    def _within(self, number: int, value: Any = None) -> None:
        for loaded in tuple(self._layers.values()):
            self.pass_on(loaded, 0, number, value)

    # Script.

    def parameter(self, name: str) -> Any:
        """Return the value of a parameter; an inherited one has the value of the parent box.

        Raises:
            RuntimeError: for an unknown parameter.
        """
        if name not in self.box.parameters:
            raise RuntimeError(f"{self.box.path} has no parameter {name!r}")
        own = self.box.parameters[name]
        if own.inherited and self.around is not None:
            with suppress(RuntimeError):
                return self.around[0].parameter(name)
        return own.value

    def set_parameter(self, name: str, value: Any) -> None:
        """Set a parameter while the box runs."""
        own = files.Parameter(value, False)
        self.box = replace(self.box, parameters=self.box.parameters | {name: own})

    def _emitter(self, number: int) -> Callable[..., None]:
        # In a thread: boxes are unloaded while the script that stops them goes on, as on the robot.
        return lambda _, value=None: self.behavior.beside(lambda: self.emit(number, value))

    def _call(self, method: str, value: Any = None) -> bool:
        """Call a method of the script, if it exists; return whether nothing failed."""
        function = getattr(self._script, method, None)
        if function is None:
            return True
        code = getattr(function, "__code__", None)
        takes = code is None or code.co_argcount > 1 or bool(code.co_flags & 0x04)
        if self._guarded(lambda: function(value) if takes else function()):
            return True
        if method not in ("onLoad", "onUnload"):
            self._call("onUnload")
        return False

    def _guarded(self, does: Callable[[], Any]) -> bool:
        """Call a function; record an error as a failure of the box, and return whether there was none."""
        try:
            does()
        except (Exception, SystemExit) as error:
            self.behavior.failed(self.box, error)
            return False
        return True


@dataclass
class _Loaded:
    """A diagram whose boxes are loaded."""

    diagram: Diagram
    boxes: dict[int, RunningBox]


class _Logger(qi_logging.Logger):
    """The logger of a box, with the method names of Python's logging, too."""

    warn, critical = qi_logging.Logger.warning, qi_logging.Logger.fatal


class BoxScript(naoqi.ALModule):
    """Base class of the boxes' scripts, under the name GeneratedClass."""

    _box: RunningBox

    def __init__(self, *_: Any) -> None:
        self.logger = _Logger(self._box.box.path)

    def getParameter(self, name: str) -> Any:
        """Return the value of a parameter."""
        return self._box.parameter(name)

    def setParameter(self, name: str, value: Any) -> None:
        """Set a parameter until the box is unloaded."""
        self._box.set_parameter(name, value)

    def session(self) -> Any:
        """Return the session with the twin."""
        return self._box.behavior.session

    def log(self, *words: Any) -> None:
        """Log a line."""
        self.logger.info(*words)

    def packageUid(self) -> str:
        """Return the name of the application."""
        return self._box.behavior.file.parent.parent.name

    @property
    def id(self) -> str:
        """Name of the box."""
        return self.getName()

    @property
    def behaviorId(self) -> str:
        """Name of the behavior for ALFrameManager."""
        return self._box.behavior.file.parent.name

    def behaviorAbsolutePath(self) -> str:
        """Return the folder of the behavior."""
        return str(self._box.behavior.file.parent)

    def behaviorRelativePath(self) -> str:
        """Return the name of the behavior's folder."""
        return self.behaviorId

    def BIND_PYTHON(self, *_: Any) -> None:
        """Do nothing: events can call every method."""

    def stimulateIO(self, name: str, value: Any = None) -> None:
        """Send a signal from an output."""
        for number, port in self._box.box.outputs.items():
            if port.name == name:
                self._box.emit(number, value)

    def getTimeline(self) -> Player | None:
        """Return the timeline of the box."""
        return self._box.player

    def getParentTimeline(self) -> Player | None:
        """Return the innermost timeline that contains the box."""
        around = self._box.around
        while around is not None and around[0].player is None:
            around = around[0].around
        return None if around is None else around[0].player


class Player:
    """The timeline of a box, with the methods that scripts call.

    Args:
        box: Box of the timeline.
    """

    def __init__(self, box: RunningBox) -> None:
        self._box = box
        assert box.box.timeline is not None
        self._timeline = box.box.timeline
        self._fps = self._timeline.fps
        self._frame, self._since = self._timeline.first, 0.0
        self._run = 0  # number of the current playback; a new number ends it
        self._plays = False
        self._task: BodyTask | None = None

    def play(self) -> None:
        """Play from the present frame."""
        if not self._plays:
            self._plays, self._since = True, self._box.behavior.broker.body.time.now
            self._run += 1
            run = self._run
            self._box.behavior.beside(lambda: self._go(run))

    def pause(self) -> None:
        """Pause at the present frame, and end the motion."""
        self._frame, self._plays = self.getFrame(), False
        self._run += 1
        body = self._box.behavior.broker.body
        if self._task is not None and not self._task.ended:
            with body.time.lock:
                body.tasks.kill([self._task], body)
        self._task = None

    def stop(self) -> None:
        """Pause, and return to the first frame."""
        self.pause()
        self._frame = self._timeline.first

    def goTo(self, frame: float) -> None:
        """Jump to a frame, and go on if the timeline plays."""
        plays = self._plays
        self.pause()
        self._frame = min(max(float(frame), self._timeline.first), self._timeline.last)
        if plays:
            self.play()

    def gotoAndPlay(self, frame: float) -> None:
        """Play from a frame."""
        self.goTo(frame)
        self.play()

    def gotoAndStop(self, frame: float) -> None:
        """Pause at a frame."""
        self.pause()
        self.goTo(frame)

    def getFrame(self) -> float:
        """Return the present frame."""
        passed = self._box.behavior.broker.body.time.now - self._since if self._plays else 0.0
        return min(self._frame + passed * self._fps, self._timeline.last)

    def getSize(self) -> int:
        """Return the number of frames."""
        return int(self._timeline.last - self._timeline.first) + 1

    def getFPS(self) -> float:
        """Return the frames per second."""
        return self._fps

    def setFPS(self, fps: float) -> None:
        """Set the frames per second."""
        frame, plays = self.getFrame(), self._plays
        self.pause()
        self._fps, self._frame = float(fps), frame
        if plays:
            self.play()

    def _go(self, run: int) -> None:
        """Play to the last frame: start the motion, and load each diagram at its frame."""
        begun, body = self._frame, self._box.behavior.broker.body
        keys = self._keys(begun)
        if keys:
            self._task = body.do(CurveTask(TIMELINE, keys))
        shown = [(d.frame, k, d) for k, layer in enumerate(self._timeline.layers) for d in layer]
        for frame, layer, diagram in sorted(shown, key=lambda one: one[:2]):
            if begun <= frame <= self._timeline.last:
                if not self._comes_to(frame, run):
                    return
                self._box.show(layer, diagram)
        task = self._task
        if self._comes_to(self._timeline.last, run):
            body.time.wait_until(lambda: self._run != run or task is None or task.ended)
            if self._run == run:
                self._box.stop()

    def _comes_to(self, frame: float, run: int) -> bool:
        """Wait for a frame; return whether the timeline still plays."""
        time = self._box.behavior.broker.body.time
        time.wait_until(lambda: self._run != run or self.getFrame() >= frame - 1e-6)
        return self._run == run

    def _keys(self, begun: float) -> dict[str, tuple[Key, ...]]:
        """Return the keys of each joint from a frame on, with simulated times from the present [s]."""
        motion = self._timeline.motion
        broker = self._box.behavior.broker
        shift, slower = (begun - self._timeline.first) / self._timeline.fps, self._timeline.fps / self._fps
        keys = {}
        foreign = []
        for curve in () if motion is None else motion.curves:
            if curve.joint not in broker.body.index:
                foreign.append(curve.joint)
                continue
            left = [key for key in curve.keys if key.time >= shift - 1e-9]
            if left:
                keys[curve.joint] = tuple(_retimed(key, shift, slower) for key in left)
        if foreign:
            said = f"{len(foreign)} joints of another robot stay out: {', '.join(foreign)}"
            broker.log(f"{self._box.box.path}: {said}")
        return keys


def _retimed(key: Key, shift: float, slower: float) -> Key:
    before, behind = (Handle(h.kind, slower * h.time, h.value) for h in (key.before, key.behind))
    return Key(max(0.0, slower * (key.time - shift)), key.value, before, behind)
