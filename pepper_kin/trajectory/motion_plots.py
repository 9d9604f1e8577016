"""Plots of motions over time, in units and with limits: one motion, or several together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, TypeAlias

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.collision.loads import inverse_dynamics_with, loads_of
from pepper_kin.dynamics.load import Loads
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.file_access.atomic_file import PathName
from pepper_kin.file_access.picture import (
    LIMIT_COLOR,
    figure_format,
    line_style,
    new_figure,
    plain_words,
    write_figure,
)
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import check_positive
from pepper_kin.trajectory.plot import joints_to_draw
from pepper_kin.trajectory.samples import refuse_other_joints, unit_of
from pepper_kin.trajectory.trajectory import Trajectory

if TYPE_CHECKING:
    from pepper_kin.collision import Scene

QUANTITIES = ("position", "velocity", "acceleration", "torque", "error")
"""Quantities that can be drawn; "error" is the position of a run minus its reference."""

MOST_ROWS = 6
"""Number of joints drawn if none are named: the joints that move most."""

_STEP, _POINTS = 0.002, 4000
_NEAR = 0.5  # fraction of a limit above which the limit's line is drawn


class PlottedRun(Protocol):
    """Data of a run of the twin that plots read; arrays have shape (T,) or (T, n).

    Attributes:
        joint_names: Order of the columns.
        time: Sample times [s].
        position: Joint positions [rad or m].
        velocity: Joint velocities [rad/s or m/s].
        torque: Joint torques [N m or N].
        reference_position: Reference positions of the servos [rad or m].
    """

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Order of the columns."""

    @property
    def time(self) -> Array:
        """Sample times."""

    @property
    def position(self) -> Array:
        """Joint positions."""

    @property
    def velocity(self) -> Array:
        """Joint velocities."""

    @property
    def torque(self) -> Array:
        """Joint torques."""

    @property
    def reference_position(self) -> Array:
        """Reference positions of the servos."""


Plottable: TypeAlias = Trajectory | PlottedRun
"""A trajectory or a run of the twin."""


class _Lines(NamedTuple):
    """A motion as lines: quantities by name, shape (T, n) each."""

    time: Array
    values: Mapping[str, Array]


def plot_motions(
    pepper: PepperModel,
    motions: Plottable | Mapping[str, Plottable],
    path: PathName | None = None,
    *,
    joints: str | Sequence[str] | None = None,
    quantities: Sequence[str] | None = None,
    title: str | None = None,
    width: float = 7.1,
    scene: Scene | None = None,
    payload: Mapping[str, float] | None = None,
) -> Any:
    """Draw joints over time, in their units and with the robot's limits, of one motion or of several.

    A row for each joint, a column for each quantity.  Dashed red lines are limits; a limit far from the
    motion is only written above the plot.  A run that is drawn alone is shown with its reference, dashed and
    gray.  `plot` draws a trajectory as fractions of limits, for all joints at once.

    Args:
        pepper: The robot.
        motions: A trajectory or a run of the twin, or several by their names in the legend.
        path: File to write, .png, .pdf or .svg; nothing is written if omitted.
        joints: Joints to draw, names of joints and groups; the six that move most if omitted.
        quantities: Names of `QUANTITIES`; position, velocity and torque if omitted.
        title: Heading; none if omitted.
        width: Width of the picture [inch]; 7.1 fits a page of two columns, 3.5 one column.
        scene: The scene whose attached objects count in the torques of trajectories; a run has its own
            torques.
        payload: Point masses held at "left", "right" or a frame by name [kg], for the torques of
            trajectories.

    Returns:
        The figure of matplotlib, which shows itself in a notebook.

    Raises:
        InvalidValueError: for no motion, another type, or a motion of other joints; for the acceleration of a
            run, or the error of a trajectory, which do not exist.
        UnknownNameError: for an unknown joint, group, quantity, frame or suffix.
        MissingDependencyError: where matplotlib is not installed.
        FileFormatError: where the file cannot be written.
    """
    kind = None if path is None else figure_format(path)
    chosen = ("position", "velocity", "torque") if quantities is None else tuple(quantities)
    for name in chosen:
        if name not in QUANTITIES:
            raise UnknownNameError("quantity", name, QUANTITIES)
    alone = "" if isinstance(motions, Trajectory) else "run"
    named = dict(motions) if isinstance(motions, Mapping) else {alone: motions}
    if not (named and chosen):
        raise InvalidValueError("motions and quantities", "none", "one or more")
    held = loads_of(pepper, scene, payload)
    lines = {label: _lines(pepper, label, motion, chosen, held) for label, motion in named.items()}
    rows = _rows(pepper, list(lines.values()), joints)
    size = check_positive("width", width, "inch"), 0.5 + 1.35 * len(rows)
    figure = new_figure("a plot of motions", figsize=size)
    axes = figure.subplots(len(rows), len(chosen), sharex=True, squeeze=False)
    for row, j in enumerate(rows):
        for column, quantity in enumerate(chosen):
            _draw(axes[row, column], pepper, quantity, j, lines, column == 0)
    for column, quantity in enumerate(chosen):
        axes[0, column].set_title(quantity, fontsize=9, loc="left")
        axes[-1, column].set_xlabel("time [s]", fontsize=8)
    handles, words = axes[0, 0].get_legend_handles_labels()
    if words:
        legend = figure.legend(
            handles, words, loc="outside lower center", ncols=min(len(words), 4), fontsize=8, frameon=False
        )
        for text in legend.get_texts():
            text.set_parse_math(False)
    if title is not None:
        figure.suptitle(plain_words(title), fontsize=10, parse_math=False)
    if path is not None and kind is not None:
        write_figure(figure, path, kind, dpi=200)
    return figure


