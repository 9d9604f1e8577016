"""The web application: one page, one socket."""

from __future__ import annotations

import json
import logging
import secrets
import sys
import time
from functools import partial
from typing import TYPE_CHECKING, Any

import tornado.web
import tornado.websocket

from pepper_kin.exceptions import PepperKinError
from pepper_kin.viewer.server.body_poses import drawing_message
from pepper_kin.viewer.server.document import Document
from pepper_kin.viewer.server.page_text import content_policy, page_text
from pepper_kin.viewer.server.protocol import LONGEST_TEXT, PageCommand, parse

if TYPE_CHECKING:
    from pepper_kin.viewer.server.hub import Hub

_LOG = logging.getLogger(__name__)
PING_SECONDS = 20.0
MOST_PER_SECOND, AT_ONCE = 200.0, 400.0
"""Maximum commands of a page per second, and in a burst after a pause; others are refused."""
MOST_REFUSALS = 50
"""Maximum number of unsent refusals for a page."""
MOST_UNSENT = 32_000_000
"""Maximum unsent data for a page, beyond its first messages; a slower page is closed [byte]."""


def application(hub: Hub, title: str) -> tornado.web.Application:
    """Return the application of a server; `GatedHttpServer` checks the rules of access before it."""
    return tornado.web.Application(
        [("/", PageHandler, {"title": title}), ("/socket", PageSocket, {"hub": hub})],
        default_handler_class=NothingHere,
        websocket_ping_interval=PING_SECONDS,
        websocket_max_message_size=4 * LONGEST_TEXT,
    )


class CarefulHandler(tornado.web.RequestHandler):
    """Handler with the headers of every answer."""

    def set_default_headers(self) -> None:
        """Forbid browsers to guess types, to cache pages and to send the address to other servers."""
        self.set_header("X-Content-Type-Options", "nosniff")
        self.set_header("Cache-Control", "no-store")
        self.set_header("Referrer-Policy", "no-referrer")
        self.set_header("Connection", "close")
        self.set_header("Cross-Origin-Resource-Policy", "same-origin")
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.clear_header("Server")


class PageHandler(CarefulHandler):
    """Handler of the page."""

    def initialize(self, title: str) -> None:
        """Store the application's arguments."""
        self._title = title

    def get(self) -> None:
        """Send the page."""
        nonce = secrets.token_urlsafe(16)
        self.set_header("Content-Type", "text/html; charset=utf-8")
        self.set_header("Content-Security-Policy", content_policy(nonce, self.request.host))
        self.finish(page_text(self._title, nonce))


class NothingHere(CarefulHandler):
    """Handler of every other address."""

    def prepare(self) -> None:
        """Send the status 404."""
        self.set_status(404)
        self.finish("There is nothing here but /.")


class PageSocket(tornado.websocket.WebSocketHandler):
    """The socket of one page.  Texts are JSON, binary messages are drawing commands and poses."""

    def initialize(self, hub: Hub) -> None:
        """Store the application's arguments."""
        self._hub = hub
        self.revision = -1
        self._unsent: Any = None
        self._late_poses = False
        self._bytes, self._most_bytes, self._refusals = 0, sys.maxsize, 0
        self._left, self._asked_at, self._warned_at = AT_ONCE, time.monotonic(), 0.0

    def check_origin(self, origin: str) -> bool:
        """Return True: the gate has checked the access already."""
        return True

    def open(self, *args: str, **kwargs: str) -> None:
        """Send a new page its first messages."""
        self.set_nodelay(True)
        self._hub.join(self)
        self._most_bytes = self._bytes + MOST_UNSENT

    def on_message(self, message: str | bytes) -> None:
        """Execute a command of the page; errors are sent to this page alone."""
        if not self._may_ask():
            return
        try:
            command: PageCommand = parse(message)
            self._hub.handle(command)
        except PepperKinError as error:
            self._refuse(str(error))
        except Exception as error:
            _LOG.exception("a command of a page failed")
            self._refuse(f"The server failed with {type(error).__name__}; its log says where.")
            self._hub.wake()

    def _may_ask(self) -> bool:
        """Return whether the page is within its rate of commands."""
        now = time.monotonic()
        self._left = min(self._left + MOST_PER_SECOND * (now - self._asked_at), AT_ONCE)
        self._asked_at = now
        if self._left < 1.0:
            if now - self._warned_at > 1.0:
                self._warned_at = now
                self._refuse(f"More than {MOST_PER_SECOND:g} commands in a second: some were left out.")
            return False
        self._left -= 1.0
        return True

    def _refuse(self, text: str) -> None:
        """Send the reason of a refusal, unless too many refusals are unsent."""
        if self._refusals < MOST_REFUSALS:
            self._refusals += 1
            self.tell({"type": "refused", "text": text})
            if self._unsent is not None:
                self._unsent.add_done_callback(self._refused)

    def _refused(self, sent: Any) -> None:
        self._refusals -= 1

    def on_close(self) -> None:
        """Remove the page from the hub."""
        self._hub.leave(self)

    # ---- for the hub

    @property
    def busy(self) -> bool:
        """Whether the last message to the page is still unsent."""
        return self._unsent is not None and not self._unsent.done()

    def tell(self, content: dict[str, Any]) -> None:
        """Send values as JSON."""
        self._write(json.dumps(content, separators=(",", ":"), allow_nan=False), binary=False)

    def draw(self, command: bytes) -> None:
        """Send a drawing command."""
        self._write(drawing_message(command), binary=True)

    def pose(self, poses: bytes) -> None:
        """Send poses; a page that is busy with older poses gets the newest ones later."""
        if self.busy:
            self._late_poses = True
        else:
            self._late_poses = False
            self._write(poses, binary=True)

    @property
    def lacks_poses(self) -> bool:
        """Whether the page was busy at the last poses and is not any more."""
        return self._late_poses and not self.busy

    def catch_up(self, document: Document) -> None:
        """Send the changes since the page's last update."""
        if self.revision == document.count or (self.busy and self.revision >= 0):
            return
        changes, self.revision = document.changes_since(self.revision), document.count
        self.tell({"type": "state", "values": changes})

    def _write(self, message: str | bytes, binary: bool) -> None:
        """Send a message; close a page with too much unsent data."""
        if self._bytes > self._most_bytes:
            self._hub.leave(self)
            self.close(1008, "the page does not take what it is sent")
            return
        try:
            self._unsent = self.write_message(message, binary=binary)
            self._bytes += len(message)
            self._unsent.add_done_callback(partial(self._written, len(message)))
        except tornado.websocket.WebSocketClosedError:
            self._unsent = None

    def _written(self, size: int, sent: Any) -> None:
        self._bytes -= size
        # A page that closes while something is sent is not an error; `on_close` follows.
        if not sent.cancelled() and sent.exception() is None and self._late_poses:
            self._hub.wake()
