"""The examples and the documents about trajectories, gestures, files and Choregraphe: what they show runs."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("arguments", [("10_gestures.py", "--quick"), ("11_files.py",)], ids=lambda a: a[0])
def test_examples_pass_their_own_check(tmp_path, arguments):
    script = ROOT / "examples" / arguments[0]
    assert len(script.read_text().splitlines()) < 100
    done = subprocess.run(
        [sys.executable, str(script), *arguments[1:]], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("document", ["files", "gestures", "choregraphe", "trajectories"])
def test_documents_run(tmp_path, monkeypatch, capsys, document):
    monkeypatch.chdir(tmp_path)
    text = (ROOT / "docs" / f"{document}.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    assert blocks
    names = {}
    for block in blocks:
        exec(block, names)
    if document == "choregraphe":
        shown = re.search(r"```text\n(.*?)```", text, re.DOTALL)
        assert shown.group(1).strip() in capsys.readouterr().out
    if document == "gestures":
        for name in names["pk"].motion.gesture_names():
            assert f"| `{name}` | {names['pk'].motion.gesture_meaning(name)} |" in text
