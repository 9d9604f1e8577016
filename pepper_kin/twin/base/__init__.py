"""The base: three omnidirectional wheels, their limits, and balance on them.

    OmniBase, BaseGeometry, pepper_base       wheel speeds and twists of the body
    BaseController, world_velocity            ramped commands within all limits
    Odometry, arc_between, arc_moved          the pose from the wheels' rotation
    BalanceMonitor, BalanceReport, BalanceEvent   forces on the wheels, and when one lifts
    simulate_tipping, TippingRun, TippingStatus, edge_moments, EdgeMoments
    BatchTipping                              tilts of many robots, from step to step

Poses on the floor are x, y [m] and yaw [rad].
"""

from pepper_kin.call_errors import name_options
from pepper_kin.kinematics.base_geometry import BaseGeometry, pepper_base
from pepper_kin.twin.base.balance import BalanceEvent, BalanceMonitor, BalanceReport
from pepper_kin.twin.base.controller import BaseController, world_velocity
from pepper_kin.twin.base.odometry import Odometry, arc_between, arc_moved
from pepper_kin.twin.base.omni_base import OmniBase
from pepper_kin.twin.base.tipping import (
    BatchTipping,
    EdgeMoments,
    TippingRun,
    TippingStatus,
    edge_moments,
    simulate_tipping,
)

__all__ = [
    "BalanceEvent",
    "BalanceMonitor",
    "BalanceReport",
    "BaseController",
    "BaseGeometry",
    "BatchTipping",
    "EdgeMoments",
    "Odometry",
    "OmniBase",
    "TippingRun",
    "TippingStatus",
    "arc_between",
    "arc_moved",
    "edge_moments",
    "pepper_base",
    "simulate_tipping",
    "world_velocity",
]

name_options(__name__)
