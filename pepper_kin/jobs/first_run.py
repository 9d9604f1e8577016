"""First result without machine code, computed by Python's interpreter in another process."""

from __future__ import annotations

import importlib
import os
import subprocess
import sys
from collections.abc import Callable, Sequence

from pepper_kin.kernels.compiled_function import INTERPRETED, INTERPRETER
from pepper_kin.kernels.warm_up import Build, missing_modules

_PROGRAM = """
import sys
import numpy
from pepper_kin.cli import main
numpy.seterr(all="ignore")  # as in machine code
sys.argv[0] = "pepper-kin"
main()
"""


def run_interpreted(arguments: Sequence[str], module: str, tell: Callable[[str], None]) -> int | None:
    """Run a command by Python's interpreter if most of its machine code is missing; this takes longer.

    Other processes compile machine code meanwhile; code that is finished by the end is cached.

    Args:
        arguments: Words of the command, without "pepper-kin".
        module: Name of the module that does the command's work.
        tell: Function that is called with sentences on how the result is computed.

    Returns:
        Exit code of the command; None if machine code exists and nothing was run.
    """
    importlib.import_module(module)
    missing, of = missing_modules()
    if INTERPRETED or 2 * len(missing) < of:
        return None
    tell("No machine code has been made here yet: Python's interpreter computes this, with the same numbers.")
    build = Build(missing, nice=True)
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-c", _PROGRAM, *arguments],
            env={**os.environ, INTERPRETER: "1"},
            check=False,
        )
    finally:
        build.end()
    ratio = build.progress.ratio
    tell(
        (f"{100.0 * ratio:.0f} % of the machine code was made meanwhile. " if ratio > 0.0 else "")
        + "The next program makes the machine code that it needs, once; `pepper-kin warm-up` makes all of it."
    )
    return done.returncode
