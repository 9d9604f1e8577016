"""Names and values of a robot with NAOqi, from the files in `data/`, each read once."""

from __future__ import annotations

import csv
import json
from functools import cache
from importlib.resources import files
from typing import Any


@cache
def table(name: str) -> Any:
    """Return the contents of data/<name>.json, which callers must not change."""
    return json.loads(_text(f"{name}.json"))


@cache
def rows(name: str) -> tuple[dict[str, str], ...]:
    """Return the rows of data/<name>.csv."""
    return tuple(csv.DictReader(_text(f"{name}.csv").splitlines()))


def _text(name: str) -> str:
    return (files("pepper_kin.naoqi") / "data" / name).read_text(encoding="utf-8")
