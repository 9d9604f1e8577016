"""The URDF texts that come with the package, and the order that our own reader gives joints and frames."""

import shutil

import numpy as np
import pinocchio
import pytest

import pepper_kin as pk
from pepper_kin.model import expanded_urdf
from pepper_kin.model.plain_urdf import plain_urdf

CHOICES = [(base, hands) for base in expanded_urdf.BASES for hands in expanded_urdf.HANDS]


@pytest.mark.parametrize(("base", "hands"), CHOICES)
def test_texts_equal_the_expansion(base, hands):
    """If this fails after a change of urdf/xacro: python -m pepper_kin.model.expanded_urdf."""
    assert expanded_urdf.expanded(base, hands) == expanded_urdf.expand(base=base, hands=hands)
    assert pk.model.pepper_urdf(base=base, hands=hands) == expanded_urdf.expanded(base, hands)


@pytest.mark.thorough
def test_defaults_are_those_of_the_xacro_sources():
    assert pk.model.pepper_urdf() == expanded_urdf.expand()
    assert pk.model.pepper_urdf(hands="mimic") == expanded_urdf.expand(hands="mimic")
    assert 'name="salt"' in pk.model.pepper_urdf(name="salt")


def test_text_names_no_folder_of_this_machine():
    assert str(expanded_urdf.urdf_folder()) not in pk.load_pepper().urdf


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A copy of the sources with the texts made from them."""
    folder = tmp_path_factory.mktemp("written") / "urdf"
    shutil.copytree(expanded_urdf.urdf_folder() / "xacro", folder / "xacro")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(expanded_urdf, "urdf_folder", lambda: folder)
        assert len(expanded_urdf.write_expanded()) == 6
    return folder


@pytest.mark.thorough
@pytest.mark.parametrize("wrong", ["sources", "missing", "no text"])
def test_stale_or_missing_texts_are_expanded_anew(tmp_path, monkeypatch, written, wrong):
    folder = shutil.copytree(written, tmp_path / "urdf")
    monkeypatch.setattr(expanded_urdf, "urdf_folder", lambda: folder)
    good = expanded_urdf.expanded("fixed", "locked")
    assert good == expanded_urdf.expand()
    if wrong == "sources":
        source = folder / "xacro" / "leg.xacro"
        source.write_text(source.read_text() + "<!-- changed -->")
    elif wrong == "missing":
        (folder / "expanded" / "pepper_fixed_locked.urdf").unlink()
    else:
        (folder / "expanded" / "pepper_fixed_locked.urdf").write_bytes(b"\xff")
    assert expanded_urdf.expanded("fixed", "locked") is None
    assert pk.model.pepper_urdf() == good


@pytest.mark.parametrize(("base", "hands"), CHOICES)
def test_model_says_what_pinocchio_says(base, hands):
    pepper = pk.load_pepper(base, hands)
    model = pinocchio.buildModelFromXML(plain_urdf(pepper.document))
    own = {joint.name: joint for joint in pepper.document.joints}
    names = list(model.names)[1:]
    assert pepper.joint_names == tuple(name for name in names if own[name].mimic is None)
    assert pepper.full_map.shape == (model.nv, pepper.n)
    rows = [names.index(name) for name in pepper.joint_names]
    bounded = [k for k, name in enumerate(pepper.joint_names) if own[name].type != "continuous"]
    places = np.array(rows)[bounded]
    np.testing.assert_array_equal(pepper.lower_limits[bounded], model.lowerPositionLimit[places])
    np.testing.assert_array_equal(pepper.upper_limits[bounded], model.upperPositionLimit[places])
    for own_limits, limits in (
        (pepper.velocity_limits, model.velocityLimit),
        (pepper.effort_limits, model.effortLimit),
    ):
        described = np.isfinite(own_limits)
        np.testing.assert_array_equal(own_limits[described], limits[rows][described])
    body = pinocchio.FrameType.BODY
    frames = {frame.name: place for place, frame in enumerate(model.frames) if frame.type == body}
    assert pepper.frame_names == pepper.document.links
    assert {name: pepper.frame_id(name) for name in pepper.frame_names} == frames
    for name in pepper.posture_names:
        assert pepper.posture(name).shape == (pepper.n,)
    assert list(pepper.pinocchio_model.names)[1:] == names


def test_siblings_are_ordered_by_the_bytes_of_their_names():
    names = ["b", "B", "é", "a10", "a9", "_", "z/ü", "Z"]
    links = "".join(f'<link name="{name}_link"/>' for name in ("root", *names))
    limit = '<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/>'
    joints = "".join(
        f'<joint name="{name}" type="revolute"><parent link="{parent}_link"/><child link="{name}_link"/>'
        f"{limit}</joint>"
        for name, parent in zip(names, ["root", "root", "root", "b", "b", "root", "b", "root"], strict=True)
    )
    robot = pk.load_robot(f'<robot name="r">{links}{joints}</robot>')
    assert robot.joint_names == tuple(list(robot.pinocchio_model.names)[1:])
    for name in robot.frame_names:
        assert robot.pinocchio_model.frames[robot.frame_id(name)].name == name
