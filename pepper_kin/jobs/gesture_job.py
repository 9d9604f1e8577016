"""Gestures of the library: creation, certificate and files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pepper_kin.arrays import BriefRepr
from pepper_kin.collision import Scene
from pepper_kin.exceptions import UnknownNameError
from pepper_kin.jobs.result_files import write_results
from pepper_kin.model import PepperModel
from pepper_kin.motion import gesture, gesture_meaning, gesture_names
from pepper_kin.plugins import plugins
from pepper_kin.trajectory import Certificate, Trajectory

CSV_STEP = 0.01  # [s]


@dataclass(frozen=True, eq=False)
class MadeGesture(BriefRepr):
    """A gesture with the certificate of its independent examination.

    Attributes:
        name: Of the gesture.
        options: Side, amplitude and tempo.
        trajectory: The gesture.
        certificate: What was found, clearance between the parts of the body included.
    """

    name: str
    options: dict[str, Any]
    trajectory: Trajectory
    certificate: Certificate

    def report(self) -> str:
        """Return what the gesture is and what was found, in words."""
        options = ", ".join(f"{name} {value}" for name, value in self.options.items())
        return f"{self.name}: {gesture_meaning(self.name)} ({options}).\n{self.certificate.report()}"

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {"gesture": self.name, **self.options, "certificate": self.certificate.as_dict()}


def make_gesture(
    pepper: PepperModel, name: str, *, side: str = "right", amplitude: float = 1.0, tempo: float = 1.0
) -> MadeGesture:
    """Make a gesture of the library and examine it.

    Args:
        pepper: Pepper.
        name: One of `pepper_kin.motion.gesture_names()`.
        side: As `pepper_kin.motion.gesture` takes it.
        amplitude: As `pepper_kin.motion.gesture` takes it.
        tempo: As `pepper_kin.motion.gesture` takes it.

    Raises:
        UnknownNameError: for another name, listing also those that are registered.
        InvalidValueError: for an option out of range.
    """
    if name not in gesture_names():
        raise UnknownNameError("gesture", name, (*sorted(plugins("gestures")), *gesture_names()))
    trajectory = gesture(pepper, name, side=side, amplitude=amplitude, tempo=tempo)
    options = {"side": side, "amplitude": amplitude, "tempo": tempo}
    return MadeGesture(name, options, trajectory, trajectory.check(pepper, Scene()))


def save_library_gesture(made: MadeGesture, folder: str | Path) -> dict[str, Path]:
    """Write `trajectory.csv`, `columns.json` and `summary.json` of a gesture.

    Args:
        made: The gesture.
        folder: Where; made if it is not there.

    Returns:
        The files written, by name.

    Raises:
        PepperKinError: where the folder cannot be written to; no half-written file is left.
    """
    return write_results(folder, made.as_dict(), made.trajectory, step=CSV_STEP)
