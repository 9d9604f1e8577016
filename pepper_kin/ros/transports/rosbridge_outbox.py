"""Messages to be sent to one rosbridge client: bounded, throttled, the oldest of a topic dropped first."""

from __future__ import annotations

import asyncio
import itertools
import time
from collections import deque
from collections.abc import Callable
from typing import Any

from pepper_kin.ros.transports.rosbridge_json import fragments_of, png_of, text_of

QUEUE = 100
"""Messages of a subscription that wait where the client states no `queue_length`."""

MOST_ANSWERS = 5_000
"""Answers that wait; a client that reads none of them is disconnected."""

_numbers = itertools.count(1)


class Outgoing:
    """One subscription of a client.

    Args:
        topic: Its name.
        identifier: The client's name for it.
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
        """Queue a text, unless it is throttled and nothing is to be queued."""
        if self._drops and time.monotonic() < self.due:
            return
        self._waiting.append(text)
        if self._drops:
            self.due = time.monotonic() + self.interval

    def take(self, now: float) -> str | None:
        """Return a text that may be sent now, on a monotonic clock [s]."""
        if not self._waiting or (now < self.due and not self._drops):
            return None
        if not self._drops:
            self.due = now + self.interval
        return self._waiting.popleft()

    @property
    def waits(self) -> bool:
        """Whether something is queued."""
        return bool(self._waiting)

    def texts(self, text: str) -> list[str]:
        """Return a text as it is sent: compressed, in fragments."""
        if self.compression == "png":
            text = text_of({"op": "png", "data": png_of(text)})
        size = self.fragment_size
        if size is None or len(text) <= size:
            return [text]
        return fragments_of(text, f"{self.topic}:{next(_numbers)}", size)


class Outbox:
    """Answers and messages for one client; used from the event loop only.

    Args:
        write: Sends a text, and returns when the socket has taken it.
        overflow: Called where a client does not read.
    """

    def __init__(self, write: Callable[[str], Any], overflow: Callable[[], None]) -> None:
        self._write, self._overflow = write, overflow
        self._answers: deque[str] = deque()
        self.subscriptions: list[Outgoing] = []
        self._changed = asyncio.Event()

    def answer(self, message: dict[str, Any] | str) -> None:
        """Queue an answer, an object or its text; these are never dropped."""
        self._answers.append(message if isinstance(message, str) else text_of(message))
        if len(self._answers) > MOST_ANSWERS:
            self._overflow()
        self._changed.set()

    def wake(self) -> None:
        """Look for something to send."""
        self._changed.set()

    async def run(self) -> None:
        """Send until canceled, or until the socket is closed."""
        while True:
            wait = await self._send_all()
            # Not by `asyncio.wait_for`: until Python 3.12 it may swallow that the task is canceled.
            alarm = None
            if wait is not None:
                alarm = asyncio.get_running_loop().call_later(wait, self._changed.set)
            try:
                await self._changed.wait()
            finally:
                if alarm is not None:
                    alarm.cancel()

    async def _send_all(self) -> float | None:
        """Send what may be sent; return the time until a throttled message may [s]."""
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
