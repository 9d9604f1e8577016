"""Files of the paper's validation: text, JSON, series, and figures 6 and 7."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np

from pepper_kin.file_access.atomic_file import make_folder, write_bytes
from pepper_kin.file_access.picture import new_figure
from pepper_kin.paper.check import ITERATIONS, MovementCheck, PaperCheck


def save_paper_check(check: PaperCheck, folder: str | Path) -> dict[str, Path]:
    """Write `paper.txt`, `paper.json` and, for each movement, a table and a picture.

    The pictures show, like the paper's figures 6 and 7, joint trajectories and errors over 1000 iterations,
    and below them the joint angles recovered from sensors on the links.

    Args:
        check: Results of the validation.
        folder: Folder of the files, created if missing.

    Returns:
        Written files by name.

    Raises:
        MissingDependencyError: if matplotlib is not installed.
        FileFormatError: if a file cannot be written.
    """
    folder = make_folder(folder)
    numbers = json.dumps(check.as_dict(), indent=2) + "\n"
    written = {
        "report": write_bytes(folder / "paper.txt", (check.report() + "\n").encode()),
        "numbers": write_bytes(folder / "paper.json", numbers.encode()),
    }
    for movement in check.movements:
        stem = f"figure_{movement.name}"
        written[f"{stem}.csv"] = write_bytes(folder / f"{stem}.csv", _series(movement).encode())
        content = io.BytesIO()
        paper_figure(movement).savefig(content, format="png", dpi=110)
        written[f"{stem}.png"] = write_bytes(folder / f"{stem}.png", content.getvalue())
    return written


def paper_figure(movement: MovementCheck) -> Any:
    """Draw a movement: joint trajectories, errors, and angles from accelerometers, over 1000 iterations.

    Returns:
        A figure of matplotlib.

    Raises:
        MissingDependencyError: if matplotlib is not installed.
    """
    time, commanded, measured = movement.iterations()
    steps, tilt = np.arange(ITERATIONS), movement.tilt
    figure = new_figure("figures 6 and 7 of the paper", figsize=(10, 11))
    figure.suptitle(f"{movement.name}: {ITERATIONS} iterations in {time[-1]:.1f} s", fontsize=13)
    top, middle, bottom = figure.subplots(3, 1, sharex=True)
    for j, joint in enumerate(tilt.joint_names):
        (line,) = top.plot(steps, measured[:, j], label=joint)
        top.plot(steps, commanded[:, j], "--", color=line.get_color(), linewidth=0.8)
        middle.plot(steps, measured[:, j] - commanded[:, j], color=line.get_color())
        bottom.plot(steps, tilt.estimate[:, j] - tilt.true[:, j], color=line.get_color())
        bottom.plot(steps, tilt.formulas[:, j] - tilt.true[:, j], ":", color=line.get_color(), linewidth=1.0)
    top.set(ylabel="joint position [rad]", title="commanded (dashed) and twin")
    top.legend(loc="best", fontsize=9)
    middle.set(ylabel="tracking error [rad]", title="twin less commanded")
    bottom.set(
        ylabel="error [rad]", xlabel="iteration", ylim=(-0.1, 0.1),
        title="angles from sensors on the links: filter, and tilt formulas (dotted; most leave the picture)",
    )  # fmt: skip
    for axes in (top, middle, bottom):
        axes.grid(alpha=0.3)
    return figure


def _series(movement: MovementCheck) -> str:
    """Return the time series of a movement as CSV."""
    time, commanded, measured = movement.iterations()
    tilt = movement.tilt
    head, columns = ["iteration", "time [s]"], [np.arange(ITERATIONS), time]
    for j, joint in enumerate(tilt.joint_names):
        head += [f"{joint}.{what} [rad]" for what in ("commanded", "twin", "tilt_formulas", "filter")]
        columns += [commanded[:, j], measured[:, j], tilt.formulas[:, j], tilt.estimate[:, j]]
    rows = [",".join(f"{value:.9g}" for value in row) for row in zip(*columns, strict=True)]
    return "\n".join([",".join(head), *rows]) + "\n"
