"""Repetition of the published twin's validation: tables 4 and 5, figures 6 and 7, and its measuring chain."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.model import PepperModel, load_pepper
from pepper_kin.model.joint_vectors import check_seed
from pepper_kin.model.text_table import text_table
from pepper_kin.paper.gesture_replay import GestureReport, replay
from pepper_kin.paper.table4 import LimitsTable, limits_table
from pepper_kin.paper.table5 import GESTURES
from pepper_kin.paper.tilt import BLIND, TiltMeasurement, measure_by_tilt
from pepper_kin.twin import Run, RunStatus, Twin

ITERATIONS = 1000
"""Number of samples of a movement in the paper's figures 6 and 7."""
PERIOD = 0.01  # duration of one iteration [s]: an assumption, since the paper gives none
TRACKING_LIMIT = 0.002  # maximum root mean square tracking error [rad]: a tenth of the paper's worst


@dataclass(frozen=True, eq=False)
class MovementCheck:
    """One movement in minimum time and at the pace of the paper's figures.

    Attributes:
        fast: The movement in minimum time, with its keyframes compared with table 5.
        calm: The movement in `ITERATIONS` iterations of `PERIOD`.
        tilt: Joint angles of the calm movement recovered from sensors on the links.
    """

    fast: GestureReport
    calm: GestureReport
    tilt: TiltMeasurement

    @property
    def name(self) -> str:
        """Name of the movement."""
        return self.fast.gesture.name

    def iterations(self) -> tuple[Array, Array, Array]:
        """Return times [s], commanded and measured positions [rad] of figures 6 and 7, shape (1000, ...)."""
        run = self.calm.run
        time = np.linspace(0.0, run.duration, ITERATIONS)
        places = [run.joint_names.index(name) for name in self.calm.gesture.joint_names]
        return time, _at(run, run.reference_position, time)[:, places], run.position_at(time)[:, places]

    @property
    def tracking(self) -> tuple[Array, Array]:
        """Root mean square tracking errors of the fast and the calm movement [rad], shape (k,) each."""
        return self.fast.rms_tracking_error, self.calm.rms_tracking_error


@dataclass(frozen=True, eq=False)
class PaperCheck:
    """Comparison with the paper's validation.

    Attributes:
        limits: Limits of table 4.
        movements: The three movements of table 5.
    """

    limits: LimitsTable
    movements: tuple[MovementCheck, ...]

    @property
    def worst_tracking(self) -> float:
        """Maximum root mean square tracking error of a movement's joints [rad]."""
        return float(max(np.max(errors) for m in self.movements for errors in m.tracking))

    @property
    def success(self) -> bool:
        """Whether no run was stopped and all tracked within `TRACKING_LIMIT`."""
        runs = [run for movement in self.movements for run in (movement.fast.run, movement.calm.run)]
        ended = all(run.status is not RunStatus.STOPPED for run in runs)
        return ended and self.worst_tracking <= TRACKING_LIMIT

    def report(self) -> str:
        """Return all tables and the conclusions as text."""
        parts = [
            "== Table 4: joint limits",
            self.limits.report(),
            "",
            "== Table 5: three movements, five frames",
        ]
        for movement in self.movements:
            parts += [_frames_table(movement), ""]
        parts += ["== Figures 6 and 7: tracking over time", *_tracking_table(self.movements), ""]
        parts += [
            "== Section 3.3: joint angles from accelerometers on the links",
            *_tilt_table(self.movements),
        ]
        parts += ["", *_notes(self)]
        return "\n".join(parts)

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            "success": self.success,
            "tracking_limit": TRACKING_LIMIT,
            "worst_tracking": self.worst_tracking,
            "table_4": self.limits.to_dict(),
            "table_5": {m.name: m.fast.as_dict() for m in self.movements},
            "figures_6_and_7": {m.name: _tracking_dict(m) for m in self.movements},
            "section_3_3": {m.name: _tilt_dict(m.tilt) for m in self.movements},
        }


