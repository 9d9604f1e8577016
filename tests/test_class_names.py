"""A class name stands once, so that a search for it leads to one thing."""

import ast
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).parents[1]

TWICE = {
    "Camera": "qiBullet's name, and a sensor of the twin",
    "Joint": "qiBullet's name, and a joint of a URDF",
    "Laser": "qiBullet's name, and a sensor of the twin",
    "Sensor": "qiBullet's name, and a sensor of the twin",
}
"""Names that stand for two classes, and why."""


def test_class_names_stand_once():
    places = defaultdict(set)
    for folder in ("pepper_kin", "planners"):
        for path in (ROOT / folder).rglob("*.py"):
            if not path.is_relative_to(ROOT / "pepper_kin" / "planners"):
                tree = ast.parse(path.read_text(encoding="utf-8"))
                for node in ast.walk(tree):
                    if isinstance(node, ast.ClassDef):
                        places[node.name].add(f"{path.relative_to(ROOT)}:{node.lineno}")
    twice = {name: sorted(where) for name, where in places.items() if len(where) > 1}
    assert not {name: where for name, where in twice.items() if name not in TWICE}
    assert set(twice) == set(TWICE), "a name of the list stands once now: take it out"
