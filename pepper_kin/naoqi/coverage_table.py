"""Table of the modules' methods, and which of them are simulated."""

from __future__ import annotations

from collections import Counter
from functools import cache
from typing import NamedTuple

from pepper_kin.naoqi.broker import other_modules
from pepper_kin.naoqi.kept_states import RefusedModule
from pepper_kin.naoqi.memory import ALMemory
from pepper_kin.naoqi.module import Module, robot_signatures
from pepper_kin.naoqi.motion import ALMotion
from pepper_kin.naoqi.posture import ALRobotPosture
from pepper_kin.naoqi.tables import rows, table

REFUSED = "refused by name: "
_FIRST: tuple[type[Module], ...] = (ALMotion, ALRobotPosture, ALMemory)


class Covered(NamedTuple):
    """A method of a module.

    Attributes:
        module: "ALMotion".
        method: "setAngles".
        answer: "simulated"; "answered", if a value is only kept or returned, or nothing is to do; or
            "refused by name: " and the reason.
    """

    module: str
    method: str
    answer: str


@cache
def coverage() -> tuple[Covered, ...]:
    """Return each method of each module once; the methods of the robot's list, if it is known."""
    found = []
    for kind in (*_FIRST, *other_modules()):
        listed = [each.name for each in robot_signatures() if each.module == kind.name]
        own = set(kind.__new__(kind).getMethodList()).difference(Module.__new__(Module).getMethodList())
        more = table("modules")["not_simulated"].get(kind.name, ())
        found += [Covered(kind.name, name, _answer(kind, name)) for name in sorted({*(listed or own), *more})]
    return tuple(found)


def _answer(kind: type[Module], name: str) -> str:
    """Return "simulated", "answered" or "refused by name: " with the reason, for a method of a class."""
    if issubclass(kind, RefusedModule):
        return REFUSED + str(table("modules")["refused"][kind.name]["why"])
    if name in kind.not_simulated:
        return REFUSED + kind.not_simulated[name]
    row = next((r for r in rows("simple_methods") if (r["module"], r["method"]) == (kind.name, name)), None)
    if callable(getattr(kind, name, None)):
        return "simulated" if row is None or row["does"] == "call" else "answered"
    if name in table("modules")["not_simulated"].get(kind.name, ()) or kind.__getattr__ is Module.__getattr__:
        return f"{REFUSED}the twin has nothing that it could act on"
    return "answered"


def coverage_summary() -> str:
    """Return how many methods of each module are simulated, answered and refused, as a table of Markdown.

    Modules that only answer share one row, and modules that refuse every call share another.
    """
    lines = ["| module | methods | simulated | answered | refused by name |", "|---|---|---|---|---|"]
    together: dict[str, list[str]] = {"answered": [], "refused by name": []}
    for kind in (*_FIRST, *other_modules()):
        counted = Counter(row.answer.partition(":")[0] for row in coverage() if row.module == kind.name)
        if issubclass(kind, RefusedModule) or set(counted) == {"answered"}:
            together["refused by name" if issubclass(kind, RefusedModule) else "answered"].append(kind.name)
        else:
            numbers = [counted.total(), *(counted[each] for each in ("simulated", *together))]
            lines.append(f"| {kind.name} | {' | '.join(map(str, numbers))} |")
    lines.append(f"| {', '.join(together['answered'])} | all | 0 | all | 0 |")
    lines.append(f"| {', '.join(together['refused by name'])} | all | 0 | 0 | all |")
    return "\n".join(lines)


__all__ = ["Covered", "coverage", "coverage_summary"]
