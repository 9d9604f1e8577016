"""Report on the installation: packages, machine code, and missing parts with the extra that installs them."""

from __future__ import annotations

import importlib
import os
import platform
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, requires, version
from typing import Any, NamedTuple

from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name

from pepper_kin.exceptions import MissingDependencyError
from pepper_kin.kernels.store import cache_folder, prefers_native
from pepper_kin.kernels.target import host_target
from pepper_kin.kernels.wheel_code import wheel_processor
from pepper_kin.proxsuite_library import proxqp

PURPOSES: Mapping[str, str] = {
    "numpy": "arrays",
    "scipy": "splines, hulls of points, rotations",
    "pin": "Pinocchio: the robot's tree, kinematics and dynamics of single states",
    "coal": "exact distances and contacts, of which certificates are made",
    "proxsuite": "the solver ProxQP, of IK and of contacts that Newton's method does not solve",
    "casadi": "expressions, of which machine code of robots, tasks and formulas is made",
    "llvmlite": "loading and making of machine code",
    "numba": "machine code of compiled functions",
    "ruckig": "`OnlineMotion`",
    "xacro": "descriptions in xacro",
    "meshcat": "the page's drawing code; the rest of it, such as IPython, is not loaded",
    "fast-simplification": "coarser meshes for the live page",
    "trimesh": "meshes in PLY, glTF and others; masses of meshes",
    "pycollada": "meshes in COLLADA",
    "tornado": "servers of the live page and of rosbridge",
    "pyyaml": "trajectories of ROS, jobs of datasets",
    "typer": "commands",
    "packaging": "`pepper-kin doctor`",
    "rich": "progress bars and tables of commands",
    "placo": 'IK by `solver="placo"`',
    "toppra": 'timing by `solver="toppra"`',
    "cmeel-urdfdom": "what placo is built against",
    "cmeel-tinyxml2": "the parser of XML that placo is built against",
    "pandas": "tables",
    "matplotlib": "plots",
    "av": "films as MP4",
    "pillow": "films as GIF",
    "mcap": "recordings of ROS 2",
    "pyarrow": "Parquet: datasets",
    "distributed": "datasets made by a cluster of Dask",
    "fsspec": "datasets in stores of objects",
    "gymnasium": "environments to learn on",
    "mujoco": "`pepper-kin check physics`",
    "ompl": "OMPL's planners",
    "qi": "robots with NAOqi, by libqi",
    "fissix": "NAOqi scripts in Python 2",
    "cyclonedds": "ROS 2 by Cyclone DDS",
    "eclipse-zenoh": "ROS 2 by Zenoh",
}
"""Purpose of each dependency, by its name in `pyproject.toml`."""

DEVELOPMENT = ("test", "docs", "dev", "dask", "full")
"""Extras for developers, and extras that combine others."""


class Package(NamedTuple):
    """A package that the library can use.

    Attributes:
        name: Name of the package.
        bounds: Supported versions, such as ">=2.0".
        extra: Extra that installs the package; empty for the library's own dependencies.
        installed: Installed version, or None.
    """

    name: str
    bounds: str
    extra: str
    installed: str | None

    @property
    def fits(self) -> bool:
        """Whether the installed version is supported."""
        return self.installed in SpecifierSet(self.bounds) if self.installed else False