def _lines(
    pepper: PepperModel, label: str, motion: Plottable, quantities: Sequence[str], loads: Loads
) -> _Lines:
    """Return the curves of a motion.

    Args:
        pepper: The robot.
        label: The motion's name.
        motion: A trajectory or a run.
        quantities: Names of the quantities to draw.
        loads: Loads that trajectories carry.
    """
    of = f" {label!r}" if label else ""
    if isinstance(motion, Trajectory):
        refuse_other_joints(pepper, motion.joint_names)
        if "error" in quantities:
            raise InvalidValueError("quantities", f"the error of a trajectory{of}", "of runs: it has none")
        time = np.linspace(0.0, motion.duration, min(_POINTS, int(motion.duration / _STEP) + 2))
        state = motion(time)
        values = state._asdict()
        if "torque" in quantities:
            values["torque"] = inverse_dynamics_with(pepper, loads, *state)
        return _Lines(time, values)
    try:
        refuse_other_joints(pepper, motion.joint_names)
        values = {name: getattr(motion, name) for name in ("position", "velocity", "torque")}
        values |= {"reference": motion.reference_position}
        values |= {"error": motion.position - motion.reference_position}
        time = motion.time
    except AttributeError as error:
        allowed = "a trajectory, a run, or several by name"
        raise InvalidValueError(f"motion{of}", type(motion).__name__, allowed) from error
    if "acceleration" in quantities:
        raise InvalidValueError("quantities", f"the acceleration of a run{of}", "quantities that it has")
    return _Lines(time, values)


def _rows(pepper: PepperModel, lines: Sequence[_Lines], joints: str | Sequence[str] | None) -> list[int]:
    """Return indices of the joints to draw; if none are named, of the six that move most, in order."""
    if joints is not None:
        return joints_to_draw(pepper, lines[0].values["position"], joints)
    way = np.max([np.ptp(line.values["position"], axis=0) for line in lines], axis=0)
    return sorted(np.argsort(-way, kind="stable")[:MOST_ROWS].tolist())


def _draw(
    axes: Any, pepper: PepperModel, quantity: str, j: int, lines: Mapping[str, _Lines], first: bool
) -> None:
    """Draw a quantity of a joint of all motions, with its limits, and in the first column its name."""
    most = 0.0
    for number, (label, line) in enumerate(lines.items()):
        value = line.values[quantity][:, j]
        most = max(most, float(np.abs(value).max()))
        color, style = line_style(number)
        # matplotlib leaves a name with a leading underscore out of the legend.
        name = plain_words(label).replace("_", " ", 1) if label.startswith("_") else plain_words(label)
        wide = max(1.0, 2.0 - 0.5 * number)  # so that a line under another one is seen
        axes.plot(line.time, value, color=color, linestyle=style, linewidth=wide, label=name or None)
        if quantity == "position" and len(lines) == 1 and "reference" in line.values:
            reference = line.values["reference"][:, j]
            axes.plot(line.time, reference, color="0.45", linestyle="--", linewidth=0.8, label="reference")
    unit = unit_of("position" if quantity == "error" else quantity, pepper.joint_units[j]).replace("^2", "²")
    name = f"{pepper.joint_names[j]}\n" if first else ""
    axes.set_ylabel(f"{name}[{unit}]", fontsize=8, parse_math=False)
    _draw_limits(axes, pepper, quantity, j, most)
    axes.margins(x=0)
    axes.grid(alpha=0.3, linewidth=0.5)
    axes.tick_params(labelsize=7)


def _draw_limits(axes: Any, pepper: PepperModel, quantity: str, j: int, most: float) -> None:
    """Draw the limits of a joint that a motion comes near to, and write all limits above the plot.

    Args:
        axes: The axes to draw into.
        pepper: The robot.
        quantity: Name of the quantity; errors have no limit.
        j: Index of the joint.
        most: Maximum absolute value of the motion.
    """
    if quantity == "error":
        return
    upper = {
        "position": pepper.upper_limits,
        "velocity": pepper.velocity_limits,
        "acceleration": pepper.acceleration_limits,
        "torque": pepper.effort_limits,
    }[quantity][j]
    lower = pepper.lower_limits[j] if quantity == "position" else -upper
    if not np.isfinite([lower, upper]).all():
        return
    if most > _NEAR * min(abs(lower), abs(upper)) or quantity == "position":
        low, high = axes.get_ylim()
        room = 0.6 * (high - low)
        for limit in (lower, upper):
            if low - room < limit < high + room:
                axes.axhline(limit, color=LIMIT_COLOR, linestyle="--", linewidth=0.9)
    words = f"limit ±{upper:.3g}" if lower == -upper else f"limits {lower:.3g}, {upper:.3g}"
    axes.annotate(
        words, (1, 1), xycoords="axes fraction", ha="right", va="bottom", fontsize=6.5, color=LIMIT_COLOR
    )
