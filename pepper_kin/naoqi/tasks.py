"""Motion tasks: what moves which joints, who waits for whom, and how one is ended.

A task books joints.  A task for a booked joint waits until the joint is free; a reactive one (`setAngles`)
takes the place of an earlier reactive one on its joints.
"""

from __future__ import annotations

import contextlib
import itertools
import threading
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pepper_kin.naoqi.body import Body


class BodyTask:
    """Something that moves joints, cycle by cycle.

    Args:
        name: Name of the method that began it.
        resources: Joints (and wheels) that it books.
        reactive: Whether a later reactive task takes its joints away.

    Attributes:
        thread: Which thread asked for it.
        number: What `getTaskList` and `post` call it; 0 until it was handed to the tasks.
        started: Whether it has its joints.
        ended: Whether it is over.
        killed: Whether somebody ended it.
        begun: Whether its first cycle was prepared.
        failure: What it raised.
        error: Why it ended before its time; "" if it did not.
        protected: Whether arms that it moves are kept from what they would touch.
    """

    def __init__(self, name: str, resources: Iterable[str], *, reactive: bool = False) -> None:
        self.name = name
        self.resources = set(resources)
        self.reactive = reactive
        self.number = 0
        self.thread = threading.get_ident()
        self.started = self.ended = self.killed = False
        self.begun = False
        self.failure: Exception | None = None
        self.error = ""
        self.protected = True

    def start(self, body: Body) -> None:
        """Prepare, at the beginning of the first cycle."""

    def step(self, body: Body) -> bool:
        """Write the commands of one cycle; return whether the task goes on."""
        raise NotImplementedError

    def finish(self, body: Body) -> None:
        """Clean up, after the last cycle or when killed."""


class Call:
    """A call that runs beside others.

    Args:
        ticket: Number in the order of arrival, from 1; -1 lets it begin no more tasks.
    """

    def __init__(self, ticket: int) -> None:
        self.ticket = ticket


class Tasks:
    """All tasks of a body, in the order in which they came."""

    def __init__(self) -> None:
        self._tasks: list[BodyTask] = []
        self._number = 0
        self._tickets = itertools.count(1)
        self._stopped: dict[str | None, int] = {}  # joint, or None for all -> ticket of its last stop
        self._thread = threading.local()

    def __iter__(self) -> Iterator[BodyTask]:
        return iter(tuple(self._tasks))

    @property
    def booked(self) -> set[str]:
        """Joints of the tasks that run."""
        return {name for task in self._tasks if task.started for name in task.resources}

    def add(self, task: BodyTask) -> BodyTask:
        """Queue a task; a reactive one takes joints from earlier reactive ones.

        One of a call that was made before its joints were stopped ends before it begins.
        """
        self._number += 1
        task.number = self._number
        if (call := getattr(self._thread, "call", None)) is not None:
            of = (None, *task.resources)
            task.killed = any(self._stopped.get(name, 0) > call.ticket for name in of)
        if task.reactive and not task.killed:
            for other in self._tasks:
                if other.reactive:
                    other.resources -= task.resources
                    if not other.resources:
                        other.killed = True
        self._tasks.append(task)
        return task

    def step(self, body: Body) -> None:
        """Start what can be started, and let everything that runs write its commands."""
        with self.within(None):  # whoever waits runs the cycles: what tasks begin is not of that call
            self._step(body)

    def _step(self, body: Body) -> None:
        wanted: set[str] = set()
        for task in tuple(self._tasks):
            if task.killed:
                self._end(task, body)
                continue
            if not task.started:
                others = {
                    name
                    for other in self._tasks
                    if other is not task and other.started
                    for name in other.resources
                }
                if task.resources & (others | wanted):
                    wanted |= task.resources
                    continue
                task.started = True
            try:
                if not task.begun:
                    task.begun = True
                    task.start(body)
                going = task.step(body)
            except Exception as error:  # raised again where somebody waits for the task
                task.failure, going = error, False
            if not going:
                self._end(task, body)

    def _end(self, task: BodyTask, body: Body) -> None:
        if task.started:
            task.finish(body)
        task.ended = True
        if task in self._tasks:
            self._tasks.remove(task)

    def new_call(self) -> Call:
        """Return a call that is made now, for `within`."""
        return Call(next(self._tickets))

    @contextlib.contextmanager
    def within(self, call: Call | None) -> Iterator[None]:
        """Let what this thread does in the meantime be of a call that was made earlier, or of none."""
        before, self._thread.call = getattr(self._thread, "call", None), call
        try:
            yield
        finally:
            self._thread.call = before

    def stop(self, resources: Iterable[str] | None, body: Body) -> None:
        """End all tasks, or those that use any of some joints, and what earlier calls hand over later."""
        call = getattr(self._thread, "call", None)
        ticket = next(self._tickets) if call is None else call.ticket
        names: list[str | None] = [None] if resources is None else [*resources]
        for name in names:
            self._stopped[name] = max(self._stopped.get(name, 0), ticket)
        self.kill(self._tasks if resources is None else self.using([*resources]), body)

    def kill(self, tasks: Iterable[BodyTask], body: Body) -> None:
        """End tasks now; brakes that they begin are not of the call that ends them."""
        with self.within(None):
            for task in tuple(tasks):
                task.killed = True
                self._end(task, body)

    def by_number(self, number: int) -> BodyTask | None:
        """Return the task with a number, or None where it is over."""
        return next((task for task in self._tasks if task.number == number), None)

    def using(self, resources: Sequence[str]) -> list[BodyTask]:
        """Return tasks that run or wait on any of these joints."""
        return [task for task in self._tasks if task.resources & set(resources)]
