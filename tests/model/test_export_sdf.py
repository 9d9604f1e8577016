"""SDF, read by a small reader that knows its specification (`tests/zoo/sdf_model.py`)."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest
from sdf_model import SdfModel

import pepper_kin as pk

VARIANTS = [(base, hands) for base in ("fixed", "planar") for hands in ("locked", "mimic", "independent")]


@pytest.fixture(scope="module", params=VARIANTS, ids="-".join)
def pair(request):
    base, hands = request.param
    pepper = pk.load_pepper(base=base, hands=hands)
    return pepper, SdfModel(pepper.export("sdf"))


def random_q(pepper, seed):
    rng = np.random.default_rng(seed)
    return rng.uniform(np.maximum(pepper.lower_limits, -3), np.minimum(pepper.upper_limits, 3))


def test_frames_are_ours(pair):
    pepper, sdf = pair
    q = random_q(pepper, 0)
    values = dict(zip(pepper.joint_names, q, strict=True))
    for name in pepper.frame_names:
        expected = pk.kinematics.frame_pose(pepper, q, name)
        np.testing.assert_allclose(sdf.pose(name, values), expected, atol=1e-9, err_msg=name)


def test_masses_are_ours(pair):
    pepper, sdf = pair
    q = random_q(pepper, 1)
    bodies = list(sdf.bodies(dict(zip(pepper.joint_names, q, strict=True))))
    assert sum(mass for mass, _, _ in bodies) == pytest.approx(pk.dynamics.total_mass(pepper), abs=1e-6)
    assert all(mass > 0 and np.linalg.eigvalsh(inertia)[0] > 0 for mass, _, inertia in bodies)
    center = sum(mass * c for mass, c, _ in bodies) / sum(mass for mass, _, _ in bodies)
    np.testing.assert_allclose(center, pk.dynamics.center_of_mass(pepper, q), atol=1e-6)


@pytest.mark.parametrize(("base", "hands"), [("fixed", "locked"), ("planar", "mimic")])
def test_mass_matrix_is_ours(base, hands):
    pepper = pk.load_pepper(base=base, hands=hands)
    q = random_q(pepper, 2)
    matrix = SdfModel(pepper.export("sdf")).mass_matrix(pepper.joint_names, q)
    np.testing.assert_allclose(matrix, pk.dynamics.mass_matrix(pepper, q), atol=1e-6)


def test_limits_shapes_and_names(pair):
    pepper, sdf = pair
    for i, name in enumerate(pepper.joint_names):
        limit = sdf.joints[name].find("axis/limit")
        wanted = (
            pepper.lower_limits[i],
            pepper.upper_limits[i],
            pepper.effort_limits[i],
            pepper.velocity_limits[i],
        )
        for tag, value in zip(("lower", "upper", "effort", "velocity"), wanted, strict=True):
            found = limit.find(tag)
            assert (found is None) if np.isinf(value) else float(found.text) == value, (name, tag)
    coupled = any(joint.find("axis/mimic") is not None for joint in sdf.joints.values())
    assert sdf.root.get("version") == ("1.11" if coupled else "1.9")
    assert coupled == pepper.is_coupled
    names = [*sdf.links, *sdf.frames, *sdf.joints]
    assert len(set(names)) == len(names), "SDF has one name space for links, frames and joints"
    assert not {"world", "__model__"} & set(names)
    shapes = [
        item for link in sdf.links.values() for kind in ("visual", "collision") for item in link.findall(kind)
    ]
    assert len(shapes) == len(pepper.visual_shapes) + len(pepper.collision_shapes)
    for link in sdf.links.values():
        inside = [item.get("name") for item in link if item.get("name")]
        assert len(set(inside)) == len(inside)
    tree = {joint.find("child").text for joint in sdf.joints.values()}
    assert tree == set(sdf.links), "every link hangs on one joint, the first ones on the world"


def test_capsules_and_meshes():
    pepper = pk.load_pepper()
    root = ET.fromstring(pepper.export("sdf", mesh_paths="package"))
    bicep = root.find("model/link[@name='LBicep']/collision/geometry/capsule")
    assert float(bicep.find("radius").text) == 0.04449
    uris = {uri.text for uri in root.iter("uri")}
    assert "model://pepper_kin/urdf/meshes/head_shell.stl" in uris
    absolute = ET.fromstring(pepper.export("sdf"))
    import pathlib

    assert all(pathlib.Path(uri.text).is_file() for uri in absolute.iter("uri"))
