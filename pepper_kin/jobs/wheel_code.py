"""The machine code of a wheel, made for its platform.

    python -m pepper_kin.jobs.wheel_code manylinux_2_28_x86_64 pepper_kin/kernels/data/wheel.code

`build_backend.py` runs it in the environment that builds the wheel.  The file has all compiled functions and
the kernels of everyday calls (`everyday_calls`), in the order of their names, so that the same sources and
versions of Numba and LLVM make the same bytes.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
from collections.abc import Sequence
from pathlib import Path

from pepper_kin.jobs.everyday_calls import everyday_calls
from pepper_kin.kernels.compiled_function import unit_of
from pepper_kin.kernels.parallel_build import compiled_modules
from pepper_kin.kernels.sources import digests_key, known_digests
from pepper_kin.kernels.store import collected
from pepper_kin.kernels.target import WHEELS, host_target
from pepper_kin.kernels.warm_up import Build
from pepper_kin.kernels.wheel_code import write_wheel_code


def make_wheel_code(tag: str, path: Path) -> int:
    """Write the file with a wheel's machine code.

    Args:
        tag: Platform tag of the wheel, one of `WHEELS`.
        path: The file to write.

    Returns:
        Size of the file [bytes].

    Raises:
        RuntimeError: if a process that compiles machine code fails.
    """
    target, modules = WHEELS[tag](), compiled_modules()
    Build(modules, only=True).finish(lambda reached: None)  # the calls below need code for this processor
    if target != host_target():
        Build(modules, only=True, wheel=tag).finish(lambda reached: None)
    with collected(target) as collection:
        everyday_calls()
        for name in modules:
            importlib.import_module(name)
            unit_of(name).load()
    parts = dict(sorted(collection.parts.items(), key=lambda item: (item[1][0], item[0])))
    digests = json.dumps(json.loads(known_digests()), sort_keys=True).encode()
    return write_wheel_code(parts | {digests_key(): ("digests", digests)}, target, path)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(prog="python -m pepper_kin.jobs.wheel_code", description=__doc__)
    parser.add_argument("tag", choices=sorted(WHEELS), help="platform tag of the wheel")
    parser.add_argument("path", type=Path, help="the file to write")
    options = parser.parse_args(arguments)
    print(f"{make_wheel_code(options.tag, options.path)} bytes of machine code for {options.tag}, ", end="")
    print(f"made by {os.cpu_count()} processes")


if __name__ == "__main__":
    main()
