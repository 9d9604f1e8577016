"""Trajectories: a value, timing within limits, an independent check, and files of many programs."""

from pepper_kin.trajectory.binding import Binding, binding_limits
from pepper_kin.trajectory.certificate import Certificate, LimitCheck, ScalarCheck
from pepper_kin.trajectory.check import check
from pepper_kin.trajectory.choregraphe import naoqi_timeline, read_choregraphe, read_naoqi_export
from pepper_kin.trajectory.csv_file import read_csv, write_csv
from pepper_kin.trajectory.excess import Excess, find_excesses
from pepper_kin.trajectory.files import load, save
from pepper_kin.trajectory.key_curve import Handle, Key
from pepper_kin.trajectory.make_safe import make_safe
from pepper_kin.trajectory.naoqi_file import NaoqiArguments, naoqi_arguments
from pepper_kin.trajectory.online import OnlineMotion
from pepper_kin.trajectory.phase_plane import PhasePlane, phase_plane
from pepper_kin.trajectory.plot import plot
from pepper_kin.trajectory.retiming import retime
from pepper_kin.trajectory.table_file import read_columns, read_table, write_table
from pepper_kin.trajectory.timeline import Curve, ImportedMotion, Timeline, import_timeline
from pepper_kin.trajectory.trajectory import Samples, State, Trajectory

__all__ = [
    "Binding",
    "Certificate",
    "Curve",
    "Excess",
    "Handle",
    "ImportedMotion",
    "Key",
    "LimitCheck",
    "NaoqiArguments",
    "OnlineMotion",
    "PhasePlane",
    "Samples",
    "ScalarCheck",
    "State",
    "Timeline",
    "Trajectory",
    "binding_limits",
    "check",
    "find_excesses",
    "import_timeline",
    "load",
    "make_safe",
    "naoqi_arguments",
    "naoqi_timeline",
    "phase_plane",
    "plot",
    "read_choregraphe",
    "read_columns",
    "read_csv",
    "read_naoqi_export",
    "read_table",
    "retime",
    "save",
    "write_csv",
    "write_table",
]
