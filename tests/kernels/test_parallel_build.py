"""Processes that make machine code: what is made, in which order, and how they end."""

import subprocess
import sys
import time

import pytest

from pepper_kin.kernels import parallel_build
from pepper_kin.kernels.compiled_function import unit_of
from pepper_kin.kernels.sources import digests_key
from pepper_kin.kernels.store import is_kept
from pepper_kin.kernels.warm_up import Build

SMALL = ("pepper_kin.kernels.calling", "pepper_kin.core.timing.kinks", "pepper_kin.core.kernel_batch")
LARGE = "pepper_kin.core.inverse_kinematics.multi_start"


@pytest.fixture
def empty(tmp_path, monkeypatch):
    monkeypatch.setenv("PEPPER_KIN_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def kept():
    for name in SMALL:
        parallel_build.importlib.import_module(name)
    return {name for name in SMALL if is_kept(unit_of(name).key())}


@pytest.mark.thorough
def test_all_that_is_named_is_made_and_no_more(empty):
    reports = []
    Build(SMALL[:2], only=True).finish(reports.append)
    assert kept() == set(SMALL[:2])
    assert reports[-1].ratio == 1.0
    assert not list(empty.glob("*.lock"))


@pytest.mark.thorough
def test_what_is_asked_for_later_is_made_too(empty):
    build = Build(SMALL[:1], only=True)
    build.ask(SMALL[2])
    build.finish(lambda progress: None)
    assert SMALL[2] in kept()


@pytest.mark.thorough
def test_one_that_is_ended_leaves_whole_parts(empty):
    build = Build(SMALL, only=True)
    while build.is_running and not kept():
        time.sleep(0.01)
    build.end()
    assert not build.is_running
    before = kept()
    assert before
    Build(SMALL, only=True).finish(lambda progress: None)
    assert kept() == set(SMALL)


@pytest.mark.thorough
def test_the_same_bytes_are_made_whatever_was_made_before(tmp_path, monkeypatch):
    """Of Numba's counters, hashes of names, and flags of whoever called a function first, nothing is left."""
    folders = []
    for before in ("pepper_kin.core.braking", "pepper_kin.core.timing.parameterization"):
        folders.append(tmp_path / before)
        monkeypatch.setenv("PEPPER_KIN_CACHE", str(folders[-1]))
        for name in (before, LARGE):
            Build([name], only=True).finish(lambda progress: None)
    first, second = ({path.name: path.read_bytes() for path in folder.glob("*.code")} for folder in folders)
    same = first.keys() & second.keys() - {f"{digests_key()}.code"}  # the list of sources that were read
    assert len(same) > 50
    assert not [name for name in same if first[name] != second[name]]


@pytest.mark.thorough
def test_a_module_that_is_not_there_is_an_error_that_names_it(empty):
    with pytest.raises(RuntimeError, match="no_such_module"):
        Build(["pepper_kin.no_such_module"], only=True).finish(lambda progress: None)


@pytest.fixture
def schedule(monkeypatch):
    """Units of functions that are named by letters, with nothing made."""
    reached = {"one": "abcdef", "two": "abcdefg", "three": "xyz", "asked": "a"}

    class Unit:
        def __init__(self, name):
            self.name = name

        def key(self):
            return self.name

        def reached(self):
            return dict.fromkeys(reached[self.name])

    monkeypatch.setattr(parallel_build, "unit_of", Unit)
    monkeypatch.setattr(parallel_build.importlib, "import_module", lambda name: None)
    monkeypatch.setattr(parallel_build, "is_known", lambda key, target: False)
    made = parallel_build._Schedule(None)
    for name in ("one", "two", "three"):
        made.add(name, 1)
    return made


def test_units_that_share_functions_are_not_made_side_by_side(schedule):
    assert [schedule.next(), schedule.next()] == ["two", "three"]


def test_what_is_asked_for_comes_first_and_what_is_shared_counts_once(schedule):
    schedule.add("asked", 0)
    assert schedule.next() == "asked"
    schedule.finish("asked")
    order = []
    while (name := schedule.next()) is not None:
        order.append(name)
        schedule.finish(name)
    assert order == ["two", "three", "one"]
    assert schedule.done == pytest.approx(schedule.total)


@pytest.mark.thorough
def test_processes_end_that_were_never_given_work():
    """One that had just been forked lost the signal to end, and was waited for without end."""
    program = (
        "from pepper_kin.kernels.parallel_build import _run, _Schedule\n"
        "for _ in range(20):\n    _run(_Schedule(None), 6)"
    )
    subprocess.run([sys.executable, "-c", program], check=True, timeout=120)
