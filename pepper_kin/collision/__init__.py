"""Collision of the robot with itself and the world.

    Scene, SceneObject, AttachedObject        frozen: obstacles and attached objects
    HalfSpace, ConvexMesh, TriangleMesh, PointCloud   geometries of objects, in addition to those of `model`
    in_collision, clearance                   collision checks and minimum distances, of one state or many
    closest_pair, ClosestPair, contacts, Contact
    near_pairs, NearPairs                     all pairs within a distance, with gradients
    least_clearance, LeastClearance           the minimum distance along many states
    clearance_along, Clearance                the minimum distances to itself and to obstacles, separately
    approach_speed                            a bound on the speed at which bodies come nearer
    without_robot                             the points of a cloud that are not on the robot
    loads_of, load_torque, load_wrench        torques and wrenches of attached objects and payloads
    CollisionChecker, checker_for             one robot in one scene, reused by many calls

`scene=None` means the same in every package: there are no obstacles, but the robot is still checked against
itself.  Functions that can ignore collisions take `collisions=False`, and their reports state it.
"""

from pepper_kin.call_errors import name_options
from pepper_kin.collision.checker import CollisionChecker, checker_for
from pepper_kin.collision.contact import Clearance, ClosestPair, Contact
from pepper_kin.collision.least_clearance import (
    LeastClearance,
    approach_speed,
    clearance_along,
    least_clearance,
)
from pepper_kin.collision.loads import load_torque, load_wrench, loads_of
from pepper_kin.collision.near_pairs import NearPairs, near_pairs
from pepper_kin.collision.queries import clearance, closest_pair, contacts, in_collision, without_robot
from pepper_kin.collision.scene import Scene
from pepper_kin.collision.scene_object import AttachedObject, SceneObject
from pepper_kin.collision.solids import ConvexMesh, HalfSpace, PointCloud, TriangleMesh

__all__ = [
    "AttachedObject",
    "Clearance",
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
    "approach_speed",
    "checker_for",
    "clearance",
    "clearance_along",
    "closest_pair",
    "contacts",
    "in_collision",
    "least_clearance",
    "load_torque",
    "load_wrench",
    "loads_of",
    "near_pairs",
    "without_robot",
]

name_options(__name__)
