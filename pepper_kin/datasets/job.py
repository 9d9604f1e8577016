"""Jobs: specification of a dataset, as a value and as a YAML file."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from pepper_kin import __version__
from pepper_kin.collision import Scene
from pepper_kin.collision.scene_file import FORMAT as SCENE_FORMAT
from pepper_kin.collision.scene_file import VERSION as SCENE_VERSION
from pepper_kin.collision.scene_file import scene_as_dict, scene_from_dict
from pepper_kin.exceptions import FileFormatError, InvalidValueError, UnknownNameError
from pepper_kin.file_access.atomic_file import PathName, as_path, write_text
from pepper_kin.file_access.reading import read_bytes, read_json, read_text
from pepper_kin.model.joint_vectors import check_choice, check_positive, check_whole

FORMAT = "pepper_kin data set job"
VERSION, MADE_BY = 1, "pepper_kin"
KINDS = ("ik", "reach_maps", "plans", "trajectories", "runs", "demonstrations", "replays")
"""Kinds of rows of a dataset, the `kind` of a `DatasetJob`."""
FORMATS = ("parquet", "lerobot", "mcap")
"""Formats in which a dataset is written."""
MOST_ROWS = 10**12
MOST_IN_SHARD = 100_000

_POINTS = {"hand", "by", "lower", "upper", "look"}
_MOTION: dict[str, set[str]] = {
    "targets": _POINTS | {"start"},
    "randomization": {"objects"},
    "planner": {"planner", "margin", "least_margin", "timeout", "joints", "balance", "payload"},
    "timing": {
        "velocity_scale", "acceleration_scale", "torque_scale", "balance", "hand_speed", "payload", "jerk",
        "duration",
    },
}  # fmt: skip
_USED: dict[str, dict[str, set[str]]] = {
    "ik": {
        "targets": _POINTS,
        "randomization": {"objects"},
        "planner": {"solver", "restarts", "max_iterations", "margin", "joints", "collisions", "closest"},
    },
    "reach_maps": {"targets": {"frame", "joints", "samples", "resolution"}},
    "plans": {name: _MOTION[name] for name in ("targets", "randomization", "planner")},
    "trajectories": _MOTION,
    "runs": {
        **_MOTION,
        "randomization": {"objects", "twin"},
        "twin": {"timestep", "feedforward", "substeps", "payload", "hold_time"},
    },
    "demonstrations": {"targets": {"task", "goal_seed", "speed"}, "randomization": {"twin"}},
    "replays": {"targets": {"logs"}},
}
"""Kind -> section -> allowed options."""
_WITH_SCENES = ("ik", "plans", "trajectories", "runs")
_ROBOT = {"base", "hands", "head_limits", "urdf", "srdf"}
_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_DEEPEST = 20
_NOT_ROWS = ("name", "rows_per_shard", "format", "license")
"""Fields that do not change a row."""


@dataclass(frozen=True)
class DatasetJob:
    """Specification of a dataset.  A row depends only on the job and on the row's index.

    Attributes:
        kind: One of `KINDS`.
        rows: Number of rows: solutions, maps, plans, motions, runs, episodes or logs.
        name: Title of the dataset.
        seed: Seed of all random choices, from 0 to 2^63 - 1.
        rows_per_shard: Number of rows of a file; a process holds one file's rows at a time.
        robot: Options of `load_pepper`, or `urdf` and `srdf`, files of another robot.
        scenes: Worlds, of which each row gets one: `Scene`s, files of scenes, or the content of such a file.
        targets: Goals of the hand, `by` "box" (uniform from `lower` to `upper` [m]) or `by` "postures" (hand
            positions of random joint positions), whether to `look` at them, and the `start` posture, or
            "random"; for maps `frame`, `joints`, `samples`, `resolution`; a learning `task`; `logs`.
        randomization: `objects`, name -> (3,) maximum shift along each axis [m]; `twin`, the ranges of
            `learning.Randomization`, or "measured".
        planner: Options of `plan`, or of `ik.solve_batch`.
        timing: Options of `retime`.
        twin: Options of `Twin`, and `hold_time` [s].
        sensors: Names of sensors, including cameras, that a run reads.
        fps: Frame rate of motions [1/s].
        format: "parquet", or "lerobot" or "mcap", which is made from the Parquet files at the end.
        license: License of the data, for the card.

    Raises:
        InvalidValueError: naming the field and the allowed values.
        UnknownNameError: for an option that the kind does not have.
        FileFormatError: for a missing file, or one that is not a scene.
    """

    kind: str
    rows: int
    name: str = "Pepper data set"
    seed: int = 0
    rows_per_shard: int = 1000
    robot: Mapping[str, Any] = field(default_factory=dict)
    scenes: tuple[Mapping[str, Any], ...] = ()
    targets: Mapping[str, Any] = field(default_factory=dict)
    randomization: Mapping[str, Any] = field(default_factory=dict)
    planner: Mapping[str, Any] = field(default_factory=dict)
    timing: Mapping[str, Any] = field(default_factory=dict)
    twin: Mapping[str, Any] = field(default_factory=dict)
    sensors: tuple[str, ...] = ()
    fps: float = 50.0
    format: str = "parquet"
    license: str = "CC-BY-4.0"

    def __post_init__(self) -> None:
        """Check the fields, and store the content of scenes and the hashes of other files in them."""
        if self.kind not in KINDS:
            raise UnknownNameError("kind of dataset", self.kind, KINDS)
        check_whole("rows", self.rows, 1, MOST_ROWS)
        check_whole("rows_per_shard", self.rows_per_shard, 1, MOST_IN_SHARD)
        check_whole("seed", self.seed, 0, 2**63 - 1)
        check_choice("format", self.format, FORMATS)
        for name in ("name", "license"):
            if not isinstance(getattr(self, name), str):
                raise InvalidValueError(name, repr(getattr(self, name)), "a text")
        used = {"robot": _ROBOT, **_USED[self.kind]}
        for section in ("robot", "targets", "randomization", "planner", "timing", "twin"):
            value = getattr(self, section)
            if not isinstance(value, Mapping):
                raise InvalidValueError(section, repr(value), "options by name")
            allowed = used.get(section, set())
            for option in value:
                if option not in allowed:
                    raise UnknownNameError(f"option of {section} for {self.kind}", option, sorted(allowed))
            object.__setattr__(self, section, _plain(dict(value), section))
        for section in ("scenes", "sensors"):
            if not isinstance(getattr(self, section), list | tuple):
                raise InvalidValueError(section, repr(getattr(self, section)), "a list")
        if self.scenes and self.kind not in _WITH_SCENES:
            raise InvalidValueError("scenes", len(self.scenes), f"none for {self.kind}")
        object.__setattr__(self, "scenes", tuple(_scene(s, k) for k, s in enumerate(self.scenes)))
        if self.sensors and self.kind != "runs":
            raise InvalidValueError("sensors", self.sensors, f"none for {self.kind}")
        if not all(isinstance(name, str) for name in self.sensors):
            raise InvalidValueError("sensors", self.sensors, "names")
        object.__setattr__(self, "sensors", tuple(self.sensors))
        object.__setattr__(self, "fps", check_positive("fps", self.fps))
        if self.kind == "replays" and not self.targets.get("logs"):
            raise InvalidValueError("logs of targets", repr(self.targets.get("logs")), "a list of files")
        for section, option in (("targets", "logs"), ("robot", "urdf"), ("robot", "srdf")):
            _take_files(getattr(self, section), option)
        if self.format != "parquet" and self.kind in ("ik", "reach_maps", "plans"):
            raise InvalidValueError("format", self.format, f"parquet for {self.kind}: it has no frames")

    @property
    def shards(self) -> int:
        """Number of files."""
        return -(-self.rows // self.rows_per_shard)

    @cached_property
    def hash(self) -> str:
        """SHA-256 of all inputs of the rows, including the version of the library."""
        value = {k: v for k, v in self.as_dict().items() if k not in _NOT_ROWS}
        value["pepper_kin"] = __version__
        return hashlib.sha256(json.dumps(value, sort_keys=True, allow_nan=False).encode()).hexdigest()

    def bounds(self, shard: int) -> tuple[int, int]:
        """Return the first row of a shard and the row after its last.

        Raises:
            InvalidValueError: for a shard out of range.
        """
        check_whole("shard", shard, 0, self.shards - 1)
        begin = shard * self.rows_per_shard
        return begin, min(begin + self.rows_per_shard, self.rows)

    def as_dict(self) -> dict[str, Any]:
        """Return plain values from which `DatasetJob(**values)` makes an equal job."""
        return json.loads(json.dumps({f.name: getattr(self, f.name) for f in fields(self)}))

    def save(self, path: PathName) -> Path:
        """Write the job as a YAML file, with the scenes in it; return its path.

        Raises:
            FileFormatError: if it cannot be written.
        """
        return write_text(path, self.text())

    def text(self, **more: str) -> str:
        """Return the content of the YAML file, with `pepper_kin`, the version that made rows, if given."""
        content = {"job": FORMAT, "version": VERSION, **more, **self.as_dict()}
        return str(yaml.safe_dump(content, sort_keys=False, allow_unicode=True))


def load_job(path: PathName) -> DatasetJob:
    """Read a job from a YAML file; file names in it are relative to its folder.

    Raises:
        FileFormatError: naming the file, and the wrong line or field.
    """
    return job_of_text(read_text(path), path)


def job_of_text(text: str, source: PathName) -> DatasetJob:
    """Return the job in the text of a YAML file named `source`; see `load_job`."""
    try:
        _check_nesting(text, source)
        content = yaml.load(text, Loader=_LOADER)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        line = None if mark is None else mark.line + 1
        raise FileFormatError(source, f"is not YAML: {error.problem}", line) from error
    except (yaml.YAMLError, ValueError, RecursionError, OverflowError) as error:
        raise FileFormatError(source, f"is not YAML: {error}") from error
    if not isinstance(content, dict) or content.pop("job", None) != FORMAT:
        raise FileFormatError(source, f"is not a job: it lacks 'job: {FORMAT}'")
    if content.pop("version", None) != VERSION:
        raise FileFormatError(source, f"is of another version, expected 'version: {VERSION}'")
    content.pop(MADE_BY, None)
    known = [f.name for f in fields(DatasetJob)]
    for name in content:
        if name not in known:
            raise FileFormatError(source, str(UnknownNameError("field", name, known)))
    for name in ("kind", "rows"):
        if name not in content:
            raise FileFormatError(source, f"lacks {name!r}")
    try:
        return DatasetJob(**_beside(content, as_path(source).parent))
    except FileFormatError:
        raise
    except (InvalidValueError, UnknownNameError, TypeError, AttributeError, RecursionError) as error:
        raise FileFormatError(source, str(error)) from error


def _check_nesting(text: str, source: PathName) -> None:
    """Refuse YAML references, a few lines of which can fill the memory, and too deep nesting."""
    depth = 0
    for event in yaml.parse(text, Loader=_LOADER):
        if isinstance(event, yaml.AliasEvent):
            raise FileFormatError(source, "has an alias (*), which is not read", event.start_mark.line + 1)
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > _DEEPEST:
            raise FileFormatError(source, "is nested too deep", event.start_mark.line + 1)


def _beside(content: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return the fields with absolute file names, relative names taken from a folder."""

    def named(value: Any) -> Any:
        if isinstance(value, dict) and "path" in value:
            return {**value, "path": named(value["path"])}
        return str((folder / value).absolute()) if isinstance(value, str) else value

    if isinstance(content.get("scenes"), list):
        content["scenes"] = [named(scene) if isinstance(scene, str) else scene for scene in content["scenes"]]
    for section, option in (("targets", "logs"), ("robot", "urdf"), ("robot", "srdf")):
        part = content.get(section)
        if isinstance(part, dict) and option in part:
            value = part[option]
            part[option] = [named(each) for each in value] if isinstance(value, list) else named(value)
    return content


