"""An edit makes those units anew that hold the edited function, and no others."""

import json

import pytest

KEYS = """
import importlib, json, sys
from pepper_kin.kernels import sources
from pepper_kin.kernels.compiled_function import unit_of
from pepper_kin.kernels.parallel_build import compiled_modules
old, new, place = sys.argv[1:]
edits, true_read = [0], sources.Path.read_bytes
def read(path):
    data = true_read(path)
    if str(path).endswith(place):
        edits.append(data.count(old.encode()))
        data = data.replace(old.encode(), new.encode())
    return data
sources.Path.read_bytes = read
keys = {name: unit_of(name).key() for name in compiled_modules() if importlib.import_module(name)}
print(json.dumps([max(edits), keys]))
"""


@pytest.fixture(scope="module")
def keys(child):
    return json.loads(child(KEYS, "", "", "no file").stdout)[1]


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("import math\n", "import math  # a comment\n", set()),
        ('    """Return', '    """Return, in other words,', set()),
        ("def symmetric_eigen(", "def symmetric_eigen(more=1, *, ", {"pepper_kin.core.servo_tick"}),
    ],
    ids=["a comment", "docstrings", "one function"],
)
def test_an_edit_changes_the_keys_of_the_units_that_hold_the_function(child, keys, old, new, expected):
    count, edited = json.loads(child(KEYS, old, new, "core/linear_algebra.py").stdout)
    assert count >= 1
    assert {name for name in keys if edited[name] != keys[name]} == expected
