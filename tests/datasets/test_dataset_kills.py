"""Whatever is killed, full or doubled: every row is there once, with the bits of an undisturbed run."""

import dataclasses
import json
import os
import re
import resource
import signal
import subprocess
import sys
from contextlib import ExitStack, closing
from pathlib import Path

import distributed
import numpy as np
import pyarrow.parquet as pq
import pytest
from small_jobs import small_job

from pepper_kin import datasets
from pepper_kin.datasets import cluster as cluster_module
from pepper_kin.datasets import pool
from pepper_kin.datasets import shard as shard_module
from pepper_kin.datasets.shard import name_of
from pepper_kin.datasets.store import Store
from pepper_kin.exceptions import FileFormatError, InfeasibleError, InvalidValueError, PepperKinError


@pytest.fixture
def job(tmp_path):
    return small_job("ik", tmp_path, rows=240, rows_per_shard=6)


def contents(folder):
    """Return the bytes of all files of a dataset, the lock excepted."""
    place = Path(folder)
    return {
        p.relative_to(place): p.read_bytes() for p in place.rglob("*") if p.is_file() and p.name != ".lock"
    }


@pytest.fixture
def undisturbed(job, tmp_path):
    datasets.make(job, tmp_path / "undisturbed", workers=0)
    return contents(tmp_path / "undisturbed")


def children():
    """Return the ids of the processes that this one has started and that run."""
    tasks = Path(f"/proc/{os.getpid()}/task").glob("*/children")
    return [int(word) for task in tasks for word in task.read_text().split()]


@pytest.mark.thorough
def test_workers_of_the_pool_killed_again_and_again(job, undisturbed, tmp_path, monkeypatch):
    monkeypatch.setattr(pool, "MOST_KILLS", 50)
    kills, rng = [], np.random.default_rng(3)

    def kill(_):
        if len(kills) < 8:
            found = [pid for pid in children() if "serve" in Path(f"/proc/{pid}/cmdline").read_text()]
            if found:
                kills.append(int(rng.choice(found)))
                os.kill(kills[-1], signal.SIGKILL)

    datasets.make(job, tmp_path / "killed", workers=2, on_progress=kill)
    assert len(kills) == 8
    assert contents(tmp_path / "killed") == undisturbed


def test_a_shard_that_kills_every_process_is_named(job, tmp_path, monkeypatch):
    monkeypatch.setattr(pool, "serve", None)

    class Killed(pool._Worker):
        def give(self, shard):
            super().give(shard)
            self.process.kill()

    monkeypatch.setattr(pool, "_Worker", Killed)
    with pytest.raises(InfeasibleError, match=r"5 processes died over shard \d+"):
        datasets.make(job, tmp_path / "data", workers=1)


@pytest.mark.thorough
def test_workers_of_dask_killed(job, undisturbed, tmp_path):
    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": ":0", "processes": True}
    with distributed.LocalCluster(**options) as cluster, distributed.Client(cluster) as client:
        kills = []

        def kill(_):
            pids = list(client.run(os.getpid, on_error="ignore").values())
            if len(kills) < 3 and pids:
                kills.append(pids[len(kills) % len(pids)])
                os.kill(kills[-1], signal.SIGKILL)

        made = datasets.make(job, tmp_path / "dask", client=client, on_progress=kill)
    assert len(kills) == 3
    assert len(made) == 240
    assert contents(tmp_path / "dask") == undisturbed


@pytest.mark.thorough
def test_a_scheduler_that_is_gone(job, undisturbed, tmp_path):
    options = {"n_workers": 1, "threads_per_worker": 1, "dashboard_address": ":0", "processes": False}
    cluster = distributed.LocalCluster(**options)
    client = distributed.Client(cluster)
    with pytest.raises(InfeasibleError, match=r"the scheduler is gone.*resume"):
        datasets.make(job, tmp_path / "data", client=client, on_progress=lambda _: cluster.close())
    client.close()
    with pytest.raises(InfeasibleError, match="scheduler"):
        datasets.make(job, tmp_path / "data", client="tcp://127.0.0.1:1")
    datasets.resume(tmp_path / "data", workers=0)
    assert contents(tmp_path / "data") == undisturbed