def check_paper(
    pepper: PepperModel | None = None,
    *,
    seed: int = 0,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> PaperCheck:
    """Repeat the published twin's validation.

    Each of table 5's movements is run twice: in minimum time, which is the hardest to track, and in 1000
    iterations of 10 ms as in figures 6 and 7. For the second run, accelerometers and gyroscopes on the links
    are simulated, and joint angles recovered from them.

    Args:
        pepper: Pepper with a fixed base; `load_pepper()` if omitted.
        seed: Seed of the sensors' noise.
        progress: Function that is called with the numbers of finished and of all movements.

    Returns:
        Tables, runs and measurements.

    Raises:
        InvalidValueError: for a negative seed.

    Source: Sekkat et al., Heliyon (2024), tables 4 and 5, figures 6 and 7, section 3.3.
    """
    check_seed(seed)
    pepper = load_pepper() if pepper is None else pepper
    movements = []
    for index, name in enumerate(GESTURES):
        progress(index, len(GESTURES))
        twin = Twin(pepper)
        fast = replay(pepper, name, twin=twin)
        calm = replay(pepper, name, twin=twin, duration=ITERATIONS * PERIOD)
        movements.append(MovementCheck(fast, calm, _measured(pepper, calm, seed)))
    progress(len(GESTURES), len(GESTURES))
    return PaperCheck(limits_table(), tuple(movements))


def _measured(pepper: PepperModel, report: GestureReport, seed: int) -> TiltMeasurement:
    """Return the joint angles of a movement recovered from simulated sensors."""
    run = report.run
    time = np.linspace(0.0, run.duration, ITERATIONS)
    velocity = _at(run, run.velocity, time)
    acceleration = np.gradient(velocity, time, axis=0)
    joints = report.gesture.joint_names
    return measure_by_tilt(pepper, time, run.position_at(time), velocity, acceleration, joints, seed=seed)


def _at(run: Run, values: Array, time: Array) -> Array:
    """Return a run's values, shape (samples, m), at other times [s], shape (T,), by linear interpolation."""
    return np.column_stack([np.interp(time, run.time, column) for column in values.T])


def _frames_table(movement: MovementCheck) -> str:
    """Return the table of a movement's keyframes compared with table 5."""
    gesture, rows = movement.fast.gesture, []
    for j, joint in enumerate(gesture.joint_names):
        for label, values in (
            ("plan (RViz2)", gesture.plan), ("Gazebo", gesture.gazebo), ("Choregraphe", gesture.choregraphe),
            ("Reality", gesture.reality), ("ours", movement.fast.measured),
        ):  # fmt: skip
            digits = 4 if label == "ours" else 2
            plan = movement.fast.commanded if label == "ours" else gesture.plan
            error = np.abs(values - plan).mean(axis=0)[j]
            name = joint if label.startswith("plan") else ""
            cells = [f"{value:.{digits}f}" for value in values[:, j]]
            rows.append([name, label, *cells, "" if label.startswith("plan") else f"{error:.4f}"])
    return "\n".join(
        text_table((f"{movement.name} [rad]", "", "T0", "T1", "T2", "T3", "T4", "mean error"), rows)
    )


def _tracking_table(movements: tuple[MovementCheck, ...]) -> list[str]:
    """Return the lines of the table of tracking errors."""
    rows = []
    for movement in movements:
        fast, calm = movement.tracking
        peak = [report.run.max_error for report in (movement.fast, movement.calm)]
        for j, joint in enumerate(movement.fast.gesture.joint_names):
            place = movement.fast.run.joint_names.index(joint)
            values = (fast[j], peak[0][place], calm[j], peak[1][place])
            rows.append([joint, *(f"{value:.2e}" for value in values)])
    head = ("error [rad]", "fastest, rms", "greatest", "1000 iterations, rms", "greatest")
    return text_table(head, rows)


def _tilt_table(movements: tuple[MovementCheck, ...]) -> list[str]:
    """Return the lines of the table of recovered joint angles' errors."""
    rows = []
    for movement in movements:
        tilt = movement.tilt
        for j, joint in enumerate(tilt.joint_names):
            low = tilt.visible[:, j].min()
            rows.append(
                [joint, f"{tilt.formulas_error[j]:.4f}", f"{tilt.estimate_error[j]:.4f}", f"{low:.2f}",
                 "blind" if tilt.blind[j] else ""]
            )  # fmt: skip
    return text_table(
        ("rms error [rad]", "tilt formulas", "filter", "least gravity across the axis [share]", ""), rows
    )


def _notes(check: PaperCheck) -> list[str]:
    """Return sentences on the results."""
    blind = [
        name for m in check.movements for name, b in zip(m.tilt.joint_names, m.tilt.blind, strict=True) if b
    ]
    return [
        "An accelerometer cannot see a turn about the vertical. Gravity comes within "
        f"{np.degrees(np.arcsin(BLIND)):.0f} degrees of the axis of {', '.join(blind)} here; the tilt "
        "formulas are wrong there by as much as the joint moves, and wrong too wherever a link is turned "
        "about two axes. The filter compares gravity on both sides of the joint about its own axis, and "
        "bridges the rest with gyroscopes.",
        "The formulas' third angle is the tilt of the z axis; it stands for yaw, which it is not. Noise and "
        "bias of the sensors are assumed.",
        *check.movements[0].fast.notes()[-4:],
        f"Worst tracking error: {check.worst_tracking:.2e} rad rms, limit {TRACKING_LIMIT:g}"
        f" (the paper reports 0.01 to 0.02): {'within' if check.success else 'BEYOND'}.",
    ]


def _tracking_dict(movement: MovementCheck) -> dict[str, Any]:
    """Return durations and tracking errors of a movement as plain values."""
    fast, calm = movement.tracking
    return {
        "seconds": {"fastest": movement.fast.trajectory.duration, "calm": movement.calm.trajectory.duration},
        "iterations": ITERATIONS,
        "rms_error": {
            joint: {"fastest": float(fast[j]), "calm": float(calm[j])}
            for j, joint in enumerate(movement.fast.gesture.joint_names)
        },
    }


def _tilt_dict(tilt: TiltMeasurement) -> dict[str, Any]:
    """Return the errors of recovered joint angles as plain values."""
    return {
        joint: {
            "formulas_rms_error": float(tilt.formulas_error[j]),
            "filter_rms_error": float(tilt.estimate_error[j]),
            "least_gravity_across_axis": float(tilt.visible[:, j].min()),
            "blind": bool(tilt.blind[j]),
        }
        for j, joint in enumerate(tilt.joint_names)
    }
