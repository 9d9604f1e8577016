"""Odd but valid robots in the exports: what other engines read is the same robot, or it was refused by name.

MuJoCo reads MJCF, Pinocchio the URDF, and `sdf_model` SDF: frames and the torques of gravity agree to 1e-9,
limits and friction as well.
"""

import math
import warnings

import mujoco
import numpy as np
import pinocchio
import pytest
from odd_robots import odd_robot, write_meshes
from sdf_model import SdfModel

import pepper_kin as pk
from pepper_kin.exceptions import ModelError, ModelWarning
from pepper_kin.model.export_inertia import TINY_INERTIA
from pepper_kin.model.urdf_version import to_version_1_0
from pepper_kin.model.xml_source import parse_xml

TOLERANCE = 1e-9


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("zoo meshes")
    write_meshes(place)
    return place


def postures(pepper, rng):
    low = np.minimum(np.maximum(pepper.lower_limits, -3.0), pepper.upper_limits)  # also of a range beyond
    high = np.maximum(np.minimum(pepper.upper_limits, 3.0), low)
    return rng.uniform(low, high, (2, pepper.n))


def gravity(pepper, q):
    zero = np.zeros(pepper.n)
    return pk.dynamics.inverse_dynamics(pepper, q, zero, zero)


def exported(made, pepper, format):
    """Return the text of an export, or None where it was refused, which the robot must give a reason for."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            text = pepper.export(format)
        except ModelError as error:
            text, reason = None, f"{format}: {error}"
    if text is None:
        assert format in made.refusals, reason
        return None
    if format == "mjcf":
        told = " ".join(str(w.message) for w in caught if issubclass(w.category, ModelWarning))
        assert all(name in told for name in made.unread), (made.unread, told)
    return text


def mjcf_differences(pepper, text, rng):
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    names = list(pepper.inner_model.names)[1:]
    rows = [model.joint(name).qposadr[0] for name in names]
    for q in postures(pepper, rng):
        data.qpos[rows] = pepper.to_full(q)
        mujoco.mj_forward(model, data)
        for link in pepper.link_names:
            if link == pepper.document.root:
                continue
            body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, link) >= 0
            item = data.body(link) if body else data.site(link)
            pose = pk.kinematics.frame_pose(pepper, q, link)
            yield "pose", np.abs(item.xpos - pose[:3, 3]).max()
            yield "pose", np.abs(item.xmat.reshape(3, 3) - pose[:3, :3]).max()
        yield "gravity", np.abs(pepper.full_map.T @ data.qfrc_bias[rows] - gravity(pepper, q)).max()
    for joint in (j for j in pepper.document.joints if j.type != "fixed"):
        found = model.joint(joint.name)
        assert bool(found.limited[0]) == math.isfinite(joint.upper), joint.name
        if math.isfinite(joint.upper):
            yield "limits", np.abs(found.range - (joint.lower, joint.upper)).max()
        follows = joint.mimic is not None
        yield "friction", abs(model.dof_frictionloss[found.dofadr[0]] - joint.friction)
        yield "friction", max(joint.damping - model.dof_damping[found.dofadr[0]], 0.0)
        if not follows:
            yield "friction", max(model.dof_damping[found.dofadr[0]] - joint.damping, 0.0)
    for name, effort in zip(pepper.joint_names, pepper.effort_limits, strict=True):
        joint, limited = model.joint(name).id, math.isfinite(effort) and effort > 0
        assert bool(model.jnt_actfrclimited[joint]) == limited, name
        if limited:
            yield "limits", np.abs(model.jnt_actfrcrange[joint] - (-effort, effort)).max()


def sdf_differences(pepper, text, rng):
    model = SdfModel(text)
    names = {}
    for joint in model.joints.values():
        names[joint.find("child").text] = joint.get("name")
    of_joint = {j.name: names[j.child] for j in pepper.document.joints if j.type != "fixed"}
    inside = model.model.findall("link") + model.model.findall("joint") + model.model.findall("frame")
    listed = [element.get("name") for element in inside]
    assert len(set(listed)) == len(listed)
    for kind, known in (("visual", pepper.visual_shapes), ("collision", pepper.collision_shapes)):
        assert len(list(model.model.iter(kind))) == len(known)
    for link in model.links.values():
        for kind in ("visual", "collision"):
            shapes = [shape.get("name") for shape in link.findall(kind)]
            assert len(set(shapes)) == len(shapes)

    def values(q):
        return {of_joint[name]: value for name, value in zip(pepper.joint_names, q, strict=True)}

    def potential(q):
        return sum(9.81 * mass * center[2] for mass, center, _ in model.bodies(values(q)))

    for q in postures(pepper, rng):
        known = {}
        for link in pepper.link_names:
            if link == "world":
                continue
            pose = model.pose(link, values(q), known)
            yield "pose", np.abs(pose - pk.kinematics.frame_pose(pepper, q, link)).max()
        torque = []
        for k in range(pepper.n):  # the slope of the potential, by Richardson's extrapolation
            unit = np.eye(pepper.n)[k]
            one, half, quarter = (
                (potential(q + h * unit) - potential(q - h * unit)) / (2 * h) for h in (8e-3, 4e-3, 2e-3)
            )
            torque.append((64 * quarter - 20 * half + one) / 45)
        yield "gravity", np.abs(np.array(torque) - gravity(pepper, q)).max()
    for joint in (j for j in pepper.document.joints if j.type != "fixed"):
        axis = model.joints[of_joint[joint.name]].find("axis")
        for tag in ("lower", "upper", "effort", "velocity"):
            stated, value = axis.findtext(f"limit/{tag}"), getattr(joint, tag)
            assert (stated is not None) == math.isfinite(value), (joint.name, tag)
            yield "limits", 0.0 if stated is None else abs(float(stated) - value)
        for tag in ("damping", "friction"):
            yield "friction", abs(float(axis.findtext(f"dynamics/{tag}", "0")) - getattr(joint, tag))


def urdf_differences(pepper, text, rng):
    again = pk.load_robot(text)
    root = parse_xml(text, "URDF")
    assert not to_version_1_0(root), "the export is of version 1.0"
    for name in ("lower_limits", "upper_limits", "velocity_limits", "effort_limits"):
        assert np.array_equal(getattr(again, name), getattr(pepper, name)), name
    theirs = pinocchio.buildModelFromXML(text)
    data = theirs.createData()
    for q in postures(pepper, rng):
        full = dict(zip(list(pepper.inner_model.names)[1:], pepper.to_full(q), strict=True))
        config = pinocchio.neutral(theirs)
        for name, value in full.items():
            joint = theirs.joints[theirs.getJointId(name)]
            turns = joint.nq == 2
            config[joint.idx_q : joint.idx_q + joint.nq] = (
                (math.cos(value), math.sin(value)) if turns else value
            )
        pinocchio.framesForwardKinematics(theirs, data, config)
        torque = pinocchio.computeGeneralizedGravity(theirs, data, config)
        rows = [theirs.joints[theirs.getJointId(name)].idx_v for name in full]
        yield "gravity", np.abs(pepper.full_map.T @ torque[rows] - gravity(pepper, q)).max()
        for link in pepper.link_names:
            frame = next(f for f in data.oMf[theirs.getFrameId(link, pinocchio.BODY) :])
            yield "pose", np.abs(frame.homogeneous - pk.kinematics.frame_pose(pepper, q, link)).max()


READERS = {"mjcf": mjcf_differences, "sdf": sdf_differences, "urdf": urdf_differences}


def test_other_engines_read_the_same_robot(amount, rng, tried, folder):
    """Frames and torques of gravity to 1e-9, limits, friction; refused is what the format cannot express."""
    refused = asked = 0
    for _ in range(amount(25, 400, 6500)):
        made = odd_robot(rng, folder)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ModelWarning)
            try:
                pepper = pk.load_robot(made.text)
            except pk.exceptions.ModelError as error:
                if " follows " not in str(error):
                    raise
                continue  # limits of a leader and of its follower exclude each other
        for format, differences in READERS.items():
            asked += 1
            text = exported(made, pepper, format)
            if text is None:
                refused += 1
                continue
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", ModelWarning)
                worst = {}
                for what, value in differences(pepper, text, rng):
                    worst[what] = max(worst.get(what, 0.0), float(value))
            assert max(worst.values()) <= TOLERANCE, (format, worst)
            tried(f"robots in {format}", 1)
    assert refused <= 3 + 0.02 * asked


def test_inertias_that_no_body_has_are_balanced_when_asked(folder, rng):
    """MuJoCo's own `balanceinertia` accepts what was added; masses and centers stay."""
    text = """<robot name="r"><link name="b"/><link name="a"><inertial><mass value="1"/><inertia ixx="2.5e-5"
    iyy="6.2e-5" izz="2.6e-4" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="j" type="continuous">
    <parent link="b"/><child link="a"/><axis xyz="0 0 1"/></joint></robot>"""
    with pytest.warns(ModelWarning, match="link a"):
        pepper = pk.load_robot(text)
    for format in ("mjcf", "sdf"):
        with pytest.raises(ModelError, match=r"link a: principal moments .* balance_inertias=True"):
            pepper.export(format)
    with pytest.warns(ModelWarning, match=r"link a: .* 0\.000173 kg m\^2 is added"):
        model = mujoco.MjModel.from_xml_string(pepper.export("mjcf", balance_inertias=True))
    assert model.body("a").inertia == pytest.approx([4.33e-4, 2.35e-4, 1.98e-4], rel=1e-6)
    assert model.body("a").mass == 1.0
    assert TINY_INERTIA < 1e-6
