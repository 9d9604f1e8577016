"""The twin: the robot's dynamics with its servos, stepped through time."""

from pepper_kin.twin.actuators import ActuatorParameters, actuator_parameters
from pepper_kin.twin.integrator import Integrator
from pepper_kin.twin.run import Run, read_run
from pepper_kin.twin.twin import DivergedError, Twin, TwinState

__all__ = [
    "ActuatorParameters",
    "DivergedError",
    "Integrator",
    "Run",
    "Twin",
    "TwinState",
    "actuator_parameters",
    "read_run",
]
