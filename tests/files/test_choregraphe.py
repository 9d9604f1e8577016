"""Animations of Choregraphe and NAOqi: their curves, what is unsafe in them, and every wrong file."""

import math

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import FileFormatError, InvalidValueError, UnknownNameError
from pepper_kin.files import naoqi_timeline, read_choregraphe
from pepper_kin.trajectory import (
    Handle,
    JointCurve,
    Key,
    Timeline,
    Trajectory,
    find_limit_violations,
    import_timeline,
)

BEHAVIOR = """<?xml version="1.0" encoding="UTF-8" ?>
<ChoregrapheProject xmlns="http://www.aldebaran-robotics.com/schema/choregraphe/project.xsd" xar_version="3">
 <Box name="root" id="-1">
  <Timeline enable="0">
   <BehaviorLayer name="layer">
    <BehaviorKeyframe name="keyframe" index="1">
     <Diagram>
      <Box name="Hello" id="2">
       <Timeline enable="1" fps="25" start_frame="1" end_frame="-1" size="60">
        <ActuatorList model="">
         <ActuatorCurve name="value" actuator="HeadYaw" mute="0" unit="0">
          <Key frame="0" value="99" />
          <Key frame="11" value="30" />
          <Key frame="21" value="-10">
           <Tangent side="left" interpType="linear" abscissaParam="0" ordinateParam="0" />
           <Tangent side="right" interpType="constant" abscissaParam="0" ordinateParam="0" />
          </Key>
          <Key frame="31" value="10" />
         </ActuatorCurve>
         <ActuatorCurve name="value" actuator="HeadPitch" mute="0" unit="0">
          <Key frame="11" value="0">
           <Tangent side="right" interpType="bezier" abscissaParam="5" ordinateParam="6" />
          </Key>
          <Key frame="36" value="20">
           <Tangent side="left" interpType="bezier" abscissaParam="-12" ordinateParam="-3" />
          </Key>
         </ActuatorCurve>
         <ActuatorCurve name="value" actuator="RHand" mute="0" unit="1">
          <Key frame="11" value="0.6" />
         </ActuatorCurve>
         <ActuatorCurve name="value" actuator="LElbowRoll" mute="1" unit="0">
          <Key frame="11" value="-40" />
         </ActuatorCurve>
        </ActuatorList>
       </Timeline>
      </Box>
     </Diagram>
    </BehaviorKeyframe>
   </BehaviorLayer>
  </Timeline>
 </Box>
</ChoregrapheProject>
"""


@pytest.fixture
def behavior(tmp_path):
    path = tmp_path / "behavior.xar"
    path.write_text(BEHAVIOR)
    return path


def one(joint, *keys):
    return Timeline("test", (JointCurve(joint, keys),))


def positions(pepper, timeline, joint, times, start=None):
    return timeline.to_trajectory(pepper, start)(times).position[..., pepper.joint_index(joint)]


def bezier(first, last, at):
    """The segment between two keys at given times, by solving for u: another way than the importer's."""
    x = [first.time, first.time + first.behind.time, last.time + last.before.time, last.time]
    y = [first.value, first.value + first.behind.value, last.value + last.before.value, last.value]

    def blend(points, u):
        return (
            (1 - u) ** 3 * points[0] + 3 * (1 - u) ** 2 * u * points[1]
            + 3 * (1 - u) * u**2 * points[2] + u**3 * points[3]
        )  # fmt: skip

    low, high = np.zeros_like(at), np.ones_like(at)
    for _ in range(60):
        middle = (low + high) / 2
        right = blend(x, middle) < at
        low, high = np.where(right, middle, low), np.where(right, high, middle)
    return blend(y, (low + high) / 2)


def test_behavior_is_read(behavior, pepper):
    (timeline,) = read_choregraphe(behavior)
    assert timeline.name == "root/Hello"
    assert timeline.joint_names == ("HeadYaw", "HeadPitch", "RHand")  # the muted elbow is left out
    yaw = timeline.curves[0].keys
    assert [key.time for key in yaw] == pytest.approx([0.4, 0.8, 1.2])  # (frame - start) / fps; frame 0 not
    assert [math.degrees(key.value) for key in yaw] == pytest.approx([30, -10, 10])
    assert [yaw[0].before.kind, yaw[1].before.kind, yaw[1].behind.kind] == ["auto", "linear", "constant"]
    handle = timeline.curves[1].keys[0].behind
    assert (handle.time, math.degrees(handle.value)) == pytest.approx((0.2, 6))
    assert timeline.curves[2].keys[0].value == 0.6
    assert timeline.duration == pytest.approx(1.4)