@pytest.mark.thorough
def test_workers_of_dask_that_do_not_come_back(job, tmp_path, monkeypatch):
    monkeypatch.setattr(cluster_module, "PATIENCE", 1.0)
    options = {"n_workers": 1, "threads_per_worker": 1, "dashboard_address": ":0", "processes": False}
    stopped = pytest.raises(InfeasibleError, match=r"no worker was seen for 1 s; start it again and resume")
    with distributed.LocalCluster(**options) as cluster, distributed.Client(cluster) as client, stopped:
        datasets.make(job, tmp_path / "a", client=client, on_progress=lambda _: cluster.scale(0))


def test_an_error_on_a_worker_of_dask_is_that_of_the_row(job, tmp_path):
    options = {"n_workers": 1, "threads_per_worker": 1, "dashboard_address": ":0", "processes": False}
    with distributed.LocalCluster(**options) as cluster, distributed.Client(cluster) as client:

        def obstruct(_):
            (tmp_path / "a" / name_of(job, 30)).mkdir(exist_ok=True)

        with pytest.raises(FileFormatError, match=r"shard-000030.*cannot be written: it is a folder"):
            datasets.make(job, tmp_path / "a", client=client, on_progress=obstruct)


DRIVER = """
import sys
from pepper_kin import datasets
job = datasets.load_job(sys.argv[1])
datasets.make(job, sys.argv[2], workers=1, on_progress=lambda state: print(state.done, flush=True))
"""


@pytest.mark.thorough
def test_a_killed_driver_and_a_second_one(job, undisturbed, tmp_path):
    """The second is refused while the first lives; after its death resume goes on, and asks no clock."""
    job.save(tmp_path / "job.yaml")
    arguments = [sys.executable, "-c", DRIVER, str(tmp_path / "job.yaml"), str(tmp_path / "data")]
    with subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True) as driver:
        driver.stdout.readline()
        with pytest.raises(InvalidValueError, match=f"process {driver.pid} does"):
            datasets.make(job, tmp_path / "data", workers=0)
        driver.kill()
    with pytest.raises(FileFormatError, match="not complete: resume"):
        datasets.open(tmp_path / "data")
    found = datasets.check(tmp_path / "data")
    assert not found.success
    assert found.written < found.shards
    half = tmp_path / "data/data" / ".shard-000001.abc.part"
    half.write_bytes(b"PAR1")  # of a worker that was killed
    for path in (tmp_path / "data/data").iterdir():
        os.utime(path, (4e9, 4e9))  # as if the clock had been set back since
    datasets.resume(tmp_path / "data", workers=0)
    assert contents(tmp_path / "data") == undisturbed


def limit_files():
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (3000, 3000))  # a shard is longer


@pytest.mark.thorough
def test_a_full_disk(job, undisturbed, tmp_path):
    """A line that names file and cause; nothing half written; resume goes on."""
    job.save(tmp_path / "job.yaml")
    command = [sys.executable, "-c", "from pepper_kin.cli import main; main()", "dataset", "make"]
    command += [str(tmp_path / "job.yaml"), "-o", str(tmp_path / "data"), "--workers", "1"]
    # Python would leave cut files in place of its byte code.
    options = {"env": {**os.environ, "PYTHONDONTWRITEBYTECODE": "1"}, "preexec_fn": limit_files}
    done = subprocess.run(command, capture_output=True, text=True, check=False, **options)
    assert done.returncode == 2
    assert "shard-000000" in done.stderr
    assert "cannot be written: File too large" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1, done.stderr
    assert not [p for p in (tmp_path / "data/data").iterdir() if not p.name.startswith(".")]
    datasets.resume(tmp_path / "data", workers=0)
    assert contents(tmp_path / "data") == undisturbed


