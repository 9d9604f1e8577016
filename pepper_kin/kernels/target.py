"""Target processor of generated code, and the number of values in one of its registers."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import llvmlite.binding as llvm

from pepper_kin.exceptions import InvalidValueError

SCALAR_BYTES: dict[str, int] = {"float64": 8, "float32": 4}
"""Number formats of kernels -> size [bytes]."""


@dataclass(frozen=True)
class Target:
    """A processor.

    Attributes:
        triple: LLVM's name of the platform.
        cpu: LLVM's name of the processor.
        features: LLVM's list of instruction set extensions ("+avx2,-avx512f,...").
        vector_bytes: Width of a vector register [bytes]: 64, 32 or 16.
        has_fma: Whether multiply-add with one rounding is an instruction.
    """

    triple: str
    cpu: str
    features: str
    vector_bytes: int
    has_fma: bool

    def lanes(self, dtype: str) -> int:
        """Number of values of `dtype` ("float64" or "float32") in one vector register."""
        if dtype not in SCALAR_BYTES:
            raise InvalidValueError("dtype", repr(dtype), "'float64' or 'float32'")
        return self.vector_bytes // SCALAR_BYTES[dtype]


CPU_VARIABLE = "PEPPER_KIN_CPU"
"""Environment variable with the name of a target processor in place of this machine's."""

_LEVEL_2 = "+cx16,+sahf,+popcnt,+sse4.2"
_LEVEL_3 = f"{_LEVEL_2},+avx,+avx2,+bmi,+bmi2,+f16c,+fma,+lzcnt,+movbe,+xsave"
_LEVEL_4 = f"{_LEVEL_3},+avx512f,+avx512bw,+avx512cd,+avx512dq,+avx512vl"


def portable_target() -> Target:
    """Return the processor for which portable code is simplified: the one with the fewest instructions."""
    return make_target(llvm.get_process_triple(), "generic", "")


@cache
def host_target() -> Target:
    """The processor that runs this program, or the one that `PEPPER_KIN_CPU` names.

    A cluster whose machines share a cache folder may name their common denominator, such as "x86-64-v3".
    """
    chosen = os.environ.get(CPU_VARIABLE)
    if chosen:
        levels = {"x86-64": "", "x86-64-v2": _LEVEL_2, "x86-64-v3": _LEVEL_3, "x86-64-v4": _LEVEL_4}
        if chosen not in levels:
            raise InvalidValueError(CPU_VARIABLE, repr(chosen), f"one of {', '.join(levels)}")
        return make_target(llvm.get_process_triple(), chosen, levels[chosen])
    cpu, features = llvm.get_host_cpu_name(), llvm.get_host_cpu_features()
    return make_target(llvm.get_process_triple(), cpu, features.flatten())


def make_target(triple: str, cpu: str, features: str) -> Target:
    """A processor by its names in LLVM; vector width and multiply-add follow from the features.

    Args:
        triple: Name of the platform ("x86_64-unknown-linux-gnu").
        cpu: Name of the processor ("x86-64", "znver3", "generic").
        features: Extensions, "+" for present, comma-separated; "+avx512f" gives 64-byte vectors, "+avx"
            32-byte ones, anything else 16 (SSE2, NEON).
    """
    present = {name[1:] for name in features.split(",") if name.startswith("+")}
    vector_bytes = 64 if "avx512f" in present else 32 if "avx" in present else 16
    has_fma = bool(present & {"fma", "avx512f"}) or triple.startswith(("aarch64", "arm64"))
    return Target(triple, cpu, features, vector_bytes, has_fma)


WHEELS: dict[str, Callable[[], Target]] = {
    "manylinux_2_28_x86_64": lambda: make_target("x86_64-unknown-linux-gnu", "x86-64-v3", _LEVEL_3),
    "manylinux_2_28_aarch64": lambda: make_target("aarch64-unknown-linux-gnu", "generic", "+fp-armv8,+neon"),
    "macosx_11_0_arm64": lambda: make_target("arm64-apple-darwin20.0.0", "apple-m1", "+fp-armv8,+neon"),
}
"""Platform tag of a wheel -> the processor that its machine code is for.

x86-64-v3 has AVX2 and FMA, as processors have since 2013.
"""


@cache
def made_by() -> str:
    """Return the versions of llvmlite and Numba, looked up without importing Numba."""
    from importlib.metadata import version

    return f"llvmlite {version('llvmlite')} numba {version('numba')}"
