"""What lerobot reads of our datasets, value by value: `python tests/zoo/read_by_lerobot.py COUNT [SEED]`.

It is installed for this alone, beside the library (`pip install "lerobot[dataset]"`, Python 3.12), and is no
part of continuous integration.
"""

import sys
import tempfile
import warnings
from collections import Counter
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "datasets"))

from small_jobs import small_job, write_log

from pepper_kin import datasets
from pepper_kin.datasets import Feature, LeRobotWriter
from pepper_kin.exceptions import FileFormatWarning

TASKS = ("reach", "Schau nach oben", "attrape la tasse à café", "コップを取る", "a/b: {c}", " ", "")
NAMES = ("observation.state", "action", "self", "größe", "two words", "力", "x.{y}", "a-1", "\N{ROBOT FACE}")
STATES = {  # kind of job -> columns of its rows that are state and action
    "trajectories": ("position", "position"),
    "runs": ("position", "reference_position"),
    "demonstrations": ("observation", "action"),
    "replays": ("measured", "command"),
}
SHIFTED = {"objects": {"table": [0.03, 0.03, 0.0]}}


def read_data_sets(count, rng):
    """Count sets that lerobot reads as they were written: random, large, and one of each kind of job."""
    counts = Counter()
    for _ in range(count):
        fps = int(rng.choice([1, 7, 10, 30, 50, 60, 240, 1000]))
        films = {
            f"observation.images.{name}": 2 * rng.integers(4, 30, 2) for name in NAMES[: rng.integers(3)]
        }
        sizes = {str(name): int(rng.integers(1, 20)) for name in rng.permutation(NAMES)[: rng.integers(1, 5)]}
        counts["random"] += write_and_read(fps, sizes, films, rng.integers(1, 25, rng.integers(1, 7)), rng)
    film = {"observation.images.top": np.array([16, 16])}
    counts["1,005 episodes"] += write_and_read(10, {"action": 2}, film, np.ones(1005, int), rng)
    counts["50 minutes"] += write_and_read(10, {"action": 2}, film, np.array([30_000]), rng)
    for kind in STATES:
        counts[kind] += make_and_read(kind, rng)
    return counts


def write_and_read(fps, sizes, films, lengths, rng):
    """Write random frames of some features, read them; return 1."""
    features = {
        name: Feature(size, tuple(f"{name} {k}" for k in range(size))) for name, size in sizes.items()
    }
    features |= {name: Feature(picture=tuple(size.tolist())) for name, size in films.items()}
    episodes, tasks = [], [str(word) for word in rng.choice(TASKS, len(lengths))]
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "set"
        with LeRobotWriter(place, fps, features, frames_per_file=int(rng.integers(20, 60))) as writer:
            for task, length in zip(tasks, lengths, strict=True):
                scale = 10.0 ** rng.integers(-30, 30)
                frames = {name: scale * rng.normal(size=(length, size)) for name, size in sizes.items()}
                frames |= {name: pictures(length, *size) for name, size in films.items()}
                writer.add(task, **frames)
                episodes.append(frames)
        names = {name: list(feature.names) for name, feature in features.items() if feature.size}
        examine(place, fps, names, tasks, episodes, rng)
    return 1


def make_and_read(kind, rng):
    """Make a small job of a kind, read its set and compare it with the job's own rows; return 1."""
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore", FileFormatWarning)  # joints that a log lacks
        more = {"randomization": SHIFTED} if kind == "trajectories" else {}
        if kind == "replays":
            logs = [write_log(Path(folder) / f"head{k}.csv") for k in range(2)]
            more = {"targets": {"logs": [str(log) for log in logs]}}
        job = small_job(kind, Path(folder), format="lerobot", **more)
        rows = datasets.make(job, Path(folder) / "data", workers=0)
        columns = {column.name: column for column in rows.columns}
        state, action = (columns[name] for name in STATES[kind])
        solved = [row for row in rows if row["status"] == "solved"]
        known = slice(None)
        if kind == "replays":  # a log may lack joints
            both = [np.isfinite(row[one.name]).all(axis=0) for row in solved for one in (state, action)]
            known = np.flatnonzero(np.all(both, axis=0))
        episodes = []
        for row in solved:
            frames = {"observation.state": row[state.name][:, known], "action": row[action.name][:, known]}
            if kind == "trajectories":  # the next position
                frames["action"] = np.concatenate([frames["action"][1:], frames["action"][-1:]])
            objects = [name for name in columns if name.startswith("object.")]
            if objects:
                where = np.concatenate([row[name] for name in objects])
                frames["observation.environment_state"] = np.tile(where, (len(row["time"]), 1))
            for sensor in [name for name in columns if f"{name}.time" in columns]:
                newest = [np.flatnonzero(row[f"{sensor}.time"] <= t + 1e-9)[-1] for t in row["time"]]
                values = row[sensor][newest]
                folder_of = "images" if values.ndim == 4 else "sensors"
                frames[f"observation.{folder_of}.{sensor}"] = (
                    values.reshape(len(newest), -1) if values.ndim < 4 else values
                )
            episodes.append(frames)
        named = {"observation.state": state, "action": action}
        names = {name: np.array(column.names)[known].tolist() for name, column in named.items()}
        fps = round(1.0 / np.median(np.diff(solved[0]["time"])))
        tasks = [job.targets.get("task", job.name)] * len(solved)
        examine(Path(folder) / "data/lerobot", fps, names, tasks, episodes, rng)
    return 1


