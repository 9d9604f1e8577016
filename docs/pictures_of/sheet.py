"""A sheet that drawn scenes, plots and words share, saved as a small file."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rcParams
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import ArrayLike
from PIL import Image

from pepper_kin.file_access.atomic_file import write_bytes

from .camera import Camera

SIZE = (800, 500)
FOLDER = Path(__file__).resolve().parents[1] / "pictures"
HORIZON = "#eef2f6"
INK = "#26323f"
COLORS = {"orange": "#ed5c33", "blue": "#296bc7", "green": "#2e9459", "gray": "#73808f", "violet": "#8c45cc"}
STYLE = {
    "font.size": 10,
    "axes.edgecolor": "#8793a0",
    "axes.labelcolor": INK,
    "axes.titlesize": 11,
    "axes.titlecolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#dde3ea",
    "axes.axisbelow": True,
    "xtick.color": INK,
    "ytick.color": INK,
    "legend.frameon": False,
    "text.color": INK,
}
rcParams.update(STYLE)


class Sheet:
    """A picture that is put together; places count in pixels from the upper left corner."""

    def __init__(self, size: tuple[int, int] = SIZE) -> None:
        self.size = size
        self.figure = Figure(figsize=(size[0] / 100, size[1] / 100), dpi=100, facecolor="white")
        FigureCanvasAgg(self.figure)
        self._over: Any = None

    def image(self, image: Image.Image, left: int = 0, top: int = 0) -> Sheet:
        """Put a drawn image somewhere, pixel by pixel."""
        below = self.size[1] - top - image.height
        self.figure.figimage(np.asarray(image)[::-1], left, below, origin="lower", zorder=-1)
        return self

    def axes(self, left: int, top: int, width: int, height: int, **options: Any) -> Any:
        """Return axes for a plot whose frame is there."""
        wide, high = self.size
        place = (left / wide, 1 - (top + height) / high, width / wide, height / high)
        return self.figure.add_axes(place, **options)

    def text(self, left: float, top: float, words: str, **options: Any) -> Sheet:
        """Write words."""
        options = {"fontsize": 10, "color": INK, "va": "top", **options}
        self.figure.text(left / self.size[0], 1 - top / self.size[1], words, **options)
        return self

    def label(
        self,
        camera: Camera,
        point: ArrayLike,
        words: str,
        offset: tuple[float, float],
        *,
        color: str = INK,
        corner: tuple[int, int] = (0, 0),
    ) -> Sheet:
        """Name a point of a scene: words at an offset from where it is seen [pixel, y up], and a line."""
        if self._over is None:
            self._over = self.axes(0, 0, *self.size)
            self._over.set(xlim=(0, self.size[0]), ylim=(self.size[1], 0), facecolor="none")
            self._over.axis("off")
        x, y = camera.project(point) + corner
        self._over.annotate(
            words,
            (x, y),
            offset,
            textcoords="offset pixels",
            fontsize=10,
            color=color,
            ha="center",
            va="center",
            bbox={"boxstyle": "round,pad=0.25", "facecolor": "white", "edgecolor": "none", "alpha": 0.85},
            arrowprops={"arrowstyle": "-", "color": color, "linewidth": 0.9, "shrinkA": 0, "shrinkB": 2},
        )
        return self

    def save(self, name: str) -> Path:
        """Write the picture into the documentation's folder."""
        drawn = io.BytesIO()
        self.figure.savefig(drawn, format="png", dpi=100)
        return save_small(Image.open(drawn).convert("RGB"), name)


def save_small(image: Image.Image, name: str) -> Path:
    """Write an image in at most 256 colors of its own."""
    content = io.BytesIO()
    palette = image.quantize(256, method=Image.Quantize.MEDIANCUT, kmeans=3, dither=Image.Dither.NONE)
    few = image.quantize(palette=palette, dither=Image.Dither.FLOYDSTEINBERG)  # no steps in the sky
    few.save(content, format="PNG", optimize=True)
    return write_bytes(FOLDER / name, content.getvalue())
