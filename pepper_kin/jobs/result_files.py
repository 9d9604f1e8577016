"""Files of a reach: summary, trajectory and run."""

from __future__ import annotations

import json
import platform
from importlib.metadata import version
from pathlib import Path
from typing import Any

from pepper_kin.file_access import atomic_file
from pepper_kin.files import save
from pepper_kin.jobs.motion_file import SCENE_FILE
from pepper_kin.jobs.reaching import ReachOutcome
from pepper_kin.kernels.compiled_function import INTERPRETED
from pepper_kin.model import PepperModel
from pepper_kin.trajectory import Trajectory
from pepper_kin.twin import Run

CSV_STEP = 0.001  # time between rows of trajectory.csv [s]
_LIBRARIES = ("pin", "proxsuite", "coal", "llvmlite", "meshcat", "numpy")


def summary(pepper: PepperModel, outcome: ReachOutcome) -> dict[str, Any]:
    """Return the summary of an outcome as plain values for JSON, in SI units."""
    certificate = outcome.certificate
    return {
        "robot": pepper.name,
        "joints": list(pepper.joint_names),
        "success": outcome.success,
        "message": outcome.message,
        "hand": outcome.hand,
        "target_m": outcome.target.tolist(),
        "gaze_m": None if outcome.gaze is None else outcome.gaze.tolist(),
        "obstacles": {
            name: {
                "geometry": repr(item.geometry),
                "position_m": item.transform_object_to_world[:3, 3].tolist(),
            }
            for name, item in outcome.scene.objects.items()
        },
        "plan": {
            "status": outcome.plan.status.value,
            "waypoints": 0 if outcome.plan.path is None else len(outcome.plan.path),
            "states_checked": outcome.plan.states_checked,
            "seconds": outcome.plan.time,
            "seed": outcome.plan.seed,
        },
        "certificate": None
        if certificate is None
        else {"success": certificate.success, "report": certificate.report()},
        **outcome.figures,
        "interpreted": INTERPRETED,
        "versions": {
            "python": platform.python_version(),
            **{name: version(name) for name in ("pepper_kin", *_LIBRARIES)},
        },
    }


def save_outcome(pepper: PepperModel, outcome: ReachOutcome, folder: str | Path) -> dict[str, Path]:
    """Write `summary.json`, `scene.json` and, for a motion, its trajectory, run and columns.

    The motion's files are `trajectory.csv`, `run.csv` and `columns.json`.

    Args:
        pepper: The robot.
        outcome: Outcome to write.
        folder: Folder of the files, created if missing.

    Returns:
        The written files by name.

    Raises:
        PepperKinError: if the folder cannot be written; no partial file is left.
    """
    moved = outcome.trajectory is not None and outcome.run is not None
    motion = (outcome.trajectory, outcome.run) if moved else (None, None)
    files = write_results(folder, summary(pepper, outcome), *motion)
    files[SCENE_FILE] = Path(folder) / SCENE_FILE
    outcome.scene.save(files[SCENE_FILE])
    return files


def save_gesture(report: Any, folder: str | Path) -> dict[str, Path]:
    """Write `summary.json`, `trajectory.csv`, `run.csv` and `columns.json` of a gesture.

    Args:
        report: Report of a registered gesture, see `pepper_kin.plugins`.
        folder: Folder of the files, created if missing.

    Returns:
        The written files by name.

    Raises:
        PepperKinError: if the folder cannot be written; no partial file is left.
    """
    return write_results(folder, report.as_dict(), report.trajectory, report.run)


def write_results(
    folder: str | Path,
    numbers: dict[str, Any],
    trajectory: Trajectory | None = None,
    run: Run | None = None,
    step: float = CSV_STEP,
) -> dict[str, Path]:
    """Write `summary.json` and, if given, `trajectory.csv` and `run.csv` with their `columns.json`.

    Args:
        folder: Folder of the files, created if missing.
        numbers: Values of the summary.
        trajectory: The motion, or None.
        run: Run of the twin, or None.
        step: Time between rows of the trajectory [s].

    Returns:
        The written files by name.

    Raises:
        PepperKinError: if the folder cannot be written; no partial file is left.
    """
    folder = atomic_file.make_folder(folder)
    files: dict[str, Path] = {}
    if trajectory is not None:
        files["trajectory.csv"] = save(
            trajectory, folder / "trajectory.csv", dt=step, unchecked=True
        )  # for inspection; the summary has the certificate
    if run is not None:
        files["run.csv"] = run.save(folder / "run.csv")
    if files:
        files["columns.json"] = folder / "columns.json"
    text = json.dumps(numbers, indent=2) + "\n"
    files["summary.json"] = atomic_file.write_text(folder / "summary.json", text)
    return files
