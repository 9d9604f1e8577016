"""Pictures of trajectories as shares of limits: four quantities, and the phase plane."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.collision.loads import inverse_dynamics_with, loads_of
from pepper_kin.dynamics.load import Loads, carried_words
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
from pepper_kin.trajectory.phase_plane import PhasePlane, phase_plane
from pepper_kin.trajectory.quantities import unit_of

if TYPE_CHECKING:
    from pepper_kin.collision import Scene
    from pepper_kin.trajectory.trajectory import Trajectory


QUANTITIES = ("position", "velocity", "acceleration", "torque")
_POINTS = 1500
_MOVES = 1e-3  # [rad or m] a joint that moves less is left out
_LEGEND = "greatest share of limits: position [rad]; velocity [rad/s]; acceleration [rad/s²]; torque [N m]"


def plot(
    pepper: PepperModel,
    trajectory: Trajectory,
    path: PathName | None = None,
    *,
    joints: str | Sequence[str] | None = None,
    title: str | None = None,
    scene: Scene | None = None,
    payload: Mapping[str, float] | None = None,
) -> Any:
    """Draw a trajectory against the robot's limits.

    Position, velocity, acceleration and torque of each joint as a share of its limits, so that joints of
    different strength share one picture: 1 and -1 are the ends of its range, what lies beyond is shaded.  A
    joint's numbers at its worst instant are in the legend.  Below, the phase plane with the maximum-velocity
    curve; see `phase_plane`.

    Args:
        pepper: The robot.
        trajectory: The trajectory; its joints must be the robot's.
        path: File to write, .png, .pdf or .svg; nothing is written if omitted.
        joints: Joints to draw, names of joints and groups; those that move if omitted.
        title: Heading; duration, joints and what is carried if omitted.
        scene: The scene whose attached objects count with their mass; None for none.
        payload: Point masses held at "left", "right" or a frame by name [kg], besides attached objects.

    Returns:
        The figure of matplotlib, which shows itself in a notebook.

    Raises:
        InvalidValueError: where the joints are not the robot's, or the trajectory does not move.
        UnknownNameError: for an unknown joint, group, frame or suffix.
        MissingDependencyError: where matplotlib is not installed.
        FileFormatError: where the file cannot be written.
    """
    kind = None if path is None else figure_format(path)
    held = loads_of(pepper, scene, payload)
    plane = phase_plane(pepper, trajectory, scene=scene, payload=payload)
    time = np.linspace(0.0, trajectory.duration, _POINTS)
    places = joints_to_draw(pepper, trajectory(time).position, joints)
    figure = new_figure("a plot of a trajectory", figsize=(11, 11))
    axes = figure.subplot_mosaic(
        [["position", "velocity"], ["acceleration", "torque"], ["legend", "legend"], ["plane", "plane"]],
        height_ratios=[1.0, 1.0, 0.12 + 0.11 * np.ceil(len(places) / 2), 1.15],
    )
    heading = f"{len(places)} joints in {trajectory.duration:.2f} s{carried_words(held)}"
    # A `$` is not to begin a formula.
    figure.suptitle(plain_words(title or heading), fontsize=13, parse_math=False)
    peaks = [_draw_quantity(axes[name], pepper, name, trajectory, time, places, held) for name in QUANTITIES]
    _draw_legend(axes["legend"], pepper, places, peaks)
    _draw_plane(axes["plane"], plane)
    if path is not None and kind is not None:
        write_figure(figure, path, kind, dpi=120)
    return figure


def joints_to_draw(pepper: PepperModel, position: Array, joints: str | Sequence[str] | None) -> list[int]:
    """Return the joints to draw, or those that move, by positions [rad or m], shape (T, n)."""
    if joints is not None:
        return [pepper.joint_index(name) for name in pepper.resolve_joints(joints)]
    return [int(j) for j in np.flatnonzero(np.ptp(position, axis=0) > _MOVES)]


def _values(
    pepper: PepperModel, name: str, trajectory: Trajectory, time: Array, loads: Loads
) -> tuple[Array, Array, Array]:
    """Return a quantity, shape (T, n), and its lower and upper limits."""
    state = trajectory(time)
    if name == "position":
        return state.position, pepper.lower_limits, pepper.upper_limits
    if name == "torque":
        return inverse_dynamics_with(pepper, loads, *state), -pepper.effort_limits, pepper.effort_limits
    limit = pepper.velocity_limits if name == "velocity" else pepper.acceleration_limits
    return (state.velocity if name == "velocity" else state.acceleration), -limit, limit


def _draw_quantity(
    axes: Any,
    pepper: PepperModel,
    name: str,
    trajectory: Trajectory,
    time: Array,
    places: list[int],
    loads: Loads,
) -> list[str]:
    """Draw one quantity as shares of the limits; return each joint's worst value and its limit, in words.

    Args:
        axes: Where to draw.
        pepper: The robot.
        name: Of the quantity.
        trajectory: The trajectory.
        time: Instants [s], shape (T,).
        places: Indices of the joints.
        loads: What is carried.
    """
    value, lower, upper = _values(pepper, name, trajectory, time, loads)
    peaks, largest = [], 1.0
    for number, j in enumerate(places):
        unit = "" if pepper.joint_units[j] == "rad" else f" {unit_of(name, pepper.joint_units[j])}"
        if not np.isfinite(upper[j] - lower[j]):
            peaks.append("no limit")
            continue
        share = (2 * value[:, j] - lower[j] - upper[j]) / (upper[j] - lower[j])
        at = int(np.argmax(np.abs(share)))
        largest = max(largest, float(np.abs(share[at])))
        color, style = line_style(number)
        axes.plot(time, share, color=color, linestyle=style, linewidth=1.4)
        limit = upper[j] if share[at] > 0 else lower[j]
        peaks.append(f"{value[at, j]:.3g} of {limit:.3g}{unit}")
    reach = 1.18 * largest
    for low, high in ((1.0, reach), (-reach, -1.0)):
        axes.axhspan(low, high, color=LIMIT_COLOR, alpha=0.12, linewidth=0)
        axes.axhline(low if low > 0 else high, color=LIMIT_COLOR, linewidth=0.9)
    axes.set(
        xlim=(0.0, trajectory.duration), ylim=(-reach, reach), xlabel="time [s]", ylabel="share of limit"
    )
    axes.set_title(name, fontsize=11)
    axes.grid(alpha=0.3)
    return peaks


def _draw_legend(axes: Any, pepper: PepperModel, places: list[int], peaks: list[list[str]]) -> None:
    """Write each joint with its worst position, velocity, acceleration and torque, in two columns."""
    from matplotlib.lines import Line2D

    axes.axis("off")
    handles = [
        Line2D([], [], color=line_style(i)[0], linestyle=line_style(i)[1], linewidth=2)
        for i in range(len(places))
    ]
    words = [
        f"{pepper.joint_names[j]}: " + "; ".join(peak[i] for peak in peaks) for i, j in enumerate(places)
    ]
    legend = axes.legend(
        handles, words, loc="center", ncols=2 if len(places) > 1 else 1, fontsize=7.2, frameon=False,
        title=_LEGEND, title_fontsize=8,
        columnspacing=1.0, handlelength=1.6,
    )  # fmt: skip
    for text in legend.get_texts():
        text.set_parse_math(False)  # a `$` in the name of a joint begins no formula


def _draw_plane(axes: Any, plane: PhasePlane) -> None:
    limit = np.minimum(plane.velocity_limit, plane.force_limit)
    # The limits are in the picture unless that would flatten the trajectory.
    fastest = max(float(plane.speed.max()), 1e-9)
    top = max(1.3 * fastest, min(1.15 * float(limit.max()), 3.0 * fastest))
    axes.fill_between(plane.way, limit, max(top, 1.0), color=LIMIT_COLOR, alpha=0.12, linewidth=0)
    axes.plot(plane.way, plane.velocity_limit, color="#7570b3", linewidth=1.2, label="velocity limits")
    axes.plot(
        plane.way, plane.force_limit, color=LIMIT_COLOR, linewidth=1.2,
        label="acceleration and torque limits (maximum-velocity curve)",
    )  # fmt: skip
    axes.plot(plane.way, plane.speed, color="#222222", linewidth=1.8, label="trajectory")
    axes.set(
        xlim=(plane.way[0], plane.way[-1]), ylim=(0.0, top),
        xlabel="way in joint space [rad]", ylabel="speed [rad/s]",
    )  # fmt: skip
    axes.set_title("phase plane", fontsize=11, loc="left")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, frameon=False)
