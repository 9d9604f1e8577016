"""Scripts run as they are: in Python 2 with proxies, in Python 3 with sessions."""

import json
import signal
import subprocess
import sys
import threading
import traceback
from pathlib import Path

import pytest

from pepper_kin.exceptions import FileFormatError, InvalidValueError
from pepper_kin.kernels import threads
from pepper_kin.naoqi import run_script

SCRIPTS = Path(__file__).parent / "scripts"


def test_a_script_in_python_2_runs_to_its_end(broker, capsys):
    result = run_script(SCRIPTS / "old_style.py2", broker=broker)
    assert result.error is None
    assert result.ended == "completed"
    assert result.duration >= 2.5
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "refused ALMotion::getAngles"
    assert lines[1].startswith("yaw 0.52")
    assert lines[3] == "touched MiddleTactilTouched 1.0"


def test_a_script_in_python_3_runs_to_its_end(broker, capsys):
    result = run_script(SCRIPTS / "new_style.py", ["--ip", "robot"], broker=broker)
    assert result.success, result.error
    assert capsys.readouterr().out.splitlines() == ["arrived True", "slept 1.0", "event 5"]
    assert result.duration > 1.5


def test_a_script_without_an_end_is_interrupted(broker, tmp_path):
    script = tmp_path / "endless.py"
    script.write_text("import time\nwhile True:\n    time.sleep(1)\n")
    result = run_script(script, broker=broker, longest=5.0)
    assert (result.ended, result.success) == ("time is up", True)
    assert result.duration == pytest.approx(5.0, abs=0.05)


def test_a_script_is_interrupted_in_a_call_that_blocks(broker, tmp_path):
    script = tmp_path / "blocked.py"
    script.write_text(
        "import qi\n"
        "motion = qi.Session().service('ALMotion')\n"
        "try:\n    motion.angleInterpolation('HeadYaw', 0.5, 1000.0, True)\n"
        "finally:\n    motion.killAll()\n    motion.angleInterpolation('HeadYaw', 0.1, 2.0, True)\n"
    )
    result = run_script(script, broker=broker, longest=5.0)
    assert (result.ended, result.success) == ("time is up", True)
    assert result.duration == pytest.approx(7.0, abs=0.1)  # what it does to clean up is done
    broker.motion.angleInterpolation("HeadYaw", 0.5, 2.0, True)  # the limit was that of the script


def test_what_a_script_raises_is_in_the_result(broker, tmp_path):
    script = tmp_path / "wrong.py"
    script.write_text("raise ValueError('no')\n")
    result = run_script(script, broker=broker)
    assert (result.ended, result.code, result.success) == ("failed", 1, False)
    assert isinstance(result.error, ValueError)
    script.write_text("import sys\nsys.exit(3)\n")
    assert run_script(script, broker=broker).code == 3


def test_modules_and_names_are_put_back(broker, tmp_path):
    script = tmp_path / "plain.py"
    script.write_text("import naoqi, qi, almath, motion, vision_definitions, time\n")
    argv, main = list(sys.argv), sys.modules["__main__"]
    before = {name: sys.modules.get(name) for name in ("naoqi", "qi", "almath", "motion")}
    run_script(script, broker=broker)
    assert {name: sys.modules.get(name) for name in before} == before
    assert (sys.argv, sys.modules["__main__"]) == (argv, main)


def test_a_file_that_is_no_script_is_refused(broker, tmp_path):
    script = tmp_path / "no.py"
    script.write_text("def broken(:\n")
    with pytest.raises(FileFormatError, match=r"no\.py"):
        run_script(script, broker=broker)


def test_a_folder_and_code_that_is_nested_too_deep_are_refused(broker, tmp_path):
    with pytest.raises(FileFormatError, match="cannot be read: Is a directory"):
        run_script(tmp_path, broker=broker)
    script = tmp_path / "deep.py"
    script.write_text("-" * 100_000 + "1")
    with pytest.raises(FileFormatError, match=r"deep\.py: cannot be compiled by Python: "):
        run_script(script, broker=broker)


def test_what_a_script_says_as_it_exits_is_seen(broker, tmp_path, capsys):
    script = tmp_path / "exits.py"
    script.write_text("import sys\nsys.exit('usage: exits.py IP')\n")
    result = run_script(script, broker=broker)
    assert (result.ended, result.code) == ("exited", 1)
    assert capsys.readouterr().err == "usage: exits.py IP\n"


