"""Descriptions that are long, deep or odd: read in little time, or refused by name."""

import sys

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.collision.mesh_file import read_mesh
from pepper_kin.exceptions import FileFormatError, InvalidValueError, ModelError
from pepper_kin.model import audit, compare, dynamics_model
from pepper_kin.model.dynamics_model import MOST_COMPUTED
from pepper_kin.model.neighbors import neighboring_pairs
from pepper_kin.model.tree_order import depth_first
from pepper_kin.model.urdf_document import LONGEST_CHAIN, MOST_MOVING, parse_urdf

INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
LIMIT = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'


def joint(name: str, parent: str, child: str, kind: str = "revolute", more: str = "") -> str:
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{name}" type="{kind}">{ends}<axis xyz="0 0 1"/>{LIMIT}{more}</joint>'


def chain(count: int, kind: str = "revolute", mimic: bool = False) -> str:
    parts = ['<link name="l0"/>']
    for i in range(count):
        parts.append(f'<link name="l{i + 1}">{INERTIAL if i + 1 == count else ""}</link>')
        follows = f'<mimic joint="j{i - 1}"/>' if mimic and i else ""
        parts.append(joint(f"j{i}", f"l{i}", f"l{i + 1}", kind if i else "revolute", follows))
    return f'<robot name="chain">{"".join(parts)}</robot>'


def lines_run(count: int) -> int:
    """Return how many lines of Python run while a chain is read."""
    text, lines = chain(count, "fixed"), 0

    def tracer(frame: object, event: str, _: object) -> object:
        nonlocal lines
        lines += event == "line"
        return tracer

    before = sys.gettrace()  # that of the coverage
    sys.settrace(tracer)  # type: ignore[arg-type]
    try:
        depth_first(parse_urdf(text))
    finally:
        sys.settrace(before)
    return lines


def test_work_grows_with_the_length_of_a_chain() -> None:
    assert lines_run(1000) < 4.5 * lines_run(250)


@pytest.mark.thorough
@pytest.mark.parametrize(("kind", "mimic"), [("revolute", False), ("fixed", False), ("revolute", True)])
def test_the_longest_chain_is_read(kind: str, mimic: bool) -> None:
    robot = pk.load_robot(chain(LONGEST_CHAIN, kind, mimic))
    assert robot.n == (1 if mimic or kind == "fixed" else LONGEST_CHAIN)
    assert robot.inner_model.njoints == (2 if kind == "fixed" else LONGEST_CHAIN + 1)
    if mimic:
        np.testing.assert_array_equal(robot.full_map, 1.0)


def test_longer_chains_and_too_many_joints_are_refused() -> None:
    with pytest.raises(ModelError, match=f"hangs on a chain of more than {LONGEST_CHAIN} joints"):
        pk.load_robot(chain(LONGEST_CHAIN + 1))
    star = "".join(f'<link name="l{i}"/>{joint(f"j{i}", "root", f"l{i}")}' for i in range(MOST_MOVING + 1))
    with pytest.raises(ModelError, match=f"{MOST_MOVING + 1} joints move, at most {MOST_MOVING}"):
        pk.load_robot(f'<robot name="star"><link name="root"/>{star}</robot>')


def test_more_joints_than_pinocchio_can_compute_with_are_refused_by_number() -> None:
    """Its working memory grows with the cube: 7 GB for 600 joints."""
    robot = pk.load_robot(chain(MOST_COMPUTED + 1))
    for compute in (
        lambda: pk.kinematics.frame_poses(robot, robot.neutral(), ["l5", "l9"]),
        lambda: robot.pinocchio_data,
        lambda: pk.dynamics.mass_matrix(robot, robot.neutral()),
    ):
        with pytest.raises(ModelError, match=r"has 301 moving joints.*takes 0\.873 GB; .* at most 300"):
            compute()


