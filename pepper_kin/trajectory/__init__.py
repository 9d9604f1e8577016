"""Trajectories: a value, timing within the robot's limits, an independent check, and files."""

from pepper_kin.trajectory.retime import retime
from pepper_kin.trajectory.trajectory import Samples, State, Trajectory

__all__ = ["Samples", "State", "Trajectory", "retime"]
