"""The state that all pages share, as values for JSON."""

from __future__ import annotations

from typing import Any


def blank_document() -> Document:
    """Return the initial state, without message, plan and motion."""
    document = Document()
    document.set("message", {"text": "", "kind": "info", "count": 0})
    document.set("busy", None)
    document.set("ready", {"servo": False, "planner": False})
    document.set("motion", None)
    document.set("alerts", [])
    document.set("touching", {"bodies": [], "objects": []})
    return document


class Document:
    """Values by name, each with the count of its last change.

    A page that has seen the state at a count requests the changes since: a slow page misses intermediate
    values, never the last one.
    """

    def __init__(self) -> None:
        self._values: dict[str, Any] = {}
        self._changed: dict[str, int] = {}
        self.count = 0

    def __getitem__(self, name: str) -> Any:
        return self._values[name]

    def set(self, name: str, value: Any) -> None:
        """Set a value; an equal value counts as no change."""
        if name in self._values and self._values[name] == value:
            return
        self.count += 1
        self._values[name] = value
        self._changed[name] = self.count

    def changes_since(self, count: int) -> dict[str, Any]:
        """Return the values that changed after a count; all for -1."""
        return {name: value for name, value in self._values.items() if self._changed[name] > count}
