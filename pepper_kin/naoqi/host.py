"""The modules as services of libqi, for any `qi` client on this machine (extra `naoqi`)."""

from __future__ import annotations

import atexit
import hmac
import threading
import time
from typing import Any

from pepper_kin.naoqi.broker import Broker
from pepper_kin.naoqi.errors import NaoqiError
from pepper_kin.naoqi.host_gate import HostGate
from pepper_kin.naoqi.qi_library import libqi
from pepper_kin.naoqi.wire import Wire
from pepper_kin.servers.access import LOOPBACK, Access
from pepper_kin.servers.connection_gate import listening_sockets
from pepper_kin.servers.end_signals import EndRequest, ended_by_signals

RISK = "they could read what the robot does, and move it with the token"

CLOSING = 10.0
"""Maximum time for closing the server [s]."""

WRONG_TOKEN = 0.5
"""Delay of the answer to a wrong token [s]."""


class Host:
    """A server of libqi with all modules of a broker.

    With a token, sessions may only read: calls that change anything are refused.  The service "Access" opens
    all methods: `session.service("Access").unlock(token).service("ALMotion")`.  Neither the connection nor
    the token is encrypted.

    If other parts of this library were used before `qi` was imported, bytes that are no messages of libqi may
    end the process; see `pepper_kin.naoqi.qi_library`.  `pepper-kin naoqi serve` imports it first.

    Args:
        broker: The simulated robot.
        address: Address to listen on; loopback only unless `allow_remote`.
        port: TCP port; 0 for any free port.
        allow_remote: Whether other machines may connect; they need the token.
        token: Token for `unlock`.  If omitted, none is needed on loopback, and one is generated for other
            machines.

    Attributes:
        url: Address for clients, "tcp://127.0.0.1:9559".
        token: The token, or None if none is needed.

    Raises:
        MissingDependencyError: if `qi` is not installed.
        InvalidValueError: for another machine's address without `allow_remote`, a token that is too short,
            or an invalid port.
        InfeasibleError: for an address or a port that is not available.
    """

    def __init__(
        self,
        broker: Broker,
        address: str = "127.0.0.1",
        port: int = 9559,
        *,
        allow_remote: bool = False,
        token: str | None = None,
    ) -> None:
        self.broker = broker
        access = Access.of(address, allow_remote, token, RISK)
        self.token = access.token
        qi = libqi()
        sockets = listening_sockets("server of NAOqi", address, port)
        self._wire = Wire(qi)
        self._session = qi.Session()
        self._open: dict[str, Any] = {}
        self._closed = threading.Lock()
        self._session.listenStandalone(f"tcp://{LOOPBACK}:0")
        inner = int(str(self._session.endpoints()[0]).rpartition(":")[2])
        self.url = f"tcp://{access.shown_host}:{sockets[0].getsockname()[1]}"
        self._gate = HostGate(sockets, inner, self.token)
        atexit.register(self.close)
        for name in broker.module_names:
            service = self._wire.service(broker.module(name), locked=self.token is not None)
            self._session.registerService(name, service)
        if self.token is not None:
            unlock = self._wire.object_of("Access", {"unlock": self._unlock})
            self._session.registerService("Access", unlock)

    def __enter__(self) -> Host:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the server: running calls end, motions stop, clients are disconnected."""
        if not self._closed.acquire(blocking=False):
            return
        atexit.unregister(self.close)
        self._wire.refuse()
        body = self.broker.body
        with body.time.lock:
            body.tasks.kill(tuple(body.tasks), body)
        body.time.release()
        self._session.close(_async=True).wait(int(1000 * CLOSING))
        self._gate.close()  # last: libqi still answers the calls that have just ended
        body.time.release()  # calls that were accepted just before
        del self._session  # libqi keeps the services as long as the session exists
        self._open.clear()
        self._wire.close(CLOSING)

    def wait(self, ended: EndRequest | None = None) -> None:
        """Serve until Ctrl-C or SIGTERM.

        Args:
            ended: Event that ends the wait when it is set, as `ended_by_signals` yields.

        Raises:
            Exception: the error that ended the simulation, if any.
        """
        if ended is None:
            with ended_by_signals() as ended:
                return self.wait(ended)
        while not ended.wait(0.5):
            if self.broker.body.time.failure is not None:
                raise self.broker.body.time.failure
        return None

    def _unlock(self, token: str) -> Any:
        """Return an object whose `service(name)` returns modules with all their methods."""
        if not hmac.compare_digest(str(token).encode(), (self.token or "").encode()):
            time.sleep(WRONG_TOKEN)
            raise NaoqiError("Access", "unlock", "wrong token")
        return self._wire.object_of("Unlocked", {"service": self._unlocked})

    def _unlocked(self, name: str) -> Any:
        if name not in self._open:
            self._open[name] = self._wire.service(self.broker.module(name), named=False)
        return self._open[name]
