"""The notebooks of the examples run, in a kernel as notebooks do, and hold no outputs."""

from pathlib import Path

import nbformat
import pytest
from examined_motions import run_examined
from nbclient import NotebookClient

pytestmark = pytest.mark.thorough

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted((ROOT / "examples" / "notebooks").glob("*.ipynb"))
INSTALL = 'if importlib.util.find_spec("pepper_kin") is None:\n    %pip install -q "pepper_kin'


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(path: Path, tmp_path: Path) -> None:
    book = nbformat.read(path, as_version=4)
    nbformat.validate(book)
    code = [cell for cell in book.cells if cell.cell_type == "code"]
    assert INSTALL in code[0].source  # on a machine without it, such as Colab's
    assert code[-1].source.startswith("assert ")
    assert not any(cell.outputs or cell.execution_count for cell in code)
    NotebookClient(book, timeout=120, resources={"metadata": {"path": str(tmp_path)}}).execute()
    assert [cell.execution_count for cell in code] == list(range(1, len(code) + 1))


@pytest.mark.parametrize("name", ["start", "planning", "twin"])
def test_motions_of_a_notebook_are_green_and_the_twin_follows(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    book = nbformat.read(ROOT / "examples" / "notebooks" / f"{name}.ipynb", as_version=4)
    code = [cell.source for cell in book.cells if cell.cell_type == "code"]
    assert run_examined("\n".join(code[1:]), name, {"__name__": "notebook"}) == []


def test_the_page_of_notebooks_names_each() -> None:
    page = (ROOT / "docs" / "notebooks.md").read_text(encoding="utf-8")
    assert len(NOTEBOOKS) == 5
    assert [path.name for path in NOTEBOOKS if f"examples/notebooks/{path.name}" not in page] == []
