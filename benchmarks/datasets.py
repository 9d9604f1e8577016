"""What data sets cost, and what kills do to them: `python benchmarks/datasets.py [PART ...]`.

    rows      IK rows with self-collision, some of them out of reach: processor time of each
    motions   certified trajectories past a table: processor time of each
    writer    frames a second of the LeRobot writer, 30 columns, statistics included, beside pandas' writer
    kills     50 workers killed in 1,000 shards, by the pool and by Dask: the bytes are those of a quiet run
    scaling   two workers over one, by the pool and by Dask: wall time, alone on the machine only; and the
              processor time that two take over one, which other programs change little

All parts without names, in a temporary folder.  `tests/zoo/read_by_lerobot.py` counts what lerobot reads.
"""

import argparse
import os
import signal
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pandas

from pepper_kin import datasets
from pepper_kin.datasets import DatasetJob, Feature, LeRobotWriter, pool

TABLE = {
    "objects": [{"name": "table", "kind": "box", "size": [0.4, 0.8, 0.03], "position": [0.47, 0.05, 0.715]}]
}
NEAR = {"lower": [0.28, 0.05, 0.75], "upper": [0.42, 0.35, 1.0]}


@contextmanager
def processor_time(found):
    begin = time.process_time()
    yield
    found.append(time.process_time() - begin)


def rows(folder, count):
    """Rows of a box within reach, and of a longer one."""
    for name, targets in (
        ("all within reach", NEAR),
        ("some out of reach", {"lower": [0.28, 0.05, 0.75], "upper": [0.65, 0.45, 1.0]}),
    ):
        job = DatasetJob("ik", count, rows_per_shard=count, targets=targets)
        datasets.run_shard(DatasetJob("ik", 50, targets=targets), 0)
        spent = []
        with processor_time(spent):
            table = datasets.run_shard(job, 0)
        statuses = np.array(table["status"].to_pylist())
        share = (statuses != "solved").mean()
        print(f"IK, {name}: {1e6 * spent[0] / count:.0f} us a row, {share:.1%} unsolved")
    assert (statuses == "solved").any()


def motions(folder, count):
    job = DatasetJob("trajectories", count, rows_per_shard=count, targets=NEAR, scenes=[TABLE])
    datasets.run_shard(DatasetJob("trajectories", 3, targets=NEAR, scenes=[TABLE]), 0)
    spent = []
    with processor_time(spent):
        table = datasets.run_shard(job, 0)
    statuses = table["status"].to_pylist()
    assert statuses.count("solved") > 0.9 * count
    each = spent[0] / count
    print(
        f"certified trajectories: {1e3 * each:.1f} ms each; 100,000 on two cores {1e5 * each / 120:.0f} min"
    )


def writer(folder, count):
    rng = np.random.default_rng(0)
    states = rng.normal(size=(500, 15)).astype(np.float32).cumsum(axis=0)
    features = {"observation.state": Feature(15), "action": Feature(15)}
    own, peer = [], []
    for turn in range(3):
        with processor_time(own), LeRobotWriter(folder / f"set{turn}", 50, features) as out:
            for k in range(count):
                out.add("reach", **{"observation.state": states + k, "action": states - k})
        with processor_time(peer):
            for k in range(count // 10):
                both = pandas.DataFrame(np.concatenate([states + k, states - k], axis=1)).astype(np.float32)
                both.quantile([0.01, 0.1, 0.5, 0.9, 0.99]), both.describe()
                both.columns = both.columns.astype(str)
                both.to_parquet(folder / "one.parquet")
    rates = 500 * count / np.median(own), 50 * count / np.median(peer)
    print(f"LeRobot writer: {rates[0]:.0f} frames/s; a DataFrame for each episode: {rates[1]:.0f}")
    assert len(pandas.read_parquet(folder / "set0/data")) == 500 * count


def small_job(shards):
    return DatasetJob("ik", 5 * shards, rows_per_shard=5, targets=NEAR, planner={"collisions": False})


def contents(folder):
    return {
        p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file() and p.name != ".lock"
    }


def kills(folder, shards, count=50):
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
    print(f"pool: {len(done)} kills in {shards} shards; bit-equal: {same}")
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
    print(f"Dask: {len(done)} kills in {shards} shards; bit-equal: {same}")
    assert same


@contextmanager
def dask(workers):
    from distributed import Client, LocalCluster

    options = {"n_workers": workers, "threads_per_worker": 1, "dashboard_address": ":0"}
    with LocalCluster(**options) as cluster, Client(cluster) as client:
        client.run(datasets.run_shard, small_job(1), 0)  # started, and everything is loaded
        yield client


def scaling(folder, shards):
    job = DatasetJob("trajectories", 50 * shards, rows_per_shard=50, targets=NEAR, scenes=[TABLE])
    times, spent = {}, {}
    for turn in range(2):
        for workers in (1, 2):
            for name in ("pool", "Dask"):
                place = folder / f"{name}{workers}{turn}"
                if name == "pool":
                    begin, used = time.monotonic(), sum(os.times()[:4])
                    datasets.make(job, place, workers=workers)
                    times.setdefault((name, workers), []).append(time.monotonic() - begin)
                    spent.setdefault(workers, []).append(sum(os.times()[:4]) - used)
                else:
                    with dask(workers) as client:
                        begin = time.monotonic()
                        datasets.make(job, place, client=client)
                        times.setdefault((name, workers), []).append(time.monotonic() - begin)
    for name in ("pool", "Dask"):
        ratio = min(times[name, 1]) / min(times[name, 2])
        print(f"{name}: two workers over one {ratio:.2f}, one takes {min(times[name, 1]):.1f} s")
    one, two = (min(spent[workers]) for workers in (1, 2))
    print(f"pool: processor time {one:.1f} s by one, {two:.1f} s by two workers: {2 * one / two:.2f} at most")
    print(f"load of the machine: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")


PARTS = {"rows": (rows, 2000), "motions": (motions, 100), "writer": (writer, 200), "kills": (kills, 1000)}
PARTS["scaling"] = (scaling, 200)

if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("parts", nargs="*", help="parts to run")
    parser.add_argument("--count", type=int, help="rows, motions, episodes or shards")
    options = parser.parse_args()
    for part in options.parts or PARTS:
        with tempfile.TemporaryDirectory() as name:
            run, count = PARTS[part]
            run(Path(name), options.count or count)
