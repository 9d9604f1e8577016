"""Numbers of a description that no computation could use are refused by name; odd ones are warned of."""

import time
import warnings

import pytest

import pepper_kin as pk
from pepper_kin.exceptions import ModelError, ModelWarning

LIMIT = {"lower": "-1", "upper": "1", "effort": "1", "velocity": "1"}
INERTIA = {"ixx": "1", "iyy": "1", "izz": "1", "ixy": "0", "ixz": "0", "iyz": "0"}


def attributes(values: dict[str, str]) -> str:
    return " ".join(f'{name}="{value}"' for name, value in values.items())


def load(
    limit: dict[str, str] | None = None,
    mass: str = "1",
    inertia: dict[str, str] | None = None,
    dynamics: dict[str, str] | None = None,
) -> pk.PepperModel:
    return pk.load_robot(
        f"""<robot name="r"><link name="a"/><link name="b"><inertial><mass value="{mass}"/>
        <inertia {attributes({**INERTIA, **(inertia or {})})}/></inertial></link>
        <joint name="elbow" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
        <limit {attributes({**LIMIT, **(limit or {})})}/>
        {f"<dynamics {attributes(dynamics)}/>" if dynamics else ""}</joint></robot>"""
    )


def test_a_sound_description_loads_without_a_warning() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error", ModelWarning)
        assert load(dynamics={"damping": "0.1", "friction": "0"}).n == 1


@pytest.mark.parametrize("value", ["-1", "1e31", "inf", "nan", "1_0", "\u0661", "9" * 5000, "", "one"])
def test_a_limit_that_cannot_be_is_refused_by_joint_and_value(value: str) -> None:
    below_zero_is_none = value == "-1"
    for name in ["acceleration"] if below_zero_is_none else ["velocity", "effort", "acceleration"]:
        with pytest.raises(ModelError, match=f"elbow: {name}") as caught:
            load(limit={name: value})
        assert len(str(caught.value)) < 200
        assert value[:4] in str(caught.value).replace("e+", "e")


def test_friction_below_zero_is_refused() -> None:
    for name, value in [("damping", "-1"), ("friction", "-0.5"), ("damping", "inf")]:
        with pytest.raises(ModelError, match=f"elbow: {name}.*{value}"):
            load(dynamics={name: value})


def test_a_mass_that_cannot_be_is_refused_by_link() -> None:
    for value in ["-1", "inf", "nan", "1e300", "1_0", "\u0661"]:
        with pytest.raises(ModelError, match="link b: value"):
            load(mass=value)


def test_an_inertia_that_cannot_be_is_refused_by_link() -> None:
    for name, value in [("ixx", "-1"), ("izz", "inf"), ("iyy", "1e300"), ("ixy", "1e200"), ("iyz", "x")]:
        with pytest.raises(ModelError, match=r"inertial? of link b"):
            load(inertia={name: value})


def test_an_impossible_inertia_is_warned_of_in_the_words_of_the_audit() -> None:
    for inertia, message in [
        ({"ixx": "100"}, "break the triangle inequality"),
        ({"ixy": "5"}, "not positive definite"),
    ]:
        with pytest.warns(ModelWarning, match=f"link b: .*{message}") as caught:
            robot = load(inertia=inertia)
        assert caught[0].filename == __file__
        said = str(caught[0].message).partition("link b: ")[2]
        assert said in str(pk.model.audit(robot.urdf).report())


def test_groups_that_name_a_group_twice_take_no_time() -> None:
    depth = 300
    nested = "".join(
        f"<group name='g{k}'><group name='g{k + 1}'/><group name='g{k + 1}'/></group>" for k in range(depth)
    )
    srdf = f"<robot name='r'>{nested}<group name='g{depth}'><joint name='elbow'/></group></robot>"
    began = time.process_time()
    robot = pk.load_robot(load().urdf, srdf)
    assert robot.joint_group("g0") == ("elbow",)
    assert time.process_time() - began < 60.0  # without memory: 2**300 visits
