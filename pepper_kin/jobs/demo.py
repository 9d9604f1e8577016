"""The demonstration: the left hand goes over a table's edge to its top while the head looks at the spot."""

from __future__ import annotations

from collections.abc import Callable

from pepper_kin.collision import Scene
from pepper_kin.jobs.reach import ReachOutcome, reach
from pepper_kin.model import PepperModel

TARGET = (0.38, 0.16, 0.82)
GAZE = (0.48, 0.12, 0.76)


def demo_scene() -> Scene:
    """Return the table that stands between the hanging hand and its target."""
    return (
        Scene()
        .add_box("table", size=(0.60, 1.20, 0.04), position=(0.53, 0.0, 0.72))
        .add_box("parcel", size=(0.10, 0.08, 0.12), position=(0.52, 0.16, 0.80))
    )


def run_demo(
    pepper: PepperModel, *, seed: int = 0, on_stage: Callable[[str], None] = lambda stage: None
) -> ReachOutcome:
    """Run the main job with the built-in targets; see `reach`."""
    return reach(pepper, "left", TARGET, GAZE, demo_scene(), seed=seed, on_stage=on_stage)
