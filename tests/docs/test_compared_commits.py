"""Commands that the pages name, and the comparison of commits."""

import math

import pytest
import run_all
from operations import OPERATIONS


def test_commands_of_the_pages_can_be_given():
    """Their scripts exist, and take the options that are named."""
    named = run_all.commands("")
    assert len(named) > 40
    for command, page in named:
        script, *words = command.split()
        text = (run_all.HERE / script).read_text("utf-8")
        for option in (word for word in words if word.startswith("--")):
            assert f'"{option}"' in text, f"{page}: {command}"


def test_words_in_capitals_are_filled_in_or_left_out():
    words = {"PROBLEMS": "a b", "FOLDER": "c"}
    assert run_all.filled("x.py PROBLEMS --plan --count 15", words) == [
        "x.py",
        "a b",
        "--plan",
        "--count",
        "15",
    ]
    assert run_all.filled("x.py --python PATH --full", words) == ["x.py", "--full"]
    assert run_all.filled("x.py FOLDER/tests", words) == ["x.py", "c/tests"]
    assert run_all.filled("x.py RESOURCES", words) is None


@pytest.mark.parametrize(
    ("ratio", "error", "fell"),
    [(0.9, 0.01, True), (0.9, 0.04, False), (0.97, 0.001, False), (1.2, 0.0, False), (math.nan, 0.0, False)],
)
def test_a_ratio_fell_beyond_its_noise_only(ratio, error, fell):
    assert run_all.Compared("a", "b", "plan", 1.0, ratio, error).fell == fell


def test_the_history_tells_what_small_changes_came_to(tmp_path, monkeypatch):
    monkeypatch.setattr(run_all, "HISTORY", tmp_path / "history.csv")
    rows = [run_all.Compared(str(k), str(k - 1), "plan", 100.0, 0.97, 0.01) for k in range(1, 4)]
    for row in rows:
        run_all.keep([row])
    assert [row.commit for row in run_all.history()] == ["1", "2", "3"]
    last = run_all.Compared("4", "3", "plan", 100.0, 0.97, 0.01)
    assert f"| {0.97**4:.2f} |" in run_all.line(last, OPERATIONS["plan"], run_all.history())


@pytest.mark.thorough
def test_two_commits_take_turns(tmp_path):
    """Here the sources with themselves, and with some that lack what is asked for."""
    now = run_all.copy_of(None, tmp_path / "now")
    old = run_all.copy_of(None, tmp_path / "old")
    with (old / "pepper_kin" / "dynamics" / "mass.py").open("a", encoding="utf-8") as file:
        file.write("\n\ndef mass_matrix(*_):\n    raise NotImplementedError\n")
    sides = [run_all.Side(package, tmp_path / "cache") for package in (old, now)]
    same = run_all.compared("inverse_dynamics", ("old", "now"), sides, 3)
    lost = run_all.compared("mass_matrix", ("old", "now"), sides, 1)
    for side in sides:
        side.close()
    assert 0.2 < same.ratio < 5.0
    assert same.peer.startswith("Pinocchio 3")
    assert math.isnan(lost.ratio)
    assert lost.microseconds > 0.0
    assert not lost.fell
