"""Build backend: that of setuptools, and machine code in a wheel where PEPPER_KIN_WHEEL names a platform.

    PEPPER_KIN_WHEEL=manylinux_2_28_x86_64 python -m build

Without the variable a wheel has no machine code and serves every platform: code is made on first use.  With
it the wheel is for that platform, and for every version of Python.  The code is made of what the wheel
contains, by the versions of `requirements-dev.lock`, so that two builds make the same bytes.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path
from typing import Any

from setuptools import build_meta
from setuptools.build_meta import *  # noqa: F403  # the other hooks

SWITCH = "PEPPER_KIN_WHEEL"
CODE = Path("pepper_kin/kernels/data/wheel.code")
TIME = "315532800"
"""Time stamp of all files of a wheel [s]: the first that an archive can have, 1980."""


def get_requires_for_build_wheel(config_settings: Any = None) -> list[str]:
    """Return what has to be installed: with the switch all that computes, in locked versions."""
    needs = list(build_meta.get_requires_for_build_wheel(config_settings))
    return [*needs, "wheel", *_locked()] if os.environ.get(SWITCH) else needs


def build_wheel(wheel_directory: str, config_settings: Any = None, metadata_directory: Any = None) -> str:
    """Build a wheel; return its name."""
    tag = os.environ.get(SWITCH)
    if not tag:
        return str(build_meta.build_wheel(wheel_directory, config_settings, metadata_directory))
    os.environ["SOURCE_DATE_EPOCH"] = TIME
    with tempfile.TemporaryDirectory() as folder:
        name = build_meta.build_wheel(folder, config_settings, metadata_directory)
        return _with_code(Path(folder), name, tag, Path(wheel_directory))


def _locked() -> list[str]:
    """Return requirements of the lock file: what the library depends on, and their own libraries in C++."""
    project = tomllib.loads(Path("pyproject.toml").read_text("utf-8"))["project"]
    names = {re.split(r"[^\w.-]", line, maxsplit=1)[0] for line in project["dependencies"]}
    own = re.compile(rf"({'|'.join(map(re.escape, names))}|cmeel.*|lib(coal|pinocchio)|eigenpy)==")
    lines = Path("requirements-dev.lock").read_text("utf-8").splitlines()
    return [line for line in lines if own.match(line)]


def _with_code(folder: Path, name: str, tag: str, output: Path) -> str:
    """Add machine code to a wheel of a folder, and write it elsewhere under the name of its platform."""

    def run(*words: str | Path, **environment: str) -> None:
        done = subprocess.run(
            [sys.executable, "-m", *map(str, words)],
            cwd=folder, env={**os.environ, **environment}, capture_output=True, text=True, check=False,
        )  # fmt: skip
        if done.returncode:
            raise RuntimeError(f"{words[0]} failed:\n{done.stdout}{done.stderr}")

    run("wheel", "unpack", "--dest", folder / "tree", folder / name)
    (content,) = (folder / "tree").iterdir()
    paths = os.pathsep.join(filter(None, (str(content), os.environ.get("PYTHONPATH"))))
    processor = {"PEPPER_KIN_CPU": "x86-64-v3"} if tag.endswith("x86_64") else {}
    run(
        "pepper_kin.jobs.wheel_code", tag, content / CODE,
        PYTHONPATH=paths, PEPPER_KIN_CACHE=str(folder / "cache"), PYTHONDONTWRITEBYTECODE="1",
        PYTHONHASHSEED="0", **processor,
    )  # fmt: skip
    (metadata,) = content.glob("*.dist-info")
    text = (metadata / "WHEEL").read_text("utf-8")
    text = text.replace("Purelib: true", "Purelib: false").replace("-none-any", f"-none-{tag}")
    (metadata / "WHEEL").write_text(text, "utf-8")
    run("wheel", "pack", "--dest-dir", output.resolve(), content)
    return name.replace("-none-any", f"-none-{tag}")
