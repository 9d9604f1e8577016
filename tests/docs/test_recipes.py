"""Every recipe says when one wants it, runs by itself, prints what its comments say, and is in the index."""

import ast
import contextlib
import io
import re
from pathlib import Path
from typing import NamedTuple

import pytest
from core_packages import hide_extras
from examined_motions import examine

DOCS = Path(__file__).parents[2] / "docs"
BLOCK = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)
MOST_LINES = 18


class Recipe(NamedTuple):
    """A heading of a page of recipes, with the text below it.

    Attributes:
        page: The page's name, without its suffix.
        title: The heading.
        text: Everything up to the next heading.
        line: Number of lines of the page above the text.
    """

    page: str
    title: str
    text: str
    line: int


def recipes() -> list[Recipe]:
    """Return all recipes, page by page."""
    found = []
    for path in sorted((DOCS / "recipes").glob("*.md")):
        page = path.read_text(encoding="utf-8")
        for match in re.finditer(r"^## (.+)\n((?:(?!^## ).*\n?)*)", page, re.MULTILINE):
            found.append(Recipe(path.stem, match[1], match[2], page.count("\n", 0, match.start(2))))
    return found


def promised(block: str, statement: ast.stmt) -> str | None:
    """Return the comment behind a `print`, which tells what it prints; None for other statements."""
    if not (isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Call)):
        return None
    if getattr(statement.value.func, "id", "") != "print" or statement.end_col_offset is None:
        return None
    rest = block.splitlines()[(statement.end_lineno or 0) - 1].encode()[statement.end_col_offset :].decode()
    return rest.partition("#")[2].strip() or None


def run(block: str) -> list[tuple[str, str]]:
    """Run a block by itself; return what its `print` statements promise, and what they print."""
    namespace: dict[str, object] = {"__name__": "recipe"}
    compared, examined, faults = [], {}, {}
    for statement in ast.parse(block).body:
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(compile(ast.Module([statement], []), "recipe", "exec"), namespace)
        if (words := promised(block, statement)) is not None:
            compared.append((words, printed.getvalue().strip()))
        examine(namespace, examined, faults)
    assert not any(faults.values()), faults
    return compared


def marks(recipe: Recipe) -> list[pytest.MarkDecorator]:
    """Return `browser` for a recipe that draws pictures or films, `thorough` for one that fits masses."""
    draws = re.search(r"\.save_(image|video)\(", recipe.text) is not None
    return [pytest.mark.browser] * draws + [pytest.mark.thorough] * ("estimate_inertia" in recipe.text)


ALL = recipes()


def test_there_are_forty_and_the_index_lists_them_in_order():
    index = (DOCS / "recipes.md").read_text(encoding="utf-8")
    listed = re.findall(r"^- \[([^\]]+)\]\(recipes/(\w+)\.md#", index, re.MULTILINE)
    pages = list(dict.fromkeys(page for _, page in listed))
    assert len(ALL) >= 40
    assert listed == [(r.title, page) for page in pages for r in ALL if r.page == page]
    assert len(listed) == len(ALL)


@pytest.mark.parametrize("recipe", ALL, ids=lambda recipe: f"{recipe.page}: {recipe.title}")
def test_a_recipe_begins_with_one_sentence_of_at_most_25_words(recipe: Recipe) -> None:
    first = recipe.text.strip().partition("\n\n")[0]
    words = re.sub(r"`[^`]*`", "code", first)
    assert re.fullmatch(r"[A-Z][^.?!:|\[<#\n]*(?:: [^.?!:|\[<#\n]+)?\.", words), first
    assert 8 <= len(words.split()) <= 25


@pytest.mark.thorough
@pytest.mark.parametrize(
    "recipe",
    [pytest.param(recipe, marks=marks(recipe), id=f"{recipe.page}: {recipe.title}") for recipe in ALL],
)
def test_a_recipe_runs_by_itself_and_prints_what_it_says(
    recipe: Recipe, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    hide_extras(recipe.text, monkeypatch)
    (block,) = BLOCK.findall(recipe.text)
    assert len(block.splitlines()) <= MOST_LINES
    for words, printed in run(block):
        assert printed == words


def test_a_wrong_comment_is_noticed():
    assert run("print(1 + 1)  # 3\nx = 4  # not a result\nprint(x)\n") == [("3", "2")]
