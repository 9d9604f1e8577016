"""Projects of Choregraphe: what their timelines say at each frame, and the order and the time of signals."""

import math
import subprocess
import sys
import zipfile
from html import escape

import pytest

from pepper_kin.exceptions import FileFormatError, InvalidValueError
from pepper_kin.naoqi import run_behavior

ON_LOAD, EVENT, START, STOP, MEMORY = range(5)
INPUTS = ((1, "onLoad", ON_LOAD, ""), (2, "onStart", START, ""), (3, "onStop", STOP, ""))
STOPPED = (4, "onStopped", 1)


def box(number, name, script="", inner="", inputs=(), outputs=(), parameters=()):
    """A box of a .xar file; its inputs 1, 2, 3 and its output 4 are the usual ones."""
    ports = "".join(
        f'<Input name="{name}" type="1" type_size="1" nature="{kind}" stm_value_name="{event}" id="{k}" />'
        for k, name, kind, event in (*INPUTS, *inputs)
    ) + "".join(
        f'<Output name="{name}" type="1" type_size="1" nature="{kind}" id="{k}" />'
        for k, name, kind in (STOPPED, *outputs)
    )
    values = "".join(
        f'<Parameter name="{name}" inherits_from_parent="{inherits}" content_type="{kind}"'
        f' value="{escape(value)}" id="{50 + k}" />'
        for k, (name, kind, value, inherits) in enumerate(parameters)
    )
    code = f"<script language='4'><content><![CDATA[{script}]]></content></script>"
    return f'<Box name="{name}" id="{number}">{code}{ports}{values}{inner}</Box>'


def diagram(boxes, *links):
    """A diagram; links are (box, output, box, input), 0 being the box around it."""
    ways = "".join(
        f'<Link outputowner="{a}" indexofoutput="{o}" inputowner="{b}" indexofinput="{i}" />'
        for a, o, b, i in links
    )
    return f"<Diagram>{''.join(boxes)}{ways}</Diagram>"


def flow(boxes, *links):
    keyframe = f'<BehaviorKeyframe name="k" index="1">{diagram(boxes, *links)}</BehaviorKeyframe>'
    layer = f'<BehaviorLayer name="l">{keyframe}</BehaviorLayer>'
    return f'<Timeline enable="0">{layer}</Timeline>'


def timeline(size, curves, keyframes=()):
    """A timeline of 25 frames a second; curves are {joint: {frame: degrees}}."""
    keys = "".join(
        f'<ActuatorCurve name="v" actuator="{joint}" mute="0" unit="0">'
        + "".join(f'<Key frame="{frame}" value="{value}" />' for frame, value in values.items())
        + "</ActuatorCurve>"
        for joint, values in curves.items()
    )
    shown = "".join(
        f'<BehaviorKeyframe name="k" index="{frame}">{d}</BehaviorKeyframe>' for frame, d in keyframes
    )
    return (
        f'<Timeline enable="1" fps="25" start_frame="1" end_frame="-1" size="{size}">'
        f'<BehaviorLayer name="l">{shown}</BehaviorLayer>'
        f'<ActuatorList model="">{keys}</ActuatorList></Timeline>'
    )


def behavior(path, *root, **named):
    path.parent.mkdir(parents=True, exist_ok=True)
    inner = box(-1, "root", "", flow(*root), **named)
    path.write_text(
        f'<?xml version="1.0" encoding="UTF-8" ?>\n<ChoregrapheProject>{inner}</ChoregrapheProject>'
    )
    return path


def script(**methods):
    """The script of a box in Python 2."""
    body = "".join(
        f"    def {name}(self{', p' if 'p' in text.split('#')[0].split() else ''}):\n"
        + "".join(f"        {line}\n" for line in text.splitlines())
        for name, text in methods.items()
    )
    begin = "class MyClass(GeneratedClass):\n    def __init__(self):\n        GeneratedClass.__init__(self)\n"
    return begin + body


def says(text, *more):
    return script(onInput_onStart="\n".join([f"self.log('{text}')", *more, "self.onStopped()"]))


