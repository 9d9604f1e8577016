"""`pepper-kin doctor`, and the tables of what is installed and why."""

import json
import re
import sys
import tomllib
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from typer.testing import CliRunner

from pepper_kin import jobs
from pepper_kin.cli.program import app
from pepper_kin.jobs import installation

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
EXTRAS = {
    name: rows
    for name, rows in PROJECT["optional-dependencies"].items()
    if name not in ("test", "docs", "dev")
}
(PIN,) = (Requirement(row).specifier for row in PROJECT["dependencies"] if Requirement(row).name == "pin")
PAGE = (ROOT / "docs" / "platforms.md").read_text("utf-8")


def names(rows):
    return [Requirement(text).name for text in rows]


def table(section):
    """Return the rows of a section's table, cells without code marks around names."""
    part = PAGE.split(f"## {section}\n", 1)[1].split("\n## ", 1)[0]
    return [
        [cell.strip() for cell in line.strip("|").split(" | ")] for line in part.splitlines() if "|" in line
    ][2:]


def test_the_table_of_costs_has_the_dependencies_of_pyproject_and_what_each_is_for():
    rows = table("What it costs")
    assert sorted(row[0].strip("`") for row in rows) == sorted(names(PROJECT["dependencies"]))
    for name, cost, purpose in rows:
        assert float(cost) > 0
        assert purpose == installation.PURPOSES[name.strip("`")]
    assert [float(row[1]) for row in rows] == sorted((float(row[1]) for row in rows), reverse=True)


def test_the_table_of_extras_has_those_of_pyproject():
    rows = {row[0].strip("`"): row[1:] for row in table("Extras")}
    assert {extra: re.findall(r"`([\w-]+)`", row[0]) for extra, row in rows.items()} == {
        extra: names(packages) for extra, packages in EXTRAS.items()
    }
    for extra, row in rows.items():
        purposes = [installation.PURPOSES[name] for name in names(EXTRAS[extra]) if name != "pepper_kin"]
        assert row[1] == "; ".join(purposes)


def test_the_lock_has_a_version_of_all_that_development_needs_and_no_address():
    lines = (ROOT / "requirements-dev.lock").read_text("utf-8").splitlines()
    locked = [Requirement(line) for line in lines]
    assert all(re.fullmatch(r"==[\w.+]+", str(one.specifier)) and one.url is None for one in locked)
    extras = PROJECT["optional-dependencies"]
    wanted = [
        *PROJECT["dependencies"],
        *(row for name in ("dev", "test", "docs", "reference") for row in extras[name]),
    ]
    versions = {}
    for one in locked:
        versions.setdefault(canonicalize_name(one.name), []).append(one.specifier)
    for need in map(Requirement, wanted):
        if need.name != "pepper_kin":
            found = versions[canonicalize_name(need.name)]
            assert any(str(version).removeprefix("==") in need.specifier for version in found), need


def test_the_environment_of_the_tests_is_whole():
    found = jobs.check_installation("/usr/bin/chromium")
    assert found.success, found.report()
    assert {one.name for one in found.packages if not one.extra} >= {"numpy", "pin", "coal", "llvmlite"}
    for one in found.packages:
        assert one.installed is None or one.installed == metadata.version(one.name)
    assert "All that belongs to the library is there." in found.report()
    assert "pictures and films: /usr/bin/chromium" in found.report()
    assert json.loads(json.dumps(found.as_dict()))["success"] is True


@pytest.fixture
def installed(monkeypatch):
    """Return what pretends that a version of a package is installed, or none."""

    def pretend(name, version):
        true = metadata.version

        def other(asked):
            if asked != name:
                return true(asked)
            if version is None:
                raise metadata.PackageNotFoundError(name)
            return version

        monkeypatch.setattr(installation, "version", other)

    return pretend


@pytest.mark.parametrize(("version", "there"), [(None, "nothing"), ("2.7.1", "2.7.1")])
def test_what_belongs_to_the_library_and_is_missing_or_wrong_is_named(installed, version, there):
    installed("pin", version)
    done = CliRunner().invoke(app, ["doctor"])
    assert done.exit_code == 1
    fault = f"pin{PIN} is not there, but {there}: pip install 'pin{PIN}'"
    assert f"Wrong: {fault}" in done.stdout
    done = CliRunner().invoke(app, ["doctor", "--json"])
    assert json.loads(done.stdout)["faults"] == [fault]


def test_libraries_with_which_pinocchio_does_not_load_are_a_fault(monkeypatch):
    """An installer that takes pin 3.8.0 without placo puts urdfdom 6 beside it."""
    monkeypatch.setitem(sys.modules, "pinocchio", None)
    (fault,) = jobs.check_installation().faults
    assert "Pinocchio does not load (import of pinocchio halted" in fault
    assert "pip install --upgrade 'pin>=4.1'" in fault


def test_what_an_extra_brings_is_named_and_is_no_fault(installed):
    installed("placo", None)
    found = jobs.check_installation()
    assert found.success
    assert 'reference: pip install "pepper_kin[reference]"' in found.report()
    assert re.search(r"placo +missing +IK by", found.report())


def test_a_package_of_another_platform_is_not_asked_for(monkeypatch):
    rows = [
        "numpy>=2.0",
        'windows-only; sys_platform == "no system"',
        'fissix>=24.4; python_version < "3" and extra == "naoqi"',
    ]
    monkeypatch.setattr(installation, "requires", lambda _: rows)
    assert [one.name for one in jobs.check_installation().packages] == ["numpy"]


def test_the_code_that_runs_is_named(monkeypatch):
    for wheel, words in ((None, "made here on first use"), ("x86-64-v3", "the wheel's, for x86-64-v3")):
        monkeypatch.setattr(installation, "wheel_processor", lambda wheel=wheel: wheel)
        assert f"machine code: {words} (processor: " in jobs.check_installation().report()


def test_summaries_name_versions_of_what_belongs_to_the_library():
    from pepper_kin.jobs.result_files import _LIBRARIES

    assert set(_LIBRARIES) <= set(names(PROJECT["dependencies"]))
