"""What `print` shows of results: two lines, never arrays."""

import dataclasses
import importlib
import re

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.arrays import LINE, BriefRepr

PACKAGES = (
    *("base_placement", "collision", "dynamics", "identification", "ik", "jobs", "kinematics", "learning"),
    *("model", "motion", "naoqi", "ros", "servo", "symbolic", "trajectory", "twin", "twin.base"),
    *("twin.sensors", "twin.world", "viewer"),
)
ARRAYS = re.compile(r"\b(Array|NDArray|ndarray)\b")
WITHOUT = ("ik.tasks.", "motion.curves", "kinematics.axes")  # inputs of a few numbers that a call repeats


def result_classes() -> list[type]:
    """Return public dataclasses with arrays, or with a public dataclass that has some."""
    found = {}
    for package in PACKAGES:
        module = importlib.import_module(f"pepper_kin.{package}")
        for name in module.__all__:
            item = getattr(module, name)
            if isinstance(item, type) and dataclasses.is_dataclass(item):
                found[item.__name__] = item
    types = {name: " ".join(str(f.type) for f in dataclasses.fields(c)) for name, c in found.items()}
    large = {name for name, text in types.items() if ARRAYS.search(text)}
    while True:
        words = re.compile(rf"\b({'|'.join(sorted(large))})\b")
        more = {name for name, text in types.items() if words.search(text)} - large
        if not more:
            return [
                found[name] for name in sorted(large) if not any(x in found[name].__module__ for x in WITHOUT)
            ]
        large |= more


def test_all_results_are_brief():
    """Every public result with arrays has the common `repr`, or its own."""
    classes = result_classes()
    assert {"Plan", "Run", "IKResult", "Certificate", "ReachMap", "LiveState", "Retargeted"} <= {
        c.__name__ for c in classes
    }
    generated = [c.__name__ for c in classes if hasattr(c.__repr__, "__wrapped__")]  # by dataclass
    assert generated == []


def assert_brief(value, *words):
    text = repr(value)
    lines = text.splitlines()
    assert len(lines) <= 2, text
    assert max(map(len, lines)) <= LINE, text
    for word in words:
        assert word in text, text


def test_what_is_printed(pepper):
    """Status, duration, joints and errors stand in the two lines."""
    table = pk.Scene().add_box("table", size=(0.40, 0.80, 0.03), position=(0.47, 0.05, 0.715))
    tasks = [pk.ik.HandPosition("left", (0.38, 0.22, 0.82))]
    assert_brief(pk.ik.solve(pepper, tasks, scene=table), "solved", "errors")
    plan = pk.plan(pepper, pepper.posture("Stand"), tasks, table, seed=0)
    assert_brief(plan, "solved", "15 joints", f"path {plan.path.shape}")
    far = pk.plan(pepper, pepper.posture("Stand"), [pk.ik.HandPosition("left", (3, 0, 1))], table)
    assert_brief(far, "no_ik", "beyond reach")
    motion = pk.retime(pepper, plan)
    assert_brief(motion, "15 joints", f"{motion.duration:.4g} s")
    certificate = motion.check(pepper, table)
    assert_brief(certificate, "success", f"{motion.duration:.4g} s")
    assert_brief(certificate.position, "position")
    run = pk.Twin(pepper, scene=table).execute(motion)
    assert_brief(run, "completed", "15 joints", f"off by at most {run.max_error.max():.3g}")
    for value in (motion.stop(pepper, 0.2, scene=table), motion.active_limits(pepper), pk.Twin(pepper).state):
        assert_brief(value, type(value).__name__)


@dataclasses.dataclass(frozen=True, eq=False)
class Odd(BriefRepr):
    """A value whose fields are unusual."""

    message: str
    names: tuple[str, ...] = ()
    few: np.ndarray = dataclasses.field(default_factory=lambda: np.array([1.0, np.nan]))
    none: object = None
    hidden: object = dataclasses.field(default="hidden", repr=False)

    @property
    def success(self) -> bool:
        """Raises."""
        raise RuntimeError("not known")


@pytest.mark.parametrize("message", ["", "one\ntwo", "a long sentence " * 30])
def test_odd_values(message):
    """Lines stay two, and nothing is raised, whatever a value holds."""
    assert_brief(Odd(message, tuple("abcdefgh")))
    assert "hidden" not in repr(Odd(message))
    assert "few [ 1. nan]" in repr(Odd(""))
