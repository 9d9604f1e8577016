"""The machine code that comes with the package: it fits the sources; what does not fit is refused."""

import json
import logging
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from pepper_kin.jobs import shipping as job
from pepper_kin.kernels import package_file, shipping
from pepper_kin.kernels.progress import making
from pepper_kin.kernels.target import BASELINES, make_target

KEY, OTHER = "a" * 64, "b" * 64
THIRD = "d" * 64
PARTS = {
    KEY: ("pepper_kin.core.one", b"first part " * 50),
    OTHER: ("a kernel", b"second part " * 50),
    THIRD: ("pepper_kin.core.three", b"third part " * 50),
}


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A file of our own in place of the package's."""
    path = tmp_path / "code"
    shipping.write_shipped(PARTS, "x86-64-v3", path)
    monkeypatch.setattr(shipping, "shipped_path", lambda name: path)
    forget()
    yield path
    forget()


def forget():
    shipping._index.cache_clear()
    package_file._reasons.clear()


def ask(caplog, name="pepper_kin.core.one", key=KEY):
    with caplog.at_level(logging.WARNING, "pepper_kin.kernels"):
        part = shipping.shipped_part(name, key)
        if part is None:
            with making(name):  # reasons are logged where something is made
                pass
        return part


def test_the_file_fits_the_sources():
    assert job.stale_names() == []
    for baseline in BASELINES:
        assert shipping.shipped_path(baseline).stat().st_size <= job.LARGEST


CHECK = """
import sys
from pathlib import Path
from pepper_kin.kernels import sources
from pepper_kin.jobs.shipping import main
true_digest = sources.file_digest
edited = sys.argv[1:]
sources.file_digest = lambda path: ("an edit of " if Path(path).name in edited else "") + true_digest(path)
sys.exit(main(["--check"]))
"""


@pytest.mark.parametrize(
    ("edited", "missing"),
    [
        ((), ()),
        (("urdf_document.py",), ("gravity_torque", "ik", "inverse_dynamics")),
        (("step_kernel.py",), ("twin step",)),
    ],
    ids=["sources as they are", "an edit of the model", "an edit of the twin"],
)
def test_the_check_sees_kernels_that_would_be_made_anew(edited, missing):
    """A kernel of other sources is missing, though no compiled function has changed."""
    done = subprocess.run([sys.executable, "-c", CHECK, *edited], capture_output=True, text=True, check=False)
    assert (done.returncode == 0) == (not missing), done.stderr
    for name in missing:
        assert f": {name}" in done.stderr
    assert "stale: " not in done.stderr


def test_parts_come_back_as_they_were(place, caplog):
    assert ask(caplog)[0] == PARTS[KEY][1]
    assert ask(caplog, "a kernel", OTHER)[0] == PARTS[OTHER][1]
    assert ask(caplog, "pepper_kin.core.three", THIRD)[0] == PARTS[THIRD][1]
    assert ask(caplog, "a kernel", "c" * 64) is None
    assert not caplog.records


@pytest.mark.parametrize("order", [(KEY, OTHER, THIRD), (THIRD, KEY, OTHER), (OTHER, THIRD, KEY, THIRD, KEY)])
def test_parts_can_be_read_in_any_order(place, caplog, order):
    for key in order:
        name, content = PARTS[key]
        assert ask(caplog, name, key)[0] == content


def test_threads_that_read_parts_at_once_get_whole_ones(tmp_path, monkeypatch):
    contents = {
        f"{k:064x}": ("pepper_kin.core.one", np.random.default_rng(k).bytes(3000 + k)) for k in range(64)
    }
    path = tmp_path / "code"
    shipping.write_shipped(contents, "x86-64-v3", path)
    monkeypatch.setattr(shipping, "shipped_path", lambda name: path)
    forget()
    keys = [*contents, *reversed(contents)] * 3
    with ThreadPoolExecutor(8) as pool:
        read = list(pool.map(lambda key: shipping.shipped_part("pepper_kin.core.one", key)[0], keys))
    forget()
    assert read == [contents[key][1] for key in keys]


def test_code_of_other_sources_is_not_found_and_reported_once(place, caplog):
    for _ in range(2):
        assert ask(caplog, key="c" * 64) is None
    (record,) = caplog.records
    assert "made from other sources of pepper_kin.core.one" in record.getMessage()


@pytest.mark.parametrize("where", [40, -10, -1690], ids=["index", "last part", "first part"])
def test_a_flipped_bit_is_found(place, caplog, where):
    data = bytearray(place.read_bytes())
    data[where] ^= 4
    place.write_bytes(bytes(data))
    found = [ask(caplog, PARTS[key][0], key) for key in PARTS]
    assert found.count(None) >= 1
    assert all(part is None or part[0] == PARTS[key][1] for key, part in zip(PARTS, found, strict=True))
    (record,) = caplog.records
    assert "damaged" in record.getMessage()


