"""Machine code of one robot is never run for another: all kinds of compiled things, all kinds of changes.

Answers of robots that differ in one thing, asked for one after the other in one process and with one cache,
are those of processes with a cache that holds no robot's code, and that know one robot only.
"""

import json
import os
import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np

SCRIPT = Path(__file__).with_name("robots_and_answers.py")
worker = runpy.run_path(str(SCRIPT))
NAMES, KINDS, IN_PLACE = worker["NAMES"], worker["KINDS"], worker["IN_PLACE"]


def ask(cache, kinds, names):
    done = subprocess.run(
        [sys.executable, str(SCRIPT), " ".join(kinds), *names],
        env={**os.environ, "PEPPER_KIN_CACHE": str(cache)},
        capture_output=True,
        text=True,
        timeout=3000,
        check=False,
    )
    assert done.returncode == 0, (names, done.stderr)
    return [json.loads(line) for line in done.stdout.splitlines()]


def differing(found, wanted):
    """Return the kinds whose answers differ."""
    return [kind for kind in wanted if not _same(found[kind], wanted[kind])]


def _same(found, wanted):
    if isinstance(found, str) or isinstance(wanted, str):
        return found == wanted
    return len(found) == len(wanted) and np.allclose(found, wanted, rtol=1e-9, atol=1e-9, equal_nan=True)


def test_code_of_one_robot_is_never_run_for_another(tmp_path, rng, amount, tried, made_units):
    """In both orders, with the cache kept; a robot changed in place answers as one changed before its use."""
    kinds = list(KINDS)[: amount(3, 7, len(KINDS))]
    others = [name for name in NAMES if name != "as it is"]
    chosen = rng.permutation(others)[: amount(1, 4, len(others))].tolist()
    plain = ask(made_units(tmp_path / "plain"), kinds, ["as it is"])[0]
    assert not {kind: text for kind, text in plain.items() if isinstance(text, str)}
    wrong, count, kept, effects = [], 0, made_units(tmp_path / "kept"), set()
    for k, name in enumerate(chosen):
        wanted = ask(made_units(tmp_path / f"alone {k}"), kinds, [name])[0]
        effects.update(differing(wanted, plain))
        later = f"later {name}" if name in IN_PLACE else name
        for order in (["as it is", later, "as it is", name], [name, "as it is"]):
            for asked, found in zip(order, ask(kept, kinds, order), strict=True):
                bad = differing(found, plain if asked == "as it is" else wanted)
                wrong += [(order, asked, kind) for kind in bad]
                count += len(kinds)
    tried("answers with a kept cache", count, len(wrong))
    assert not wrong
    assert effects  # the changes do change answers
