"""Figures of matplotlib, which is loaded at the first figure, and their files."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

from pepper_kin.exceptions import UnknownNameError, optional
from pepper_kin.file_access.atomic_file import PathName, write_bytes


def new_figure(purpose: str, **options: Any) -> Any:
    """Return a `matplotlib.figure.Figure` without pyplot: no window system and no global state.

    Args:
        purpose: Purpose of the figure, for the error message.
        **options: Options of the figure, such as `figsize` [inch].

    Raises:
        MissingDependencyError: if matplotlib is not installed.
    """
    figure = optional("matplotlib.figure", extra="plot", need=purpose).Figure(layout="constrained", **options)
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    FigureCanvasAgg(figure)
    return figure


FORMATS = ("png", "pdf", "svg")
COLORS = ("#1f77b4", "#d95f02", "#1b9e77", "#7570b3", "#e7298a", "#66a61e", "#a6761d", "#444444")
"""Colors of the lines of plots in order; from the ninth line on they repeat with dashes."""
LIMIT_COLOR = "#c0392b"


def line_style(number: int) -> tuple[str, Any]:
    """Return color and style of a line by its index."""
    return COLORS[number % len(COLORS)], "-" if number < len(COLORS) else "--"


def plain_words(text: str) -> str:
    """Return text that matplotlib can draw: file names may contain halves of surrogate pairs."""
    return text.encode("utf-8", "replace").decode()


def figure_format(path: PathName) -> str:
    """Return the format of a figure's file by its suffix.

    Raises:
        UnknownNameError: for a suffix that is not in `FORMATS`.
    """
    kind = Path(path).suffix.lower().lstrip(".")
    if kind not in FORMATS:
        raise UnknownNameError("suffix", f".{kind}", (f".{name}" for name in FORMATS))
    return kind


def write_figure(figure: Any, path: PathName, kind: str = "png", dpi: float = 100) -> Path:
    """Write a figure as a file of a format and return its path.

    A PDF contains its fonts as TrueType, as print shops require.

    Raises:
        FileFormatError: if the file cannot be written.
    """
    from matplotlib import rc_context

    content = io.BytesIO()
    with rc_context({"pdf.fonttype": 42, "svg.fonttype": "path"}):
        figure.savefig(content, format=kind, dpi=dpi)
    return write_bytes(path, content.getvalue())
