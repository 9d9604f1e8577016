"""Drawing commands for meshcat on the pages, kept for pages that open later."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any

from pepper_kin.viewer.drawable import Color, Drawable
from pepper_kin.viewer.drawing import draw_commands

Root = tuple[str, ...]


class Board:
    """Groups of drawables by their path; a group is drawn, shown, hidden and erased as a whole.

    Args:
        send: Sends a packed command to all open pages.
    """

    def __init__(self, send: Callable[[bytes], None]) -> None:
        self._send = send
        self._drawn: dict[Root, list[bytes]] = {}
        self._shown: dict[Root, bytes] = {}
        self._painted: dict[Root, bytes] = {}

    def draw(self, root: Root, drawables: Iterable[Drawable]) -> None:
        """Replace the drawables of a group."""
        self.erase(root)
        commands = [_packed(command) for command in draw_commands(drawables, root)]
        if commands:
            self._drawn[root] = commands
            kept = [self._shown.get(root), self._painted.get(root)]
            for command in (*commands, *filter(None, kept)):
                self._send(command)

    def erase(self, root: Root) -> None:
        """Erase a group."""
        if self._drawn.pop(root, None):
            self._send(_packed({"type": "delete", "path": _lowered(root)}))

    def show(self, root: Root, visible: bool) -> None:
        """Show or hide a group, also when it is drawn again."""
        self._shown[root] = _packed(
            {"type": "set_property", "path": _lowered(root), "property": "visible", "value": visible}
        )
        self._send(self._shown[root])

    def paint(self, root: Root, color: Color) -> None:
        """Set the color of a group, red, green, blue, opacity, also when it is drawn again."""
        self._painted[root] = _packed(
            {"type": "set_property", "path": _lowered(root), "property": "color", "value": list(color)}
        )
        self._send(self._painted[root])

    def snapshot(self) -> Iterator[bytes]:
        """Yield the commands that draw all groups on an empty page."""
        for commands in self._drawn.values():
            yield from commands
        yield from self._shown.values()
        yield from (command for root, command in self._painted.items() if root in self._drawn)


def _lowered(root: Root) -> str:
    return "/" + "/".join(root)


def _packed(command: dict[str, Any]) -> bytes:
    import umsgpack

    return bytes(umsgpack.packb(command))