def pictures(length, height, width):
    """Return pictures whose brightness differs from one to the next, shape (length, height, width, 3)."""
    shade = np.linspace(0, 60, width)[:, None] + np.array([0, 10, 20])
    film = 20 + shade + (16 * np.arange(length) % 160)[:, None, None, None] + np.zeros((height, 1, 1))
    return film.astype(np.uint8)


def examine(place, fps, names, tasks, episodes, rng):
    """Compare what lerobot reads with what was written: metadata, statistics, items, windows, batches."""
    import torch
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    data = LeRobotDataset("local/x", root=place)
    lengths = [len(next(iter(frames.values()))) for frames in episodes]
    films = [name for name, values in episodes[0].items() if values.ndim == 4]
    numbers = [name for name in episodes[0] if name not in films]
    first = np.cumsum([0, *lengths])
    assert (data.fps, data.num_episodes, data.num_frames) == (fps, len(episodes), first[-1])
    assert sorted(data.meta.camera_keys) == sorted(films)
    assert data.meta.robot_type == "pepper"
    for name, words in names.items():
        assert (data.meta.features[name]["names"] or []) == words, name
    joined = {name: np.concatenate([frames[name] for frames in episodes]) for name in episodes[0]}
    single = {name: joined[name].astype(np.float32) for name in numbers}
    check_statistics(data.meta.stats, single, {name: joined[name] for name in films}, first[-1])
    where = np.arange(first[-1]) if first[-1] < 1500 else np.sort(rng.choice(first[-1], 300, replace=False))
    steps = [-2, 0, 3]
    windows = LeRobotDataset(
        "local/x", root=place, delta_timestamps={name: [k / fps for k in steps] for name in joined}
    )
    for index in where.tolist():
        item, window = data[index], windows[index]
        episode = int(np.searchsorted(first, index, side="right")) - 1
        begin, end = first[episode], first[episode + 1]
        assert item["task"] == tasks[episode]
        found = [item[name].item() for name in ("index", "episode_index", "frame_index")]
        assert found == [index, episode, index - begin]
        assert item["timestamp"].item() == np.float32((index - begin) / fps)
        rows = np.clip(index + np.array(steps), begin, end - 1)
        for name in joined:
            padded = window[f"{name}_is_pad"].numpy()
            assert np.array_equal(padded, rows != index + np.array(steps)), name
        for name in numbers:
            assert np.array_equal(item[name].numpy().reshape(-1), single[name][index]), name
            assert np.array_equal(window[name].numpy().reshape(3, -1), single[name][rows]), name
        for name in films:
            for picture, row in [(item[name], index), *zip(window[name], rows, strict=True)]:
                check_picture(picture.numpy(), joined[name], row, begin, end)
    chosen = int(rng.integers(len(episodes)))
    one = LeRobotDataset("local/x", root=place, episodes=[chosen])
    assert len(one) == lengths[chosen]
    assert one[0]["index"].item() == first[chosen]
    batch = next(iter(torch.utils.data.DataLoader(data, batch_size=4, shuffle=True)))
    drawn = batch["index"].numpy()
    for name in numbers:
        assert np.array_equal(batch[name].numpy().reshape(len(drawn), -1), single[name][drawn]), name


def check_picture(picture, film, row, begin, end):
    """Compare a decoded picture, (3, height, width) from 0 to 1, with those around it in time."""
    near = np.arange(max(begin, row - 4), min(end, row + 5))
    shown = 255.0 * np.moveaxis(picture, 0, -1)
    off = np.abs(film[near] - shown).mean(axis=(1, 2, 3))
    assert off[row - near[0]] <= off.min() + 1e-9 or np.array_equal(film[row], film[near[off.argmin()]])
    assert off[row - near[0]] < 6.0, off


def check_statistics(stats, numbers, films, count):
    """Compare those of the whole set with NumPy's."""
    for name, values in numbers.items():
        exact, scale = values.astype(float), np.abs(values).max() + 1e-300
        for word in ("min", "max", "mean", "std"):
            value = getattr(exact, word)(axis=0)
            assert stats[name][word].shape == value.shape
            assert np.abs(stats[name][word] - value).max() <= 1e-5 * scale, (name, word)
        assert stats[name]["count"].tolist() == [count]
    for name, film in films.items():
        assert stats[name]["mean"].shape == (3, 1, 1)
        assert np.abs(stats[name]["mean"].ravel() - film.mean(axis=(0, 1, 2)) / 255).max() < 0.05


if __name__ == "__main__":
    generator = np.random.default_rng(int(sys.argv[2]) if len(sys.argv) > 2 else 0)
    for what, number in read_data_sets(int(sys.argv[1]), generator).items():
        print(f"{number:6}  {what}")