def test_a_time_that_is_none_is_refused(broker, tmp_path):
    for longest in [0.0, -1.0, float("nan")]:
        (tmp_path / "s.py").write_text("")
        with pytest.raises(InvalidValueError, match="a time above 0"):
            run_script(tmp_path / "s.py", broker=broker, longest=longest)


@pytest.mark.thorough
@pytest.mark.skipif(not hasattr(signal, "pthread_kill"), reason="signals as on Unix")
def test_ctrl_c_ends_a_script_with_130_and_keeps_the_recording(tmp_path):
    script = tmp_path / "endless.py"
    script.write_text(
        "import time\ntime.sleep(0.2)\nprint('begun', flush=True)\nwhile True:\n    time.sleep(0.1)\n"
    )
    # What a shell began with "&" ignores SIGINT, and so do its children.
    hear = "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler)"
    program = f"{hear}; sys.argv[0] = 'pepper-kin'; from pepper_kin.cli import main; main()"
    words = ["naoqi", "run", str(script), "--record", str(tmp_path / "run.csv"), "--json"]
    with subprocess.Popen(
        [sys.executable, "-c", program, *words],
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    ) as process:  # fmt: skip
        try:
            assert any(line == "begun\n" for line in process.stderr)  # other packages may warn before
            process.send_signal(signal.SIGINT)
            output, errors = process.communicate(timeout=60)
        finally:
            process.kill()
    assert process.returncode == 130
    assert json.loads(output)["ended"] == "interrupted"
    assert "Traceback" not in errors
    assert (tmp_path / "run.csv").read_text().startswith("time,")


def test_a_recording_too_short_for_a_run_hides_nothing_of_the_script(run, tmp_path):
    (tmp_path / "wrong.py").write_text("raise ValueError('the reason')\n")
    done = run("naoqi", "run", "wrong.py", "--fast", "--record", "run.csv", cwd=tmp_path)
    assert done.returncode == 1
    assert "Not written: run.csv: fewer than two cycles" in done.stderr
    assert "ValueError: the reason" in done.stderr


def output_of(broker, folder, capsys, text, modules=(), longest=5.0):
    for name, content in [("main.py", text), *modules]:
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(content)
    result = run_script(folder / "main.py", broker=broker, longest=longest)
    return result, capsys.readouterr().out


def test_modules_beside_a_script_are_translated_and_forgotten(broker, tmp_path, capsys):
    half = "from naoqi import ALProxy\nimport time\ndef half(x):\n\ttime.sleep(0.5)\n        return x / 2\n"
    deep = "NAME = u'deep'\nprint 'deep is read'\n"
    modules = [("tools.py", half), ("parts/__init__.py", ""), ("parts/deep.py", deep)]
    text = "from tools import half\nimport parts.deep as deep\nprint half(5), deep.NAME\n"
    result, out = output_of(broker, tmp_path, capsys, text, modules)
    assert result.success, result.error
    assert out == "deep is read\n2 deep\n"
    assert result.duration == pytest.approx(0.5)
    assert not {"tools", "parts", "parts.deep"} & set(sys.modules)


@pytest.mark.parametrize(
    ("program", "printed"),
    [
        ("from naoqi import ALProxy\nx = 7\nx /= 2\nprint(x, 7 / 2, 7.0 / 2, -7 / 2)", "(3, 3, 3.5, -4)"),
        ("from __future__ import division\nimport naoqi\nprint 7 / 2", "3.5"),
        ("print(7 / 2, round(2.5))", "3.5 2"),
        ("import Queue, urllib2, ConfigParser, StringIO\nq = Queue.Queue()\nq.put(1)\nprint q.get(), "
         "urllib2.quote('a b'), StringIO.StringIO('x').read(), ConfigParser.ConfigParser.__name__",
         "1 a%20b x ConfigParser"),
        ("picture = bytes(bytearray([1, 2, 255]))\nprint map(ord, picture), [ord(c) for c in 'ab']",
         "[1, 2, 255] [97, 98]"),
        ("import numpy\nfrom naoqi import ALProxy\n"
         "print(numpy.fromstring(bytes(bytearray([1, 2])), numpy.uint8).tolist())", "[1, 2]"),
        ("import Image, naoqi\n"
         "picture = Image.fromstring('RGB', (2, 1), str(bytearray([1, 2, 3, 200, 5, 6])))\n"
         "print picture.getpixel((1, 0)), len(str(bytearray([200]))), str(7)", "(200, 5, 6) 1 7"),
        ("print '\u00e9'.decode('utf-8') + u'!'.encode('utf8'), 'ff'.decode('hex')[0]", "\u00e9! \u00ff"),
        ("d = {'a': 1}\nprint d.has_key('a'), d.keys() + [2], d.items()", "True ['a', 2] [('a', 1)]"),
        ("print round(2.5), cmp(1, 2), reduce(lambda a, b: a + b, xrange(4)), raw_input()", "\n3.0 -1 6 "),
        ("exec 'y = 3'\nprint y, 0777, 5L, `y`, 1 <> 2", "3 511 5 3 True"),
    ],
)  # fmt: skip
def test_programs_mean_what_they_meant_in_python_2(broker, tmp_path, capsys, program, printed):
    result, out = output_of(broker, tmp_path, capsys, "# -*- coding: utf-8 -*-\n" + program + "\n")
    assert result.success, result.error
    assert out == printed + "\n"


