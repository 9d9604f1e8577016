"""The tables of `docs/statuses.md`: every status of a result, with its advice.

python docs/make_statuses.py
"""

from __future__ import annotations

import importlib
import re
from pathlib import Path

from pepper_kin.status import ResultStatus

PAGE = Path(__file__).parent / "statuses.md"
PACKAGES = ("ik", "base_placement", "servo", "motion", "planners", "trajectory", "twin", "twin.base")
SECTION = re.compile(r"(?<=<!-- statuses -->\n).*(?=<!-- end of statuses -->)", re.DOTALL)


def main() -> None:
    """Write the tables into the page."""
    PAGE.write_text(SECTION.sub(lambda _: tables(), PAGE.read_text("utf-8")), "utf-8")


def tables() -> str:
    """Return one table for each public enumeration of statuses."""
    parts = []
    for package, status in statuses():
        rows = [f"| `{member.name}` | {member.advice} |" for member in status]
        first = (status.__doc__ or "").strip().splitlines()[0]
        parts.append(f"\n## `{package}.{status.__name__}`\n\n{first}\n\n| status | what to do |\n|---|---|\n")
        parts.append("\n".join(rows) + "\n")
    return "".join(parts) + "\n"


def statuses() -> list[tuple[str, type[ResultStatus]]]:
    """Return the public enumerations whose members give advice, with their packages."""
    found: dict[type[ResultStatus], str] = {}
    for package in PACKAGES:
        module = importlib.import_module(f"pepper_kin.{package}")
        for name in module.__all__:
            value = getattr(module, name)
            if isinstance(value, type) and issubclass(value, ResultStatus):
                found[value] = package
    return [(package, status) for status, package in found.items()]


if __name__ == "__main__":
    main()
