import sys

import pytest

from pepper_kin.exceptions import UnknownNameError
from pepper_kin.kernels import sources
from pepper_kin.kernels.sources import source_digest
from pepper_kin.kernels.syntax_digests import digest, digests_of


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A package of two files, and what says its digest anew."""
    folder = tmp_path / "a_room"
    folder.mkdir()
    (folder / "__init__.py").write_text("")
    (folder / "part.py").write_text("x = 1\n")
    monkeypatch.syspath_prepend(str(tmp_path))

    def digest_of(*modules):
        sources.digests.cache_clear()
        source_digest.cache_clear()
        return source_digest(*modules)

    yield folder, digest_of
    sources.digests.cache_clear()
    source_digest.cache_clear()
    for name in [name for name in sys.modules if name.startswith("a_room")]:
        del sys.modules[name]


def test_digest_changes_with_any_file_and_with_nothing_else(package):
    folder, digest = package
    first = digest("a_room")
    (folder / "notes.txt").write_text("no source")
    (folder / "part.py").write_bytes(b'"""What it is."""\r\nx = 1  # and why\r\n')
    assert digest("a_room") == first
    (folder / "part.py").write_text("x = 2\n")
    assert digest("a_room") != first
    (folder / "part.py").write_text("x = 1\n")
    assert digest("a_room") == first
    (folder / "part.py").rename(folder / "other.py")
    assert digest("a_room") != first


def test_one_module_alone(package):
    folder, digest = package
    first = digest("a_room.part")
    (folder / "__init__.py").write_text("y = 3")
    assert digest("a_room.part") == first
    assert digest("a_room.part", "a_room") != first


def test_files_are_read_once(package):
    folder, digest = package
    first = digest("a_room")
    (folder / "part.py").write_text("x = 2\n")
    assert source_digest("a_room") == first


def test_a_module_that_is_not_there(package):
    with pytest.raises(UnknownNameError, match=r"a_room\.nothing"):
        source_digest("a_room.nothing")
    with pytest.raises(UnknownNameError, match="no_such"):
        source_digest("no_such.part")


SOURCE = b"""
LIMIT = 2

def outer(x):
    def inner(y):
        return y + LIMIT
    return inner(x)

class Box:
    size: int = 3

    def half(self):
        return self.size / 2
"""


def test_a_function_counts_by_itself():
    first = digests_of(SOURCE)
    assert set(first.functions) == {"outer", "outer.<locals>.inner", "Box.half"}
    other = digests_of(SOURCE.replace(b"self.size / 2", b"self.size / 4"))
    assert other.whole != first.whole
    assert {name for name in first.functions if other.functions[name] != first.functions[name]} == {
        "Box.half"
    }


def test_words_and_layout_do_not_count():
    for edit in [
        lambda s: s.replace(b"def outer(x):\n", b'def outer(x):\n    """Add the limit."""\n    # once\n'),
        lambda s: s.replace(b"size: int = 3\n", b'size: int = 3\n    """In meters."""\n'),
        lambda s: s.replace(b"return inner(x)", b"return inner(\n        x\n    )"),
        lambda s: b'"""A module."""\n\n\n' + s,
    ]:
        assert digests_of(edit(SOURCE)) == digests_of(SOURCE)


@pytest.mark.thorough
def test_digests_are_kept_for_later_processes(child, tmp_path):
    """The second process parses nothing, and has the digests of the first."""
    (tmp_path / "own.py").write_bytes(SOURCE)
    program = (
        "import ast\nfrom pepper_kin.kernels import sources\nparsed = []\ntrue_parse = ast.parse\n"
        "ast.parse = lambda source: parsed.append(source) or true_parse(source)\n"
        f"print(sources.digests({str(tmp_path / 'own.py')!r}), len(parsed))"
    )
    first, second = (child(program, PEPPER_KIN_CACHE=tmp_path / "cache").stdout for _ in range(2))
    assert first.endswith(" 1\n")
    assert second == first[:-2] + "0\n"
    assert digests_of(SOURCE).whole in first


def test_empty_fields_do_not_count():
    """Versions of Python add fields that are empty in older programs, such as the parameters of types."""
    import ast

    tree = ast.parse(SOURCE)
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            node.type_params = []
            node._fields = (*type(node)._fields, "type_params")
    assert digest(tree) == digests_of(SOURCE).whole
