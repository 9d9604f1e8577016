"""The state that all pages share, as values that JSON can carry."""

from __future__ import annotations

from typing import Any


def blank_document() -> Document:
    """Return the state before anything has been said, planned or loaded."""
    document = Document()
    document.set("message", {"text": "", "kind": "info", "count": 0})
    document.set("busy", None)
    document.set("ready", {"servo": False, "planner": False})
    document.set("motion", None)
    document.set("alerts", [])
    document.set("touching", {"bodies": [], "objects": []})
    return document


class Document:
    """Values by name, each with the count of changes at which it last changed.

    A page that has seen the state at some count asks for what changed since: a slow one misses steps between,
    never the last value.
    """

    def __init__(self) -> None:
        self._values: dict[str, Any] = {}
        self._changed: dict[str, int] = {}
        self.count = 0

    def __getitem__(self, name: str) -> Any:
        return self._values[name]

    def set(self, name: str, value: Any) -> None:
        """Give a value a name; nothing happens where it is the same already."""
        if name in self._values and self._values[name] == value:
            return
        self.count += 1
        self._values[name] = value
        self._changed[name] = self.count

    def changes_since(self, count: int) -> dict[str, Any]:
        """Return what changed after a count; -1 for everything."""
        return {name: value for name, value in self._values.items() if self._changed[name] > count}