def test_another_job_in_the_folder_and_a_folder_with_other_things(job, tmp_path):
    datasets.make(job, tmp_path / "data", workers=0)
    with pytest.raises(InvalidValueError, match="this very job"):
        datasets.make(small_job("ik", tmp_path, rows=240, rows_per_shard=6, planner={}), tmp_path / "data")
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/letter.txt").write_text("dear")
    with pytest.raises(InvalidValueError, match=r"letter\.txt"):
        datasets.make(job, tmp_path / "mine")
    with pytest.raises(FileFormatError, match="holds no dataset"):
        datasets.resume(tmp_path / "mine")
    text = (tmp_path / "data/job.yaml").read_text()
    (tmp_path / "data/job.yaml").write_text(re.sub("pepper_kin: .*", "pepper_kin: 0.0.9", text))
    with pytest.raises(FileFormatError, match=r"was begun by pepper_kin 0\.0\.9"):
        datasets.resume(tmp_path / "data")
    assert len(datasets.open(tmp_path / "data")) == 240


def test_a_shard_of_another_pyarrow_takes_its_place_in_the_manifest(job, tmp_path, monkeypatch):
    """The same rows in other bytes; what is damaged in other files stays refused."""
    folder = tmp_path / "data"
    datasets.make(job, folder, workers=0)
    (folder / name_of(job, 2)).unlink()
    (folder / name_of(job, 5)).write_bytes(b"PAR1")
    monkeypatch.setattr(shard_module.pa, "__version__", "99.0")
    datasets.resume(folder, workers=0)
    monkeypatch.undo()
    assert datasets.open(folder)[13]["row"] == 13
    (fault,) = datasets.check(folder, sample=40).faults
    assert "shard-000005" in fault


def test_another_format_is_refused_where_nothing_would_be_written(tmp_path):
    job = small_job("demonstrations", tmp_path, rows=1)
    datasets.make(job, tmp_path / "data", workers=0)
    with pytest.raises(InvalidValueError, match="this very job"):
        datasets.make(dataclasses.replace(job, format="lerobot"), tmp_path / "data", workers=0)


@pytest.mark.thorough
def test_the_same_job_in_two_folders_by_one_scheduler(job, undisturbed, tmp_path):
    """The tasks of one are not those of the other."""
    options = {"n_workers": 1, "threads_per_worker": 1, "dashboard_address": ":0", "processes": False}
    with distributed.LocalCluster(**options) as cluster, distributed.Client(cluster) as client:

        def make_other(state):
            if state.new == 6:  # while the scheduler knows the next shards of the first
                datasets.make(job, tmp_path / "b", client=client)

        datasets.make(job, tmp_path / "a", client=client, on_progress=make_other)
    assert contents(tmp_path / "a") == contents(tmp_path / "b") == undisturbed


@pytest.mark.thorough
def test_other_clusters_of_the_process_come_and_go(job, undisturbed, tmp_path):
    """The newest client is the default one of all threads: it is not asked about the shards of another."""
    options = {"n_workers": 1, "threads_per_worker": 1, "dashboard_address": ":0", "processes": False}
    with ExitStack() as stack:
        client, newest = (
            stack.enter_context(closing(distributed.Client(stack.enter_context(cluster))))
            for cluster in (distributed.LocalCluster(**options), distributed.LocalCluster(**options))
        )
        assert distributed.default_client() is newest
        newest.sync = lambda *arguments, **more: pytest.fail("a client of another cluster is asked")
        datasets.make(job, tmp_path / "data", client=client, on_progress=lambda state: newest.close())
    assert contents(tmp_path / "data") == undisturbed


