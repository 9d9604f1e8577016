"""Keys of kernels name every source of which their expressions are made.

A program makes kernels of every room anew, and notes which files of the package have functions
that run meanwhile.  An edit of any of them has to change the key.
"""

import json

import pytest

PROGRAM = """
import collections, json, os, sys, threading
from pathlib import Path
from pepper_kin.kernels import sources

files_of, true_source_digest = {}, sources.source_digest
def noted(*modules):  # which files a digest stands for
    digest = true_source_digest(*modules)
    files_of[digest] = {str(path) for module in modules for path in sources._files(module)}
    return digest
import pepper_kin.kernels as kernels
sources.source_digest = kernels.source_digest = noted

from pepper_kin.kernels import kernel as made_here, store
FOLDER = str(Path(kernels.__file__).parent.parent)
OTHERS = [str(Path(__import__("pepper_kin.planners").planners.__file__).parent)]
missing = collections.defaultdict(set)
true_obtain, true_key = made_here.obtain, made_here._key
contents = {}
def key_of(content, dtype):
    key = true_key(content, dtype)
    contents[key] = content
    return key
read_by_key = set()
true_read = Path.read_bytes
def read(path):
    read_by_key.add(str(path))
    return true_read(path)
Path.read_bytes = read
made_here._source_digest.cache_clear()
made_here._source_digest()  # reads the files of the generator
generator = {path for path in read_by_key if "/kernels/" in path}
Path.read_bytes = true_read

def obtain(name, key, make, **options):
    ran = set()
    def profile(frame, event, argument):
        if event == "call":
            ran.add(frame.f_code.co_filename)
    def profiled(target):
        sys.setprofile(profile)
        try:
            return make(target)
        finally:
            sys.setprofile(None)
    part = true_obtain(name, key, profiled, **(options | {"keep": False}))
    named = set(generator)
    for digest, files in files_of.items():
        if digest in contents[key]:
            named |= files
    for path in ran:
        if path.startswith(FOLDER) and path not in named and "<" not in path:
            missing[name].add(os.path.relpath(path, FOLDER))
    return part
made_here.obtain, made_here._key = obtain, key_of

from pepper_kin import batch, ik, load_pepper
pepper = load_pepper()
batch.kernel(pepper, "gravity_torque")
batch.kernel(load_pepper(base="planar", hands="mimic"), "frame_pose", "LArm_effector")
from pepper_kin.ik.fast.compiled_tasks import _with_machine_code
wheels = [(0.09, 0.155), (-0.17, 0.0), (0.09, -0.155)]
tasks = ik.HandPosition("left", (0.38, 0.22, 0.82)), ik.CenterOfMassOverWheels(0.01, contacts=wheels)
_with_machine_code(pepper, tuple(task.structure() for task in tasks))
from pepper_kin.motion.static_limits import static_limits
static_limits(pepper, 0.005, {"LArm_effector": 0.3})
from pepper_kin.motion.constraints import _kernel, soft_structures
_kernel(pepper, soft_structures(tasks[:1]))
print(json.dumps({name: sorted(files) for name, files in missing.items()}))
print(len(contents))
"""

IRRELEVANT = {
    # They carry arguments and errors about; what they do cannot change an expression.
    "call_errors.py",
    "lazy_names.py",
    "arrays.py",
    "exceptions.py",
    "kernels/progress.py",
    "kernels/store.py",
    "kernels/wheel_code.py",
    "kernels/sources.py",
    "kernels/__init__.py",
}


@pytest.mark.thorough
def test_the_key_of_a_kernel_names_every_source_that_runs_while_it_is_made(child, tmp_path, made_units):
    missing, count = child(PROGRAM, PEPPER_KIN_CACHE=made_units(tmp_path)).stdout.splitlines()
    assert int(count) >= 5
    left = {name: sorted(set(files) - IRRELEVANT) for name, files in json.loads(missing).items()}
    assert not {name: files for name, files in left.items() if files}
