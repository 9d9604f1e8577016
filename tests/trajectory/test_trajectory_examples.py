"""The examples and the documents about gestures and Choregraphe: what they show runs and is what they say.

That every page runs is tested in `tests/docs`.
"""

import re
from pathlib import Path

import pytest

from pepper_kin.motion import gesture_meaning, gesture_names

ROOT = Path(__file__).parents[2]


@pytest.mark.thorough
@pytest.mark.parametrize("arguments", [("10_gestures.py", "--quick"), ("11_files.py",)], ids=lambda a: a[0])
def test_examples_pass_their_own_check(run_example, tmp_path, arguments):
    assert len((ROOT / "examples" / arguments[0]).read_text().splitlines()) < 100
    assert run_example(*arguments, cwd=tmp_path).returncode == 0


def test_the_page_about_choregraphe_prints_what_it_shows(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    text = (ROOT / "docs" / "choregraphe.md").read_text(encoding="utf-8")
    names = {}
    for block in re.findall(r"```python\n(.*?)```", text, re.DOTALL):
        exec(block, names)
    shown = re.search(r"```text\n(.*?)```", text, re.DOTALL)
    assert shown.group(1).strip() in capsys.readouterr().out


def test_the_page_about_gestures_names_them_all():
    text = (ROOT / "docs" / "gestures.md").read_text(encoding="utf-8")
    for name in gesture_names():
        assert f"| `{name}` | {gesture_meaning(name)} |" in text
