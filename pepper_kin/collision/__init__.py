"""Collision of the robot with itself and the world."""

from pepper_kin.collision.checker import ClosestPair, CollisionChecker, checker_for
from pepper_kin.collision.near_pairs import NearPairs, near_pairs
from pepper_kin.collision.queries import clearance, closest_pair, in_collision
from pepper_kin.collision.scene import Scene, SceneObject

__all__ = [
    "ClosestPair",
    "CollisionChecker",
    "NearPairs",
    "Scene",
    "SceneObject",
    "checker_for",
    "clearance",
    "closest_pair",
    "in_collision",
    "near_pairs",
]
