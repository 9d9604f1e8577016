"""The module `qi.logging` of Python scripts: messages by category, in the twin's log."""

from __future__ import annotations

from fnmatch import fnmatchcase
from typing import Any

from pepper_kin.naoqi.shims.futures import current_broker

SILENT, FATAL, ERROR, WARNING, INFO, VERBOSE, DEBUG = range(7)
_LEVELS: dict[str, int] = {"*": INFO}


class Logger:
    """Logger of a category."""

    def __init__(self, category: str = "") -> None:
        self._category = category

    def _log(self, level: int, text: Any, arguments: tuple[Any, ...]) -> None:
        pattern = next((one for one in reversed(_LEVELS) if fnmatchcase(self._category, one)), "*")
        if level <= _LEVELS[pattern]:
            current_broker().log(f"{self._category}: {' '.join(map(str, (text, *arguments)))}")

    def fatal(self, text: Any, *arguments: Any) -> None:
        """Log a fatal error."""
        self._log(FATAL, text, arguments)

    def error(self, text: Any, *arguments: Any) -> None:
        """Log an error."""
        self._log(ERROR, text, arguments)

    def warning(self, text: Any, *arguments: Any) -> None:
        """Log a warning."""
        self._log(WARNING, text, arguments)

    def info(self, text: Any, *arguments: Any) -> None:
        """Log an information."""
        self._log(INFO, text, arguments)

    def verbose(self, text: Any, *arguments: Any) -> None:
        """Log details."""
        self._log(VERBOSE, text, arguments)

    def debug(self, text: Any, *arguments: Any) -> None:
        """Log a message for debugging."""
        self._log(DEBUG, text, arguments)


def setLevel(level: int) -> None:
    """Set the level up to which messages are logged: SILENT, FATAL, ..., DEBUG."""
    _LEVELS["*"] = int(level)


def setFilters(filters: str) -> None:
    """Set levels of categories: "+naoqi*=5:-audio*"; without a level, + logs all messages and - none."""
    for one in filters.replace(",", ":").split(":"):
        name, _, level = one.lstrip("+-").partition("=")
        if name:
            _LEVELS.pop(name, None)
            _LEVELS[name] = int(level) if level else (SILENT if one.startswith("-") else DEBUG)


def setContext(context: int) -> None:
    """Accept the parts of a line, without effect: the twin's log has time and category."""


def _of(level: str) -> Any:
    return lambda category, text, *arguments: getattr(Logger(category), level)(text, *arguments)


fatal, error, warning, info, verbose, debug = map(
    _of, ("fatal", "error", "warning", "info", "verbose", "debug")
)
