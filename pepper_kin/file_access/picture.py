"""Figures of matplotlib, which is loaded when one is made, and files of them."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

from pepper_kin.exceptions import MissingDependencyError
from pepper_kin.file_access.atomic_file import PathName, write_bytes


def new_figure(purpose: str, **options: Any) -> Any:
    """Return a `matplotlib.figure.Figure` without pyplot: no window system and no global state.

    Args:
        purpose: What it is for, for the message.
        **options: Of the figure, such as `figsize` [inch].

    Raises:
        MissingDependencyError: where matplotlib is not installed.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise MissingDependencyError("matplotlib", 'pip install "pepper_kin[plot]"', purpose) from error
    figure = Figure(layout="constrained", **options)
    FigureCanvasAgg(figure)
    return figure


def write_figure(figure: Any, path: PathName) -> Path:
    """Write a figure as a PNG file; return its path.

    Raises:
        FileFormatError: where the file cannot be written.
    """
    content = io.BytesIO()
    figure.canvas.print_png(content)
    return write_bytes(path, content.getvalue())
