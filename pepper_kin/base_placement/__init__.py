"""Base placement: search for base poses from which targets are reached.

    place_base, PlacementResult, PlacementStatus, Placement   the best base poses and all trials
    PlacementWeights, PlacementTerms          weights and terms of the score
    placement_map, PlacementMap               the score of every cell of the floor

Targets are in world coordinates; a robot with a fixed base can be placed, too.
"""

from pepper_kin.base_placement.place_base import place_base
from pepper_kin.base_placement.placement_map import PlacementMap, placement_map
from pepper_kin.base_placement.result import Placement, PlacementResult, PlacementStatus
from pepper_kin.base_placement.score import PlacementTerms, PlacementWeights
from pepper_kin.call_errors import name_options

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

name_options(__name__)
