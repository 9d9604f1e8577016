"""Collision of the robot with itself and the world."""

from pepper_kin.collision.checker import CollisionChecker, checker_for
from pepper_kin.collision.contact import ClosestPair, Contact
from pepper_kin.collision.least_clearance import LeastClearance, least_clearance
from pepper_kin.collision.near_pairs import NearPairs, near_pairs
from pepper_kin.collision.queries import clearance, closest_pair, contacts, in_collision, without_robot
from pepper_kin.collision.scene import Scene
from pepper_kin.collision.scene_object import AttachedObject, SceneObject
from pepper_kin.collision.solids import ConvexMesh, HalfSpace, PointCloud, TriangleMesh

__all__ = [
    "AttachedObject",
    "ClosestPair",
    "CollisionChecker",
    "Contact",
    "ConvexMesh",
    "HalfSpace",
    "LeastClearance",
    "NearPairs",
    "PointCloud",
    "Scene",
    "SceneObject",
    "TriangleMesh",
    "checker_for",
    "clearance",
    "closest_pair",
    "contacts",
    "in_collision",
    "least_clearance",
    "near_pairs",
    "without_robot",
]
