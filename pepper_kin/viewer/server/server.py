"""The server: a thread with an event loop, and calls into it from Python."""

from __future__ import annotations

import asyncio
import concurrent.futures
import threading
from collections.abc import Callable
from typing import Any, TypeVar

from pepper_kin.exceptions import InfeasibleError
from pepper_kin.model import PepperModel
from pepper_kin.servers.access import Access
from pepper_kin.servers.connection_gate import listening_sockets
from pepper_kin.viewer.server.hub import Hub
from pepper_kin.viewer.server.session import LiveSession
from pepper_kin.viewer.server.tasks import LongTasks
from pepper_kin.viewer.server.worker import Worker

DEFAULT_PORT = 7878
"""The port of the live page, if none is asked for and nobody has taken it."""
_TRIED = 20
"""Ports that are tried after the default one, where others are at home already."""

T = TypeVar("T")


class ViewerServer:
    """Serves one robot's live page from a separate thread.

    Args:
        pepper: The robot.
        access: Who may talk to it; None for this machine alone.
        port: The port; None takes the first free one from 7878 on, 0 any free one.
        title: The page's title; None for the robot's name.

    Raises:
        InvalidValueError: for a port that is none.
        InfeasibleError: where the port is taken, or the host is none of this machine's.
    """

    def __init__(
        self,
        pepper: PepperModel,
        access: Access | None = None,
        port: int | None = None,
        title: str | None = None,
    ) -> None:
        self.access = access or Access()
        first, tried = (DEFAULT_PORT, _TRIED) if port is None else (port, 1)
        self._sockets = listening_sockets("live page", self.access.host, first, tried)
        self.port = int(self._sockets[0].getsockname()[1])
        self._title = title or pepper.name.title()
        self._loop = asyncio.SelectorEventLoop()  # others do not tell when a socket can be read
        self._worker = Worker(self._deliver)
        self._tasks = LongTasks(pepper, self._worker)
        self._hub = Hub(pepper, self._tasks)
        self._lock = threading.Lock()
        self._calls: set[concurrent.futures.Future[Any]] = set()
        self._ended = False
        self._thread = threading.Thread(target=self._run, name="pepper-kin viewer", daemon=True)
        self._started = threading.Event()
        self._thread.start()
        self._started.wait()

    @property
    def url(self) -> str:
        """The address of the page, with its token where one is needed."""
        token = "" if self.access.token is None else f"?token={self.access.token}"
        return f"http://{self.access.shown_host}:{self.port}/{token}"

    def call(self, do: Callable[[LiveSession], T]) -> T:
        """Do something with the session in the thread that owns it; return what it returns.

        Raises:
            InfeasibleError: after the server has ended, or where it ends meanwhile.
        """
        if threading.current_thread() is self._thread:  # it cannot wait for itself
            return do(self._hub.session)
        outcome: concurrent.futures.Future[T] = concurrent.futures.Future()

        def work() -> None:
            try:
                outcome.set_result(do(self._hub.session))
            except BaseException as error:  # it belongs to whoever called
                outcome.set_exception(error)
            self._hub.wake()

        with self._lock:
            if self._ended:
                raise _has_ended()
            self._calls.add(outcome)
            self._loop.call_soon_threadsafe(work)
        try:
            return outcome.result()
        finally:
            with self._lock:
                self._calls.discard(outcome)

    def warm_up(self) -> None:
        """Begin to load what following and planning need; returns at once."""
        self.call(self._tasks.warm_up)

    def close(self) -> None:
        """End the server; pages try to come back."""
        with self._lock:
            if not self._ended:
                self._worker.stop()
                self._loop.call_soon_threadsafe(self._stop.set)
        if threading.current_thread() is not self._thread:
            self._thread.join()

    def _deliver(self, do: Callable[[], None]) -> None:
        def work() -> None:
            do()
            self._hub.wake()

        try:
            self._loop.call_soon_threadsafe(work)
        except RuntimeError:  # the server has ended, and nobody waits for the result
            return

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._serve())
        finally:
            with self._lock:
                self._ended = True
                self._loop.close()
                calls = tuple(self._calls)
            for outcome in calls:
                if not outcome.done():  # its turn would come after the end: nobody would answer it
                    outcome.set_exception(_has_ended())

    async def _serve(self) -> None:
        from pepper_kin.servers.http_server import GatedHttpServer
        from pepper_kin.viewer.server.app import application

        self._stop = asyncio.Event()
        server = GatedHttpServer(application(self._hub, self._title), "live page", self.access.fault)
        server.start(self._sockets)
        ticking = asyncio.ensure_future(self._hub.run())
        self._started.set()
        await self._stop.wait()
        ticking.cancel()
        self._hub.close_pages()
        await server.close()
        await asyncio.gather(ticking, return_exceptions=True)  # it has yet to hear of its end


def _has_ended() -> InfeasibleError:
    return InfeasibleError("live page", "its server has ended", "make a new viewer")
