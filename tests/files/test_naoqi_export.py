"""Python scripts as Choregraphe exports them: read, never run."""

import pytest

from pepper_kin.exceptions import FileFormatError
from pepper_kin.files import read_naoqi_export
from pepper_kin.trajectory.key_curve import Handle, Key

EXPORT = """# made by hand
names = list()
times = list()
keys = list()

names.append("HeadYaw")
times.append([0.5, 1.5])
keys.append([[0.3, [3, -0.166667, 0], [3, 0.333333, 0]], [0, [3, -0.333333, 0], [3, 0, 0]]])

names.append("HeadPitch")
times.append([1])
keys.append([0.1])

try:
  motion = ALProxy("ALMotion")
  motion.angleInterpolationBezier(names, times, keys)
except BaseException, err:
  print err
"""


def test_export_in_python_2_is_read(tmp_path):
    path = tmp_path / "nod.py"
    path.write_text(EXPORT)
    timeline = read_naoqi_export(path)
    assert timeline.name == "nod"
    assert timeline.joint_names == ("HeadYaw", "HeadPitch")
    assert timeline.curves[0].keys[0] == Key(
        0.5, 0.3, Handle("bezier", -0.166667, 0.0), Handle("bezier", 0.333333, 0.0)
    )


def test_wrong_exports(tmp_path):
    for old, new, line, message in [
        ("[0.5, 1.5]", "[0.5, 1.5", 7, "times.append(...) has no plain values"),
        ('"HeadYaw"', "open('x')", 6, "names.append(...) has no plain values"),
        ("[0.5, 1.5]", "[1.5, 0.5]", None, "times of HeadYaw"),
        ("[0.5, 1.5]", "[0.5]", None, "lists of HeadYaw: got 1 times, 2 keys"),
        ("[[0.3, [3,", "[[0.3, [7,", None, "kind 7"),
        ("[[0.3,", "[['a',", None, "key of HeadYaw at 0.5 s: got 'a', expected numbers"),
        ("[[0.3,", "[[1e999,", None, "expected finite numbers"),
        ("[3, -0.166667, 0]", "[3, 0.166667, 0]", None, "handle before the key at 0.5 s"),
        ('"HeadPitch"', '"HeadYaw"', None, "curves of nod: got HeadYaw"),
        ("names.append", "words.append", None, "lists of nod"),
        ("names = list()", "names.append(3", 2, "names.append(...) has no plain values"),
    ]:
        path = tmp_path / "nod.py"
        path.write_text(EXPORT.replace(old, new, 1))
        with pytest.raises(FileFormatError) as caught:
            read_naoqi_export(path)
        assert message in str(caught.value)
        assert caught.value.line == line


def test_other_scripts_are_no_exports(tmp_path):
    path = tmp_path / "x.py"
    path.write_text("print('hello')\n")
    with pytest.raises(FileFormatError, match=r"has no names.append"):
        read_naoqi_export(path)
