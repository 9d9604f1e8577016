"""Base placement: where to stand so that targets are best reached.

    place_base, PlacementResult, PlacementStatus, Placement   the best places and what was tried
    PlacementWeights, PlacementTerms          what makes a place good
    placement_map, PlacementMap               the score of every cell of the floor

Targets are given in the world; a robot with a fixed base is moved to them all the same.
"""

from pepper_kin.base_placement.place_base import place_base
from pepper_kin.base_placement.placement_map import PlacementMap, placement_map
from pepper_kin.base_placement.result import Placement, PlacementResult, PlacementStatus
from pepper_kin.base_placement.score import PlacementTerms, PlacementWeights

__all__ = [
    "Placement",
    "PlacementMap",
    "PlacementResult",
    "PlacementStatus",
    "PlacementTerms",
    "PlacementWeights",
    "place_base",
    "placement_map",
]
