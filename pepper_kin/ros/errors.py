"""Errors of transports."""

from __future__ import annotations

from pepper_kin.exceptions import PepperKinError, shortened


class TransportError(PepperKinError):
    """A transport cannot do what was requested: no peer, a closed connection, a missing feature.

    Attributes:
        name: Topic, service or action; or the transport's name.
        reason: What is wrong, with advice.
    """

    def __init__(self, name: str, reason: str) -> None:
        self.name, self.reason = name, reason
        super().__init__(f"{shortened(name)}: {reason}")


class NotCarriedError(TransportError):
    """A transport has no services or no actions; topics of the same node work."""
