"""Trajectories: a value, timing within the robot's limits, an independent check, and files."""

from pepper_kin.trajectory.certificate import Certificate, LimitCheck, ScalarCheck
from pepper_kin.trajectory.check import check
from pepper_kin.trajectory.csv_file import read_csv, write_csv
from pepper_kin.trajectory.files import load, save
from pepper_kin.trajectory.make_safe import make_safe
from pepper_kin.trajectory.naoqi_file import NaoqiArguments, naoqi_arguments
from pepper_kin.trajectory.retiming import retime
from pepper_kin.trajectory.table_file import read_columns, read_table, write_table
from pepper_kin.trajectory.trajectory import Samples, State, Trajectory

__all__ = [
    "Certificate",
    "LimitCheck",
    "NaoqiArguments",
    "Samples",
    "ScalarCheck",
    "State",
    "Trajectory",
    "check",
    "load",
    "make_safe",
    "naoqi_arguments",
    "read_columns",
    "read_csv",
    "read_table",
    "retime",
    "save",
    "write_csv",
    "write_table",
]
