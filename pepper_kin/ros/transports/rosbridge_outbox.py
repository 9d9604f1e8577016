"""Outgoing messages for one rosbridge client: bounded, throttled, the oldest of a topic dropped first."""

from __future__ import annotations

import asyncio
import itertools
import time
from collections import deque
from collections.abc import Callable
from typing import Any

from pepper_kin.ros.transports.rosbridge_json import fragments_of, png_of, text_of

QUEUE = 100
"""Maximum number of waiting messages of a subscription without a `queue_length`."""

MOST_ANSWERS = 5_000
"""Maximum number of waiting answers, above which the client is disconnected."""

_numbers = itertools.count(1)


class Outgoing:
    """One subscription of a client.

    Args:
        topic: Name of the topic.
        identifier: Identifier of the subscription by the client.
        options: `throttle_rate` [ms], `queue_length`, `fragment_size` [characters], `compression`.
    """

    def __init__(self, topic: str, identifier: str | None, options: dict[str, Any]) -> None:
        self.topic, self.identifier = topic, identifier
        self.interval = options["throttle_rate"] / 1000.0
        self.fragment_size, self.compression = options["fragment_size"], options["compression"]
        self._drops = self.interval > 0.0 and options["queue_length"] == 0
        self._waiting: deque[str] = deque(maxlen=options["queue_length"] or QUEUE)
        self.due = 0.0

    def add(self, text: str) -> None:
        """Queue a text, unless it is throttled and the client wants no queue."""
        if self._drops and time.monotonic() < self.due:
            return
        self._waiting.append(text)
        if self._drops:
            self.due = time.monotonic() + self.interval

    def take(self, now: float) -> str | None:
        """Remove and return a text that may be sent at a time on a monotonic clock [s], or None."""
        if not self._waiting or (now < self.due and not self._drops):
            return None
        if not self._drops:
            self.due = now + self.interval
        return self._waiting.popleft()

    @property
    def waits(self) -> bool:
        """Whether a text is queued."""
        return bool(self._waiting)

    def texts(self, text: str) -> list[str]:
        """Return the texts that are sent for a text: compressed, in fragments."""
        if self.compression == "png":
            text = text_of({"op": "png", "data": png_of(text)})
        size = self.fragment_size
        if size is None or len(text) <= size:
            return [text]
        return fragments_of(text, f"{self.topic}:{next(_numbers)}", size)


class Outbox:
    """Answers and messages for one client; used from the event loop only.

    Args:
        write: Function that sends a text, and returns when the socket has taken it.
        overflow: Function that is called if the client does not read.
    """

    def __init__(self, write: Callable[[str], Any], overflow: Callable[[], None]) -> None:
        self._write, self._overflow = write, overflow
        self._answers: deque[str] = deque()
        self.subscriptions: list[Outgoing] = []
        self._changed = asyncio.Event()

    def answer(self, message: dict[str, Any] | str) -> None:
        """Queue an answer, an object or its text; answers are never dropped."""
        self._answers.append(message if isinstance(message, str) else text_of(message))
        if len(self._answers) > MOST_ANSWERS:
            self._overflow()
        self._changed.set()

    def wake(self) -> None:
        """Wake the sender."""
        self._changed.set()

    async def run(self) -> None:
        """Send until canceled, or until the socket is closed."""
        while True:
            wait = await self._send_all()
            # `asyncio.wait_for` is not used: before Python 3.12 it may swallow the task's cancellation.
            alarm = None
            if wait is not None:
                alarm = asyncio.get_running_loop().call_later(wait, self._changed.set)
            try:
                await self._changed.wait()
            finally:
                if alarm is not None:
                    alarm.cancel()

    async def _send_all(self) -> float | None:
        """Send all messages that are due; return the time until a throttled one is due [s]."""
        sent = True
        while sent:
            self._changed.clear()
            sent = False
            while self._answers:
                await self._write(self._answers.popleft())
            for outgoing in tuple(self.subscriptions):
                text = outgoing.take(time.monotonic())
                if text is not None:
                    sent = True
                    for part in outgoing.texts(text):
                        await self._write(part)
        due = [outgoing.due for outgoing in self.subscriptions if outgoing.waits]
        return max(min(due) - time.monotonic(), 0.001) if due else None
