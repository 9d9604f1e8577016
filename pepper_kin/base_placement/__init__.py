"""Base placement: where to stand so that targets are best reached.

place_base, PlacementResult, PlacementStatus, Placement   the best places and what was tried
PlacementWeights, PlacementTerms          what makes a place good
floor_map, FloorMap                       the score of every cell of the floor
"""

from pepper_kin.base_placement.floor_map import FloorMap, floor_map
from pepper_kin.base_placement.place_base import place_base
from pepper_kin.base_placement.result import Placement, PlacementResult, PlacementStatus
from pepper_kin.base_placement.score import PlacementTerms, PlacementWeights

__all__ = [
    "FloorMap",
    "Placement",
    "PlacementResult",
    "PlacementStatus",
    "PlacementTerms",
    "PlacementWeights",
    "floor_map",
    "place_base",
]
