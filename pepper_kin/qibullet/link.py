"""Links of a robot."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass
class Link:
    """A link, or the frame of a sensor.

    Attributes:
        index: Its number.
        name: Its name.
        parent_index: Number of the link that it hangs on; -1 for the first one.
    """

    index: int
    name: str
    parent_index: int

    def getIndex(self) -> int:
        """Return the number."""
        return self.index

    def getName(self) -> str:
        """Return the name."""
        return self.name

    def getParentIndex(self) -> int:
        """Return the number of the link that it hangs on."""
        return self.parent_index
