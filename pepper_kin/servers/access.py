"""Access rules of a server: only its own pages, under its own host names."""

from __future__ import annotations

import hmac
import ipaddress
import secrets
import socket
from dataclasses import dataclass
from urllib.parse import urlsplit

from pepper_kin.exceptions import InvalidValueError

RISK = "others could move the robot's picture, plan on this machine, and see what is shown"
LOOPBACK = "127.0.0.1"
_LOOPBACK_NAMES = ("localhost",)
_ANY = ("0.0.0.0", "::")


@dataclass(frozen=True)
class Access:
    """Access rules of one server.

    A page of another site can make a browser send requests to this server, but it cannot hide its origin
    (`Origin`), nor another name that it gave this machine by DNS rebinding (`Host`). Beyond loopback other
    machines can reach the port, so a token in the address is required.

    Attributes:
        host: Address on which the server listens.
        token: Token that the page's address must contain; None for none.
    """

    host: str = LOOPBACK
    token: str | None = None

    @classmethod
    def of(cls, host: str, allow_remote: bool, token: str | None = None, risk: str = RISK) -> Access:
        """Return the rules of a server on a host.

        Args:
            host: Name or address of this machine.
            allow_remote: Whether other machines may reach the host.
            token: The token; None draws one if other machines can reach the server, else no token is used.
            risk: Risk of a reachable host, for the error message.

        Raises:
            InvalidValueError: for a host beyond loopback that is not allowed, or a token that is too short or
                not alphanumeric.
        """
        if token is not None and (len(token) < 8 or not token.isascii() or not token.isalnum()):
            raise InvalidValueError("token", "something else", "eight or more letters and digits")
        if is_loopback(host):
            return cls(host, token)
        if not allow_remote:
            raise InvalidValueError(
                "host",
                repr(host),
                f"a loopback address, or allow_remote (--allow-remote): {risk}",
            )
        return cls(host, token or secrets.token_hex(16))

    @property
    def shown_host(self) -> str:
        """Host in the form of a browser's address."""
        name = socket.gethostname() if self.host in _ANY else self.host
        return f"[{name}]" if ":" in name else name

    def fault(self, host: str | None, origin: str | None, token: str | None) -> str | None:
        """Return the reason why a request is refused; None for an allowed request.

        Args:
            host: Header `Host` of the request.
            origin: Header `Origin`, or None.
            token: Token of the request, or None.
        """
        name = _name_of(host)
        if name is None or not self._is_mine(name):
            return "This server does not go by that name."
        if origin is not None and not _same_place(origin, host or ""):
            return "Pages of other sites may not use this server."
        if self.token is not None and not hmac.compare_digest(
            (token or "").encode("utf-8", "replace"), self.token.encode()
        ):
            return "The address lacks the token that was printed when the server started."
        return None

    def _is_mine(self, name: str) -> bool:
        """Whether a host name is this machine's, as far as the server listens on it."""
        if name in _LOOPBACK_NAMES or is_loopback(name):
            return True
        if is_loopback(self.host):
            return False
        own = {self.host.lower(), socket.gethostname().lower(), socket.getfqdn().lower()}
        return name in own or _is_address(name)


def is_loopback(host: str) -> bool:
    """Whether a host name or address is a loopback one, which only this machine reaches."""
    if host.lower() in _LOOPBACK_NAMES:
        return True
    return _is_address(host) and ipaddress.ip_address(host).is_loopback


def _is_address(name: str) -> bool:
    """Whether a host name is an IP address."""
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def _name_of(host: str | None) -> str | None:
    """Return the name in a header `Host` without port, in lower case; None for a malformed header."""
    try:
        return urlsplit(f"//{host}").hostname if host else None
    except ValueError:
        return None


def _same_place(origin: str, host: str) -> bool:
    """Whether an origin has the host and port of the request."""
    try:
        parts = urlsplit(origin)
    except ValueError:
        return False
    return parts.scheme in ("http", "https") and parts.netloc.lower() == host.lower()
