"""Data sets made by many processes or machines, no row lost or doubled: `pip install pepper_kin[datasets]`.

    DatasetJob, load_job          what a data set shall hold, as a value and as a YAML file
    make, resume, Progress        on processes of this machine, or on a Dask cluster
    check, DatasetCheck           the proof that no row is missing or double, with rows recomputed
    open, Dataset                 rows as NumPy's arrays, tables of Arrow, pandas and polars
    run_shard                     the rows of one file: a pure function of the job
    Column, Moments               what a column holds; statistics of parts, joined
    LeRobotWriter, Feature        LeRobotDataset v3.0 of any frames
    KINDS, FORMATS                of jobs

`pepper-kin dataset make | check | show | resume` does the same from a job's file.
"""

# ruff: noqa: E402 -- what is not installed is said first

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
"""`open_dataset`, by a shorter name."""

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
