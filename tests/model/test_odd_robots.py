"""Robots of one joint, of sliding, endless and following joints, without mass or shapes, with odd names."""

import inspect
from collections.abc import Callable
from typing import Any
from xml.sax.saxutils import quoteattr

import mujoco
import numpy as np
import pinocchio as pin
import pytest

import pepper_kin as pk
from pepper_kin.collision import CollisionChecker
from pepper_kin.exceptions import ModelError, ModelWarning, PepperKinError
from pepper_kin.files import load, save
from pepper_kin.model import FORMATS, audit, compare

INERTIAL = (
    '<inertial><origin xyz="0.1 0 0.02"/><mass value="1.5"/>'
    '<inertia ixx="0.1" iyy="0.12" izz="0.11" ixy="0.01" ixz="0" iyz="0"/></inertial>'
)
SHAPE = '<collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>'
LIMIT = '<limit lower="-1" upper="1" effort="10" velocity="1"/>'


def link(name: str, inertial: str = INERTIAL, shape: str = SHAPE) -> str:
    return f"<link name={quoteattr(name)}>{inertial}{shape}</link>"


def joint(name: str, parent: str, child: str, kind: str = "revolute", limit: str = LIMIT) -> str:
    ends = f"<parent link={quoteattr(parent)}/><child link={quoteattr(child)}/>"
    return (
        f'<joint name={quoteattr(name)} type="{kind}"><origin xyz="0.3 0.1 0.1" rpy="0.2 0 0.4"/>{ends}'
        f'<axis xyz="0 1 0.2"/>{limit}</joint>'
    )


def robot(*parts: str) -> str:
    return f'<robot name="odd">{"".join(parts)}</robot>'


BASE = link("base_footprint")
FOLLOWS = LIMIT + '<mimic joint="j" multiplier="-2" offset="0.1"/>'
CHAIN = LIMIT + '<mimic joint="k" multiplier="0.5"/>'
ROBOTS = {
    "one joint": robot(BASE, link("b"), joint("j", "base_footprint", "b")),
    "one that slides": robot(BASE, link("b"), joint("j", "base_footprint", "b", "prismatic")),
    "sliding": robot(
        BASE, link("b"), link("c"), joint("j", "base_footprint", "b", "prismatic"),
        joint("k", "b", "c", "prismatic"),
    ),
    "endless": robot(
        BASE, link("b"), link("c"), joint("j", "base_footprint", "b", "continuous", ""),
        joint("k", "b", "c", "continuous", ""),
    ),
    "following": robot(
        BASE, link("b"), link("c"), link("d"), joint("j", "base_footprint", "b"),
        joint("k", "b", "c", limit=FOLLOWS), joint("m", "c", "d", limit=CHAIN),
    ),
    "without shapes": robot(
        link("base_footprint", shape=""), link("b", shape=""), joint("j", "base_footprint", "b")
    ),
    "mass of the root only": robot(
        BASE, link("b", ""), link("c", ""), joint("j", "base_footprint", "b"), joint("k", "b", "c")
    ),
    "no limits but positions": robot(
        BASE, link("b"), joint("j", "base_footprint", "b", limit='<limit lower="-1" upper="1"/>')
    ),
    "one position": robot(
        BASE, link("b"),
        joint("j", "base_footprint", "b", limit='<limit lower="0.5" upper="0.5" effort="0" velocity="0"/>'),
    ),
}  # fmt: skip
VECTORS = ("q", "v", "a", "tau")
NEED_MASS = ("forward_dynamics", "forward_dynamics_derivatives", "inverse_mass_matrix")
TOO_LIGHT = "the mass matrix has no inverse: no mass is moved by"


def functions() -> list[Callable[..., Any]]:
    """Return the public functions of joint vectors, frames and forces."""
    found = []
    for package in (pk.kinematics, pk.dynamics):
        for name in package.__all__:
            function = getattr(package, name)
            if not inspect.isfunction(function):
                continue
            needed = [p.name for p in inspect.signature(function).parameters.values() if p.default is p.empty]
            others = set(needed[1:])
            if (
                needed[0] == "pepper"
                and others & set(VECTORS)
                and others <= {*VECTORS, "frame", "frames", "forces"}
            ):
                found.append(function)
    return found


def shapes(value: Any) -> Any:
    return tuple(shapes(part) for part in value) if isinstance(value, tuple | list) else np.shape(value)


def parts(value: Any, row: int) -> Any:
    """Return a row of each array of a result."""
    return [parts(part, row) for part in value] if isinstance(value, tuple | list) else np.asarray(value)[row]


