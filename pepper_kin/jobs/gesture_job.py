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

CSV_STEP = 0.01  # time between rows of trajectory.csv [s]


@dataclass(frozen=True, eq=False)
class MadeGesture(BriefRepr):
    """A gesture with the certificate of its independent check.

    Attributes:
        name: Name of the gesture.
        options: Side, amplitude and tempo.
        trajectory: The gesture.
        certificate: Certificate, with the clearance between the robot's links.
    """

    name: str
    options: dict[str, Any]
    trajectory: Trajectory
    certificate: Certificate

    def report(self) -> str:
        """Return the gesture's meaning, its options and the certificate, as text."""
        options = ", ".join(f"{name} {value}" for name, value in self.options.items())
        return f"{self.name}: {gesture_meaning(self.name)} ({options}).\n{self.certificate.report()}"

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {"gesture": self.name, **self.options, "certificate": self.certificate.as_dict()}


def make_gesture(
    pepper: PepperModel, name: str, *, side: str = "right", amplitude: float = 1.0, tempo: float = 1.0
) -> MadeGesture:
    """Make a gesture of the library and check it.

    Args:
        pepper: Pepper.
        name: Name of a gesture, see `pepper_kin.motion.gesture_names()`.
        side: Side of the gesture, see `pepper_kin.motion.gesture`.
        amplitude: Factor on the amplitude, see `pepper_kin.motion.gesture`.
        tempo: Factor on the tempo, see `pepper_kin.motion.gesture`.

    Raises:
        UnknownNameError: for another name, listing the library's and the registered gestures.
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
        folder: Folder of the files, created if missing.

    Returns:
        The written files by name.

    Raises:
        PepperKinError: if the folder cannot be written; no partial file is left.
    """
    return write_results(folder, made.as_dict(), made.trajectory, step=CSV_STEP)
