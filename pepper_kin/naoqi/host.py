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
"""The longest time that a server takes to close [s]."""

WRONG_TOKEN = 0.5
"""Time until a wrong token is answered [s]."""


class Host:
    """A server of libqi with all modules of a broker.

    With a token, sessions may read, and whatever changes something is refused.  The service "Access" opens
    the rest: `session.service("Access").unlock(token).service("ALMotion")`.  Nothing is encrypted, the
    token neither.

    Where other parts of this library were used before `qi` was imported, bytes that are no messages of libqi
    may end the process; see `pepper_kin.naoqi.qi_library`.  `pepper-kin naoqi serve` imports it first.

    Args:
        broker: The simulated robot.
        address: Where to listen; loopback only unless `allow_remote`.
        port: Where to listen; 0 for any free port.
        allow_remote: Whether other machines may connect; they need the token.
        token: What `unlock` takes.  If omitted none is needed on loopback, and one is made for other
            machines.

    Attributes:
        url: Where clients connect, "tcp://127.0.0.1:9559".
        token: The token, or None where none is needed.

    Raises:
        MissingDependencyError: where `qi` is not installed.
        InvalidValueError: for an address that is not this machine's without `allow_remote`, a token that is
            too short to be one, or a port that there is not.
        InfeasibleError: for an address or a port that cannot be had.
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
        """End the server: calls under way end, motions stop, clients are disconnected."""
        if not self._closed.acquire(blocking=False):
            return
        atexit.unregister(self.close)
        self._wire.refuse()
        body = self.broker.body
        with body.time.lock:
            body.tasks.kill(tuple(body.tasks), body)
        body.time.release()
        self._session.close(_async=True).wait(int(1000 * CLOSING))
        self._gate.close()  # not before: libqi still answers the calls that have just ended
        body.time.release()  # calls that were accepted just before
        del self._session  # libqi keeps the services for as long as there is a session
        self._open.clear()
        self._wire.close(CLOSING)

    def wait(self, ended: EndRequest | None = None) -> None:
        """Serve until Ctrl-C or SIGTERM.

        Args:
            ended: Set by somebody else to end it, as `ended_by_signals` does.

        Raises:
            Exception: what ended the simulation, if something did.
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
