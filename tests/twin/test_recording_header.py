"""The header of a recording: each entry is checked, and any change is seen."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import FileFormatError
from pepper_kin.twin import Recorder, load_recording
from pepper_kin.twin.recording_header import HEADER, write_header

PEPPER = pk.load_pepper()


@pytest.fixture(scope="module")
def header(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    folder = tmp_path_factory.mktemp("recording")
    Recorder(pk.Twin(PEPPER), folder, seed=3)
    assert load_recording(folder).joint_names == PEPPER.joint_names
    return dict(json.loads((folder / HEADER).read_text()))


WRONG: list[tuple[str, Any, str]] = [
    ("timestep", 1e308, "timestep is 1e\\+308, expected a number in"),
    ("timestep", -1.0, "timestep is -1.0, expected a number in \\(0, 0.05\\]"),
    ("timestep", float("nan"), "holds NaN, expected finite numbers"),
    ("timestep", True, "timestep is True"),
    ("substeps", 0, "substeps is 0, expected a whole number from 1"),
    ("substeps", True, "substeps is True"),
    ("chunk_steps", 2.5, r"chunk_steps is 2\.5"),
    ("feedforward", 1, "feedforward is 1, expected one of "),
    ("units", ["deg"] * PEPPER.n, "units is"),
    ("units", ["rad"], "expected a unit for each of"),
    ("joints", ["HeadYaw", "HeadYaw"], "joints is"),
    ("joints", [], "joints is"),
    ("seed", 10**100, "checksum"),
    ("start", {"position": ["zero"]}, "start: position is not"),
    ("start", {name: ["inf"] * PEPPER.n for name in ("position", "velocity", "torque")}, "finite"),
    ("format", "another", "format is 'another'"),
    ("robot", 5, "robot is 5"),
]


def test_a_wrong_entry_is_named(tmp_path: Path, header: dict[str, Any]) -> None:
    for name, value, message in WRONG:
        (tmp_path / HEADER).write_text(json.dumps({**header, name: value}))
        with pytest.raises(FileFormatError, match=message) as caught:
            load_recording(tmp_path)
        assert caught.value.path.endswith(HEADER)
        assert len(str(caught.value)) < 300


def test_a_right_entry_that_was_changed_is_seen(tmp_path: Path, header: dict[str, Any]) -> None:
    (tmp_path / HEADER).write_text(json.dumps({**header, "timestep": 0.5 * header["timestep"]}))
    with pytest.raises(FileFormatError, match="changed after it was written"):
        load_recording(tmp_path)


def test_what_is_no_header_names_the_file(tmp_path: Path) -> None:
    for content in [b"[" * 100_000, b"9" * 5000, b"null", b"\xed\xa0\x80"]:
        (tmp_path / HEADER).write_bytes(content)
        with pytest.raises(FileFormatError, match=HEADER):
            load_recording(tmp_path)


def test_a_header_is_what_was_written(tmp_path: Path, header: dict[str, Any]) -> None:
    said = {name: value for name, value in header.items() if name not in ("format", "checksum")}
    write_header(tmp_path, said)
    found = load_recording(tmp_path).header
    assert {name: found[name] for name in said} == said
    np.testing.assert_array_equal(found["joints"], PEPPER.joint_names)
