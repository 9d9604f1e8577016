"""The pages of verification and of faults: what the script writes, and tests that are there."""

import ast
import copy
import importlib.util
import json
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "verification.md"


@pytest.fixture
def script():
    spec = importlib.util.spec_from_file_location("make_verification", ROOT / "docs" / "make_verification.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_page_is_what_its_script_writes(script, monkeypatch, tmp_path):
    monkeypatch.setattr(script, "FOLDER", tmp_path)
    script.main([])
    assert (tmp_path / "verification.md").read_text("utf-8") == PAGE.read_text("utf-8")


def test_figures_that_differ_are_named(script):
    kept = json.loads((script.REPORTS / "small.json").read_text("utf-8"))
    assert script.differences(kept) == []
    changed = copy.deepcopy(kept)
    examined = [test for test in changed["tests"] if test["counts"]]
    first = next(test for test in examined if test["counts"][0][1] >= 1000)
    first["counts"][0][1] += 1000
    assert script.differences(changed) == []  # more cases than the page states
    second, third = [test for test in examined if test is not first][:2]
    first["counts"][0][1] -= 2000
    second["counts"][0][2] += 1
    third["counts"][0][0] += ", in another way"
    lines = "\n".join(script.differences(changed))
    for part in (first["counts"][0][0], "1 wrong", "in another way: not on the page (small)"):
        assert part in lines


def test_each_fault_names_tests_that_are_there():
    section = PAGE.with_name("faults.md").read_text("utf-8")
    rows = re.findall(r"^\| (\d+) \|.*$", section, re.MULTILINE)
    assert [int(row) for row in rows] == list(range(24))
    named = re.findall(r"`([\w/]+\.py)(?:::(\w+))?`", section)
    assert len(named) > 30
    for file, function in named:
        tree = ast.parse((ROOT / file).read_text("utf-8"))
        tests = {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}
        assert any(name.startswith("test_") for name in tests), file
        assert not function or function in tests, f"{file}::{function}"
