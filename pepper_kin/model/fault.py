"""One thing that is wrong with a description."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Fault:
    """One thing that is wrong.

    Attributes:
        kind: "xml", "structure", "number", "mass", "inertia", "limits", "mimic", "mesh" or "geometry".
        where: The element, such as "joint HeadYaw".
        message: What is wrong with it, with numbers.
    """

    kind: str
    where: str
    message: str

    def __str__(self) -> str:
        return f"{self.kind}: {self.where}: {self.message}"
