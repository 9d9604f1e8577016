"""Continuous inverse kinematics: one tick at a time, within every limit.

    Servo, ServoState, ServoStatus            follows targets and twists that move while it runs
    differential_step, DifferentialStep       one tick as a plain function

The caller keeps time: a tick is one call of `step`.
"""

from pepper_kin.servo.differential import DifferentialStep, differential_step
from pepper_kin.servo.servo import Servo
from pepper_kin.servo.state import ServoState, ServoStatus

__all__ = ["DifferentialStep", "Servo", "ServoState", "ServoStatus", "differential_step"]