def test_old_meanings_that_the_translator_leaves(broker, tmp_path, capsys):
    text = (
        "import json, mutex, StringIO\nclass A:\n    def ask(self):\n        from os.path import *\n"
        "        return basename('a/b'), self.next(2)\nsetattr(A, 'next', lambda self, k=1: k)\n"
        "print A().ask(), A().next(), json.loads('[1]', encoding='latin-1')\nm = mutex.mutex()\n"
        "def f(x):\n    print x, m.test()\nm.lock(f, 1)\nm.lock(f, 2)\nm.unlock()\nm.unlock()\n"
        "print m.test()\n"
    )
    result, out = output_of(broker, tmp_path, capsys, text)
    assert result.error is None
    assert out.splitlines() == ["('b', 2) 1 [1]", "1 True", "2 True", "False"]


def test_errors_name_the_line_of_the_program(broker, tmp_path, capsys):
    text = "import urllib2\n\nprint 'one'\n\ndef wrong():\n    return 1 / 0\n\nwrong()\n"
    result, _ = output_of(broker, tmp_path, capsys, text)
    assert isinstance(result.error, ZeroDivisionError)
    frames = traceback.extract_tb(result.error.__traceback__)
    assert [frame.lineno for frame in frames if frame.filename.endswith("main.py")] == [8, 6]
    with pytest.raises(FileFormatError, match=r"main\.py:4: is neither Python 3 nor Python 2"):
        output_of(broker, tmp_path, capsys, "print 'one'\nprint 'two'\n\nif then x:\n    pass\n")


@pytest.mark.thorough
@pytest.mark.parametrize(
    "waits",
    [
        "import time\nwhile True:\n    time.sleep(0.1)",
        "while True:\n    pass",
        "while raw_input('again?') != 'q':\n    pass",
        "import socket\ns = socket.socket()\ns.bind(('127.0.0.1', 0))\ns.listen(1)\ns.accept()",
        "import threading\nthreading.Event().wait()",
        "import polars, threading\nthreading.Event().wait()",  # whose handler lets waits in the system go on
        "import threading as t\nx = t.Thread(target=t.Event().wait, daemon=True)\nx.start()\nx.join()",
        "import qi\napp = qi.Application()\napp.run()",
        "import qi\nqi.Promise().future().value()",
        "from naoqi import ALProxy\nm = ALProxy('ALMemory')\nwhile not m.getData('FaceDetected'):\n    pass",
        "import select\nselect.select([], [], [])",
        "try:\n    while True:\n        pass\nexcept KeyboardInterrupt:\n    while True:\n        pass",
        "import time\nwhile True:\n    try:\n        time.sleep(0.1)\n    except:\n        pass",
        "m = __import__('naoqi').ALProxy('ALMotion')\nwhile True:\n    try:\n        m.moveTo(1.0, 0, 0)\n"
        "    except:\n        print 'no'",
        "import threading as t\nt.Thread(target=t.Event().wait).start()",
        "import threading, time\ndef f():\n    while True:\n        time.sleep(0.1)\n"
        "threading.Thread(target=f).start()",
    ],
)
def test_a_program_that_waits_ends_when_its_time_is_up(broker, tmp_path, capsys, waits):
    broker.memory.insertData("FaceDetected", [])
    before = threading.enumerate()
    result, _ = output_of(broker, tmp_path, capsys, waits + "\n", longest=1.0)
    assert result.ended in ("time is up", "completed")
    assert result.success
    assert all(thread.daemon or thread in before for thread in threading.enumerate())  # the process can end


