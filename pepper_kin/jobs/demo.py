"""The demonstration: the left hand reaches over a table's edge while the head looks at the target."""

from __future__ import annotations

from collections.abc import Callable

from pepper_kin.collision import Scene
from pepper_kin.jobs.reaching import ReachOutcome, reach
from pepper_kin.model import PepperModel

TARGET = (0.38, 0.22, 0.82)
GAZE = (0.47, 0.12, 0.79)

TIMEOUT = 60.0
"""Time budget of the demonstration [s], for slow or busy machines; on an idle one it takes 2 s."""


def demo_scene() -> Scene:
    """Return a scene with a table and a cup between the hanging hand and its target."""
    return (
        Scene()
        .add_box("table", size=(0.40, 0.80, 0.03), position=(0.47, 0.05, 0.715))
        .add_cylinder("cup", radius=0.035, length=0.12, position=GAZE)
    )


def run_demo(
    pepper: PepperModel, *, seed: int = 0, on_stage: Callable[[str], None] = lambda stage: None
) -> ReachOutcome:
    """Run the main job with the built-in targets; see `reach`."""
    return reach(pepper, "left", TARGET, GAZE, demo_scene(), seed=seed, timeout=TIMEOUT, on_stage=on_stage)
