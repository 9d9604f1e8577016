"""NAOqi without a robot: its modules over the twin, for scripts and for clients.

Broker                                    a simulated Pepper with ALMotion, ALMemory, ...
Host                                      serves them to clients of `qi`
run_script, ScriptResult                  runs an unmodified script
run_behavior, BehaviorResult              runs a project of Choregraphe
RunLog                                    a run of the twin from what happened
coverage, coverage_summary                which methods are simulated
NaoqiError, NotSimulatedError, RefusedByRobotError   what its calls raise
Robot, RobotState                         a robot from outside: state, motions with a certificate
FollowOptions, RobotMotionResult, RobotMotionStatus   how a motion is followed, and what came of it
Mirror, states_of_run                     a twin beside a robot, live or recorded, and how they differ
RobotConnectionError, UnusableStateError   there is no connection; a state that cannot be used
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
