"""Motion tasks and their queue.

A task uses joints.  Another task for a used joint waits until the joint is free; a reactive task
(`setAngles`) takes its joints from earlier reactive tasks.
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
    """A motion of joints, cycle by cycle.

    Args:
        name: Name of the method that started the task.
        resources: Joints (and wheels) that the task uses.
        reactive: Whether a later reactive task may take joints away.

    Attributes:
        thread: Identifier of the thread that created the task.
        number: Number of the task for `getTaskList` and `killTask`; 0 before it is queued.
        started: Whether the task has its joints.
        ended: Whether the task has ended.
        killed: Whether the task was ended by another call or task.
        begun: Whether `start` was called.
        failure: The error that the task raised, or None.
        error: Reason of an early end; "" if there was none.
        protected: Whether the arms that the task moves are protected from collisions.
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
        """Prepare the task, before its first cycle."""

    def step(self, body: Body) -> bool:
        """Write the commands of one cycle; return whether the task goes on."""
        raise NotImplementedError

    def finish(self, body: Body) -> None:
        """Clean up, after the last cycle or when killed."""


class Call:
    """An asynchronous call.

    Args:
        ticket: Number in the order of arrival, from 1; with -1 the call starts no more tasks after a stop.
    """

    def __init__(self, ticket: int) -> None:
        self.ticket = ticket


class Tasks:
    """All tasks of a body, in the order of arrival."""

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
        """Joints that running tasks use."""
        return {name for task in self._tasks if task.started for name in task.resources}

    def add(self, task: BodyTask) -> BodyTask:
        """Queue a task; a reactive one takes joints from earlier reactive ones.

        A task of a call that is older than the last stop of one of its joints ends before it starts.
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
        """Start the tasks whose joints are free, and advance all running tasks by one cycle."""
        with self.within(None):  # a waiting call may run the cycle, but does not own the tasks started in it
            self._step(body)

    def _step(self, body: Body) -> None:
        """End killed tasks, start tasks whose joints are free, and step the started ones."""
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
            except Exception as error:  # raised again by waits for the task
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
        """Return a new call, for `within`."""
        return Call(next(self._tickets))

    @contextlib.contextmanager
    def within(self, call: Call | None) -> Iterator[None]:
        """Attribute this thread's tasks and stops to an earlier call, or to none, until the context ends."""
        before, self._thread.call = getattr(self._thread, "call", None), call
        try:
            yield
        finally:
            self._thread.call = before

    def stop(self, resources: Iterable[str] | None, body: Body) -> None:
        """End all tasks, or those that use or wait for given joints, and later tasks of earlier calls."""
        call = getattr(self._thread, "call", None)
        ticket = next(self._tickets) if call is None else call.ticket
        names: list[str | None] = [None] if resources is None else [*resources]
        for name in names:
            self._stopped[name] = max(self._stopped.get(name, 0), ticket)
        self.kill(self._tasks if resources is None else self.using([*resources]), body)

    def kill(self, tasks: Iterable[BodyTask], body: Body) -> None:
        """End tasks now; tasks that they start in `finish` do not belong to the present call."""
        with self.within(None):
            for task in tuple(tasks):
                task.killed = True
                self._end(task, body)

    def by_number(self, number: int) -> BodyTask | None:
        """Return the task with a number, or None if it has ended."""
        return next((task for task in self._tasks if task.number == number), None)

    def using(self, resources: Sequence[str]) -> list[BodyTask]:
        """Return the tasks that use or wait for any of the joints."""
        return [task for task in self._tasks if task.resources & set(resources)]
