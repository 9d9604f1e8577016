"""What datasets cost, and what kills do to them."""

import itertools
import os
import signal
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pandas
from harness import Times, figures, timed

from pepper_kin import datasets
from pepper_kin.datasets import DatasetJob, Feature, LeRobotWriter, pool

BOX = {"name": "table", "kind": "box", "size": [0.4, 0.8, 0.03], "position": [0.47, 0.05, 0.715]}
TABLE = {"objects": [BOX]}
NEAR = {"lower": [0.28, 0.05, 0.75], "upper": [0.42, 0.35, 1.0]}


def rows(folder, count):
    """IK rows with self-collision, some of them out of reach: processor time of each."""
    for name, targets in (
        ("all within reach", NEAR),
        ("some out of reach", {"lower": [0.28, 0.05, 0.75], "upper": [0.65, 0.45, 1.0]}),
    ):
        job = DatasetJob("ik", count, rows_per_shard=count, targets=targets)
        datasets.run_shard(DatasetJob("ik", 50, targets=targets), 0)
        table, spent = timed(datasets.run_shard, job, 0)
        statuses = np.array(table["status"].to_pylist())
        share = (statuses != "solved").mean()
        yield f"IK, {name}: {1e6 * spent / count:.0f} us a row, {share:.1%} unsolved"
    assert (statuses == "solved").any()


def motions(folder, count):
    """Certified trajectories past a table: processor time of each."""
    job = DatasetJob("trajectories", count, rows_per_shard=count, targets=NEAR, scenes=[TABLE])
    datasets.run_shard(DatasetJob("trajectories", 3, targets=NEAR, scenes=[TABLE]), 0)
    table, spent = timed(datasets.run_shard, job, 0)
    statuses = table["status"].to_pylist()
    assert statuses.count("solved") > 0.9 * count
    ms, minutes = 1e3 * spent / count, 1e5 * spent / count / 120
    yield f"certified trajectories: {ms:.1f} ms each; 100,000 on two cores {minutes:.0f} min"


def writer(folder, count):
    """Frames a second of the LeRobot writer, 30 columns, statistics included, beside pandas' writer."""
    rng = np.random.default_rng(0)
    states = rng.normal(size=(500, 15)).astype(np.float32).cumsum(axis=0)
    features = {"observation.state": Feature(15), "action": Feature(15)}
    times = Times()

    def own(place):
        with LeRobotWriter(place, 50, features) as out:
            for k in range(count):
                out.add("reach", **{"observation.state": states + k, "action": states - k})

    def peer():
        for k in range(count // 10):
            both = pandas.DataFrame(np.concatenate([states + k, states - k], axis=1)).astype(np.float32)
            both.quantile([0.01, 0.1, 0.5, 0.9, 0.99]), both.describe()
            both.columns = both.columns.astype(str)
            both.to_parquet(folder / "one.parquet")

    for turn in range(3):
        times("own", own, folder / f"set{turn}")
        times("peer", peer)
    rates = 500 * count / np.median(times["own"]), 50 * count / np.median(times["peer"])
    yield f"LeRobot writer: {rates[0]:.0f} frames/s; a DataFrame for each episode: {rates[1]:.0f}"
    assert len(pandas.read_parquet(folder / "set0/data")) == 500 * count


def small_job(shards):
    return DatasetJob("ik", 5 * shards, rows_per_shard=5, targets=NEAR, planner={"collisions": False})


def contents(folder):
    return {
        p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file() and p.name != ".lock"
    }


def kills(folder, shards, count=50):
    """Workers killed, by the pool and by Dask: the bytes are those of a quiet run."""
    job = small_job(shards)
    datasets.make(job, folder / "quiet", workers=0)
    pool.MOST_KILLS = count
    rng = np.random.default_rng(0)

    def killer(find, every):
        done = []

        def kill(state):
            if len(done) < count and state.done >= (len(done) + 1) * every:
                found = find()
                if found:
                    done.append(int(rng.choice(found)))
                    os.kill(done[-1], signal.SIGKILL)

        return done, kill

    def children():
        tasks = Path(f"/proc/{os.getpid()}/task").glob("*/children")
        every = [int(pid) for task in tasks for pid in task.read_text().split()]
        return [pid for pid in every if b"serve()" in Path(f"/proc/{pid}/cmdline").read_bytes()]

    done, kill = killer(children, job.rows / (count + 4))
    datasets.make(job, folder / "pool", workers=2, on_progress=kill)
    same = contents(folder / "pool") == contents(folder / "quiet")
    yield f"pool: {len(done)} kills in {shards} shards; bit-equal: {same}"
    assert same
    with dask(2) as client:

        def find():  # both run: a nanny may give up whose worker is killed before it has started
            for look in range(1, 200):
                found = list(client.run(os.getpid, on_error="ignore").values())
                if len(found) >= 2:
                    return found
                if look % 60 == 0:
                    client.cluster.scale(len(client.cluster.workers) + 1)
                time.sleep(0.1)
            return []

        done, kill = killer(find, job.rows / (count + 4))
        datasets.make(job, folder / "dask", client=client, on_progress=kill)
    same = contents(folder / "dask") == contents(folder / "quiet")
    yield f"Dask: {len(done)} kills in {shards} shards; bit-equal: {same}"
    assert same


@contextmanager
def dask(workers):
    from distributed import Client, LocalCluster

    options = {"n_workers": workers, "threads_per_worker": 1, "dashboard_address": ":0"}
    with LocalCluster(**options) as cluster, Client(cluster) as client:
        client.run(datasets.run_shard, small_job(1), 0)  # started, and everything is loaded
        yield client


def scaling(folder, shards):
    """Two workers over one, by the pool and by Dask.

    Wall time, alone on the machine only; and the processor time that two take over one, which other programs
    change little.
    """
    job = DatasetJob("trajectories", 50 * shards, rows_per_shard=50, targets=NEAR, scenes=[TABLE])
    times, spent = Times(time.monotonic), {}
    for turn, workers in itertools.product(range(2), (1, 2)):
        used = sum(os.times()[:4])
        times(("pool", workers), datasets.make, job, folder / f"pool{workers}{turn}", workers=workers)
        spent.setdefault(workers, []).append(sum(os.times()[:4]) - used)
        with dask(workers) as client:
            times(("Dask", workers), datasets.make, job, folder / f"Dask{workers}{turn}", client=client)
    for name in ("pool", "Dask"):
        one, two = (min(times[name, workers]) for workers in (1, 2))
        yield f"{name}: two workers over one {one / two:.2f}, one takes {one:.1f} s"
    one, two = (min(spent[workers]) for workers in (1, 2))
    yield f"pool: processor time {one:.1f} s by one, {two:.1f} s by two workers: {2 * one / two:.2f} at most"
    yield f"load of the machine: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores"


PARTS = {"rows": (rows, 2000), "motions": (motions, 100), "writer": (writer, 200), "kills": (kills, 1000)}
PARTS["scaling"] = (scaling, 200)


@figures("datasets.md", "the extra `datasets`", count=20, parts=("rows", "motions", "writer"))
def data_sets(parts: tuple[str, ...] = tuple(PARTS), count: int = 0) -> Iterator[str]:
    """What datasets cost, and what kills do to them, in a temporary folder.

    Parts are rows, motions, writer, kills (50 workers in 1,000 shards) and scaling; a count is that of rows,
    motions, episodes or shards.  `tests/zoo/read_by_lerobot.py` counts what lerobot reads.
    """
    for part in parts:
        with tempfile.TemporaryDirectory() as name:
            run, usual = PARTS[part]
            yield from run(Path(name), count or usual)
