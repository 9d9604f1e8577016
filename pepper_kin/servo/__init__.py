"""Continuous inverse kinematics: one tick at a time, within every limit.

    Servo, ServoState, ServoStatus            follows targets and twists that may change at every tick
    differential_step, DifferentialStep       one tick as a plain function

The caller is responsible for real time: a tick is one call of `step`.
"""

from pepper_kin.call_errors import name_options
from pepper_kin.servo.differential import DifferentialStep, differential_step
from pepper_kin.servo.servo import Servo
from pepper_kin.servo.state import ServoState, ServoStatus

__all__ = ["DifferentialStep", "Servo", "ServoState", "ServoStatus", "differential_step"]

name_options(__name__)
