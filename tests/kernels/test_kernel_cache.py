"""Kernels kept on disk: found again, never trusted when damaged, safe with several writers."""

import errno
import io
import logging
import os
import stat
import subprocess
import sys
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from pepper_kin.kernels import cache_folder, clear_cache, compile_function, private_folder, progress

POINTS = np.linspace(-2, 2, 30).reshape(10, 3)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("PEPPER_KIN_CACHE", str(tmp_path / "kept" / "kernels"))
    return tmp_path / "kept" / "kernels"


def make_function(factor=2.0):
    x = ca.SX.sym("x", 3)
    return ca.Function("f", [x], [factor * ca.sin(x) + x[0]], ["x"], ["y"])


def wanted(factor=2.0):
    return factor * np.sin(POINTS) + POINTS[:, :1]


def files(folder):
    return sorted(folder.glob("*"))


def test_second_time_is_read_from_the_cache(folder):
    first, second = compile_function(make_function()), compile_function(make_function())
    assert (first.from_cache, second.from_cache) == (False, True)
    assert first.signature == second.signature
    assert (first.work_size, first.lanes, first.flop_count) == (
        second.work_size,
        second.lanes,
        second.flop_count,
    )
    np.testing.assert_array_equal(first(POINTS), second(POINTS))
    np.testing.assert_allclose(second(POINTS), wanted(), rtol=1e-14, atol=1e-14)
    assert cache_folder() == folder
    assert len(files(folder)) == 1


def test_each_expression_and_format_has_its_own_file(folder):
    for factor in (2.0, 2.0000000000000004):
        for dtype in ("float64", "float32"):
            assert not compile_function(make_function(factor), dtype=dtype).from_cache
    assert len(files(folder)) == 4


def test_named_kernel_needs_no_expression_the_second_time(folder):
    calls = []

    def build():
        calls.append(1)
        return make_function()

    first = compile_function(build, key="f, factor 2")
    second = compile_function(build, key="f, factor 2")
    assert len(calls) == 1
    assert second.from_cache
    np.testing.assert_array_equal(first(POINTS), second(POINTS))
    assert not compile_function(build, key="something else").from_cache