@pytest.mark.thorough
def test_a_script_ends_in_time_where_interrupts_are_ignored(broker, tmp_path, capsys):
    """As in jobs that a shell runs in the background."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        waits = "import threading\nthreading.Event().wait()\n"
        result, _ = output_of(broker, tmp_path, capsys, waits, longest=1.0)
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)
    assert (result.ended, result.success) == ("time is up", True)


POOLS = """\
import concurrent.futures, threading, time
video = __import__('naoqi').ALProxy('ALVideoDevice')
handle = video.subscribeCamera('x', 0, 8, 11, 10)
print(len(video.getImageRemote(handle)[6]))
pool = concurrent.futures.ThreadPoolExecutor(2)
pool.submit(lambda: (time.sleep(2.0), print('late')))
"""


def test_a_script_ends_when_its_pools_and_cameras_have_nothing_to_do(broker, tmp_path, capsys):
    result, out = output_of(broker, tmp_path, capsys, POOLS, longest=60.0)
    assert (result.ended, out.split()) == ("completed", [str(40 * 30 * 3), "late"])
    assert result.duration == pytest.approx(2.0, abs=0.1)


def test_threads_of_the_library_outlive_a_script(broker, tmp_path, monkeypatch):
    """A script that computes with the library makes its pool, which serves the process after it."""
    monkeypatch.setattr(threads, "_pool", None)
    done = []
    program = "import pepper_kin.kernels.threads as t\nt.run_in_pieces(5000, 2, 1, lambda a, b: None)\n"
    (tmp_path / "script.py").write_text(program)
    assert run_script(tmp_path / "script.py", broker=broker, longest=5.0).ended == "completed"
    threads.run_in_pieces(5000, 2, 1, lambda first, last: done.append(last - first))
    assert sum(done) == 5000


ENDLESS = """\
import threading, time
m = __import__('naoqi').ALProxy('ALMotion')
def f():
    while True:
        m.angleInterpolation('HeadYaw', 0.5, 1.0, True)
        m.angleInterpolation('HeadYaw', -0.5, 1.0, True)
t = threading.Thread(target=f)
"""
TWICE = """\
import threading, time
t = threading.Thread(target=len, args=('',))
t.start()
t.join()
try:
    t.start()
except RuntimeError:
    print 'refused'
time.sleep(2)
"""


@pytest.mark.parametrize(
    ("ends", "how"),
    [
        ("t.start()", "time is up"),
        ("t.daemon = True\nt.start()\ntime.sleep(2.2)", "completed"),
        ("t.start()\nraise SystemExit(0)", "exited"),
    ],
)
def test_no_thread_of_a_program_moves_the_robot_after_it(broker, tmp_path, capsys, ends, how):
    result, _ = output_of(broker, tmp_path, capsys, f"{ENDLESS}{ends}\n", longest=4.0)
    assert result.ended == how
    broker.motion.killAll()
    yaw = broker.motion.getAngles("HeadYaw", False)[0]
    broker.body.time.sleep(3.0)
    assert broker.motion.getAngles("HeadYaw", False)[0] == pytest.approx(yaw, abs=1e-3)
    assert "Traceback" not in capsys.readouterr().err


def test_a_thread_that_is_started_twice_does_not_stop_the_clock(broker, tmp_path, capsys):
    result, out = output_of(broker, tmp_path, capsys, TWICE, longest=10.0)
    assert (result.ended, out) == ("completed", "refused\n")
    assert result.duration == pytest.approx(2.0, abs=0.05)


def test_threads_of_a_program_do_their_work_after_its_last_line(broker, tmp_path, capsys):
    text = (
        "import threading, time\nfrom naoqi import ALProxy\ndef work():\n    time.sleep(1)\n"
        "    ALProxy('ALMotion').angleInterpolation('HeadYaw', 0.3, 1.0, True)\n    print 'turned'\n"
        "threading.Timer(0.01, work).start()\n"
    )
    result, out = output_of(broker, tmp_path, capsys, text)
    assert (result.ended, out) == ("completed", "turned\n")
    assert broker.motion.getAngles("HeadYaw", True)[0] == pytest.approx(0.3, abs=0.01)
    endless = (
        "import threading\nthreading.Thread(target=threading.Event().wait).start()\nraise ValueError(1)\n"
    )
    result, _ = output_of(broker, tmp_path, capsys, endless, longest=0.5)
    assert (result.ended, repr(result.error)) == ("failed", "ValueError(1)")