def test_behavior_moves_as_drawn(behavior, pepper):
    (timeline,) = read_choregraphe(behavior)
    start = pepper.posture("Stand")
    start[pepper.joint_index("HeadYaw")] = 0.0
    times = [0.0, 0.2, 0.4, 0.8, 1.0, 1.1999, 1.2, 1.4]
    yaw = np.degrees(positions(pepper, timeline, "HeadYaw", times, start))
    assert yaw == pytest.approx([0, 15, 30, -10, -10, -10, 10, 10], abs=1e-6)
    at = np.linspace(0.4, 1.4, 400)
    first, last = timeline.curves[1].keys
    pitch = positions(pepper, timeline, "HeadPitch", at)
    np.testing.assert_allclose(pitch, bezier(first, last, at), atol=1e-6)
    others = [j for j, n in enumerate(pepper.joint_names) if n not in ("HeadYaw", "HeadPitch")]
    trajectory = timeline.to_trajectory(pepper, start)
    np.testing.assert_array_equal(trajectory(at).position[:, others] - start[others], 0)


def test_bezier_segments(pepper):
    for leave, meet in [
        ((0.3, 0.5), (-0.5, 0.2)),
        ((0.01, 0.3), (-0.9, -0.1)),
        ((1.0, 0.0), (-1.0, 0.0)),
        ((0.0, 0.0), (-0.4, 0.3)),
    ]:
        first = Key(0.0, 0.1, behind=Handle("bezier", *leave))
        last = Key(1.0, 0.6, before=Handle("bezier", *meet))
        at = np.linspace(0, 1, 501)
        found = positions(pepper, one("HeadYaw", first, last), "HeadYaw", at)
        np.testing.assert_allclose(found, bezier(first, last, at), atol=2e-4)


def test_bezier_with_handles_of_a_third_is_one_exact_cubic(pepper):
    first = Key(0.0, 0.1, behind=Handle("bezier", 0.5, 0.4))
    last = Key(1.5, -0.2, before=Handle("bezier", -0.5, 0.7))
    trajectory = one("HeadYaw", first, last).to_trajectory(pepper)
    assert trajectory.breaks.size == 2
    at = np.linspace(0, 1.5, 301)
    found = trajectory(at).position[:, pepper.joint_index("HeadYaw")]
    np.testing.assert_allclose(found, bezier(first, last, at), atol=1e-12)


def test_too_long_handles_are_shortened_to_their_segment(pepper):
    long = one("HeadYaw", Key(0.0, 0.0, behind=Handle("bezier", 4.0, 2.0)), Key(1.0, 0.5))
    short = one("HeadYaw", Key(0.0, 0.0, behind=Handle("bezier", 1.0, 0.5)), Key(1.0, 0.5))
    at = np.linspace(0, 1, 50)
    np.testing.assert_allclose(
        positions(pepper, long, "HeadYaw", at), positions(pepper, short, "HeadYaw", at), atol=1e-12
    )


def test_upright_handles_are_read(pepper):
    up = one("HeadYaw", Key(0.0, 0.0, behind=Handle("bezier", 0.0, 0.5)), Key(1.0, 0.1))
    found = positions(pepper, up, "HeadYaw", np.linspace(0, 1, 200))
    assert np.isfinite(found).all()
    assert 0.1 < found.max() < 0.5


def test_automatic_handles_are_flat_at_extremes_and_do_not_overshoot(pepper):
    rng = np.random.default_rng(3)
    for _ in range(20):
        times = np.cumsum(rng.uniform(0.1, 1.0, 8))
        values = rng.uniform(-1, 1, 8)
        timeline = naoqi_timeline(["HeadYaw"], [[0.0, *times]], [[0.0, *values]])
        trajectory = timeline.to_trajectory(pepper)
        j = pepper.joint_index("HeadYaw")
        knots = np.concatenate([[0.0], times])
        ends = np.concatenate([[0.0], values])
        np.testing.assert_allclose(trajectory(knots).position[:, j], ends, atol=1e-12)
        assert not [e for e in find_limit_violations(pepper, trajectory) if e.quantity.endswith("jump")]
        for i in range(8):
            inside = trajectory(np.linspace(knots[i], knots[i + 1], 40)).position[:, j]
            low, high = sorted(ends[i : i + 2])
            assert inside.min() > low - 1e-9
            assert inside.max() < high + 1e-9