@pytest.fixture
def run(broker, tmp_path):
    """Run a behavior; return its result, and what it logged with the times."""

    def go(*root, longest=60.0, **named):
        path = behavior(tmp_path / "project" / "behavior_1" / "behavior.xar", *root, **named)
        result = run_behavior(path, broker=broker, longest=longest)
        return result, [(round(at, 2), text.partition(": ")[2]) for at, text in broker.logged]

    return go


def test_a_timeline_is_at_its_keys_at_their_frames(broker, run):
    seen = {}
    names = ("HeadYaw", "RElbowRoll")
    broker.body.listeners.append(
        lambda: seen.setdefault(
            round(broker.body.time.now, 2), [broker.body.command[broker.body.index[n]] for n in names]
        )
    )
    curves = {
        "HeadYaw": {26: 30, 51: -20},
        "RElbowRoll": {51: 60},
        "LHipPitch": {26: 9},
        "RKneePitch": {26: 9},
    }
    moves = box(1, "moves", "", timeline(76, curves))
    result, log = run([moves], (0, 2, 1, 2), (1, 4, 0, 4))
    assert (result.ended, result.code, result.failures) == ("completed", 0, ())
    assert result.duration == pytest.approx(3.0, abs=0.05)  # frames 1 to 76
    assert seen[0.98][0] == pytest.approx(math.radians(30), abs=1e-3)  # commands of 1.00 s
    assert seen[1.98] == pytest.approx([math.radians(-20), math.radians(60)], abs=1e-3)
    assert broker.motion.getAngles(names, True) == pytest.approx(
        [math.radians(-20), math.radians(60)], abs=5e-3
    )
    assert [text for _, text in log] == ["2 joints of another robot stay out: LHipPitch, RKneePitch"]


def test_signals_carry_values_and_run_beside_each_other(run):
    asks = script(
        onInput_onStart="self.log(self.getParameter('half') / 2)\nself.answer([self.getParameter('word'), 7])"
    )
    asks = box(
        1, "asks", asks, outputs=[(5, "answer", 2)], parameters=[("half", 1, "7", 0), ("word", 3, "no", 1)]
    )
    hears = box(2, "hears", script(onInput_onStart="# p\nself.log(p[0], p[1])".replace("# p", "p = p")))
    slow = box(3, "slow", says("slow", "time.sleep(1)", "self.log('late')"))
    quick = box(4, "quick", says("quick", "time.sleep(0.5)", "self.log('soon')"))
    inner = box(
        5, "inner", "", flow([asks, hears], (0, 2, 1, 2), (1, 5, 2, 2)), parameters=[("word", 3, "yes", 0)]
    )
    result, log = run([slow, quick, inner], *((0, 2, k, 2) for k in (3, 4, 5)))
    assert result.failures == ()
    assert [text for _, text in log] == ["slow", "quick", "3", "yes 7", "soon", "late"]
    assert [at for at, text in log if text in ("soon", "late")] == pytest.approx([0.5, 1.0], abs=0.03)


def test_how_fast_boxes_compute_does_not_change_what_they_do(run):
    """A box that computes for a third of a second of the wall is as early as one that does not."""
    computes = [
        "for k in range(3):",
        "    end = wall() + 0.3",
        "    while wall() < end: pass",
        "    time.sleep(0.2)",
    ]
    text = "from timeit import default_timer as wall\n" + says("begin", *computes, "self.log('slow')")
    slow = box(1, "slow", text)
    quick = box(2, "quick", says("begin", "time.sleep(0.5)", "self.log('quick')"))
    _, log = run([slow, quick], (0, 2, 1, 2), (0, 2, 2, 2))
    assert [(at, text) for at, text in log if text != "begin"] == [(0.5, "quick"), (0.6, "slow")]


def test_keyframes_load_and_unload_their_boxes(run):
    def spoken(number, name):
        return box(
            number, name, script(onLoad=f"self.log('load {name}')", onUnload=f"self.log('unload {name}')",
                                 onInput_onStart=f"self.log('start {name}')")
        )  # fmt: skip

    shown = [(frame, diagram([spoken(1, name)], (0, 1, 1, 2))) for frame, name in ((1, "one"), (26, "two"))]
    over = box(2, "over", "", timeline(51, {"HeadYaw": {51: 0}}, shown))
    result, log = run([over], (0, 2, 2, 2), (2, 4, 0, 4))
    assert [text for _, text in log] == [
        "load one",
        "start one",
        "unload one",
        "load two",
        "start two",
        "unload two",
    ]
    assert [at for at, _ in log] == pytest.approx([0, 0, 1, 1, 1, 2], abs=0.05)
    assert result.duration == pytest.approx(2.0, abs=0.05)


