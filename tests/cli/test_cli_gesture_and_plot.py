"""The commands `gesture`, for the library's gestures, and `plot`."""

import json

import pytest


@pytest.mark.thorough
def test_gesture_of_the_library_and_its_plot(run, tmp_path):
    done = run("gesture", "nod", "--tempo", "2", "-o", "out", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "nod: nods once (side right, amplitude 1.0, tempo 2.0)." in done.stdout
    assert "passes every check" in done.stdout
    assert {p.name for p in (tmp_path / "out").iterdir()} == {
        "trajectory.csv",
        "columns.json",
        "summary.json",
    }
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["certificate"]["success"] is True
    done = run("plot", "out/trajectory.csv", "-o", "nod.png", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "nod.png").read_bytes().startswith(b"\x89PNG")
    done = run("plot", "out/trajectory.csv", "./out/trajectory.csv", "-o", "two.pdf", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "two.pdf").read_bytes().startswith(b"%PDF")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("gesture", "tail"), "unknown gesture 'tail'; available: head, left-arm, right-arm, wave,"),
        (("gesture", "wave", "--side", "up"), "side: got 'up'"),
        (("gesture", "wave", "--tempo", "9"), "tempo: got 9.0"),
        (("plot", "none.csv", "-o", "a.png"), "none.csv: cannot be read"),
        (("plot", "none.txt", "-o", "a.png"), "unknown suffix '.txt'; available: .csv"),
    ],
)
def test_misuse_exits_with_one_line(run, tmp_path, arguments, message):
    done = run(*arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert message in done.stderr
    assert list(tmp_path.iterdir()) == []