@pytest.mark.thorough
def test_damage_is_refused_by_name_and_mended_by_resume(job, undisturbed, tmp_path):
    folder = tmp_path / "data"
    datasets.make(job, folder, workers=0)
    path = folder / name_of(job, 2)
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    with pytest.raises(FileFormatError, match=f"{path.name}: is damaged"):
        datasets.open(folder)[13]
    assert datasets.open(folder)[0]["row"] == 0
    (folder / name_of(job, 5)).unlink()
    (folder / "data/shard-more.parquet").write_bytes(b"")
    found = datasets.check(folder)
    assert len(found.faults) == 3
    assert [
        word for word in ("is damaged", "is missing", "no row of this job") if word not in found.report()
    ] == []
    path.unlink()
    (folder / "data/shard-more.parquet").unlink()
    datasets.resume(folder, workers=0)
    assert contents(folder) == undisturbed


def test_rows_that_are_double_or_not_those_of_the_job_are_found(job, tmp_path):
    """In files whose sums are right: only their rows are wrong."""
    folder = tmp_path / "data"
    datasets.make(job, folder, workers=0)
    manifest = json.loads((folder / "manifest.json").read_text())

    def replace(shard, change):
        path = folder / name_of(job, shard)
        table = change(pq.read_table(path))
        metadata = pq.read_metadata(path).metadata
        with pq.ParquetWriter(path, table.schema) as writer:
            writer.write_table(table)
            writer.add_key_value_metadata(
                {k: v for k, v in metadata.items() if k.startswith(b"pepper_kin.summ")}
            )
        manifest["shards"][shard]["sha256"], manifest["shards"][shard]["bytes"] = Store(folder).sha256(
            name_of(job, shard)
        )

    replace(1, lambda table: table.take([0, 1, 2, 3, 4, 4]))

    def exchanged(table):
        at = table.schema.get_field_index("target")
        return table.set_column(at, table.schema.field(at), table["target"].take([1, 0, 2, 3, 4, 5]))

    for shard in range(2, 40):
        replace(shard, exchanged)
    (folder / "manifest.json").write_text(json.dumps(manifest))
    found = datasets.check(folder, sample=40)
    assert "rows that are missing or there twice" in found.report()
    assert "is another one when it is recomputed, in target" in found.report()


@pytest.mark.parametrize(
    "text", ["", "{", "[]", '{"shards": 3}', '{"data set": 9, "rows": 240, "shards": []}']
)
def test_damaged_manifests_are_refused(job, tmp_path, text):
    datasets.make(job, tmp_path / "data", workers=0)
    (tmp_path / "data/manifest.json").write_text(text)
    with pytest.raises(FileFormatError, match=r"manifest\.json: is damaged"):
        datasets.open(tmp_path / "data")


def test_on_an_address_of_fsspec(job, undisturbed):
    made = datasets.make(job, "memory://pepper/data", workers=0)
    place = Store("memory://pepper/data")
    for name, content in undisturbed.items():
        with place.open(str(name)) as file:
            assert file.read() == content
    assert made[239]["row"] == 239
    assert datasets.check("memory://pepper/data").success
    with pytest.raises(PepperKinError, match="nowhere"):
        datasets.make(job, "nowhere://pepper")


@pytest.mark.thorough
def test_memory_does_not_grow_with_the_rows_that_are_read(tmp_path):
    """Row after row of a dataset a hundred times a group: the arrays of one group are in memory."""
    import tracemalloc

    made = datasets.make(small_job("ik", tmp_path, rows=4000, rows_per_shard=100), tmp_path / "a", workers=0)
    for _ in made.batches():
        pass
    tracemalloc.start()
    count = sum(1 for _ in made)
    assert count == 4000
    assert tracemalloc.get_traced_memory()[1] < 3_000_000
    tracemalloc.stop()


def test_time_left_is_told(job, tmp_path):
    lines = []
    datasets.make(job, tmp_path / "a", workers=0, on_progress=lambda state: lines.append(state.sentence()))
    assert len(lines) == 40
    assert lines[0].startswith("6 of 240 rows, ")
    assert " s left; 6 solved" in lines[0]