def test_another_format_is_refused(place, caplog, monkeypatch):
    monkeypatch.setattr(shipping, "FORMAT", shipping.FORMAT + 1)
    assert ask(caplog) is None
    assert "has format 4, not 5" in caplog.text


def test_a_missing_file_is_reported(place, caplog):
    place.unlink()
    assert ask(caplog) is None
    assert "cannot be read" in caplog.text


@pytest.mark.parametrize(
    ("target", "reason"),
    [
        (
            make_target("x86_64-unknown-linux-gnu", "x86-64-v2", "+sse4.2,+popcnt,+cx16,+sahf"),
            "has no avx, avx2",
        ),
        (make_target("aarch64-unknown-linux-gnu", "generic", "+neon"), "has no fp-armv8"),
        (make_target("arm64-apple-darwin23.0.0", "generic", "+fp-armv8,+neon"), "is arm64-apple-darwin"),
    ],
)
def test_another_processor_gets_none(place, caplog, monkeypatch, target, reason):
    monkeypatch.setattr(shipping, "host_target", lambda: target)
    assert ask(caplog) is None
    assert reason in caplog.text


def test_the_index_names_every_compiled_module():
    from pepper_kin.kernels.warm_up import compiled_modules

    for baseline in BASELINES:
        assert set(compiled_modules()) <= set(shipping.shipped_keys(baseline).values())


def test_all_processors_have_the_same_parts():
    assert len({tuple(shipping.shipped_keys(baseline)) for baseline in BASELINES}) == 1


def test_code_for_arm64_is_an_object_of_arm64(monkeypatch):
    target = make_target("aarch64-unknown-linux-gnu", "cortex-a76", "+fp-armv8,+neon,+crc")
    monkeypatch.setattr(shipping, "host_target", lambda: target)
    forget()
    for key, name in shipping.shipped_keys("aarch64").items():
        content, made_for = shipping.shipped_part(name, key)
        assert made_for.triple == target.triple
        start = content.index(b"\x7fELF")  # kernels have their signature before the object
        assert int.from_bytes(content[start + 18 : start + 20], "little") == 183  # EM_AARCH64
    forget()


def test_a_change_of_one_part_changes_no_byte_of_the_others(tmp_path):
    changed = PARTS | {OTHER: ("a kernel", b"another part of another size " * 70)}
    files = []
    for parts in (PARTS, changed):
        shipping.write_shipped(parts, "x86-64-v3", tmp_path / "code")
        files.append((tmp_path / "code").read_bytes())
    for data in files:
        assert PARTS[KEY][1] in data
        assert PARTS[THIRD][1] in data


EDITED = """
import importlib, sys
from pepper_kin.kernels import sources
from pepper_kin.kernels.store import is_known
from pepper_kin.kernels.compiled_function import unit_of
from pepper_kin.kernels.warm_up import compiled_modules
old, new, place = sys.argv[1:]
edit, edits = (old.encode(), new.encode()), []
true_read = sources.Path.read_bytes
def read(path):
    data = true_read(path)
    if str(path).endswith(place):
        edits.append(data.count(edit[0]))
        data = data.replace(*edit)
    return data
sources.Path.read_bytes = read
names = compiled_modules()
changed = [name for name in names if importlib.import_module(name) and not is_known(unit_of(name).key())]
print(max(edits), *changed)
"""


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("import math\n", "import math  # a comment\n", set()),
        ('    """Return', '    """Return, in other words,', set()),
        (
            "def symmetric_eigen(",
            "def symmetric_eigen(more=1, *, ",
            {"pepper_kin.core.servo_tick"},
        ),
    ],
    ids=["a comment", "docstrings", "one function"],
)
def test_an_edit_makes_the_units_anew_that_hold_the_function(child, tmp_path, old, new, expected):
    done = child(EDITED, old, new, "core/linear_algebra.py", PEPPER_KIN_CACHE=tmp_path)
    count, *changed = done.stdout.split()
    assert int(count) >= 1
    assert set(changed) == expected


README_LIKE = """
import json, sys
import pepper_kin as pk
pepper = pk.load_pepper()
point = (0.38, 0.22, 0.82)
tasks = [pk.ik.HandPosition("left", point), pk.ik.LookAt(point)]
scene = pk.Scene().add_box("table", size=(0.40, 0.80, 0.03), position=(0.47, 0.05, 0.715))
plan = pk.plan(pepper, pepper.posture("Stand"), tasks, scene)
trajectory = pk.retime(pepper, plan, balance=0.01)
run = pk.Twin(pepper, timestep=0.001).execute(trajectory)
print(json.dumps({"numba": "numba" in sys.modules, "ok": trajectory.check(pepper, scene=scene).success}))
"""


def test_a_first_run_compiles_nothing_and_writes_nothing(child, tmp_path):
    """Also where neither home nor cache folder can be written."""
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    done = child(README_LIKE, PEPPER_KIN_CACHE=blocked / "cache", HOME=blocked / "home")
    assert json.loads(done.stdout) == {"numba": False, "ok": True}
    assert done.stderr == ""
