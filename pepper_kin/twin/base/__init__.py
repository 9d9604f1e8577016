"""The base: three omnidirectional wheels, what they can do, and whether the robot stays on them."""

from pepper_kin.twin.base.balance import BalanceEvent, BalanceMonitor, BalanceReport
from pepper_kin.twin.base.controller import BaseController, world_velocity
from pepper_kin.twin.base.geometry import BaseGeometry, pepper_base
from pepper_kin.twin.base.odometry import Odometry, arc_between, arc_moved
from pepper_kin.twin.base.omni_base import OmniBase
from pepper_kin.twin.base.tipping import EdgeMoments, TippingRun, edge_moments, simulate_tipping

__all__ = [
    "BalanceEvent",
    "BalanceMonitor",
    "BalanceReport",
    "BaseController",
    "BaseGeometry",
    "EdgeMoments",
    "Odometry",
    "OmniBase",
    "TippingRun",
    "arc_between",
    "arc_moved",
    "edge_moments",
    "pepper_base",
    "simulate_tipping",
    "world_velocity",
]