def test_as_many_joints_as_are_allowed_are_computed_with(monkeypatch) -> None:
    """With fewer than 300, for which the working memory of this test took 1.8 GB."""
    monkeypatch.setattr(dynamics_model, "MOST_COMPUTED", 80)
    most = pk.load_robot(chain(80))
    np.testing.assert_array_equal(pk.kinematics.frame_pose(most, most.neutral(), "l80"), np.eye(4))
    with pytest.raises(ModelError, match=r"has 81 moving joints.* at most 80"):
        pk.dynamics.mass_matrix(pk.load_robot(chain(81)), np.zeros(81))


def test_a_long_loop_of_followers_is_reported_in_little_time() -> None:
    links = "".join(f'<link name="l{i}"/>' for i in range(3001))
    joints = "".join(
        joint(f"j{i}", f"l{i}", f"l{i + 1}", more=f'<mimic joint="j{(i + 1) % 3000}"/>') for i in range(3000)
    )
    text = f'<robot name="r">{links}{joints}</robot>'
    report = audit(text)
    assert len([fault for fault in report.faults if "follows itself" in str(fault)]) == 3000
    assert len(report.report()) < 2_000_000
    with pytest.raises(ModelError, match="mimics itself"):
        pk.load_robot(text)


def test_factors_of_followers_may_not_grow_without_end() -> None:
    follower = joint("k", "b", "c", more='<mimic joint="j" multiplier="1e20"/>')
    last = joint("m", "c", "d", more='<mimic joint="k" multiplier="1e20"/>')
    links = "".join(f'<link name="{name}"/>' for name in "abcd")
    with pytest.raises(ModelError, match="joint m mimics k: its factors multiply to more than"):
        pk.load_robot(f'<robot name="r">{links}{joint("j", "a", "b")}{follower}{last}</robot>')


def test_deep_nesting_is_refused() -> None:
    for tag in ["a", "link", "robot"]:
        deep = f"<{tag}>" * 10_000 + f"</{tag}>" * 10_000
        text = chain(1)
        with pytest.raises(ModelError, match="URDF: elements are nested more than 100 deep"):
            pk.load_robot(text.replace("</robot>", f"{deep}</robot>"))
        with pytest.raises(ModelError, match="SRDF: elements are nested more than 100 deep"):
            pk.load_robot(text, f"<robot>{deep}</robot>")
        assert "nested more than 100 deep" in audit(text.replace("</robot>", f"{deep}</robot>")).report()
        assert compare(text, f"<robot>{deep}</robot>").faults


def test_groups_may_be_nested_deep() -> None:
    groups = "".join(f'<group name="g{i}"><group name="g{i + 1}"/></group>' for i in range(5000))
    last = '<group name="g5000"><joint name="j0"/></group>'
    robot = pk.load_robot(chain(2), f'<robot name="r">{groups}{last}</robot>')
    assert robot.joint_group("g0") == ("j0",)
    looped = last.replace("<joint", '<group name="g0"/><joint')
    with pytest.raises(ModelError, match="SRDF: group 'g0' contains itself: g0 > g1 > "):
        pk.load_robot(chain(2), f'<robot name="r">{groups}{looped}</robot>')


@pytest.mark.thorough
def test_small_texts_that_stand_for_endless_lists_are_refused() -> None:
    links = "".join(f'<link name="l{i}"/>' for i in range(2000))
    joints = "".join(joint(f"f{i}", "l0", f"l{i}", "fixed") for i in range(1, 1999))
    text = f'<robot name="r">{links}{joints}{joint("j", "l0", "l1999")}</robot>'
    every = "".join(f'<disable_default_collisions link="l{i}"/>' for i in range(2000))
    with pytest.raises(ModelError, match="SRDF: its groups and pairs list more than"):
        pk.load_robot(text, f'<robot name="r">{every}</robot>')
    shape = '<visual><geometry><sphere radius="1"/></geometry></visual>'
    links = "".join(f'<link name="l{i}">{shape}</link>' for i in range(4000))
    joints = "".join(
        joint(f"f{i}", "l0" if i % 2 else "l1999", f"l{i}", "fixed") for i in range(1, 4000) if i != 1999
    )
    with pytest.raises(ModelError, match="pairs of shaped links are neighbors"):
        neighboring_pairs(parse_urdf(f'<robot name="r">{links}{joints}{joint("j", "l0", "l1999")}</robot>'))