@dataclass(frozen=True)
class Installation:
    """Installed and missing parts.

    Attributes:
        version: Version of the library.
        python: Version and implementation of Python.
        platform: Operating system and processor.
        processor: LLVM's name of the processor.
        wheel_code: Processor of the wheel's machine code; None if no code fits, or in a clone.
        native: Whether `pepper-kin warm-up --native` has requested code for this processor.
        cache: Folder of the machine code that is compiled here.
        cached: Size of the cache [byte]; 0 without a cache.
        packages: All packages, the library's own dependencies first.
        faults: Faults, in sentences with advice.
        chromium: Path of the browser that draws pictures; None without one.
    """

    version: str
    python: str
    platform: str
    processor: str
    wheel_code: str | None
    native: bool
    cache: str
    cached: int
    packages: tuple[Package, ...]
    faults: tuple[str, ...] = field(default=())
    chromium: str | None = None

    @property
    def success(self) -> bool:
        """Whether the library's own parts are complete and supported."""
        return not self.faults

    def report(self) -> str:
        """Return the report as text."""
        code = f"the wheel's, for {self.wheel_code}" if self.wheel_code else "made here on first use"
        if self.native:
            code = f"made here for {self.processor}, as `warm-up --native` has asked"
        kept = f"{self.cached / 1e6:.1f} MB of machine code made here, in {self.cache}"
        lines = [
            f"pepper_kin {self.version}, Python {self.python}, {self.platform}",
            f"machine code: {code} (processor: {self.processor}); {kept}",
            f"pictures and films: {self.chromium or 'no Chromium: apt-get install chromium'}",
        ]
        for extra in dict.fromkeys(one.extra for one in self.packages):
            rows = [one for one in self.packages if one.extra == extra]
            missing = [one for one in rows if one.installed is None]
            install = f': pip install "pepper_kin[{extra}]"' if extra and missing else ""
            lines.append(f"\n{extra or 'the library'}{install}")
            lines += [f"  {one.name:<20}{one.installed or 'missing':<12}{PURPOSES[one.name]}" for one in rows]
        verdict = ["\nWrong: " + sentence for sentence in self.faults]
        return "\n".join([*lines, *(verdict or ["\nAll that belongs to the library is there."])])

    def as_dict(self) -> dict[str, Any]:
        """Return the attributes as plain values."""
        found = {**vars(self), "success": self.success, "faults": list(self.faults)}
        found["packages"] = [{**one._asdict(), "purpose": PURPOSES[one.name]} for one in self.packages]
        return found


def check_installation(chromium: str | None = None) -> Installation:
    """Return installed and missing parts; nothing is changed, and only Pinocchio and ProxQP are loaded.

    Args:
        chromium: Path of the browser that draws pictures, or None.
    """
    rows = tuple(_packages())
    faults = [
        f"{one.name}{one.bounds} is not there, but {one.installed or 'nothing'}: "
        f"pip install '{one.name}{one.bounds}'"
        for one in rows
        if not (one.fits if one.installed else one.extra)
    ]
    try:
        importlib.import_module("pinocchio")
    except ImportError as error:
        faults.append(
            f"Pinocchio does not load ({error}); the metadata of pin 3.8.0 admit libraries that it is not "
            "linked against: pip install --upgrade 'pin>=4.1', or, for 3.8.0, "
            "pip install cmeel-urdfdom==4.0.1 cmeel-tinyxml2==10.0.0"
        )
    try:
        proxqp()
    except MissingDependencyError as error:
        faults.append(str(error))
    folder = cache_folder()
    try:
        cached = sum(file.stat().st_size for file in folder.iterdir() if file.is_file())
    except OSError:
        cached = 0
    return Installation(
        version("pepper_kin"),
        f"{platform.python_version()} ({platform.python_implementation()})",
        f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores",
        host_target().cpu,
        wheel_processor(),
        prefers_native(),
        str(folder),
        cached,
        rows,
        tuple(faults),
        chromium,
    )


def _packages() -> Iterator[Package]:
    """Yield the packages of the library's metadata whose markers hold on this machine."""
    for text in requires("pepper_kin") or ():
        found = Requirement(text)
        extra = _EXTRA.search(text)
        of, name = extra[1] if extra else "", canonicalize_name(found.name)
        if of in DEVELOPMENT or name == "pepper-kin":
            continue
        if found.marker is not None and not found.marker.evaluate({"extra": of}):
            continue
        try:
            installed: str | None = version(name)
        except PackageNotFoundError:
            installed = None
        yield Package(name, str(found.specifier), of, installed)


_EXTRA = re.compile(r"""extra == ['"]([\w-]+)['"]""")
