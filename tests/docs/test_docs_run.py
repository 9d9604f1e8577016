"""Every Python block of the documentation runs, page by page, in the order in which it stands.

Blocks marked `py` need other libraries: they are shown, and not run.  Every motion that a page makes passes
its certificate, and the twin follows it.  A page that names no extra runs without the packages of extras.
"""

import importlib
import re
from pathlib import Path

import pytest
from core_packages import extra_modules, hide_extras
from examined_motions import run_examined

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", *(p for p in sorted(DOCS.rglob("*.md")) if p.parent.name != "recipes")]
BLOCK = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)


def blocks(page: Path) -> list[tuple[int, str]]:
    """Return line and text of each Python block."""
    text = page.read_text(encoding="utf-8")
    return [(text.count("\n", 0, found.start(1)), found.group(1)) for found in BLOCK.finditer(text)]


def marks(page: Path) -> list[pytest.MarkDecorator]:
    """Return `browser` for a page that draws pictures or films, `thorough` for one that trains policies."""
    draws = any(re.search(r"\.save_(image|video)\(", text) for _, text in blocks(page))
    return [pytest.mark.browser] * draws + [pytest.mark.thorough] * (page.name == "learning.md")


RUNNING = [
    pytest.param(page, marks=marks(page), id=str(page.relative_to(ROOT))) for page in PAGES if blocks(page)
]


@pytest.mark.thorough
@pytest.mark.parametrize("page", RUNNING)
def test_page_runs(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    hide_extras(page.read_text(encoding="utf-8"), monkeypatch)
    namespace: dict[str, object] = {"__name__": "page"}
    faults = [run_examined("\n" * line + text, str(page), namespace) for line, text in blocks(page)]
    assert sum(map(len, faults)) == 0, faults


def test_packages_of_extras_are_hidden_from_pages_that_name_none(monkeypatch: pytest.MonkeyPatch) -> None:
    assert extra_modules() >= {"gymnasium", "matplotlib", "mujoco", "ompl", "placo", "toppra"}
    assert not extra_modules() & {"casadi", "numba", "pinocchio", "coal", "pytest"}
    hide_extras('needs `pip install -e ".[full]"`', monkeypatch)
    importlib.import_module("toppra")
    hide_extras("needs nothing", monkeypatch)
    with pytest.raises(ImportError):
        importlib.import_module("toppra")


@pytest.mark.parametrize("page", sorted((DOCS / "coming_from").glob("*.md")), ids=lambda page: page.stem)
def test_each_program_of_another_library_stands_beside_one_that_runs(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    pairs = re.findall(r"^<div class=\"beside\" markdown>\n(.*?)^</div>", text, re.MULTILINE | re.DOTALL)
    kinds = [re.findall(r"^```(\w+)$", pair, re.MULTILINE) for pair in pairs]
    assert len(pairs) >= 2
    assert kinds == [["py", "python"]] * len(pairs)
    assert len(blocks(page)) == len(pairs)
