"""The first command on a new machine compiles nothing."""

CODE = """
import sys
import pepper_kin as pk
from pepper_kin.jobs import run_demo

outcome = run_demo(pk.load_pepper())
print(outcome.success, "numba" in sys.modules, outcome.message)
"""


def test_the_demo_compiles_nothing(child, tmp_path):
    """What is compiled is kept: nothing is, and nothing is said."""
    done = child(CODE, PEPPER_KIN_CACHE=tmp_path / "kernels")
    assert done.stdout.startswith("True False"), done.stdout
    assert not list(tmp_path.glob("kernels/*"))
    assert done.stderr == ""


ANSWERS = """
import pickle
import sys
import pepper_kin as pk

HEAVY = {"pinocchio", "coal", "hppfcl", "casadi", "numba", "scipy", "placo", "toppra", "xacro", "numpy.ma"}
def light(what):
    assert not HEAVY & set(sys.modules), (what, HEAVY & set(sys.modules))

pepper = pickle.loads(pickle.dumps(pk.load_pepper()))
pepper.posture("Stand"), pepper.frame_id("Head"), pepper.joint_group("left_arm")
light("a model")
target = (0.38, 0.22, 0.82)
tasks = [pk.ik.HandPosition("left", target), pk.ik.LookAt(target)]
assert pk.ik.solve(pepper, tasks[0], collisions=False).success
light("IK")
HEAVY.remove("numpy.ma")
assert pk.ik.solve(pepper, tasks).success
light("IK with collisions")
pk.retime(pepper, [pepper.posture("Stand"), pepper.posture("Stand") * 0.9])
light("timing")
table = pk.Scene().add_box("table", size=(0.4, 0.8, 0.03), position=(0.47, 0.05, 0.715))
assert pk.plan(pepper, pepper.posture("Stand"), tasks, table, timeout=60.0).success
light("a plan")
"""


def test_first_answers_load_no_compiler_and_no_other_library(child):
    child(ANSWERS)
