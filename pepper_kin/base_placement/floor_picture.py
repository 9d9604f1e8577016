"""Picture of a placement map."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.base_placement.placement_map import PlacementMap
from pepper_kin.file_access.picture import new_figure, write_figure
from pepper_kin.model.joint_vectors import as_finite


def save_floor_picture(found: PlacementMap, path: str | Path, targets: ArrayLike | None = None) -> Path:
    """Draw a placement map from above: the best score of each cell, with an arrow for its heading.

    Args:
        found: The map.
        path: PNG file; its folder must exist.
        targets: Points to mark [m], shape (k, 3) or (k, 2); None for none.

    Returns:
        The path.

    Raises:
        MissingDependencyError: if matplotlib is not installed.
        InvalidValueError: for targets of another shape, NaN or infinity.
        FileFormatError: if the file cannot be written.
    """
    figure = new_figure("the picture of the floor", figsize=(7, 6))
    axes = figure.subplots()
    corner = found.origin + np.array(found.scores.shape) * found.resolution
    image = axes.imshow(
        np.ma.masked_invalid(found.scores).T,
        origin="lower",
        extent=(found.origin[0], corner[0], found.origin[1], corner[1]),
        vmin=0,
        cmap="viridis",
        aspect="equal",
    )
    x, y = found.centers.T
    yaws = found.yaws[np.isfinite(found.scores)]
    axes.quiver(x, y, np.cos(yaws), np.sin(yaws), color="white", scale=30, width=0.003, pivot="mid")
    if targets is not None:
        width = np.shape(targets)[-1] if np.ndim(targets) == 2 else 3
        points = as_finite(targets, "targets", (None, 2 if width == 2 else 3))
        axes.plot(points[:, 0], points[:, 1], "r+", markersize=10, label="targets")
        axes.legend(loc="upper right")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.set_title(f"suitable places: {found.area:.2f} m²")
    figure.colorbar(image, ax=axes, label="best score")
    return write_figure(figure, path)
