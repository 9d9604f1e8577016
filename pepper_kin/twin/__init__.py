"""The twin: simulation of the robot's dynamics with its servos.

    Twin, TwinState, Run, RunStatus, load_run         one robot, and the log of a run
    TwinBatch, BatchRun                       thousands of robots, each with its own parameters
    Push, ActuatorParameters, actuator_parameters
    JointResponse, joint_response             measured response of joints to targets of `setAngles`
    run_real_time, Timing                     steps synchronized with the wall clock
    Recorder, Recording, load_recording       complete recordings on disk, resumable
    Integrator, DivergedError, WorldHook, SensorsHook     for your own worlds and sensors

Its packages: `world` (contacts and free bodies), `sensors`, `base` (wheels, odometry, tipping).
"""

from pepper_kin.lazy_names import lazily
from pepper_kin.twin.actuator_data import actuator_parameters
from pepper_kin.twin.actuators import ActuatorParameters
from pepper_kin.twin.batch_run import BatchRun
from pepper_kin.twin.batch_twin import TwinBatch
from pepper_kin.twin.hooks import SensorsHook, WorldHook
from pepper_kin.twin.integrator import Integrator
from pepper_kin.twin.joint_response import JointResponse, joint_response
from pepper_kin.twin.push import Push
from pepper_kin.twin.real_time import Timing, run_real_time
from pepper_kin.twin.recorder import Recorder
from pepper_kin.twin.recording import Recording, load_recording
from pepper_kin.twin.run import Run, load_run
from pepper_kin.twin.run_status import RunStatus
from pepper_kin.twin.state import DivergedError, TwinState
from pepper_kin.twin.twin import Twin

__all__ = [
    "ActuatorParameters",
    "BatchRun",
    "DivergedError",
    "Integrator",
    "JointResponse",
    "Push",
    "Recorder",
    "Recording",
    "Run",
    "RunStatus",
    "SensorsHook",
    "Timing",
    "Twin",
    "TwinBatch",
    "TwinState",
    "WorldHook",
    "actuator_parameters",
    "joint_response",
    "load_recording",
    "load_run",
    "run_real_time",
]

__getattr__, __dir__ = lazily(
    __name__,
    {
        "base": "base",
        "sensors": "sensors",
        "world": "world",
    },
)
