"""Pictures of reach maps."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.file_access.picture import new_figure, write_figure

if TYPE_CHECKING:
    from pepper_kin.kinematics.reach_map import ReachMap

VIEWS = (("from the side", 1, "x [m]", "z [m]"), ("from above", 2, "x [m]", "y [m]"))


def save_reach_picture(maps: Mapping[str, ReachMap], path: str | Path) -> Path:
    """Draw maps next to one another, from the side and from above.

    Colors show the maximum manipulability along each line of sight, relative to the map's own maximum, since
    more joints give more manipulability everywhere.

    Args:
        maps: Title -> map.
        path: PNG file; its folder must exist.

    Returns:
        The path.

    Raises:
        InvalidValueError: for no map.
        MissingDependencyError: if matplotlib is not installed.
        FileFormatError: if the file cannot be written.
    """
    if not maps:
        raise InvalidValueError("maps", maps, "at least one map")
    figure = new_figure("the picture of reach", figsize=(4 * len(maps) + 1, 7.5))
    axes = figure.subplots(len(VIEWS), len(maps), squeeze=False)
    lowest = np.min([m.origin for m in maps.values()], axis=0)
    highest = np.max([m.origin + np.array(m.counts.shape) * m.resolution for m in maps.values()], axis=0)
    for column, (title, found) in enumerate(maps.items()):
        top = max(float(found.best.max()), np.finfo(np.float32).tiny)
        corner = found.origin + np.array(found.counts.shape) * found.resolution
        for row, (view, along, across, up) in enumerate(VIEWS):
            plot = axes[row, column]
            shown = np.ma.masked_where(found.counts.max(axis=along) == 0, found.best.max(axis=along) / top).T
            kept = [k for k in range(3) if k != along]
            extent = [x[k] for k in kept for x in (found.origin, corner)]
            image = plot.imshow(
                shown, origin="lower", extent=extent, vmin=0, vmax=1, cmap="viridis", aspect="equal"
            )
            plot.set_xlim(lowest[kept[0]], highest[kept[0]])
            plot.set_ylim(lowest[kept[1]], highest[kept[1]])
            plot.set_xlabel(across)
            plot.set_ylabel(up)
            plot.grid(alpha=0.3)
            heading = f"{title}: {found.volume:.2f} m³\n{view}" if row == 0 else view
            plot.set_title(heading)
    figure.colorbar(image, ax=axes, label="best manipulability, share of the map's largest", shrink=0.6)
    return write_figure(figure, path)
