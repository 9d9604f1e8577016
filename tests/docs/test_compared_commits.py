"""Commands that the pages name, and the comparison of commits."""

from __future__ import annotations

import ast
import math
import re
from pathlib import Path

import harness
import pytest
import run_all
from operations import OPERATIONS

COMMAND = re.compile(r"`(?:\w+=\w+ )?(?:python )?benchmarks/run_all\.py ([a-z]\w+)([^`]*)`")


def test_commands_of_the_pages_can_be_given():
    """Their benchmarks exist, and their functions take the options that are named."""
    listed, taken = harness.listed(), {}
    for file in {module for module, *_ in listed.values()}:
        text = (harness.HERE / "benchmarks" / f"{file}.py").read_text("utf-8")
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef):
                taken[node.name] = {argument.arg for argument in node.args.args}
    pages = harness.HERE.glob("docs/**/*.md")
    named = [(page, *match) for page in pages for match in COMMAND.findall(page.read_text("utf-8"))]
    assert len(named) > 40
    for page, name, words in named:
        assert name in listed, page
        for option in re.findall(r"--([\w-]+)", words):
            assert option == "quick" or option.replace("-", "_") in taken[name], f"{page}: {name} {words}"


def test_every_benchmark_names_a_page():
    for name, (_, page, _) in harness.listed().items():
        assert (harness.HERE / "docs" / page).exists(), name


@pytest.fixture
def sized(monkeypatch):
    """A benchmark of its own, whose options come back."""

    def made(place: Path, count=3, share=1.0, names=("a",), known: Path | None = None, full=False):
        return ()

    monkeypatch.setattr(harness, "listed", lambda: {"made": ("math", "ik.md", "")})
    monkeypatch.setattr(harness, "REGISTERED", {})
    harness.figures("ik.md", count=1)(made)
    return lambda *words: harness.options_of("made", list(words))


def test_options_are_the_parameters_of_a_benchmark(sized):
    assert sized("x", "5") == {"place": Path("x"), "count": 5}
    assert sized("x", "--quick") == {"place": Path("x"), "count": 1}
    assert sized("--place", "x", "--quick", "--count", "2", "--full") == {
        "place": Path("x"),
        "count": 2,
        "full": True,
    }
    assert sized("x", "--names", "b", "c", "--share", "0.5")["names"] == ["b", "c"]
    assert sized("x", "5", "0.5", "b", "c")["names"] == ["b", "c"]
    for wrong in ([], ["x", "--cuont", "1"], ["x", "--count", "many"]):
        with pytest.raises(SystemExit):
            sized(*wrong)


def test_tables_begin_where_columns_change(capsys):
    harness.show(
        [("a | b [us] {:.1f}", "x", 1.25), ("a | b [us] {:.1f}", "y", "-"), "words", ("c | ok", 1, True)]
    )
    assert capsys.readouterr().out == (
        "\n| a | b [us] |\n|---|---|\n| x | 1.2 |\n| y | - |\n\nwords\n\n| c | ok |\n|---|---|\n| 1 | yes |\n"
    )


def test_calls_in_turn_are_timed_by_the_clock():
    ticks = iter(range(100))
    spent = harness.in_turn({"a": lambda: None, "b": lambda: next(ticks)}, 2, lambda: next(ticks))
    assert spent["a"].tolist() == [1, 1]
    assert spent["b"].tolist() == [2, 2]


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
    assert run_all.cells_of(last, OPERATIONS["plan"], run_all.history())[5] == pytest.approx(0.97**4)


@pytest.mark.thorough
def test_two_commits_take_turns(tmp_path):
    """Here the sources with themselves, and with some that lack what is asked for."""
    now = harness.laid_out(None, tmp_path / "now")
    old = harness.laid_out(None, tmp_path / "old")
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