def same(first: Any, second: Any) -> None:
    if isinstance(first, tuple | list):
        for one, other in zip(first, second, strict=True):
            same(one, other)
    else:
        assert np.shape(first) == np.shape(second)
        assert np.isfinite(first).all()
        np.testing.assert_allclose(first, second, atol=1e-9)


@pytest.mark.parametrize("name", ROBOTS)
def test_every_function_gives_for_one_state_what_it_gives_for_many(name: str) -> None:
    model = pk.load_robot(ROBOTS[name])
    rng = np.random.default_rng(0)
    states = {vector: rng.uniform(-0.2, 0.2, (3, model.n)) for vector in VECTORS}
    others = {
        "frame": model.link_names[-1],
        "frames": model.link_names,
        "forces": {model.link_names[-1]: np.ones(6)},
        "contacts": ((0.2, -0.2), (0.0, 0.3), (-0.2, -0.2)),
    }
    for function in functions():
        needed = [p.name for p in inspect.signature(function).parameters.values() if p.default is p.empty][1:]
        needed += ["contacts"] * (function is pk.dynamics.tip_over_margin)  # these robots have no wheels
        values = [{**states, **others}[argument] for argument in needed]
        singles = [x[1] if isinstance(x, np.ndarray) else x for x in values]
        if name == "mass of the root only" and function.__name__ in NEED_MASS:
            for arguments in (values, singles):
                with pytest.raises(ModelError, match=TOO_LIGHT):
                    function(model, *arguments)
        else:
            same(function(model, *singles), parts(function(model, *values), 1))


@pytest.mark.parametrize("name", ROBOTS)
def test_torques_are_those_of_an_independent_computation(name: str) -> None:
    model = pk.load_robot(ROBOTS[name])
    q, v, a = np.random.default_rng(1).uniform(-0.3, 0.3, (3, 40, model.n))
    expected = pk.dynamics.newton_euler(model, q, v, a)
    np.testing.assert_allclose(pk.dynamics.inverse_dynamics(model, q, v, a), expected, atol=1e-10)
    np.testing.assert_allclose(pk.dynamics.inverse_dynamics(model, q[0], v[0], a[0]), expected[0], atol=1e-10)


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("base", ["fixed", "planar"])
def test_models_are_exported_audited_changed_and_checked(name: str, base: str) -> None:
    model = pk.load_robot(ROBOTS[name], base=base)
    for format in FORMATS:
        text = model.export(format)
        if format == "mjcf" and name != "mass of the root only":  # MuJoCo refuses moving bodies without mass
            assert mujoco.MjModel.from_xml_string(text).nv >= model.n
        if format == "urdf":
            assert pk.load_robot(text).joint_names == model.joint_names
    assert audit(model).name == "odd"
    assert compare(model, model).equal
    speed = 2.0 if not model.is_coupled else 0.2  # which the followers' limits allow
    assert model.with_limits(velocity=speed).velocity_limits.tolist() == [speed] * model.n
    assert not CollisionChecker(model, pk.Scene()).in_collision(model.neutral())


def test_a_robot_without_mass_has_no_center_but_an_energy() -> None:
    parts = (link("a", ""), link("b", ""), link("c", ""), joint("j", "a", "b"), joint("k", "b", "c"))
    model = pk.load_robot(robot(*parts))
    q = np.zeros(2)
    for state in (q, np.zeros((40, 2))):
        for function in (
            pk.dynamics.center_of_mass,
            pk.dynamics.center_of_mass_jacobian,
            pk.dynamics.centroidal_map,
        ):
            with pytest.raises(ModelError, match="no link has mass, so"):
                function(model, state)
    assert pk.dynamics.potential_energy(model, q) == 0.0
    np.testing.assert_array_equal(pk.dynamics.gravity_torque(model, q), 0.0)


def test_a_robot_that_cannot_move_is_refused() -> None:
    for parts in [(BASE,), (BASE, link("b"), joint("j", "base_footprint", "b", "fixed", ""))]:
        with pytest.raises(ModelError, match="robot 'odd' has no moving joint"):
            pk.load_robot(robot(*parts))


@pytest.mark.thorough
def test_mujocos_format_refuses_a_robot_whose_inertia_is_not_computed() -> None:
    links = "".join(link(f"l{i}") for i in range(1501))
    model = pk.load_robot(robot(links, *(joint(f"j{i}", f"l{i}", f"l{i + 1}") for i in range(1500))))
    with pytest.raises(ModelError, match=r"1500 moving joints.* at most 300"):
        model.export("mjcf")
    for format in ("urdf", "srdf", "sdf"):
        assert model.export(format)


