"""Files of motions: trajectories in six formats, tables over time, animations of Choregraphe and NAOqi.

    save, load                                trajectories: CSV, NPZ, JSON, ROS 2 YAML, NAOqi script, MCAP
    save_table, load_table, load_columns      columns over time as CSV, and their meaning
    read_joint_states                         joint states of ROS, from MCAP or CSV
    read_choregraphe, read_naoqi_export       animations from other programs, as timelines
    naoqi_timeline                            lists for NAOqi, as a timeline
    naoqi_arguments, NaoqiArguments           a motion as arguments of ALMotion.angleInterpolationBezier
    ros_points, MotionPoints                  a motion as the points of a JointTrajectory

Functions that save take the object first and the path last; every file is written atomically.
"""

from pepper_kin.call_errors import name_options
from pepper_kin.files.choregraphe import naoqi_timeline, read_choregraphe, read_naoqi_export
from pepper_kin.files.formats import load, save
from pepper_kin.files.joint_states import read_joint_states
from pepper_kin.files.motion_points import MotionPoints
from pepper_kin.files.naoqi_file import NaoqiArguments, naoqi_arguments
from pepper_kin.files.ros_file import ros_points
from pepper_kin.files.table_file import load_columns, load_table, save_table

__all__ = [
    "MotionPoints",
    "NaoqiArguments",
    "load",
    "load_columns",
    "load_table",
    "naoqi_arguments",
    "naoqi_timeline",
    "read_choregraphe",
    "read_joint_states",
    "read_naoqi_export",
    "ros_points",
    "save",
    "save_table",
]

name_options(__name__)
