"""Links of a robot."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass
class Link:
    """A link, or the frame of a sensor.

    Attributes:
        index: Number of the link.
        name: Name of the link.
        parent_index: Number of the parent link; -1 for the root.
    """

    index: int
    name: str
    parent_index: int

    def getIndex(self) -> int:
        """Return the number of the link."""
        return self.index

    def getName(self) -> str:
        """Return the name of the link."""
        return self.name

    def getParentIndex(self) -> int:
        """Return the number of the parent link."""
        return self.parent_index
