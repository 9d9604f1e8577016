"""qiBullet's own tests for Pepper against `pepper_kin.qibullet`, unmodified.

Asked are 90 % of them.  The tests are read from a folder (qiBullet's repository has them, its wheel has not);
each imports `qibullet`, which here is the adapter, and `pybullet`, which must be installed.

Run: python benchmarks/qibullet_tests.py FOLDER/tests [--verbose]
"""

import importlib
import sys
import time
import unittest
from pathlib import Path

import pepper_kin.qibullet

CASES = {
    "simulation_manager_test": ("SimulationManagerTest",),
    "virtual_robot_test": ("VirtualRobotTest",),
    "base_test": ("PepperBaseTest",),
    "link_test": ("PepperLinkTest",),
    "joint_test": ("PepperJointTest",),
    "sensor_test": ("SensorTest",),
    "imu_test": ("PepperImuTest", "DummyImuTest"),
    "laser_test": ("PepperLaserTest",),
    "camera_test": ("PepperCameraTest",),
    "posture_test": ("PepperPostureTest",),
    "self_collision_test": ("PepperSelfCollisionTest",),
    "fsr_test": ("NaoFsrTest", "DummyFsrTest"),
}
"""Module of the tests -> its classes, but those that are the same for NAO and Romeo."""


def stand_in() -> None:
    """Let `import qibullet` and `from qibullet.imu import Imu` find the adapter."""
    sys.modules["qibullet"] = pepper_kin.qibullet
    for path in Path(pepper_kin.qibullet.__file__).parent.glob("*.py"):
        if path.stem != "__init__":
            module = importlib.import_module(f"pepper_kin.qibullet.{path.stem}")
            sys.modules[f"qibullet.{path.stem}"] = module


class Record(unittest.TestResult):
    """Passed and failed tests, by name, with the first line of the reason."""

    def __init__(self) -> None:
        super().__init__()
        self.passed: list[str] = []
        self.failed: dict[str, str] = {}

    def addSuccess(self, test: unittest.TestCase) -> None:  # noqa: N802
        self.passed.append(test.id())

    def addFailure(self, test, err) -> None:  # noqa: N802
        text = str(err[1]).splitlines()
        self.failed[test.id()] = f"{err[0].__name__}: {text[0] if text else ''}"

    addError = addFailure  # noqa: N815


def is_of_pepper(name: str) -> bool:
    """Return whether a test needs no robot but Pepper."""
    return not any(other in name.lower() for other in ("nao", "romeo"))


def share(passed: list[str], every: list[str]) -> str:
    return f"{len(passed)} of {len(every)} passed ({100.0 * len(passed) / max(len(every), 1):.0f} %)"


def main(folder: str, *options: str) -> None:
    stand_in()
    sys.path.insert(0, folder)
    loader, record, every = unittest.TestLoader(), Record(), []
    manager = pepper_kin.qibullet.SimulationManager()
    begun = time.perf_counter()
    for name, classes in CASES.items():
        module = importlib.import_module(name)
        for case in classes:
            suite = loader.loadTestsFromTestCase(getattr(module, case))
            ids = [test.id() for test in suite]
            every += ids
            suite(record)
            print(f"{case}: {share([i for i in ids if i in record.passed], ids)}", flush=True)
            for client in range(20):  # those that failed before they stopped their simulation
                manager.stopSimulation(client)
    for name, reason in record.failed.items():
        print(f"  {name}: {reason}")
    if "--verbose" in options:
        print("\n".join(record.passed))
    of_pepper = [name for name in every if is_of_pepper(name)]
    print(f"all: {share(record.passed, every)} in {time.perf_counter() - begun:.0f} s")
    print(f"those that need no other robot: {share(list(filter(is_of_pepper, record.passed)), of_pepper)}")


if __name__ == "__main__":
    main(*sys.argv[1:])
