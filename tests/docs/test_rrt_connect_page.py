"""The page that writes RRT-Connect: a short program that needs no robot and steps through as plain Python."""

import re
import textwrap
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "rrt_connect.md").read_text(encoding="utf-8")
PROGRAM, LIBRARY = re.findall(r"^```python\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
ALONE = """
import sys
for name in ("pinocchio", "coal", "casadi", "placo", "pepper_kin.model"):
    sys.modules[name] = None  # cannot be imported
"""
SHOW = "\nnp.save(sys.argv[1], path)\n"


def test_the_program_has_120_lines_at_most():
    assert sum(map(bool, map(str.strip, PROGRAM.splitlines()))) <= 120


def test_interpreted_and_compiled_it_finds_the_same_path_without_a_robot(child, tmp_path):
    """And the library's search and certificate, of the same check, accept it."""
    child(ALONE + PROGRAM + SHOW, tmp_path / "interpreted.npy", NUMBA_DISABLE_JIT=1)
    child(ALONE + PROGRAM + LIBRARY + SHOW, tmp_path / "compiled.npy")
    interpreted, compiled = (np.load(tmp_path / f"{name}.npy") for name in ("interpreted", "compiled"))
    assert len(compiled) > 3
    np.testing.assert_allclose(interpreted, compiled, rtol=0, atol=1e-12)


def test_the_breakpoint_is_where_a_tree_is_extended():
    (line,) = re.findall(r"break rrt\.py:(\d+)", PAGE)
    assert PROGRAM.splitlines()[int(line) - 1].strip().startswith("new = extend(")


def test_the_loop_shown_is_that_of_the_library():
    (loop,) = re.findall(r"^```py\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    source = (ROOT / "planners" / "tree_growth.py").read_text(encoding="utf-8")
    assert textwrap.indent(loop, " " * 4, lambda line: line.strip()) in source
    assert loop.count("\n") <= 30
