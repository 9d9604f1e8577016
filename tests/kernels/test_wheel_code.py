"""The machine code that a wheel brings: whole parts come back; what does not fit is refused."""

import hashlib
import json
import logging
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from pepper_kin.kernels import progress, wheel_code
from pepper_kin.kernels.progress import making
from pepper_kin.kernels.target import WHEELS, make_target

KEY, OTHER = "a" * 64, "b" * 64
THIRD = "d" * 64
PARTS = {
    KEY: ("pepper_kin.core.one", b"first part " * 50),
    OTHER: ("a kernel", b"second part " * 50),
    THIRD: ("pepper_kin.core.three", b"third part " * 50),
}
X86 = WHEELS["manylinux_2_28_x86_64"]()


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A file of our own in place of the wheel's."""
    path = tmp_path / "code"
    wheel_code.write_wheel_code(PARTS, X86, path)
    monkeypatch.setattr(wheel_code, "wheel_code_path", lambda: path)
    monkeypatch.setattr(wheel_code, "host_target", lambda: X86)
    forget()
    yield path
    forget()


def forget():
    wheel_code._index.cache_clear()
    progress._reasons.clear()


def ask(caplog, name="pepper_kin.core.one", key=KEY):
    with caplog.at_level(logging.WARNING, "pepper_kin.kernels"):
        part = wheel_code.wheel_part(name, key)
        if part is None:
            with making(name):  # reasons are logged where something is made
                pass
        return part


def test_parts_come_back_as_they_were(place, caplog):
    assert ask(caplog) == (PARTS[KEY][1], X86)
    assert ask(caplog, "a kernel", OTHER)[0] == PARTS[OTHER][1]
    assert ask(caplog, "pepper_kin.core.three", THIRD)[0] == PARTS[THIRD][1]
    assert ask(caplog, "a kernel", "c" * 64) is None
    assert not caplog.records
    assert wheel_code.wheel_processor() == "x86-64-v3"


@pytest.mark.parametrize("order", [(KEY, OTHER, THIRD), (THIRD, KEY, OTHER), (OTHER, THIRD, KEY, THIRD, KEY)])
def test_parts_can_be_read_in_any_order(place, caplog, order):
    for key in order:
        name, content = PARTS[key]
        assert ask(caplog, name, key)[0] == content


def test_threads_that_read_parts_at_once_get_whole_ones(place):
    contents = {
        f"{k:064x}": ("pepper_kin.core.one", np.random.default_rng(k).bytes(3000 + k)) for k in range(64)
    }
    wheel_code.write_wheel_code(contents, X86, place)
    forget()
    keys = [*contents, *reversed(contents)] * 3
    with ThreadPoolExecutor(8) as pool:
        read = list(pool.map(lambda key: wheel_code.wheel_part("pepper_kin.core.one", key)[0], keys))
    assert read == [contents[key][1] for key in keys]


def test_a_flipped_bit_is_found(place, caplog):
    """Each of a hundred, anywhere in the file: no part comes back other than it was."""
    whole, random = place.read_bytes(), np.random.default_rng(0)
    for where in random.integers(0, len(whole), 100):
        data = bytearray(whole)
        data[where] ^= 1 << random.integers(8)
        place.write_bytes(bytes(data))
        forget()
        caplog.clear()
        found = [ask(caplog, PARTS[key][0], key) for key in PARTS]
        assert found.count(None) >= 1
        assert all(part is None or part[0] == PARTS[key][1] for key, part in zip(PARTS, found, strict=True))
        assert "damaged" in caplog.text


def test_another_format_is_refused(place, caplog, monkeypatch):
    monkeypatch.setattr(wheel_code, "FORMAT", wheel_code.FORMAT + 1)
    assert ask(caplog) is None
    assert f"has format {wheel_code.FORMAT - 1}, not {wheel_code.FORMAT}" in caplog.text


def test_a_clone_has_no_file_and_says_nothing(place, caplog):
    place.unlink()
    assert ask(caplog) is None
    assert not caplog.records
    assert wheel_code.wheel_processor() is None


@pytest.mark.parametrize(
    ("target", "reason"),
    [
        (
            make_target("x86_64-unknown-linux-gnu", "x86-64-v2", "+sse4.2,+popcnt,+cx16,+sahf"),
            "needs a processor that has avx, avx2",
        ),
        (make_target("aarch64-unknown-linux-gnu", "generic", "+fp-armv8,+neon"), "is for x86_64-"),
        (make_target("x86_64-apple-darwin23.0.0", "generic", "+avx2"), "this processor is x86_64-apple"),
    ],
)
def test_another_processor_gets_none(place, caplog, monkeypatch, target, reason):
    monkeypatch.setattr(wheel_code, "host_target", lambda: target)
    assert ask(caplog) is None
    assert reason in caplog.text


@pytest.mark.parametrize("triple", ["arm64-apple-darwin20.0.0", "arm64-apple-darwin25.3.0"])
def test_the_version_of_the_system_does_not_count(place, caplog, monkeypatch, triple):
    wheel_code.write_wheel_code(PARTS, WHEELS["macosx_11_0_arm64"](), place)
    host = make_target(triple, "apple-m4", "+fp-armv8,+neon,+sme")
    monkeypatch.setattr(wheel_code, "host_target", lambda: host)
    forget()
    assert ask(caplog)[0] == PARTS[KEY][1]


def test_the_head_has_a_checksum_of_each_part(place):
    """The format as its docstring tells it: a digest, a line of JSON, and parts one after the other."""
    data = place.read_bytes()
    line = data[32:].partition(b"\n")[0] + b"\n"
    assert hashlib.sha256(line).digest() == data[:32]
    offset = 32 + len(line)
    for _, size, checksum in json.loads(line)["entries"].values():
        assert hashlib.sha256(data[offset : offset + size]).hexdigest().startswith(checksum)
        offset += size
    assert offset == len(data)