NAMES = (
    "a b",
    " a",
    "a/b",
    "\u732b",
    "x" * 10_000,
    "a::b",
    "<&>",
    "'\"",
    "{0}",
    "universe",
    "a,b",
    "..",
    "a\tb",
    "%s",
)


@pytest.mark.parametrize("name", NAMES, ids=range(len(NAMES)))
def test_odd_names_travel_through_every_export_and_file(name: str, tmp_path: Any) -> None:
    text = robot(link(name), link(name + "2"), joint(name, name, name + "2"))
    model = pk.load_robot(text)
    assert model.joint_names == (name,)
    assert model.link_names == (name, name + "2")
    assert pk.load_robot(text, base="planar").joint_names[-1] == name
    assert pk.load_robot(model.export("urdf")).link_names == model.link_names
    mujoco_model = mujoco.MjModel.from_xml_string(model.export("mjcf"))
    assert mujoco_model.joint(0).name == name
    group = f"<group name={quoteattr(name)}><joint name={quoteattr(name)}/></group>"
    grouped = pk.load_robot(text, f'<robot name="odd">{group}</robot>')
    if name == name.strip():
        assert grouped.joint_group(name) == (name,)
        assert pk.load_robot(text, grouped.export("srdf")).joint_group(name) == (name,)
    if "::" in name:
        with pytest.raises(ModelError, match="SDF reserves the names"):
            model.export("sdf")
    else:
        assert model.export("sdf")
    trajectory = pk.Trajectory.from_positions(model, [0.0, 1.0], [[0.0], [0.5]], overshoot=1.0)
    for suffix in (".csv", ".npz", ".json", ".yaml", ".py"):
        path = tmp_path / f"motion{suffix}"
        if suffix == ".csv" and set(name) & set(',"'):
            with pytest.raises(PepperKinError, match="without commas, quotes or line ends"):
                save(trajectory, path, unchecked=True)
        else:
            save(trajectory, path, unchecked=True)
            assert load(path, pepper=model).joint_names == (name,)


def test_names_that_are_empty_or_given_twice_are_refused() -> None:
    for what in ["link", "joint"]:
        text = robot(link("a"), link("b"), link("c"), joint("j", "a", "b"), joint("k", "b", "c"))
        old, new = ('<link name="c"', '<link name="b"') if what == "link" else ('name="k"', 'name="j"')
        with pytest.raises(ModelError, match=f"URDF: two {what}s are named"):
            pk.load_robot(text.replace(old, new))
        with pytest.raises(ModelError, match=f"URDF: a <{what}> of .* has no 'name'"):
            pk.load_robot(text.replace(old, '<link name=""' if what == "link" else 'name=""'))


EMPTY = ('<box size="0.1 0 0.1"/>', '<sphere radius="0"/>', '<cylinder radius="0.1" length="0.0"/>')


@pytest.mark.parametrize("shape", EMPTY)
def test_shapes_of_size_zero_are_left_out_with_a_warning(shape):
    """Atlas, Sawyer and Jaco have such."""
    empty = f'<collision name="none"><geometry>{shape}</geometry></collision>'
    with pytest.warns(
        ModelWarning, match="collision none of link b is left out: a .* of (size|radius|length)"
    ):
        found = pk.load_robot(robot(BASE, link("b", shape=SHAPE + empty), joint("j", "base_footprint", "b")))
    assert len(found.collision_shapes) == 2
    assert pin.buildModelFromXML(found.urdf).nq == 1


def test_prefixes_that_nothing_declares_are_read_and_audited():
    """As Gazebo's extensions are written in Fetch's description."""
    extension = '<gazebo><sensor:camera name="eye" sensor:rate="30"><a.b:c/></sensor:camera></gazebo>'
    text = robot(BASE, link("b"), joint("j", "base_footprint", "b"), extension)
    found = pk.load_robot(text)
    assert found.n == 1
    assert pk.load_robot(found.urdf).urdf == found.urdf
    faults = [str(fault) for fault in audit(text).faults if fault.kind == "xml"]
    assert faults == [f"xml: the file: the prefix {one!r} is not declared" for one in ("a.b", "sensor")]
    with pytest.raises(ModelError, match="not well-formed"):
        pk.load_robot(text.replace("</gazebo>", "</gazeb>"))