def test_half_a_character_is_refused() -> None:
    text = chain(1)
    with pytest.raises(ModelError, match=r"URDF: character .* is half of a surrogate pair"):
        pk.load_robot(text.replace('"l1"', '"l\ud800"'))
    with pytest.raises(ModelError, match=r"SRDF: character .* is half of a surrogate pair"):
        pk.load_robot(text, "<robot name='r\ud800'/>")
    with pytest.raises(FileFormatError, match="cannot be the name of a file"):
        pk.load_robot("a\ud800.urdf")
    assert "half of a surrogate pair" in audit("<robot name='\udfff'/>").report()


def test_mesh_names_may_be_too_long_for_a_file() -> None:
    shape = f'<visual><geometry><mesh filename="{"m" * 5000}.stl"/></geometry></visual>'
    text = chain(1).replace('<link name="l1">', f'<link name="l1">{shape}')
    robot = pk.load_robot(text, package_dirs=["."])
    assert len(robot.visual_shapes) == 1
    assert "is not there" in audit(text, ["."]).report()
    with pytest.raises(FileFormatError, match="there is no such file"):
        read_mesh(robot.visual_shapes[0].geometry.path)


@pytest.mark.parametrize("element", ["include", "if", "unless", "insert_block", "element"])
def test_xacro_is_refused_by_its_element(element: str) -> None:
    head = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">'
    with pytest.raises(ModelError, match=f"URDF: holds <xacro:{element}>; expand it first"):
        pk.load_robot(chain(1).replace('<robot name="chain">', f'{head}<xacro:{element} filename="a"/>'))


@pytest.mark.parametrize("value", ["1_0", "\u0661", "nan", "1e31", "9" * 5000, "0x10", "true", ""])
def test_numbers_of_each_kind_are_plain(value: str) -> None:
    text = chain(1)
    with pytest.raises(ModelError, match=r"URDF: .*is not .*finite number"):
        pk.load_robot(text.replace('<axis xyz="0 0 1"/>', f'<axis xyz="0 0 {value}"/>'))
    state = f'<group_state name="s" group="g"><joint name="j0" value="{value}"/></group_state>'
    with pytest.raises(ModelError, match=r"SRDF: .* has no number as value"):
        pk.load_robot(text, f'<robot name="r">{state}</robot>')
    report = audit(text.replace('<mass value="1"/>', f'<mass value="{value}"/>')).report()
    assert "is not a finite number" in report


def test_truth_values_and_texts_are_no_numbers() -> None:
    pepper = pk.load_pepper()
    for wrong in ([True] * 15, [0.0] * 14 + [True], ["1"] * 15, np.zeros(15, bool), [None] * 15, [1j] * 15):
        with pytest.raises(InvalidValueError, match=r"joint vector: got|q: got"):
            pepper.joint_vector(wrong)  # type: ignore[arg-type]
        with pytest.raises(InvalidValueError, match="q: got"):
            pk.dynamics.mass_matrix(pepper, wrong)  # type: ignore[arg-type]
    for wrong in (True, "1", np.True_, [1.0], None, 10**5000, 1j):
        with pytest.raises(InvalidValueError, match="sphere radius: got"):
            pk.model.Sphere(wrong)  # type: ignore[arg-type]
        with pytest.raises(InvalidValueError, match="HeadYaw"):
            pepper.joint_vector({"HeadYaw": wrong if wrong != [1.0] else True})  # type: ignore[dict-item]
    with pytest.raises(InvalidValueError, match="mesh scale"):
        pk.model.Mesh("a.stl", (1.0, True, 1.0))  # type: ignore[arg-type]


def test_a_deep_chain_does_not_end_the_process(child) -> None:  # type: ignore[no-untyped-def]
    code = """
import pepper_kin as pk
try:
    pk.load_robot(open(0).read())
except pk.PepperKinError as error:
    print(error)
"""
    assert "hangs on a chain" in child(code, text=chain(20_000, "fixed")).stdout
