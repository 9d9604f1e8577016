"""Figures of matplotlib, which is loaded when one is made, and files of them."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

from pepper_kin.exceptions import UnknownNameError, optional
from pepper_kin.file_access.atomic_file import PathName, write_bytes


def new_figure(purpose: str, **options: Any) -> Any:
    """Return a `matplotlib.figure.Figure` without pyplot: no window system and no global state.

    Args:
        purpose: What it is for, for the message.
        **options: Of the figure, such as `figsize` [inch].

    Raises:
        MissingDependencyError: where matplotlib is not installed.
    """
    figure = optional("matplotlib.figure", extra="plot", need=purpose).Figure(layout="constrained", **options)
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    FigureCanvasAgg(figure)
    return figure


FORMATS = ("png", "pdf", "svg")
COLORS = ("#1f77b4", "#d95f02", "#1b9e77", "#7570b3", "#e7298a", "#66a61e", "#a6761d", "#444444")
"""Of the lines of plots, in turn; from the ninth on they are dashed."""
LIMIT_COLOR = "#c0392b"


def line_style(number: int) -> tuple[str, Any]:
    """Return color and style of a line by its number, from 0 on."""
    return COLORS[number % len(COLORS)], "-" if number < len(COLORS) else "--"


def plain_words(text: str) -> str:
    """Return text that matplotlib can draw: names of files may hold what is no character."""
    return text.encode("utf-8", "replace").decode()


def figure_format(path: PathName) -> str:
    """Return the format of a figure's file by its suffix.

    Raises:
        UnknownNameError: for another one than `FORMATS`.
    """
    kind = Path(path).suffix.lower().lstrip(".")
    if kind not in FORMATS:
        raise UnknownNameError("suffix", f".{kind}", (f".{name}" for name in FORMATS))
    return kind


def write_figure(figure: Any, path: PathName, kind: str = "png", dpi: float = 100) -> Path:
    """Write a figure as a file of a format; return its path.  Fonts go into a PDF whole, as printers ask.

    Raises:
        FileFormatError: where the file cannot be written.
    """
    from matplotlib import rc_context

    content = io.BytesIO()
    with rc_context({"pdf.fonttype": 42, "svg.fonttype": "path"}):
        figure.savefig(content, format=kind, dpi=dpi)
    return write_bytes(path, content.getvalue())
