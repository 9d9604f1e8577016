"""Plots of trajectories as fractions of limits: four quantities, and the phase plane."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array, FrozenArrays, read_only
from pepper_kin.collision.loads import inverse_dynamics_with, loads_of
from pepper_kin.dynamics.load import Loads, carried_words
from pepper_kin.exceptions import InvalidValueError
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
from pepper_kin.model.joint_vectors import check_whole
from pepper_kin.trajectory.samples import State, refuse_other_joints, unit_of

if TYPE_CHECKING:
    from pepper_kin.collision import Scene
    from pepper_kin.trajectory.trajectory import Trajectory

_HALVINGS = 50
MOST_POINTS = 10_000_000
_SLOW = 1e-3  # minimum speed relative to the maximum; below it rounding dominates the direction
QUANTITIES = ("position", "velocity", "acceleration", "torque")
_POINTS = 1500
_MOVES = 1e-3  # range of a joint below which it is not drawn [rad or m]
_LEGEND = "greatest share of limits: position [rad]; velocity [rad/s]; acceleration [rad/s²]; torque [N m]"


@dataclass(frozen=True, eq=False)
class PhasePlane(FrozenArrays):
    """Speed over path length; arrays of shape (T,), read-only.

    Attributes:
        way: Path length s in joint space since the start [rad, or rad and m mixed].
        speed: Speed ds/dt of the trajectory [unit of s per second].
        velocity_limit: Maximum ds/dt that velocity limits allow in the direction of the path.
        force_limit: Maximum ds/dt for which some d2s/dt2 keeps acceleration and torque limits: the
            maximum-velocity curve; 0 where not even rest is possible.
    """

    way: Array
    speed: Array
    velocity_limit: Array
    force_limit: Array

    def __post_init__(self) -> None:
        for name in ("way", "speed", "velocity_limit", "force_limit"):
            object.__setattr__(self, name, read_only(getattr(self, name)))


def phase_plane(
    pepper: PepperModel,
    trajectory: Trajectory,
    points: int = 400,
    *,
    scene: Scene | None = None,
    payload: Mapping[str, float] | None = None,
) -> PhasePlane:
    """Return a trajectory's speed along its path in joint space, and the maximum-velocity curve of the path.

    With s the length of the path, q' = dq/ds a unit vector and q'' = d2q/ds2, the limits read
        |q' sd| <= v,   |q' sdd + q'' sd^2| <= a,   |A sdd + B sd^2 + g| <= tau,
        A = M q',  B = M q'' + C(q, q') q'.
    For each sd the inequalities bound sdd from both sides; the maximum sd for which some sdd is left is the
    maximum-velocity curve (Bobrow, Dubowsky and Gibson, Int. J. Robotics Research 4, 1985).

    Args:
        pepper: The robot.
        trajectory: The trajectory; its joints must be the robot's.
        points: Number of instants examined, at least 2; instants almost at rest are left out.
        scene: The scene whose attached objects count with their mass; None for none.
        payload: Point masses held at "left", "right" or a frame by name [kg], besides attached objects.

    Returns:
        The curves.

    Raises:
        InvalidValueError: where the joints are not the robot's, for fewer than 2 points, or for a trajectory
            that does not move.
        UnknownNameError: for a frame that the robot lacks.
    """
    torque = partial(inverse_dynamics_with, pepper, loads_of(pepper, scene, payload))
    refuse_other_joints(pepper, trajectory.joint_names)
    time = np.linspace(0.0, trajectory.duration, check_whole("points", points, 2, MOST_POINTS))
    state = trajectory(time)
    speed = np.linalg.norm(state.velocity, axis=1)
    if speed.max() <= 0.0:
        raise InvalidValueError("trajectory", "one that does not move", "one that moves")
    way = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(time))])
    moving = speed > _SLOW * speed.max()
    q, v, a = (quantity[moving] for quantity in state)
    rate = speed[moving][:, None]
    direction = v / rate
    bend = (a - (a * direction).sum(axis=1)[:, None] * direction) / rate**2
    still = np.zeros_like(q)
    gravity = torque(q, still, still)
    push = torque(q, still, direction) - gravity
    swing = torque(q, direction, bend) - gravity
    bound = np.broadcast_to(pepper.acceleration_limits, q.shape)
    effort = np.broadcast_to(pepper.effort_limits, q.shape)
    rows = State(
        np.concatenate([direction, push], axis=1),
        np.concatenate([bend, swing], axis=1),
        np.concatenate([still, gravity], axis=1),
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        most = np.where(direction == 0, np.inf, pepper.velocity_limits / np.abs(direction))
    fastest = np.min(most, axis=1)
    force = _greatest(*rows, np.concatenate([bound, effort], axis=1), 4.0 * np.maximum(fastest, rate[:, 0]))
    return PhasePlane(way[moving], speed[moving], fastest, force)


def _greatest(a: Array, b: Array, c: Array, bound: Array, most: Array) -> Array:
    """Return the maximum sd <= most for which some sdd keeps |a sdd + b sd^2 + c| <= bound, shape (T,)."""

    def possible(speed: Array) -> NDArray[np.bool_]:
        """Return whether some sdd keeps the bounds at speeds sd, shape (T,) each."""
        middle = b * speed[:, None] ** 2 + c
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = np.stack([(-bound - middle) / a, (bound - middle) / a])
        tiny = np.abs(a) < 1e-12
        lower = np.where(tiny, -np.inf, ends.min(axis=0)).max(axis=1)
        upper = np.where(tiny, np.inf, ends.max(axis=0)).min(axis=1)
        return np.asarray((lower <= upper) & ~np.any(tiny & (np.abs(middle) > bound), axis=1))

    # The squares of possible speeds form an interval (a slice of a convex set), which begins at rest here.
    low, high = np.zeros_like(most), most.copy()
    at_most = possible(most)
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        fits = possible(middle)
        low, high = np.where(fits, middle, low), np.where(fits, high, middle)
    return np.where(at_most, most, low)


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

    Position, velocity, acceleration and torque of each joint are drawn as fractions of its limits, so that
    joints of different strength fit one picture: 1 and -1 are the limits, and the area beyond is shaded.
    Each joint's values at its worst instants are in the legend.  The phase plane with the maximum-velocity
    curve is below; see `phase_plane`.

    Args:
        pepper: The robot.
        trajectory: The trajectory; its joints must be the robot's.
        path: File to write, .png, .pdf or .svg; nothing is written if omitted.
        joints: Joints to draw, names of joints and groups; all joints that move if omitted.
        title: Heading; number of joints, duration and loads if omitted.
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
    # A `$` must not begin a formula.
    figure.suptitle(plain_words(title or heading), fontsize=13, parse_math=False)
    peaks = [_draw_quantity(axes[name], pepper, name, trajectory, time, places, held) for name in QUANTITIES]
    _draw_legend(axes["legend"], pepper, places, peaks)
    _draw_plane(axes["plane"], plane)
    if path is not None and kind is not None:
        write_figure(figure, path, kind, dpi=120)
    return figure


def joints_to_draw(pepper: PepperModel, position: Array, joints: str | Sequence[str] | None) -> list[int]:
    """Return indices of the joints to draw; if none are named, of joints whose positions, (T, n), change."""
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
    """Draw one quantity as fractions of limits; return each joint's worst value and its limit, in words.

    Args:
        axes: The axes to draw into.
        pepper: The robot.
        name: Name of the quantity.
        trajectory: The trajectory.
        time: Instants [s], shape (T,).
        places: Indices of the joints.
        loads: Carried loads.
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
    # The limits are inside the picture unless they would make the trajectory look flat.
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
