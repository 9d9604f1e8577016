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
"""Default port of the live page, if it is free."""
_TRIED = 20
"""Number of ports that are tried from the default one on, if ports are in use."""

T = TypeVar("T")


class ViewerServer:
    """Server of a robot's live page, in a separate thread.

    Args:
        pepper: Model of the robot.
        access: Rules of access; None for this machine alone.
        port: TCP port; None takes the first free one from 7878 on, 0 any free one.
        title: Title of the page; None for the robot's name.

    Raises:
        InvalidValueError: for an invalid port.
        InfeasibleError: if the port is in use, or the host is not an address of this machine.
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
        self._loop = asyncio.SelectorEventLoop()  # other loops have no `add_reader`
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
        """Address of the page, with its token if one is needed."""
        token = "" if self.access.token is None else f"?token={self.access.token}"
        return f"http://{self.access.shown_host}:{self.port}/{token}"

    def call(self, do: Callable[[LiveSession], T]) -> T:
        """Call a function with the session, in the server's thread; return its result.

        Raises:
            InfeasibleError: if the server has ended, or ends meanwhile.
        """
        if threading.current_thread() is self._thread:  # the thread cannot wait for itself
            return do(self._hub.session)
        outcome: concurrent.futures.Future[T] = concurrent.futures.Future()

        def work() -> None:
            try:
                outcome.set_result(do(self._hub.session))
            except BaseException as error:  # raised again for the caller
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
        """Start to load the machine code of following and planning; return at once."""
        self.call(self._tasks.warm_up)

    def close(self) -> None:
        """Stop the server; pages try to reconnect."""
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
        except RuntimeError:  # the server has ended, and the result is not needed
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
                if not outcome.done():  # it would never be answered
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
        await asyncio.gather(ticking, return_exceptions=True)  # waits for the cancellation to finish


def _has_ended() -> InfeasibleError:
    return InfeasibleError("live page", "its server has ended", "make a new viewer")