def test_naoqi_lists(pepper):
    keys = [
        [0.5, [3, -0.2, 0.0], [3, 0.1, 0.05]],
        [0.2, [1, 0, 0], [1, 0, 0]],
        [0.4, [1, 0, 0], [0, 0, 0]],
        0.1,
    ]
    timeline = naoqi_timeline(["HeadYaw"], [[0.6, 1.0, 1.5, 2.0]], [keys])
    kinds = [(key.before.kind, key.behind.kind) for key in timeline.curves[0].keys]
    assert kinds == [("bezier", "bezier"), ("linear", "linear"), ("linear", "constant"), ("auto", "auto")]
    found = positions(pepper, timeline, "HeadYaw", [0.6, 1.0, 1.25, 1.5, 1.99, 2.0])
    assert found == pytest.approx([0.5, 0.2, 0.3, 0.4, 0.4, 0.1])


def test_start_posture_is_where_it_begins(pepper):
    start = pepper.posture("Stand")
    start[pepper.joint_index("HeadYaw")] = -0.7
    timeline = naoqi_timeline(["HeadYaw"], [[1.0]], [[0.3]])
    found = positions(pepper, timeline, "HeadYaw", [0.0, 0.5, 1.0], start)
    assert found == pytest.approx([-0.7, -0.2, 0.3])
    with pytest.raises(InvalidValueError, match="start: got shape"):
        timeline.to_trajectory(pepper, np.zeros(3))


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ('fps="25"', 'fps="0"', 9, "fps is 0, expected a rate above 0"),
        ('fps="25"', "", 9, "Timeline has no attribute 'fps'"),
        ('value="30"', 'value="nan"', 13, "value of Key is 'nan', expected a finite number"),
        ('frame="21"', 'frame="11"', 14, "frame 11 of HeadYaw does not come after the key before"),
        ('frame="21"', 'frame="x"', 14, "frame of Key is 'x'"),
        ('interpType="linear"', 'interpType="wavy"', 15, "interpType is 'wavy', expected one of bezier"),
        ('side="left"', 'side="up"', 15, "side is 'up', expected left or right"),
        ('abscissaParam="5"', 'abscissaParam="-5"', 21, "handle behind the key"),
        ('actuator="HeadYaw"', "", 11, "ActuatorCurve has no attribute 'actuator'"),
        ('actuator="HeadPitch"', 'actuator="HeadYaw"', 9, "curves of root/Hello: got HeadYaw"),
        ('mute="0" unit="0"', 'mute="0" unit="5"', 11, "unit of HeadYaw is 5"),
        ("</ActuatorList>", "</ActuatorLis>", 34, "is not a complete XML file: mismatched tag"),
        ("ChoregrapheProject", "Other", 2, "is not a complete XML file"),
        (
            "<ChoregrapheProject",
            '<!DOCTYPE x [<!ENTITY a "b">]>\n<ChoregrapheProject',
            2,
            "has a document type",
        ),
    ],
)
def test_wrong_behaviors(behavior, old, new, line, message):
    assert old in BEHAVIOR
    behavior.write_text(BEHAVIOR.replace(old, new, 1))
    with pytest.raises(FileFormatError) as caught:
        read_choregraphe(behavior)
    assert message in str(caught.value)
    if message != "is not a complete XML file":
        assert caught.value.line == line


def test_every_truncated_behavior_is_refused(behavior):
    for place in range(0, len(BEHAVIOR) - 2, 97):
        behavior.write_text(BEHAVIOR[:place])
        with pytest.raises(FileFormatError):
            read_choregraphe(behavior)


