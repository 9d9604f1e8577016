"""What stands in docs/naoqi.md for a robot, run as written except for the address."""

import importlib.util
import re
from pathlib import Path

import pytest

import pepper_kin as pk
from pepper_kin.naoqi.hosted_twin import hosted_twin
from pepper_kin.twin import load_run

PAGE = (Path(__file__).parents[2] / "docs" / "naoqi.md").read_text(encoding="utf-8")
PROGRAMS = re.findall(r"```py\n(.*?)```", PAGE, re.DOTALL)

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("qi") is None, reason="the package qi has no wheel for this machine"
)


@pytest.fixture(scope="module")
def url():
    with hosted_twin() as (url, _):
        yield url


@pytest.mark.thorough
@pytest.mark.parametrize("program", PROGRAMS, ids=["follow", "mirror"])
def test_a_program_of_the_page(url, program, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert "tcp://pepper.local:9559" in program
    space = {"__name__": "page"}
    exec(compile(program.replace("tcp://pepper.local:9559", url), "docs/naoqi.md", "exec"), space)
    if "result" in space:
        assert space["result"].run.position.shape[1] == space["pepper"].n
        assert load_run(space["pepper"], "measured.csv").duration > 0.1
    else:
        assert load_run(pk.load_pepper(base="planar", hands="mimic"), "robot.csv").duration > 1.0
