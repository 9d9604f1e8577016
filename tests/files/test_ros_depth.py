"""YAML nested so deep that composing it overflows the stack is refused, not a crash."""

import subprocess
import sys

import pytest

from pepper_kin.exceptions import FileFormatError
from pepper_kin.files import load

READ = """
import sys
from pepper_kin.exceptions import FileFormatError
from pepper_kin.files import load
try:
    load(sys.argv[1])
except FileFormatError as error:
    print(error)
"""


@pytest.mark.parametrize("text", ["[" * 100_000 + "\n", "- " * 30_000 + "1\n"], ids=["flow", "block"])
def test_deep_nesting_is_refused_by_line(tmp_path, text):
    path = tmp_path / "deep.yaml"
    path.write_text("# a comment\n" + text)
    done = subprocess.run(  # a process of its own: the stack overflow ended it
        [sys.executable, "-c", READ, str(path)], capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.returncode
    assert f"{path}:2: is not a JointTrajectory: nested more than 16 deep" in done.stdout


def test_what_is_a_little_too_deep_is_refused_and_less_is_read_on(tmp_path):
    path = tmp_path / "list.yaml"
    for depth, reason in ((17, "nested more than 16 deep"), (16, "expected fields joint_names, points")):
        path.write_text("[" * depth + "]" * depth + "\n")
        with pytest.raises(FileFormatError, match=reason):
            load(path)
