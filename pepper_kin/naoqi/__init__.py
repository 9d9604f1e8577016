"""NAOqi without a robot: its modules over the twin, for scripts and for clients.

Broker                                    a simulated Pepper with ALMotion, ALMemory, ...
Host                                      serves them to clients of `qi`
run_script, ScriptResult                  runs an unmodified script
run_behavior, BehaviorResult              runs a behavior of a Choregraphe project
RunLog                                    the log of a simulated body, as a run of the twin
coverage, coverage_summary                which methods are simulated
NaoqiError, NotSimulatedError, RefusedByRobotError   errors of the modules' calls
Robot, RobotState                         client of a robot: its state, and motions with a certificate
FollowOptions, RobotMotionResult, RobotMotionStatus   how a motion is followed, and its outcome
Mirror, states_of_run                     a twin that follows a robot's commands, live or recorded
RobotConnectionError, UnusableStateError   no connection; a measured state that cannot be used
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from pepper_kin.lazy_names import lazily

if TYPE_CHECKING:
    from pepper_kin.naoqi.behaviors import BehaviorResult, run_behavior
    from pepper_kin.naoqi.broker import Broker
    from pepper_kin.naoqi.coverage_table import Covered, coverage, coverage_summary
    from pepper_kin.naoqi.errors import (
        NaoqiError,
        NotSimulatedError,
        RefusedByRobotError,
        RobotConnectionError,
    )
    from pepper_kin.naoqi.following import FollowOptions, RobotMotionResult
    from pepper_kin.naoqi.host import Host
    from pepper_kin.naoqi.mirror import Mirror, states_of_run
    from pepper_kin.naoqi.robot import Robot
    from pepper_kin.naoqi.robot_state import RobotState
    from pepper_kin.naoqi.run_log import RunLog
    from pepper_kin.naoqi.scripts import ScriptResult, run_script
    from pepper_kin.supervision import RobotMotionStatus, UnusableStateError

__all__ = [
    "BehaviorResult",
    "Broker",
    "Covered",
    "FollowOptions",
    "Host",
    "Mirror",
    "NaoqiError",
    "NotSimulatedError",
    "RefusedByRobotError",
    "Robot",
    "RobotConnectionError",
    "RobotMotionResult",
    "RobotMotionStatus",
    "RobotState",
    "RunLog",
    "ScriptResult",
    "UnusableStateError",
    "coverage",
    "coverage_summary",
    "run_behavior",
    "run_script",
    "states_of_run",
]

__getattr__, __dir__ = lazily(__name__)
