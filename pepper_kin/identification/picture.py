"""Picture of the twin in comparison with a robot."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.file_access.atomic_file import PathName
from pepper_kin.file_access.picture import new_figure, write_figure
from pepper_kin.identification.replay import Replay

SHOWN = 40.0
"""Maximum time that is drawn [s]."""


def save_replay_picture(
    replays: Sequence[Replay], path: PathName, *, joints: Sequence[str] | None = None
) -> Path:
    """Draw command, robot and twin over the period of most motion in the first log, and errors of all logs.

    Stretches that no actuator explains are shaded.

    Args:
        replays: Replays of logs with the same joints.
        path: PNG file; its folder must exist.
        joints: Names of the joints to draw over time; all if omitted.

    Returns:
        The path.

    Raises:
        InvalidValueError: for no replay.
        MissingDependencyError: if matplotlib is not installed.
        FileFormatError: if the file cannot be written.
    """
    if not replays:
        raise InvalidValueError("replays", "none", "at least one")
    names = tuple(joints or replays[0].log.joint_names)
    figure = new_figure("the picture of a log", figsize=(11, 1.6 * len(names) + 2.6))
    grid = figure.add_gridspec(len(names) + 1, 1, height_ratios=[*[1.0] * len(names), 1.6])
    for row, joint in enumerate(names):
        _draw_joint(figure.add_subplot(grid[row]), replays[0], joint, row == 0)
    _draw_errors(figure.add_subplot(grid[len(names)]), replays)
    return write_figure(figure, path)


def _draw_joint(plot, one: Replay, joint: str, first: bool) -> None:  # type: ignore[no-untyped-def]
    """Draw one joint over time."""
    log, j = one.log, one.log.index(joint)
    begin = _liveliest(one)
    shown = (log.time >= begin) & (log.time <= begin + SHOWN)
    given = (log.command_time >= begin) & (log.command_time <= begin + SHOWN)
    plot.step(log.command_time[given], log.command[given, j], where="post", color="0.6", label="command")
    plot.plot(log.time[shown], log.measured[shown, j], ".-", color="C3", markersize=4, label="robot")
    plot.plot(log.time[shown], one.twin[shown, j], color="C0", label="twin")
    for stretch in one.stretches:
        if stretch.joint == joint and stretch.end > begin and stretch.begin < begin + SHOWN:
            plot.axvspan(stretch.begin, stretch.end, color="C1", alpha=0.25, linewidth=0)
    plot.set_xlim(begin, begin + SHOWN)
    plot.set_ylabel(f"{joint}\n[rad]", fontsize=8)
    plot.grid(alpha=0.3)
    if first:
        plot.set_title(f"{log.name}; shaded: no actuator explains it")
        plot.legend(loc="upper right", ncols=3, fontsize=8)


def _liveliest(one: Replay) -> float:
    """Return the start of the period in which the commands move most [s]."""
    log = one.log
    if log.duration <= SHOWN:
        return float(log.time[0])
    way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(log.command, axis=0)).sum(axis=1))])
    begins = np.arange(log.time[0] + 4.0, max(log.time[-1] - SHOWN, log.time[0] + 4.1), 5.0)
    moved = np.interp(begins + SHOWN, log.command_time, way) - np.interp(begins, log.command_time, way)
    return float(begins[int(np.argmax(moved))])


def _draw_errors(plot, replays: Sequence[Replay]) -> None:  # type: ignore[no-untyped-def]
    """Draw the fraction of readings with |twin - robot| above a size, by joint."""
    for joint in replays[0].log.joint_names:
        errors = [
            np.abs(one.error[:, one.log.index(joint)])[(one.judged & ~one.named)[:, one.log.index(joint)]]
            for one in replays
        ]
        size = np.sort(np.concatenate(errors))
        if size.size:
            plot.plot(1e3 * size, 1.0 - np.arange(size.size) / size.size, linewidth=1, label=joint)
    plot.set_yscale("log")
    plot.set_ylim(1e-3, 1.0)
    plot.set_xlim(0.0, 100.0)
    plot.set_xlabel("|twin - robot| [mrad], without the stretches")
    plot.set_ylabel("share of readings beyond")
    plot.grid(alpha=0.3)
    plot.legend(fontsize=7, ncols=2)
