"""Compilation of all machine code that this processor needs."""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pepper_kin.kernels.compiled_function import unit_of
from pepper_kin.kernels.parallel_build import compiled_modules
from pepper_kin.kernels.store import cache_folder, can_write, is_known, prefer_native
from pepper_kin.kernels.target import host_target
from pepper_kin.kernels.warm_up import Build


@dataclass(frozen=True)
class WarmUp:
    """Result of `warm_up`.

    Attributes:
        modules: Number of modules with compiled functions.
        made: Number of modules whose machine code was compiled.
        processor: LLVM's name of the processor of the machine code.
        folder: Folder of the machine code.
        time: Wall-clock time of the call [s].
    """

    modules: int
    made: int
    processor: str
    folder: str
    time: float

    def report(self) -> str:
        """Return the result in one sentence."""
        if not self.made:
            return f"Nothing to do: there is machine code of all {self.modules} modules for {self.processor}."
        return (
            f"Made machine code of {self.made} of {self.modules} modules for {self.processor} in "
            f"{self.time:.0f} s; it is kept in {self.folder}."
        )

    def as_dict(self) -> dict[str, Any]:
        """Return the attributes as plain values."""
        return dict(vars(self))


def warm_up(native: bool = False, progress: Callable[[int, int], None] = lambda done, total: None) -> WarmUp:
    """Compile all missing machine code on all cores: compiled functions and kernels of everyday calls.

    Args:
        native: Whether to compile for this processor even if a wheel has suitable code, and use the result
            from now on.
        progress: Function that is called with the finished and the total work, in thousandths.
    """
    from pepper_kin.jobs.everyday_calls import everyday_calls

    begin = time.perf_counter()
    if native and can_write():
        prefer_native()
    names = compiled_modules()
    for name in names:
        importlib.import_module(name)
    missing = [name for name in names if not is_known(unit_of(name).key())]
    if missing:
        Build(missing, only=True).finish(lambda reached: progress(round(1000 * reached.ratio), 1000))
    everyday_calls()
    seconds = time.perf_counter() - begin
    return WarmUp(len(names), len(missing), host_target().cpu, str(cache_folder()), seconds)
