import sys

import pytest

from pepper_kin.exceptions import UnknownNameError
from pepper_kin.kernels import sources
from pepper_kin.kernels.sources import source_digest


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A package of two files, and what says its digest anew."""
    folder = tmp_path / "a_room"
    folder.mkdir()
    (folder / "__init__.py").write_text("")
    (folder / "part.py").write_text("x = 1\n")
    monkeypatch.syspath_prepend(str(tmp_path))

    def digest(*modules):
        sources.file_digest.cache_clear()
        source_digest.cache_clear()
        return source_digest(*modules)

    yield folder, digest
    sources.file_digest.cache_clear()
    source_digest.cache_clear()
    for name in [name for name in sys.modules if name.startswith("a_room")]:
        del sys.modules[name]


def test_digest_changes_with_any_file_and_with_nothing_else(package):
    folder, digest = package
    first = digest("a_room")
    (folder / "notes.txt").write_text("no source")
    (folder / "part.py").write_bytes(b"x = 1\r\n")
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
