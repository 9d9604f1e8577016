"""Files of motions: trajectories in six formats, tables over time, animations of Choregraphe and NAOqi."""

from pepper_kin.files.choregraphe import naoqi_timeline, read_choregraphe, read_naoqi_export
from pepper_kin.files.csv_file import read_csv, write_csv
from pepper_kin.files.formats import load, save
from pepper_kin.files.joint_states import read_joint_states
from pepper_kin.files.naoqi_file import NaoqiArguments, naoqi_arguments
from pepper_kin.files.table_file import read_columns, read_table, write_table

__all__ = [
    "NaoqiArguments",
    "load",
    "naoqi_arguments",
    "naoqi_timeline",
    "read_choregraphe",
    "read_columns",
    "read_csv",
    "read_joint_states",
    "read_naoqi_export",
    "read_table",
    "save",
    "write_csv",
    "write_table",
]