def test_events_of_the_memory_come_in_and_methods_hear_them(run):
    raises = says("raise", "time.sleep(1)", "ALProxy('ALMemory').raiseEvent('Own', 5)")
    hears = script(
        onLoad="self.memory = ALProxy('ALMemory')\nself.BIND_PYTHON(self.getName(), 'onEvent')\n"
        "self.memory.subscribeToEvent('Own', self.getName(), 'onEvent')",
        onEvent="self.log('heard')",
    ).replace("onEvent(self)", "onEvent(self, key, p, message)")
    takes = box(3, "takes", script(onInput_onStart="p = p\nself.log('taken %d' % p)"))
    links = [(0, 2, 1, 2), (0, 9, 3, 2)]
    result, log = run(
        [box(1, "raises", raises), box(2, "hears", hears), takes], *links, inputs=[(9, "Own", MEMORY, "Own")]
    )
    assert result.failures == ()
    assert sorted(text for _, text in log) == ["heard", "raise", "taken 5"]
    assert {at for at, text in log if text != "raise"} == {1.0}


def test_a_stopped_timeline_moves_no_further(broker, run):
    moves = box(1, "moves", "", timeline(101, {"HeadYaw": {101: 60}}))
    stops = box(2, "stops", says("wait", "time.sleep(1.0)"))
    run([moves, stops], (0, 2, 1, 2), (0, 2, 2, 2), (2, 4, 1, 3), (1, 4, 0, 4))
    there = broker.motion.getAngles("HeadYaw", True)[0]
    assert 0.02 < there < math.radians(20)
    broker.body.time.sleep(2.0)
    assert broker.motion.getAngles("HeadYaw", True)[0] == pytest.approx(there, abs=0.02)


def test_a_box_may_clean_up_until_its_script_is_over(run):
    """As Choregraphe's own box that plays sounds does: it stops, and only then says that it does not run."""
    text = script(
        onLoad="self.runs = False", onUnload="while self.runs: time.sleep(0.1)\nself.log('unloaded')",
        onInput_onStart="self.runs = True\nself.onStopped()\nself.log('over')\nself.runs = False",
    )  # fmt: skip
    inner = box(1, "inner", "", flow([box(1, "sound", text)], (0, 2, 1, 2), (1, 4, 0, 4)))
    result, log = run([inner], (0, 2, 1, 2), (1, 4, 0, 4))
    assert (result.ended, [text for _, text in log]) == ("completed", ["over", "unloaded"])


def test_scripts_rule_their_timeline(broker, run):
    jumps = script(
        onInput_onStart="t = self.getParentTimeline()\ntime.sleep(0.2)\nt.goTo(76)\nself.log(t.getSize())"
    )
    over = box(
        1, "over", "",
        timeline(101, {"HeadYaw": {51: 60, 101: 15}}, [(1, diagram([box(1, "jumps", jumps)], (0, 1, 1, 2)))]),
    )  # fmt: skip
    result, log = run([over], (0, 2, 1, 2), (1, 4, 0, 4))
    assert log[0][1] == "101"
    assert result.duration == pytest.approx(1.2, abs=0.05)  # 0.2 s, then frames 76 to 101
    assert broker.motion.getAngles("HeadYaw", True)[0] == pytest.approx(math.radians(15), abs=0.01)


def test_a_box_that_fails_is_named_with_its_line_and_the_others_go_on(run):
    fails = box(1, "fails", "\n\n" + script(onInput_onStart="1 / 0", onUnload="self.log('clean')"))
    absent = box(2, "absent", says("x", "ALProxy('ALPhotoCapture').setCameraModel(1)"))
    works = box(3, "works", says("works"))
    result, log = run([fails, absent, works], *((0, 2, k, 2) for k in (1, 2, 3)), (3, 4, 0, 4))
    assert (result.ended, result.code) == ("failed", 1)
    assert result.failures[0] == (
        "root/fails",
        "line 8: ZeroDivisionError: integer division or modulo by zero",
    )
    assert "clean" in [text for _, text in log]
    assert "works" in [text for _, text in log]


