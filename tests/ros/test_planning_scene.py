"""The planning scene as MoveIt's clients change it, against the body's scene and what its sensors meet."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.collision import contacts, in_collision
from pepper_kin.naoqi.body import Body
from pepper_kin.ros.message_parts import POINT, pose_message
from pepper_kin.ros.node import RobotNode
from pepper_kin.ros.transports.local import LocalTransport
from pepper_kin.ros_messages import message_type

OBJECT = message_type("moveit_msgs/msg/CollisionObject")
ATTACHED = message_type("moveit_msgs/msg/AttachedCollisionObject")
SCENE = message_type("moveit_msgs/msg/PlanningScene")
SOLID = message_type("shape_msgs/msg/SolidPrimitive")


@pytest.fixture
def node():
    with LocalTransport() as transport, RobotNode(Body(real_time=False), transport, cameras=()) as made:
        yield made


def solid(kind, *size):
    return SOLID(type=getattr(SOLID, kind), dimensions=list(size))


def thing(name, operation="ADD", shapes=(), place=(0, 0, 0), frame="world", at=None):
    """A collision object; its shapes lie along x, half a meter apart."""
    poses = [pose_message(pk.pose((0.5 * k, 0, 0))) for k in range(len(shapes))] if at is None else at
    made = OBJECT(
        id=name, operation=getattr(OBJECT, operation), primitives=list(shapes), primitive_poses=poses
    )
    made.header.frame_id, made.pose = frame, pose_message(pk.pose(place))
    return made


def apply(node, *objects, attached=(), is_diff=True, **more):
    scene = SCENE(is_diff=is_diff, **more)
    scene.world.collision_objects = list(objects)
    scene.robot_state.attached_collision_objects = list(attached)
    request = message_type("moveit_msgs/srv/ApplyPlanningScene_Request")(scene=scene)
    return node.transport.call_service(
        "/apply_planning_scene", "moveit_msgs/srv/ApplyPlanningScene", request
    ).success


def places(node):
    return {k: one.transform_object_to_world[:3, 3].tolist() for k, one in node.body.scene.objects.items()}


def nearest(node):
    heard = []
    with node.transport.subscribe("/laser", "sensor_msgs/msg/LaserScan", pk.ros.QoS(), heard.append):
        node.body.time.sleep(0.25)
        node.transport.flush(60.0)
    return min(value for value in heard[-1].ranges if value > 0.0)


def test_objects_are_added_moved_extended_and_removed(node):
    far = nearest(node)
    assert apply(node, thing("wall", shapes=[solid("BOX", 0.1, 2.0, 1.0)], place=(1.05, 0, 0.5)))
    assert nearest(node) == pytest.approx(1.0, abs=0.05)  # the twin's lasers meet it
    assert apply(node, thing("wall", "MOVE", place=(1.55, 0, 0.5)))
    assert nearest(node) == pytest.approx(1.5, abs=0.05)
    assert apply(node, thing("wall", "APPEND", [solid("SPHERE", 0.1)], place=(1.55, 0, 0.5)))
    assert places(node) == {"wall/0": [1.55, 0, 0.5], "wall/1": [1.55, 0, 0.5]}
    assert apply(
        node, thing("wall", shapes=[solid("CYLINDER", 0.4, 0.1), solid("SPHERE", 0.2)], place=(2, 0, 0))
    )
    kinds = [one.geometry for one in node.body.scene.objects.values()]
    assert kinds == [pk.model.Cylinder(0.1, 0.4), pk.model.Sphere(0.2)]
    assert places(node) == {"wall/0": [2, 0, 0], "wall/1": [2.5, 0, 0]}
    assert apply(node, thing("wall", "REMOVE"))
    assert (places(node), nearest(node)) == ({}, far)


def test_frames_of_the_robot_count_where_it_is(node):
    node.body.place_base(np.array([1.0, 2.0, np.pi / 2]))
    assert apply(
        node, thing("cup", shapes=[solid("SPHERE", 0.05)], place=(0.5, 0, 0.8), frame="base_footprint")
    )
    assert places(node)["cup"] == pytest.approx([1.0, 2.5, 0.8])
    assert not apply(node, thing("cup", shapes=[solid("SPHERE", 0.05)], frame="nowhere"))


def test_what_hangs_on_a_hand_moves_with_it(node):
    body = node.body
    hand = body.frame_pose("r_gripper", True)[:3, 3]
    ball = thing("ball", shapes=[solid("SPHERE", 0.03)], place=hand)
    assert apply(node, attached=[ATTACHED(link_name="r_gripper", object=ball, weight=0.2)])
    assert (places(node), body.scene.attached["ball"].mass) == ({}, 0.2)
    node.transport.advertise("/joint_angles", "naoqi_bridge_msgs/msg/JointAnglesWithSpeed").publish(
        message_type("naoqi_bridge_msgs/msg/JointAnglesWithSpeed")(
            joint_names=["RShoulderPitch"], joint_angles=[0.3], speed=0.5
        )
    )
    node.transport.flush(60.0)
    body.time.sleep(3.0)
    there = body.frame_pose("r_gripper", True)[:3, 3]
    assert np.linalg.norm(there - hand) > 0.1
    told = node.planning_scene.message().robot_state.attached_collision_objects[0]
    p = told.object.pose.position
    at = np.array([p.x, p.y, p.z]) + [
        getattr(told.object.primitive_poses[0].position, axis) for axis in "xyz"
    ]
    np.testing.assert_allclose(at, there, atol=2e-3)
    assert apply(node, attached=[ATTACHED(object=thing("ball", "REMOVE"))])
    np.testing.assert_allclose(places(node)["ball"], there, atol=2e-3)


def test_a_message_is_taken_whole_or_not_at_all(node):
    good, cone = thing("good", shapes=[solid("SPHERE", 0.1)]), thing("cone", shapes=[solid("CONE", 0.2, 0.1)])
    nan = thing("nan", shapes=[solid("BOX", 0.1, float("nan"), 0.1)])
    for wrong in (cone, nan, thing("", shapes=[solid("SPHERE", 0.1)]), thing("none", "MOVE"), thing("empty")):
        assert not apply(node, good, wrong)
        assert node.body.scene is None
    twice = thing("twice", shapes=[solid("SPHERE", 0.1)] * 2, at=[pose_message(np.eye(4))])
    assert not apply(node, twice)
    assert not apply(node, attached=[ATTACHED(link_name="r_gripper", object=thing("unknown"))])
    assert apply(node, good)
    assert not apply(node, attached=[ATTACHED(link_name="no_link", object=thing("good"))])
    assert list(node.body.scene.objects) == ["good"]


def test_what_is_allowed_may_touch(node):
    body = node.body
    head = body.frame_pose("Head", True)[:3, 3]
    assert apply(node, thing("hat", shapes=[solid("SPHERE", 0.05)], place=head))
    assert in_collision(body.pepper, body.configuration(True), body.scene)
    entry = message_type("moveit_msgs/msg/AllowedCollisionEntry")
    touching = contacts(body.pepper, body.configuration(True), body.scene)
    links = sorted({name for contact in touching for name in contact.names})
    assert "hat" in links
    matrix = message_type("moveit_msgs/msg/AllowedCollisionMatrix")(
        entry_names=links, entry_values=[entry(enabled=[a != b for b in links]) for a in links]
    )
    assert apply(node, allowed_collision_matrix=matrix)
    assert not in_collision(body.pepper, body.configuration(True), body.scene)
    told = node.planning_scene.message().allowed_collision_matrix
    assert sorted(told.entry_names) == links


def test_what_a_node_tells_makes_the_same_scene_elsewhere(node):
    corners = [POINT(x=x, y=y, z=z) for x, y, z in ((0, 0, 0), (0.2, 0, 0), (0, 0.2, 0), (0, 0, 0.2))]
    faces = [
        message_type("shape_msgs/msg/MeshTriangle")(vertex_indices=f)
        for f in ((0, 2, 1), (0, 1, 3), (1, 2, 3))
    ]
    mesh = thing("mesh", place=(0, 3, 0))
    mesh.meshes = [message_type("shape_msgs/msg/Mesh")(vertices=corners, triangles=faces)]
    shelf = thing(
        "shelf", shapes=[solid("BOX", 0.1, 0.2, 0.3), solid("CYLINDER", 0.2, 0.1)], place=(2, 1, 0.5)
    )
    assert apply(node, mesh, shelf)
    kinds = message_type("moveit_msgs/srv/GetPlanningScene_Request")
    told = node.transport.call_service(
        "/get_planning_scene", "moveit_msgs/srv/GetPlanningScene", kinds()
    ).scene
    heard = []
    node.transport.listen("/monitored_planning_scene", None, heard.append)
    with LocalTransport() as transport, RobotNode(Body(real_time=False), transport, cameras=()) as other:
        assert other.planning_scene.take(told)
        assert other.body.scene.equals(node.body.scene)
    assert apply(node, is_diff=False)  # a scene that is not a change is all that there is
    assert node.body.scene.objects == {}