def test_behaviors_without_motion(behavior):
    for content, message in [
        ("<ChoregrapheProject/>", "has no timeline that moves a joint"),
        ('<ChoregrapheProject><BoxInstance path="root.xml"/></ChoregrapheProject>', "an older format"),
        ("<Anim/>", "its root is 'Anim'"),
        ("<Animation/>", "has no timeline that moves a joint"),
        ("<a>" * 500 + "</a>" * 500, "nests more than 200 elements"),
    ]:
        behavior.write_text(content)
        with pytest.raises(FileFormatError, match=message):
            read_choregraphe(behavior)


def test_animations_of_the_older_format(tmp_path, pepper):
    path = tmp_path / "nod.xml"
    path.write_text(
        '<Animation fps="25" size="300" enable="1" start_frame="0" end_frame="-1"><watches />'
        '<ActuatorList><ActuatorCurve name="value" actuator="HeadPitch" recordable="1" mute="0">'
        '<Key frame="25" value="-4.5" /><Key frame="50" value="9" /></ActuatorCurve>'
        "</ActuatorList></Animation>"
    )
    (timeline,) = read_choregraphe(path)
    assert timeline.name == "Timeline"
    found = positions(pepper, timeline, "HeadPitch", [1.0, 2.0])
    assert np.degrees(found) == pytest.approx([-4.5, 9])


PROJECT = """<?xml version="1.0" encoding="UTF-8" ?>
<Package name="show" format_version="4">
    <Manifest src="manifest.xml" />
    <BehaviorDescriptions>
        <BehaviorDescription name="behavior" src="hello" xar="behavior.xar" />
        <BehaviorDescription name="behavior" src="again" xar="behavior.xar" />
    </BehaviorDescriptions>
</Package>
"""


def test_projects(tmp_path):
    path = tmp_path / "show.pml"
    path.write_text(PROJECT)
    with pytest.raises(FileFormatError, match=r"hello/behavior.xar: cannot be read"):
        read_choregraphe(path)
    for folder in ("hello", "again"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "behavior.xar").write_text(BEHAVIOR)
    assert [timeline.name for timeline in read_choregraphe(path)] == ["hello/root/Hello", "again/root/Hello"]
    for folder in ("hello", "again"):
        (tmp_path / folder / "behavior.xar").write_text("<ChoregrapheProject/>")
    with pytest.raises(FileFormatError, match="has no behavior with a timeline"):
        read_choregraphe(path)


def test_wrong_projects(tmp_path):
    for old, new, line, message in [
        ('src="hello"', 'src="../secret"', 5, "outside its own folder"),
        ('src="hello"', 'src="/etc"', 5, "outside its own folder"),
        ('src="hello" ', "", 5, "BehaviorDescription has no attribute 'src'"),
        ("BehaviorDescriptions", "Others", 2, "names no behavior"),
        ("Package", "Parcel", 2, "is not a project: its root is 'Parcel'"),
    ]:
        path = tmp_path / "show.pml"
        path.write_text(PROJECT.replace(old, new))
        with pytest.raises(FileFormatError, match=message) as caught:
            read_choregraphe(path)
        assert caught.value.line == line


def test_import_says_what_was_unsafe_and_mends_it(pepper, behavior):
    (timeline,) = read_choregraphe(behavior)
    found = import_timeline(pepper, timeline)
    quantities = {(e.joint, e.quantity) for e in found.violations}
    assert ("HeadYaw", "position jump") in quantities
    assert ("HeadYaw", "velocity jump") in quantities
    jump = next(e for e in found.violations if e.quantity == "position jump")
    assert (jump.time, math.degrees(jump.value)) == pytest.approx((1.2, 20))
    assert "HeadYaw: position jump of 0.3491 rad at 1.200 s" in found.report()
    certificate = found.trajectory.check(pepper, collisions=False)
    assert certificate.success, certificate.report()
    assert not found.original.check(pepper, collisions=False).success
    assert found.trajectory.start == pytest.approx(found.original.start)
    assert found.trajectory.end == pytest.approx(found.original.end)


