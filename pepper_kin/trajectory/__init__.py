"""Trajectories: a value, timing within the robot's limits, an independent check, and files."""

from pepper_kin.trajectory.binding import Binding, binding_limits
from pepper_kin.trajectory.certificate import Certificate, LimitCheck, ScalarCheck
from pepper_kin.trajectory.check import check
from pepper_kin.trajectory.csv_file import read_csv, write_csv
from pepper_kin.trajectory.online import OnlineMotion
from pepper_kin.trajectory.retiming import retime
from pepper_kin.trajectory.table_file import read_columns, read_table, write_table
from pepper_kin.trajectory.trajectory import Samples, State, Trajectory

__all__ = [
    "Binding",
    "Certificate",
    "LimitCheck",
    "OnlineMotion",
    "Samples",
    "ScalarCheck",
    "State",
    "Trajectory",
    "binding_limits",
    "check",
    "read_columns",
    "read_csv",
    "read_table",
    "retime",
    "write_csv",
    "write_table",
]