def test_dialogues_and_programs_that_cannot_be_read_are_said(run):
    talks = box(1, "talks", "", "<dialogFile>a.dlg</dialogFile>")
    _, log = run([talks], (0, 2, 1, 2))
    assert log == [(0.0, "dialogues are not simulated; it waits for ever")]
    with pytest.raises(FileFormatError, match=r"behavior\.xar:4: "):
        run([box(1, "odd", "x = 1\n\nif then y:\n")], (0, 2, 1, 2))


def test_a_behavior_that_waits_ends_when_its_time_is_up(run):
    waits = box(1, "waits", says("x", "while True:", "    time.sleep(0.1)"))
    result, _ = run([waits], (0, 2, 1, 2), longest=3.0)
    assert (result.ended, result.code) == ("time is up", 0)
    assert result.duration == pytest.approx(3.0, abs=0.1)


def test_nothing_of_a_behavior_moves_after_its_time(broker, run):
    """Not even where a box does not let the others be unloaded."""
    stubborn = box(1, "stubborn", script(onUnload="while True: time.sleep(0.1)", onInput_onStart="pass"))
    frames = [(k, diagram([])) for k in range(1, 500, 50)]
    moves = box(2, "moves", "", timeline(1000, {"HeadYaw": {500: 60, 1000: -60}}, frames))
    result, _ = run([stubborn, moves], (0, 2, 1, 2), (0, 2, 2, 2), longest=3.0)
    assert result.ended == "time is up"
    yaw = broker.motion.getAngles("HeadYaw", False)[0]
    assert yaw > 0.05
    broker.body.time.sleep(3.0)
    assert broker.motion.getAngles("HeadYaw", False)[0] == pytest.approx(yaw, abs=0.03)


def test_projects_folders_and_applications_name_their_behaviors(broker, tmp_path):
    folder = tmp_path / "app"
    for name in ("first", "second"):
        behavior(folder / name / "behavior.xar", [box(1, name, says(name))], (0, 2, 1, 2), (1, 4, 0, 4))
    named = "".join(
        f'<BehaviorDescription name="b" src="{n}" xar="behavior.xar" />' for n in ("second", "first")
    )
    project = folder / "app.pml"
    project.write_text(f"<Package><BehaviorDescriptions>{named}</BehaviorDescriptions></Package>")
    package = tmp_path / "app.pkg"
    with zipfile.ZipFile(package, "w") as archive:
        for name in ("first", "second"):
            archive.write(folder / name / "behavior.xar", f"{name}/behavior.xar")
    for path, first in ((project, "second"), (folder, "second"), (package, "first")):
        result = run_behavior(path, broker=broker)
        assert (result.behavior, sorted(result.behaviors)) == (first, ["first", "second"])
        assert run_behavior(path, "first", broker=broker).behavior == "first"
        with pytest.raises(InvalidValueError, match="first"):
            run_behavior(path, "third", broker=broker)
    with zipfile.ZipFile(package, "a") as archive:
        archive.writestr("../outside/behavior.xar", "x")
    with pytest.raises(FileFormatError, match="outside its own folder"):
        run_behavior(package, broker=broker)
    empty = tmp_path / "empty"
    empty.mkdir()
    with pytest.raises(FileFormatError, match="no project"):
        run_behavior(empty, broker=broker)


def test_the_command_runs_a_project(tmp_path):
    behavior(tmp_path / "one" / "behavior.xar", [box(1, "b", says("hello"))], (0, 2, 1, 2), (1, 4, 0, 4))
    program = "import sys; from pepper_kin.cli import main; sys.argv[0] = 'pepper-kin'; main()"
    process = subprocess.run(
        [sys.executable, "-c", program, "naoqi", "run", str(tmp_path / "one" / "behavior.xar"), "--fast"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert process.returncode == 0, process.stderr
    assert "root/b: hello" in process.stderr
    assert "behavior one" in process.stderr
