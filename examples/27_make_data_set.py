"""Certified motions past a table as a dataset in Parquet, by processes here or on a SLURM cluster."""

import argparse
from contextlib import ExitStack

import pyarrow.parquet as pq

import pepper_kin as pk
from pepper_kin import datasets

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--rows", type=int, default=48, help="number of motions")
parser.add_argument("--cluster", choices=("none", "local", "slurm"), default="none", help="where Dask runs")
parser.add_argument("--queue", default="normal", help="queue of the SLURM cluster")
parser.add_argument("-o", "--output", default="motions", help="folder to make, or to go on with")
options = parser.parse_args()

job = datasets.DatasetJob(
    kind="trajectories",
    name="Reaching past a table",
    rows=options.rows,
    rows_per_shard=8,
    scenes=[pk.Scene().add_box("table", size=(0.40, 0.80, 0.03), position=(0.47, 0.05, 0.715))],
    randomization={"objects": {"table": (0.05, 0.05, 0.0)}},
    targets={"hand": "left", "lower": (0.28, 0.05, 0.70), "upper": (0.45, 0.40, 1.00)},
    timing={"velocity_scale": 0.7, "balance": 0.01},
)

with ExitStack() as stack:
    client = None
    if options.cluster != "none":  # pip install dask-jobqueue; its workers see the folder by the same name
        from dask_jobqueue import SLURMCluster
        from dask_jobqueue.local import LocalCluster
        from distributed import Client

        job_of_cluster = {"cores": 1, "processes": 1, "memory": "4GB", "walltime": "02:00:00"}
        if options.cluster == "slurm":
            cluster = SLURMCluster(queue=options.queue, n_workers=50, **job_of_cluster)
        else:  # the same script, without a queue
            cluster = LocalCluster(n_workers=2, **job_of_cluster)
        client = stack.enter_context(Client(stack.enter_context(cluster)))
        print(f"dashboard: {client.dashboard_link}")
    motions = datasets.make(
        job, options.output, workers=2, client=client, on_progress=lambda state: print(state.sentence())
    )

print(motions, motions.statuses)
solved = [row for row in motions if row["status"] == "solved"]
longest = max(solved, key=lambda row: row["duration"])
print(f"the longest of {len(solved)} takes {longest['duration']:.2f} s and has {len(longest['time'])} frames")

# Any program reads the files: each has its rows, and a group for each motion.
path = motions.store.path(motions.shards[0]["name"])
print(f"{path}: {pq.read_metadata(path).num_row_groups} motions")
found = datasets.check(options.output, sample=3)
print(found.report())

assert found.success
assert len(solved) > 0.7 * options.rows
assert sum(pq.read_metadata(motions.store.path(s["name"])).num_rows for s in motions.shards) == options.rows
