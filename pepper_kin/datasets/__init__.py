"""Datasets made by many processes or machines, no row lost or doubled: `pip install pepper_kin[datasets]`.

    DatasetJob, load_job          specification of a dataset, as a value and as a YAML file
    make, resume, Progress        generation by processes of this machine, or on a Dask cluster
    check, DatasetCheck           proof that no row is missing or double, with rows recomputed
    open, Dataset                 rows as NumPy arrays, tables of Arrow, pandas and polars
    run_shard                     rows of one file: a pure function of the job
    Column, Moments               description of a column; statistics of parts, joined
    LeRobotWriter, Feature        LeRobotDataset v3.0 of any frames
    KINDS, FORMATS                kinds of rows and file formats of jobs

`pepper-kin dataset make | check | show | resume` does the same from a job's file.
"""

# ruff: noqa: E402 -- a missing package is reported first

from pepper_kin.call_errors import name_options
from pepper_kin.exceptions import optional

optional("pyarrow", extra="datasets", need="pepper_kin.datasets")

from pepper_kin.datasets.checking import DatasetCheck, check
from pepper_kin.datasets.columns import Column, Moments
from pepper_kin.datasets.dataset import Dataset, open_dataset
from pepper_kin.datasets.job import FORMATS, KINDS, DatasetJob, load_job
from pepper_kin.datasets.lerobot import Feature, LeRobotWriter
from pepper_kin.datasets.making import Progress, make, resume
from pepper_kin.datasets.shard import run_shard

open = open_dataset
"""Short name of `open_dataset`."""

__all__ = [
    "FORMATS",
    "KINDS",
    "Column",
    "Dataset",
    "DatasetCheck",
    "DatasetJob",
    "Feature",
    "LeRobotWriter",
    "Moments",
    "Progress",
    "check",
    "load_job",
    "make",
    "open",
    "resume",
    "run_shard",
]

name_options(__name__)
