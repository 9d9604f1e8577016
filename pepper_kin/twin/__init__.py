"""The twin: the robot's dynamics with its servos, stepped through time."""

from pepper_kin.twin.actuator_data import actuator_parameters
from pepper_kin.twin.actuators import ActuatorParameters
from pepper_kin.twin.batch_run import BatchRun
from pepper_kin.twin.batch_twin import TwinBatch
from pepper_kin.twin.gestures import GestureReport, replay
from pepper_kin.twin.hooks import SensorsHook, WorldHook
from pepper_kin.twin.integrator import Integrator
from pepper_kin.twin.paper_gestures import GESTURES, PaperGesture, paper_gesture, paper_inconsistencies
from pepper_kin.twin.push import Push
from pepper_kin.twin.real_time import Timing, serve
from pepper_kin.twin.recorder import Recorder
from pepper_kin.twin.recording import Recording, read_recording
from pepper_kin.twin.run import Run, read_run
from pepper_kin.twin.state import DivergedError, TwinState
from pepper_kin.twin.twin import Twin

__all__ = [
    "GESTURES",
    "ActuatorParameters",
    "BatchRun",
    "DivergedError",
    "GestureReport",
    "Integrator",
    "PaperGesture",
    "Push",
    "Recorder",
    "Recording",
    "Run",
    "SensorsHook",
    "Timing",
    "Twin",
    "TwinBatch",
    "TwinState",
    "WorldHook",
    "actuator_parameters",
    "paper_gesture",
    "paper_inconsistencies",
    "read_recording",
    "read_run",
    "replay",
    "serve",
]
