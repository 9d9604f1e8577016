"""Archives within a limit of memory."""

import zipfile
import zlib
from pathlib import Path

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import FileFormatError
from pepper_kin.file_access import numpy_archive
from pepper_kin.file_access.numpy_archive import decompressed, read_arrays


def test_arrays_come_back(tmp_path: Path) -> None:
    np.savez_compressed(tmp_path / "a.npz", x=np.arange(5), y=np.ones((2, 3)))
    arrays = read_arrays(tmp_path / "a.npz", ("y", "x"))
    np.testing.assert_array_equal(arrays["x"], np.arange(5))
    np.testing.assert_array_equal(arrays["y"], np.ones((2, 3)))


def test_a_bomb_is_refused_before_it_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "bomb.npz"
    np.savez_compressed(path, x=np.zeros(1_000_000))
    assert path.stat().st_size < 20_000
    monkeypatch.setattr(numpy_archive, "MOST_BYTES", 7_999_999)
    opened: list[str] = []
    monkeypatch.setattr(zipfile.ZipFile, "open", lambda *a, **k: opened.append("read"))
    with pytest.raises(FileFormatError, match=r"bomb\.npz: holds 80001\d\d bytes of arrays, at most 7999999"):
        read_arrays(path)
    assert not opened


def test_other_arrays_and_a_single_one_are_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", x=np.arange(5))
    with pytest.raises(FileFormatError, match="holds x, expected y, z"):
        read_arrays(tmp_path / "a.npz", ("z", "y"))
    np.save(tmp_path / "a.npy", np.arange(5))
    with pytest.raises(FileFormatError, match="is one array"):
        read_arrays(tmp_path / "a.npy")


def test_a_member_that_is_no_array_is_refused(tmp_path: Path) -> None:
    """NumPy returns its bytes."""
    path = tmp_path / "a.npz"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("x.npy", b"something else")
    with pytest.raises(FileFormatError, match=r"a\.npz: is damaged: 'x' is no array"):
        read_arrays(path)


@pytest.mark.parametrize("cut", range(0, 220, 20))
def test_what_is_cut_short_names_the_file(tmp_path: Path, cut: int) -> None:
    np.savez_compressed(tmp_path / "whole.npz", x=np.arange(5))
    path = tmp_path / "cut.npz"
    path.write_bytes((tmp_path / "whole.npz").read_bytes()[:cut])
    with pytest.raises(FileFormatError, match=r"cut\.npz"):
        read_arrays(path)
    with pytest.raises(FileFormatError, match=r"cut\.npz"):
        pk.files.load(path)


def test_bytes_are_decompressed_within_a_limit() -> None:
    content = bytes(100_000)
    packed = zlib.compress(content)
    assert decompressed(packed, 100_000) == content
    with pytest.raises(ValueError, match="more than 99999 bytes"):
        decompressed(packed, 99_999)
    with pytest.raises(ValueError, match="cut short"):
        decompressed(packed[:-5])
    with pytest.raises(ValueError, match="incorrect header"):
        decompressed(b"no zlib")