@pytest.mark.parametrize(
    "damage",
    [
        lambda data: b"",
        lambda data: data[:20],
        lambda data: data[: len(data) // 2],
        lambda data: data[:-1],
        lambda data: data + b"x",
        lambda data: data[:-700] + bytes([data[-700] ^ 1]) + data[-699:],
        lambda data: b"\x00" * len(data),
        lambda data: bytes([data[0] ^ 255]) + data[1:],
    ],
    ids=["empty", "no body", "half", "one short", "one more", "flipped bit", "zeros", "checksum"],
)
def test_damaged_file_is_compiled_anew_and_replaced(folder, damage):
    compile_function(make_function())
    (path,) = files(folder)
    whole = path.read_bytes()
    path.write_bytes(damage(whole))
    kernel = compile_function(make_function())
    assert not kernel.from_cache
    np.testing.assert_allclose(kernel(POINTS), wanted(), rtol=1e-14, atol=1e-14)
    assert compile_function(make_function()).from_cache


def test_file_of_another_kernel_under_this_name_is_not_used(folder):
    compile_function(make_function(2.0))
    (two,) = files(folder)
    compile_function(make_function(3.0))
    (three,) = (path for path in files(folder) if path != two)
    two.write_bytes(three.read_bytes())
    kernel = compile_function(make_function(2.0))
    assert not kernel.from_cache
    np.testing.assert_allclose(kernel(POINTS), wanted(2.0), rtol=1e-14, atol=1e-14)


def test_folder_that_cannot_be_made_means_no_cache(tmp_path, monkeypatch, caplog):
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    monkeypatch.setenv("PEPPER_KIN_CACHE", str(blocked / "kernels"))
    with caplog.at_level(logging.INFO, "pepper_kin.kernels"):
        for _ in range(2):
            kernel = compile_function(make_function())
            assert not kernel.from_cache
            np.testing.assert_allclose(kernel(POINTS), wanted(), rtol=1e-14, atol=1e-14)
    assert "machine code not kept in" in caplog.text
    assert blocked.read_text() == "not a folder"


def test_a_full_disk_leaves_code_in_memory(folder, monkeypatch, caplog):
    def full(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch, caplog.at_level(logging.INFO, "pepper_kin.kernels"):
        patch.setattr("pepper_kin.kernels.store.os.replace", full)
        kernel = compile_function(make_function())
    np.testing.assert_allclose(kernel(POINTS), wanted(), rtol=1e-14, atol=1e-14)
    assert "No space left on device" in caplog.text
    assert files(folder) == []
    assert not compile_function(make_function()).from_cache


def test_cache_can_be_left_alone(folder):
    assert not compile_function(make_function(), cache=False).from_cache
    assert not folder.exists()


WRITER = """
import sys, numpy as np, casadi as ca
from pepper_kin.kernels import compile_function
x = ca.SX.sym("x", 3)
function = ca.Function("f", [x], [2.0 * ca.sin(x) + x[0]], ["x"], ["y"])
points = np.linspace(-2, 2, 30).reshape(10, 3)
print("ready", flush=True)
sys.stdin.readline()
kernel = compile_function(function)
sys.stdout.buffer.write(bytes([kernel.from_cache]) + kernel(points).tobytes())
"""


@pytest.mark.thorough
def test_of_processes_that_need_a_kernel_at_once_one_compiles_it(folder):
    """The others read what it wrote, and all get the same numbers."""
    pipe = subprocess.PIPE
    command = [sys.executable, "-c", WRITER]
    writers = [subprocess.Popen(command, stdin=pipe, stdout=pipe, bufsize=0) for _ in range(3)]
    for writer in writers:
        assert writer.stdout.readline() == b"ready\n"
    for writer in writers:
        writer.stdin.write(b"go\n")
    found = []
    for writer in writers:
        output, _ = writer.communicate(timeout=120)
        assert writer.returncode == 0
        np.testing.assert_allclose(np.frombuffer(output[1:]).reshape(10, 3), wanted(), rtol=1e-14, atol=1e-14)
        found.append(output[0])
    assert sorted(found) == [0, 1, 1] or os.name != "posix"
    assert sum(b"\x7fELF" in path.read_bytes() for path in files(folder)) == 1
    assert compile_function(make_function()).from_cache


@pytest.mark.skipif(os.name != "posix", reason="permission bits")
def test_only_the_owner_can_look_into_the_folder(folder):
    compile_function(make_function())
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700


def test_a_lock_is_gone_after_failure_and_no_lock_is_no_failure(folder, monkeypatch):
    def broken():
        assert [path.suffix for path in files(folder)] == [".lock"]
        raise RuntimeError("cannot build")

    for _ in range(2):
        with pytest.raises(RuntimeError, match="cannot build"):
            compile_function(broken, key="broken")
        assert files(folder) == []
    monkeypatch.setattr("pepper_kin.kernels.store.fcntl", None)
    assert not compile_function(make_function()).from_cache
    assert len(files(folder)) == 1


def test_clearing_removes_kernels_and_interrupted_writes_only(folder):
    compile_function(make_function())
    (folder / "abc.tmp").write_bytes(b"left behind")
    (folder / "abc.lock").touch()
    (folder / "notes.txt").write_text("mine")
    assert clear_cache() == 3
    assert [path.name for path in files(folder)] == ["notes.txt"]
    assert not compile_function(make_function()).from_cache


def test_default_folder_follows_the_platform(monkeypatch, tmp_path):
    monkeypatch.delenv("PEPPER_KIN_CACHE")
    if sys.platform.startswith("linux"):
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
        assert cache_folder() == tmp_path / "cache" / "pepper_kin"
        monkeypatch.delenv("XDG_CACHE_HOME")
        monkeypatch.setenv("HOME", str(tmp_path))
        assert cache_folder() == tmp_path / ".cache" / "pepper_kin"


def test_code_is_kept_elsewhere_where_the_home_cannot_be_written(monkeypatch, tmp_path):
    monkeypatch.delenv("PEPPER_KIN_CACHE")
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv("HOME", "/dev/null")
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    assert cache_folder() == tmp_path / "pepper_kin"


as_root = pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root can give a folder to another user"
)


@pytest.mark.parametrize("mode", [0o770, 0o707, 0o777])
def test_a_folder_that_others_can_write_is_not_used(folder, caplog, mode, monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    compile_function(make_function())
    folder.chmod(mode)
    private_folder._other.cache_clear()
    with caplog.at_level(logging.WARNING, "pepper_kin.kernels"):
        assert not compile_function(make_function()).from_cache
        assert compile_function(make_function()).from_cache
    assert cache_folder() == tmp_path / "pepper_kin"
    assert stat.S_IMODE(cache_folder().stat().st_mode) == 0o700
    assert (
        len([record for record in caplog.records if "can be written by others" in record.getMessage()]) == 1
    )


@as_root
def test_a_folder_or_a_part_of_another_user_is_not_used(folder, caplog, monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    compile_function(make_function())
    (part,) = files(folder)
    os.chown(part, 65_534, 65_534)
    with caplog.at_level(logging.WARNING, "pepper_kin.kernels"):
        assert not compile_function(make_function()).from_cache
    assert "is not read: it belongs to another user" in caplog.text
    os.chown(folder, 65_534, 65_534)
    private_folder._other.cache_clear()
    assert cache_folder() == tmp_path / "pepper_kin"


def test_a_part_that_is_a_link_is_not_read(folder, tmp_path):
    compile_function(make_function())
    (part,) = files(folder)
    part.rename(tmp_path / "elsewhere")
    part.symlink_to(tmp_path / "elsewhere")
    assert not compile_function(make_function()).from_cache
    assert not part.is_symlink()


def without_home(monkeypatch, tmp_path):
    """A user without a home whose temporary folder is everybody's."""
    shared = tmp_path / "tmp"
    shared.mkdir()
    shared.chmod(0o1777)
    monkeypatch.delenv("PEPPER_KIN_CACHE")
    monkeypatch.delenv("XDG_RUNTIME_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", "~nobody-of-this-name/cache")
    monkeypatch.setattr("tempfile.tempdir", str(shared))
    private_folder._other.cache_clear()
    return shared


def test_without_a_home_the_folder_is_private_and_stays_the_same(folder, monkeypatch, tmp_path):
    shared = without_home(monkeypatch, tmp_path)
    assert not compile_function(make_function()).from_cache
    assert cache_folder().parent == shared
    assert stat.S_IMODE(cache_folder().stat().st_mode) == 0o700
    assert compile_function(make_function()).from_cache
    session = tmp_path / "session"
    session.mkdir(mode=0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(session))
    assert cache_folder() == session / "pepper_kin"


@as_root
@pytest.mark.parametrize("planted", ["folder", "link"])
def test_a_folder_that_another_user_made_first_is_not_used(folder, monkeypatch, tmp_path, caplog, planted):
    shared = without_home(monkeypatch, tmp_path)
    place = shared / f"pepper_kin-{os.geteuid()}"
    if planted == "folder":
        place.mkdir(mode=0o777)
    else:
        place.symlink_to(tmp_path)
    os.chown(place, 65_534, 65_534, follow_symlinks=False)
    with caplog.at_level(logging.WARNING, "pepper_kin.kernels"):
        used = cache_folder()
        assert cache_folder() == used != place
    assert stat.S_IMODE(used.stat().st_mode) == 0o700
    assert used.stat().st_uid == os.geteuid()
    assert len(caplog.records) == 1


def test_a_reason_is_logged_where_something_is_made_and_not_again(folder, caplog):
    progress.note_reason("a reason of this test")
    with caplog.at_level(logging.WARNING, "pepper_kin.kernels"):
        compile_function(make_function())
        assert caplog.text.count("a reason of this test; it is made here, once, and kept") == 1
        progress._reasons.clear()  # as in another process
        progress.note_reason("a reason of this test")
        assert compile_function(make_function()).from_cache
    assert caplog.text.count("a reason of this test") == 1
    progress._reasons.clear()


def test_without_a_terminal_progress_is_logged_at_intervals(monkeypatch, caplog):
    clock = iter([0.0, 5.0, 19.9, 20.0, 30.0, 41.0])
    monkeypatch.setattr(progress, "time", SimpleNamespace(monotonic=lambda: next(clock)))
    monkeypatch.setattr(progress, "sys", SimpleNamespace(stderr=io.StringIO()))
    monkeypatch.setattr(progress, "_reported", False)
    with caplog.at_level("WARNING", "pepper_kin.kernels.progress"):
        for number in range(6):
            progress.announce(f"part {number} of \ud800")
    assert [record.message for record in caplog.records[1:]] == [r"part 3 of \ud800", r"part 5 of \ud800"]
    assert caplog.records[0].message.startswith("compiling machine code")
