"""Hub between the session and its pages: the loop that advances time and sends changes."""

from __future__ import annotations

import asyncio
import logging
import secrets
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from pepper_kin.model import PepperModel
from pepper_kin.viewer.server.follower import RATE
from pepper_kin.viewer.server.protocol import PageCommand
from pepper_kin.viewer.server.session import LiveSession
from pepper_kin.viewer.server.tasks import LongTasks

if TYPE_CHECKING:
    from pepper_kin.viewer.server.app import PageSocket

_LOG = logging.getLogger(__name__)
STATE_STEP = 0.08
"""Time between two updates of the panels [s]; poses are sent at every tick."""
MOST_PAGES = 32


class Hub:
    """The hub of a session and its pages, which may come and go.

    Args:
        pepper: Model of the robot.
        tasks: Executes long tasks.
    """

    def __init__(self, pepper: PepperModel, tasks: LongTasks) -> None:
        self._pages: set[PageSocket] = set()
        self.session = LiveSession(pepper, self._draw, tasks)
        self._name = secrets.token_hex(4)
        self._wake = asyncio.Event()
        self._sent_poses = b""
        self._sent_at = 0.0
        session = self.session
        self._doers: dict[str, Callable[..., Any]] = {
            "joint": session.set_joint,
            "posture": session.posture,
            "show": session.show,
            "follow": session.set_follow,
            "target": session.move_target,
            "release": session.release,
            "add": session.add_obstacle,
            "change": session.change_obstacle,
            "remove": session.remove_obstacle,
            "plan": session.plan,
            "go": session.go,
            "play": session.play,
            "pause": session.pause,
            "seek": session.seek,
            "speed": session.set_speed,
            "loop": session.set_loop,
            "clear": session.clear,
        }

    def handle(self, command: PageCommand) -> None:
        """Execute a command of a page.

        Raises:
            PepperKinError: for a command that cannot be executed.
        """
        self._doers[command.name](**command.fields)
        self.wake()

    def join(self, page: PageSocket) -> None:
        """Add a page, and send it the robot's data, the drawing and the present state."""
        if len(self._pages) >= MOST_PAGES:
            page.close(1013, "too many pages")
            return
        session = self.session
        session.refresh()
        page.tell({"type": "hello", "session": self._name, "robot": session.about()})
        for command in session.board.snapshot():
            page.draw(command)
        page.tell({"type": "history", "samples": session.readings.history})
        page.catch_up(session.document)
        page.pose(session.poses())
        self._pages.add(page)
        self.wake()

    def leave(self, page: PageSocket) -> None:
        """Remove a page."""
        self._pages.discard(page)

    def wake(self) -> None:
        """Wake the loop after a change."""
        self._wake.set()

    def close_pages(self) -> None:
        """Close all connections."""
        for page in tuple(self._pages):
            page.close(1001, "the server ends")

    async def run(self) -> None:
        """Run the loop: at the servo's rate while something moves, and waiting for events otherwise."""
        loop = asyncio.get_running_loop()
        before = loop.time()
        while True:
            if self.session.resting and not self._behind():
                self._wake.clear()
                await self._wake.wait()
                before = loop.time() - 1.0 / RATE
            now = loop.time()
            try:
                self.session.tick(now - before)
            except Exception as error:  # the error is shown on the pages, and the loop goes on
                self.session.clear()
                self.session.fail(error)
            before = now
            try:
                self._tell(now)
            except Exception:  # the loop goes on after a failed transmission
                _LOG.exception("the pages could not be sent what changed")
            await self._nap(now + self.session.wait - loop.time())

    async def _nap(self, seconds: float) -> None:
        """Wait for a time [s], or until something happens."""
        # Not by `asyncio.wait_for`: until Python 3.12 it may swallow the task's cancellation.
        self._wake.clear()
        alarm = asyncio.get_running_loop().call_later(max(0.0, seconds), self._wake.set)
        try:
            await self._wake.wait()
        finally:
            alarm.cancel()

    def _behind(self) -> bool:
        """Return whether any page lacks the latest state."""
        session = self.session
        session.refresh()
        return any(page.revision != session.document.count or page.lacks_poses for page in self._pages)

    def _tell(self, now: float) -> None:
        # The panel first: whoever has just been sent poses is busy with them until the next tick.
        """Send the changes of the state, every `STATE_STEP`, and the poses to all pages."""
        if now - self._sent_at >= STATE_STEP:
            self._sent_at = now
            self.session.refresh()
            for page in tuple(self._pages):
                page.catch_up(self.session.document)
        poses = self.session.poses()
        changed = poses != self._sent_poses
        for page in tuple(self._pages):
            if changed or page.lacks_poses:
                page.pose(poses)
        self._sent_poses = poses

    def _draw(self, command: bytes) -> None:
        for page in tuple(self._pages):
            page.draw(command)
