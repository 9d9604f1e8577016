"""Access to the server: pages that it served itself, on its own host names."""

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
    """The rules of one server.

    A page of another site can make a browser send requests here, but it cannot hide where it comes from
    (`Origin`), and where it gives this machine another name (DNS rebinding), by `Host`.  Beyond
    loopback others can reach the port, and a token stands in the address.

    Attributes:
        host: The address to listen on.
        token: What the address of the page must carry; None for none.
    """

    host: str = LOOPBACK
    token: str | None = None

    @classmethod
    def of(cls, host: str, allow_remote: bool, token: str | None = None, risk: str = RISK) -> Access:
        """Return the rules of a server on a host.

        Args:
            host: A name or address of this machine.
            allow_remote: Whether it may be one that other machines reach.
            token: The token; None draws one where others can reach the server, and leaves it out elsewhere.
            risk: What a host that others reach means, for the refusal.

        Raises:
            InvalidValueError: for a host beyond loopback that was not allowed, or a token that is too short
                to be one.
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
        """The host as it stands in an address for a browser."""
        name = socket.gethostname() if self.host in _ANY else self.host
        return f"[{name}]" if ":" in name else name

    def fault(self, host: str | None, origin: str | None, token: str | None) -> str | None:
        """Say why a request is refused, or None where it is not.

        Args:
            host: The header `Host`.
            origin: The header `Origin`, None where there is none.
            token: The token that it carries, None where there is none.
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
        if name in _LOOPBACK_NAMES or is_loopback(name):
            return True
        if is_loopback(self.host):
            return False
        own = {self.host.lower(), socket.gethostname().lower(), socket.getfqdn().lower()}
        return name in own or _is_address(name)


def is_loopback(host: str) -> bool:
    """Whether only this machine reaches a host, by its name or address."""
    if host.lower() in _LOOPBACK_NAMES:
        return True
    return _is_address(host) and ipaddress.ip_address(host).is_loopback


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def _name_of(host: str | None) -> str | None:
    """Return the name in a header `Host`, without its port, in small letters."""
    try:
        return urlsplit(f"//{host}").hostname if host else None
    except ValueError:
        return None


def _same_place(origin: str, host: str) -> bool:
    """Whether an origin is the place that the request went to, port included."""
    try:
        parts = urlsplit(origin)
    except ValueError:
        return False
    return parts.scheme in ("http", "https") and parts.netloc.lower() == host.lower()
