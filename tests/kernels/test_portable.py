"""The portable code that comes with the package: it fits the sources, names no processor, serves others."""

import importlib
import logging
import re

import llvmlite.binding as llvm
import pytest

from pepper_kin.jobs import shipping as job
from pepper_kin.kernels import package_file, portable
from pepper_kin.kernels.compiled_function import unit_of
from pepper_kin.kernels.compiler import compile_portable
from pepper_kin.kernels.portable import PortablePart
from pepper_kin.kernels.progress import making
from pepper_kin.kernels.target import make_target
from pepper_kin.kernels.warm_up import compiled_modules

KEY = "a" * 64
HALF = PortablePart("c" * 32, ("twice",), b"some bitcode", b"some types")
TWICE = PortablePart("d" * 32, (), b"other bitcode", b"")
MODULE = [b"some bitcode", b"other bitcode"]


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A file of our own in place of the package's."""
    path = tmp_path / "portable.ir"
    code = portable.PortableCode({KEY: "pepper_kin.core.one"}, {"half": HALF, "twice": TWICE})
    portable.write_portable(code, path)
    monkeypatch.setattr(portable, "portable_path", lambda: path)
    forget()
    yield path
    forget()


def forget():
    portable._loaded.cache_clear()
    package_file._reasons.clear()


def ask(caplog, key=KEY):
    with caplog.at_level(logging.WARNING, "pepper_kin.kernels"):
        part = portable.portable_unit(key, ["half"])
        if part is None:
            with making(key):  # reasons are logged where something is made
                pass
        return part


def package_unit(name):
    importlib.import_module(name)
    unit = unit_of(name)
    return portable.portable_unit(unit.key(), unit.symbols)


def test_the_file_has_every_unit_and_is_small():
    assert set(portable.portable_keys().values()) == set(compiled_modules())
    assert portable.portable_path().stat().st_size <= job.LARGEST


def test_parts_come_back_as_they_were(place, caplog):
    assert ask(caplog) == MODULE
    assert portable.portable_part("half", HALF.key) == HALF
    assert portable.portable_part("half", TWICE.key) is None
    assert ask(caplog, "b" * 64) is None
    assert not caplog.records


@pytest.mark.parametrize("where", [40, -10], ids=["head", "module"])
def test_a_flipped_bit_is_found(place, caplog, where):
    data = bytearray(place.read_bytes())
    data[where] ^= 4
    place.write_bytes(bytes(data))
    assert ask(caplog) is None
    (record,) = caplog.records
    assert "the portable code that comes with the package is damaged" in record.getMessage()


def test_an_older_llvm_is_reported(place, caplog, monkeypatch):
    present = llvm.llvm_version_info[0]
    monkeypatch.setattr(portable.llvm, "llvm_version_info", (present - 1, 0, 0))
    assert ask(caplog) is None
    assert f"is for LLVM {present}, and llvmlite has {present - 1}" in caplog.text


@pytest.mark.parametrize(
    ("triple", "served"),
    [
        ("aarch64-unknown-linux-gnu", True),
        ("arm64-apple-darwin23.0.0", True),
        ("powerpc64-unknown-linux-gnu", False),  # of the other order of bytes
        ("x86_64-pc-windows-msvc", False),  # another C library
    ],
)
def test_which_processors_are_served(place, caplog, monkeypatch, triple, served):
    monkeypatch.setattr(portable, "host_target", lambda: make_target(triple, "generic", ""))
    assert (ask(caplog) == MODULE) is served


def test_nothing_of_a_processor_is_in_it():
    bitcode = {part for name in compiled_modules() for part in package_unit(name)}
    text = "\n".join(str(llvm.parse_bitcode(part)) for part in bitcode)
    called = set(re.findall(r"@(llvm\.[\w.]+)", text))
    assert called
    assert not [name for name in called if re.match(r"llvm\.(x86|aarch64|arm)\.", name)]
    assert "target-cpu" not in text
    assert "target-features" not in text
    # Eight states side by side are the planners' own, rows are added by fours; nothing else was vectorized.
    assert set(re.findall(r"<(\d+) x (?:double|float|i64|ptr)>", text)) <= {"4", "8"}


def test_machine_code_for_arm64_can_be_made_of_it():
    target = make_target("aarch64-unknown-linux-gnu", "generic", "+neon")
    for name in ("pepper_kin.kernels.calling", "pepper_kin.planners.smooth", "pepper_kin.core.braking"):
        importlib.import_module(name)
        code = compile_portable(package_unit(name), target, unit_of(name).symbols)
        assert code[:4] == b"\x7fELF"
        assert int.from_bytes(code[18:20], "little") == 183  # EM_AARCH64


PROGRAM = """
import sys
import numpy as np
from pepper_kin import planners
free = lambda x: np.linalg.norm(x - 0.5, axis=1) > 0.2
problem = planners.Problem([0, 0], [1, 1], [0.1, 0.1], [0.9, 0.9], free, resolution=0.02)
path = planners.rrt_connect(problem, seed=1, timeout=600.0).path
curve = planners.car_curve((0, 0, 0), (1, 1, 0.5), 0.3)
print("numba" in sys.modules, *path.points.ravel(), *curve(np.linspace(0, 1, 5)).ravel())
"""


def test_another_processor_needs_no_numba_and_gets_the_same_answers(child, tmp_path):
    """As one process does it alone; that of many is the same function of the same file."""
    answers = []
    for variables in ({}, {"PEPPER_KIN_CPU": "x86-64-v2", "PEPPER_KIN_WARM_UP": "1"}):
        done = child(PROGRAM, PEPPER_KIN_CACHE=tmp_path / "cache", **variables)
        numba, *numbers = done.stdout.split()
        assert numba == "False"
        answers.append([float(x) for x in numbers])
    assert list((tmp_path / "cache").iterdir())
    assert answers[1] == pytest.approx(answers[0], abs=1e-6)
