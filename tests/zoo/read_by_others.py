"""What rosbags and Drake read of ours: `python tests/zoo/read_by_others.py rosbags|drake COUNT [SEED]`.

They are installed for this alone (`pip install rosbags drake`), and no part of continuous integration.
"""

import re
import sys
import tempfile
import warnings
from collections import Counter
from pathlib import Path

import numpy as np
from odd_robots import odd_robot, write_meshes
from test_exports import postures

sys.path.insert(0, str(Path(__file__).parents[1] / "ros_messages"))  # random_messages

import pepper_kin as pk
from pepper_kin.exceptions import ModelError, ModelWarning

TOLERANCE = 1e-9


def read_bags(count, rng):
    """Count bags of random types that rosbags reads as they are, and that are read as rosbags writes them."""
    from random_messages import random_message
    from rosbags.highlevel import AnyReader
    from rosbags.rosbag2 import StoragePlugin, Writer
    from test_recordings import random_definition, values_of

    from pepper_kin.ros_messages import Bag, BagWriter
    from pepper_kin.ros_messages.schemas import schema_type

    def plain(theirs, ours):
        """Return what rosbags has read, by the fields of our message, which it keeps in order."""
        found = {}
        for place, field in zip(list(theirs.__dataclass_fields__), ours.definition.fields, strict=False):
            value, own = getattr(theirs, place), getattr(ours, field.attribute)
            if field.nested and field.array is None:
                value = plain(value, own)
            elif field.nested:
                value = [plain(*pair) for pair in zip(value, own, strict=True)]
            value = value.tolist() if isinstance(value, np.ndarray) else value
            if field.base in ("byte", "char"):  # ROS 2 has 0 to 255, as mcap_ros2 reads; rosbags -128 to 127
                value = np.mod(value, 256).tolist()
            found[field.name] = value
        return found

    counts = Counter()
    for case in range(count):
        kind = schema_type("odd/msg/Whole", random_definition(rng))
        messages = [random_message(kind, rng) for _ in range(3)]
        wanted = [values_of(one) for one in messages]
        with tempfile.TemporaryDirectory() as place:
            ours = Path(place) / "ours.mcap"
            with BagWriter(ours) as bag:
                for time, message in enumerate(messages):
                    bag.write("/odd", message, time)
            storage = (StoragePlugin.MCAP, StoragePlugin.SQLITE3)[case % 2]
            theirs = Path(place) / "theirs"
            with AnyReader([ours]) as reader, Writer(theirs, version=9, storage_plugin=storage) as writer:
                store, found = reader.typestore, []
                to = writer.add_connection("/odd", reader.connections[0].msgtype, typestore=store)
                for connection, time, raw in reader.messages():
                    message = reader.deserialize(raw, connection.msgtype)
                    found.append(plain(message, messages[len(found)]))
                    writer.write(to, time, store.serialize_cdr(message, connection.msgtype))
            counts["ours, read by rosbags"] += found == wanted
            again = [values_of(one.message) for one in Bag(theirs).messages()]
            counts[f"written by rosbags as {storage.name}, read by us"] += again == wanted
    return counts


def read_robots(count, rng):
    """Count exports that Drake reads as the same robot: frames, and torques of gravity, to 1e-9."""
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import MultibodyPlant

    counts = Counter()
    folder = Path(tempfile.mkdtemp())
    write_meshes(folder)
    for _ in range(count):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ModelWarning)
            try:
                pepper = pk.load_robot(odd_robot(rng, folder).text)
            except ModelError:
                continue
            for format, ending in (("urdf", "urdf"), ("sdf", "sdf"), ("mjcf", "xml")):
                try:
                    text = pepper.export(format)
                except ModelError:
                    continue
                plant = MultibodyPlant(0.0)
                try:
                    Parser(plant).AddModelsFromString(text, ending)
                    base = pepper.document.root
                    if format == "urdf" and base != "world":
                        plant.WeldFrames(plant.world_frame(), plant.GetFrameByName(base))
                    plant.Finalize()
                    worst = difference(pepper, plant, rng)
                except RuntimeError as error:
                    words = re.sub(
                        ".* has no inertial", "a body has no inertial", str(error).split("error:")[-1].strip()
                    )
                    counts[f"{format}: refused: {words[:70]}"] += 1
                    continue
                counts[f"{format}: {'the same' if worst < TOLERANCE else 'DIFFERS'}"] += 1
    return counts


def difference(pepper, plant, rng):
    """Return the greatest difference of poses and of torques of gravity in a random posture."""
    q, worst = postures(pepper, rng)[0], 0.0
    context, rows = plant.CreateDefaultContext(), []
    positions = np.zeros(plant.num_positions())
    children = {
        joint.name: joint.child for joint in pepper.document.joints
    }  # names of joints may change in SDF
    joints = {plant.get_joint(i).child_body().name(): plant.get_joint(i) for i in plant.GetJointIndices()}
    for name, value in zip(list(pepper.inner_model.names)[1:], pepper.to_full(q), strict=True):
        joint = joints[children[name]]
        positions[joint.position_start()] = value
        rows.append(joint.velocity_start())
    plant.SetPositions(context, positions)
    for link in pepper.link_names:
        if plant.HasBodyNamed(link):
            pose = plant.GetBodyByName(link).EvalPoseInWorld(context).GetAsMatrix4()
            worst = max(worst, np.abs(pose - pk.kinematics.frame_pose(pepper, q, link)).max())
    torque = -plant.CalcGravityGeneralizedForces(context)[rows]
    zero = np.zeros(pepper.n)
    ours = pk.dynamics.inverse_dynamics(pepper, q, zero, zero)
    return max(worst, np.abs(pepper.full_map.T @ torque - ours).max())


if __name__ == "__main__":
    examine = {"rosbags": read_bags, "drake": read_robots}[sys.argv[1]]
    for what, number in sorted(
        examine(int(sys.argv[2]), np.random.default_rng(int((sys.argv[3:] or [0])[0]))).items()
    ):
        print(f"{number:6}  {what}")
