"""Portable code of compiled functions: it names no processor and serves others."""

import importlib
import re

import llvmlite.binding as llvm
import pytest

from pepper_kin.kernels.compiled_function import unit_of
from pepper_kin.kernels.compiler import compile_portable
from pepper_kin.kernels.portable import needed
from pepper_kin.kernels.target import WHEELS

MODULES = ("pepper_kin.kernels.calling", "pepper_kin.planners.smooth", "pepper_kin.core.braking")


def bitcode(name):
    from pepper_kin.kernels.numba_builder import portable_parts

    importlib.import_module(name)
    parts = portable_parts(unit_of(name).functions)
    return [parts[symbol].bitcode for symbol in needed(unit_of(name).symbols, parts.__getitem__)]


def test_nothing_of_a_processor_is_in_it():
    text = "\n".join(str(llvm.parse_bitcode(part)) for name in MODULES for part in bitcode(name))
    called = set(re.findall(r"@(llvm\.[\w.]+)", text))
    assert called
    assert not [name for name in called if re.match(r"llvm\.(x86|aarch64|arm)\.", name)]
    assert "target-cpu" not in text
    assert "target-features" not in text
    # Nor anything of the process: addresses, pickled exceptions (with paths), names with Numba's counters.
    assert not re.findall(r"inttoptr \(i64|\\80\\04\\95|site-packages|missing Environment", text)
    # Eight states side by side are the planners' own, rows are added by fours; nothing else was vectorized.
    assert set(re.findall(r"<(\d+) x (?:double|float|i64|ptr)>", text)) <= {"4", "8"}


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("wheel", "begin"),
    [
        ("manylinux_2_28_x86_64", b"\x7fELF"),
        ("manylinux_2_28_aarch64", b"\x7fELF"),
        ("macosx_11_0_arm64", b"\xcf\xfa\xed\xfe\x0c\x00\x00\x01"),  # MH_MAGIC_64, CPU_TYPE_ARM64
    ],
)
def test_machine_code_of_each_wheel_can_be_made_of_it(wheel, begin):
    for name in MODULES:
        code = compile_portable(bitcode(name), WHEELS[wheel](), unit_of(name).symbols)
        assert code.startswith(begin)
        if wheel.endswith("aarch64"):
            assert int.from_bytes(code[18:20], "little") == 183  # EM_AARCH64