def test_excesses_are_where_they_were_put(pepper):
    """A head that turns 2.5 rad by a known quintic: its peaks are closed forms."""
    q = np.tile(pepper.posture("Stand"), (2, 1))
    j = pepper.joint_index("HeadYaw")
    q[:, j] = [-0.2, 2.3]
    zero = np.zeros_like(q)
    motion = pk.trajectory.Samples(pepper.joint_names, [0, 0.6], q, zero, zero).to_trajectory()
    found = {e.quantity: e for e in find_limit_violations(pepper, motion) if e.quantity != "acceleration"}
    assert set(found) == {"position", "velocity"}
    assert found["position"].value == pytest.approx(2.3)
    assert found["position"].limit == pytest.approx(pepper.upper_limits[j])
    assert found["position"].end == pytest.approx(0.6)
    assert found["velocity"].value == pytest.approx(1.875 * 2.5 / 0.6, rel=1e-5)
    assert found["velocity"].time == pytest.approx(0.3, abs=1e-3)
    speed = np.abs(motion([found["velocity"].start, found["velocity"].end]).velocity[:, j])
    np.testing.assert_allclose(speed, pepper.velocity_limits[j], atol=0.03)
    sides = [e for e in find_limit_violations(pepper, motion) if e.quantity == "acceleration"]
    assert [np.sign(e.value) for e in sides] == [1, -1]
    assert max(abs(e.value) for e in sides) == pytest.approx(5.7735 * 2.5 / 0.36, rel=1e-4)
    assert "limit 7.34 (outside from" in found["velocity"].sentence()


def test_a_safe_animation_keeps_its_time(pepper):
    timeline = naoqi_timeline(["HeadYaw"], [[1.5, 3.0]], [[0.5, 0.0]])
    found = import_timeline(pepper, timeline)
    assert found.violations == ()
    assert "every limit of position, velocity and acceleration was kept" in found.report()
    assert found.trajectory.duration == pytest.approx(3.04, abs=1e-6)
    at = np.linspace(0, 3, 300)
    np.testing.assert_allclose(found.trajectory(at + 0.02).position, found.original(at).position, atol=1e-3)


def test_joints_that_the_robot_lacks(pepper):
    timeline = naoqi_timeline(["HeadYaw", "RHand", "LHipPitch"], [[1.0]] * 3, [[0.1]] * 3)
    with pytest.raises(
        UnknownNameError, match=r"'LHipPitch' \(did you mean 'HipPitch'\?\); available: KneePitch"
    ):
        timeline.to_trajectory(pepper)
    motion = timeline.to_trajectory(pepper, ignore=("RHand", "LHipPitch"))
    assert timeline.to_trajectory(pepper, ignore="foreign") == motion
    assert import_timeline(pepper, timeline, ignore="foreign").original == motion
    nao = naoqi_timeline(["LHipPitch", "LAnklePitch"], [[1.0]] * 2, [[0.1]] * 2)
    with pytest.raises(UnknownNameError, match=r"joint of keys 'LHipPitch, LAnklePitch'"):
        nao.to_trajectory(pepper)
    with pytest.raises(
        InvalidValueError, match="joints of keys: got LHipPitch, LAnklePitch, expected one of"
    ):
        nao.to_trajectory(pepper, ignore="foreign")


def test_units_that_a_file_leaves_open_are_degrees_and_shares(tmp_path):
    stated, left_open = tmp_path / "stated.xar", tmp_path / "open.xar"
    stated.write_text(BEHAVIOR)
    left_open.write_text(BEHAVIOR.replace('unit="0"', 'unit="-1"').replace('unit="1"', 'unit="-1"'))
    assert read_choregraphe(left_open) == read_choregraphe(stated)


def test_wrong_values_of_the_parts():
    for make, message in [
        (lambda: Handle("wavy"), "handle: got 'wavy'"),
        (lambda: Handle("bezier", np.nan), "handle: got"),
        (lambda: Key(0.0, np.inf), "key: got"),
        (lambda: JointCurve("A", ()), "times of A"),
        (lambda: Timeline("t", ()), "curves of t: got none"),
        (lambda: one("A", Key(0.0, 1.0)), "duration of test: got 0 s"),
        (lambda: naoqi_timeline(["A"], [], []), "lists of keys: got 1 names"),
        (
            lambda: find_limit_violations(pk.load_pepper(), Trajectory(("A",), [0, 1], [[[0.0]]])),
            "joints of the traj",
        ),
    ]:
        with pytest.raises(InvalidValueError, match=message):
            make()
