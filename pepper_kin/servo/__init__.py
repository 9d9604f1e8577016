"""Continuous inverse kinematics: one tick at a time, within every limit."""

from pepper_kin.servo.differential import DifferentialStep, differential_step
from pepper_kin.servo.servo import Servo
from pepper_kin.servo.state import ServoState, ServoStatus

__all__ = ["DifferentialStep", "Servo", "ServoState", "ServoStatus", "differential_step"]
