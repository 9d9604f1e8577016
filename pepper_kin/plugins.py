"""Entry points of interfaces: commands, gestures, file formats and calls, found without importing them.

Groups with the meaning of their names and the result of `load()`:

pepper_kin.commands         commands of `pepper-kin`: Typer applications
pepper_kin.checks           commands of `pepper-kin check`: Typer applications
pepper_kin.gestures         names of gestures: functions of the robot and a name that replay one, and
                            return its `trajectory`, the twin's `run`, `report()` and `as_dict()`
pepper_kin.formats          suffixes without their dots: modules with `write_trajectory(path, points)`,
                            `read_trajectory(path, pepper)`, `read_states(path)` and
                            `write_recording(path, run)`
pepper_kin.everyday_calls   any names: functions whose calls need kernels that a wheel brings

An editable installation has to be installed again for new entry points.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint


@cache
def plugins(kind: str) -> dict[str, EntryPoint]:
    """Return the entry points of the group `pepper_kin.<kind>` by name."""
    from importlib.metadata import entry_points  # imported late, since it is slow

    return {entry.name: entry for entry in entry_points(group=f"pepper_kin.{kind}")}