def _take_files(section: Mapping[str, Any], option: str) -> None:
    """Replace the names of files in a section by names with the hashes of their content."""
    if option not in section:
        return
    value = section[option]
    found = [_hashed(each) for each in (value if isinstance(value, list) else [value])]
    section[option] = found if isinstance(value, list) else found[0]  # type: ignore[index]


def _hashed(value: Any) -> dict[str, str]:
    """Return path and SHA-256 of a file; refuse a file that differs from a known hash."""
    path: Any = value.get("path") if isinstance(value, Mapping) else value
    known = value.get("sha256") if isinstance(value, Mapping) else None
    found = hashlib.sha256(read_bytes(path)).hexdigest()
    if known not in (None, found):
        raise FileFormatError(path, f"has changed: its SHA-256 is {found}, the job has {known}")
    return {"path": str(as_path(path).absolute()), "sha256": found}


def _scene(value: Any, number: int) -> Mapping[str, Any]:
    """Return a scene as checked plain values."""
    place = f"scenes[{number}]"
    if isinstance(value, Scene):
        return scene_as_dict(value)
    if isinstance(value, str | Path):
        value, place = read_json(value)[0], str(value)
    if not isinstance(value, Mapping):
        raise InvalidValueError(place, repr(value), "a scene, its file, or the content of one")
    content = _plain({"format": SCENE_FORMAT, "version": SCENE_VERSION, **value}, place)
    scene_from_dict(content, place, Scene)
    return content


def _plain(value: Any, place: str) -> Any:
    """Return a value with tuples and arrays as lists, as they would be read from a file."""
    if isinstance(value, Mapping):
        for name in value:
            if not isinstance(name, str):
                raise InvalidValueError(f"name in {place}", repr(name), "a text")
        return {name: _plain(each, f"{place}.{name}") for name, each in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(each, place) for each in value]
    if isinstance(value, Path):
        return str(value)
    if value is None or isinstance(value, str | bool | int):
        return value
    if isinstance(value, float) and np.isfinite(value):
        return value
    raise InvalidValueError(place, repr(value), "texts, truth values, finite numbers, lists and mappings")
