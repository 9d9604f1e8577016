"""Identification: comparison of robots' logs with the twin, fits to logs, and estimates of parameters.

    read_log, RobotLog                        commands and encoder readings
    replay, Replay, JointComparison           replay of commands on the twin, and its deviation from the robot
    compared, report_of                       numbers and table over several replays
    Stretch, Tolerance, KINDS                 deviations that no actuator explains, with their kinds
    fit_actuators, Fit, without_person        responses of the joints, with intervals over persons
    excitation_motion, Excitation             a motion that excites inertial parameters, within the limits
    estimate_stiffness, estimate_inertia, estimate_payload, Estimate   estimates from a recorded motion
    diagnose, Diagnosis, RunFault             faults in a log or a run; FAULTS, THRESHOLDS
    save_replay_picture, check_logs, LogCheck   picture and check of `pepper-kin check log`

The joint responses measured on a robot are `pepper_kin.twin.joint_response`.
"""

from pepper_kin.call_errors import name_options
from pepper_kin.identification.command import LogCheck, check_logs
from pepper_kin.identification.estimates import (
    Estimate,
    estimate_inertia,
    estimate_payload,
    estimate_stiffness,
)
from pepper_kin.identification.excitation import Excitation, excitation_motion
from pepper_kin.identification.fit import Fit, fit_actuators, without_person
from pepper_kin.identification.log_file import read_log
from pepper_kin.identification.picture import save_replay_picture
from pepper_kin.identification.replay import JointComparison, Replay, compared, replay, report_of
from pepper_kin.identification.robot_log import RobotLog
from pepper_kin.identification.run_monitor import FAULTS, THRESHOLDS, Diagnosis, RunFault, diagnose
from pepper_kin.identification.stretches import KINDS, Stretch, Tolerance

__all__ = [
    "FAULTS",
    "KINDS",
    "THRESHOLDS",
    "Diagnosis",
    "Estimate",
    "Excitation",
    "Fit",
    "JointComparison",
    "LogCheck",
    "Replay",
    "RobotLog",
    "RunFault",
    "Stretch",
    "Tolerance",
    "check_logs",
    "compared",
    "diagnose",
    "estimate_inertia",
    "estimate_payload",
    "estimate_stiffness",
    "excitation_motion",
    "fit_actuators",
    "read_log",
    "replay",
    "report_of",
    "save_replay_picture",
    "without_person",
]

name_options(__name__)
