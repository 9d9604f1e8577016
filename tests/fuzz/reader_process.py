"""Runs damaged files through readers, each batch in a process that may end: `python reader_process.py`.

A line of standard input is JSON: {"reader", "seed", "first", "count"}; the answer is a line with the faults.
"""

import contextlib
import json
import os
import re
import resource
import shutil
import signal
import sys
import tempfile
import traceback
import warnings
from pathlib import Path
from typing import Any

import numpy as np

SECONDS = 10.0
MEMORY = 1_000_000_000
_KEPT = 40


def main() -> None:
    """Serve until the input ends."""
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "w")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    from large_files import LARGE
    from reader_cases import READERS

    print(json.dumps({"readers": list(READERS), "large": LARGE}), file=answers, flush=True)
    for line in sys.stdin:
        print(json.dumps(batch(**json.loads(line))), file=answers, flush=True)


def reader_named(name: str) -> Any:
    """Return a reader of damaged files, or of a large one."""
    from large_files import reader_of
    from reader_cases import READERS

    return READERS[name] if name in READERS else reader_of(name)


def batch(reader: str, seed: int, first: int, count: int) -> dict[str, Any]:
    """Return the faults of cases first, ..., first + count - 1, wherever a process ends."""
    faults: dict[str, list[str]] = {}
    refused = read = wrong = 0
    slowest = 0.0
    case = first
    while case < first + count:
        ending, lines = _in_a_process(reader, seed, case, first + count)
        for line in lines:
            case = line["case"] + 1
            refused += line["outcome"] == "refused"
            read += line["outcome"] == "read"
            slowest = max(slowest, line["seconds"])
            if line["outcome"] not in ("read", "refused"):
                wrong += 1
                _note(faults, line["case"], line["outcome"])
        if ending:
            wrong += 1
            _note(faults, case, f"the process ended: {ending}")
            case += 1
    kept = [f"{len(cases)} times, first in {cases[0]}" for cases in faults.values()][:_KEPT]
    return {"faults": kept, "wrong": wrong, "read": read, "refused": refused, "slowest": slowest}


def _note(faults: dict[str, list[str]], case: int, outcome: str) -> None:
    """Put a fault to those of its kind: what differs in numbers or quoted words alone."""
    kind = re.sub(r"[-+.\w]*\d[-+.\w]*|'[^']*'", "#", outcome)
    faults.setdefault(kind, []).append(f"case {case}: {outcome}")


def _in_a_process(reader: str, seed: int, first: int, end: int) -> tuple[str, list[dict[str, Any]]]:
    """Run cases until the process ends; return how it ended, empty if at the end, and what it wrote."""
    chosen = reader_named(reader)
    chosen.beside()  # made once, here
    chosen.damage(np.random.default_rng(0))
    receiving, sending = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(receiving)
        code = 1
        try:
            with os.fdopen(sending, "w") as answers:
                _cases(reader, seed, first, end, answers)
            code = 0
        except BaseException:
            with open(os.path.join(tempfile.gettempdir(), "reader_process_error.txt"), "a") as file:
                traceback.print_exc(file=file)
        finally:
            os._exit(code)
    os.close(sending)
    with os.fdopen(receiving) as answers:
        lines = [json.loads(line) for line in answers if line.endswith("\n")]
    _, status = os.waitpid(child, 0)
    if os.WIFSIGNALED(status):
        number = os.WTERMSIG(status)
        late = (
            f"more than {SECONDS:g} s"
            if number in (signal.SIGALRM, signal.SIGPROF)
            else signal.Signals(number).name
        )
        return late, lines
    return "" if os.WEXITSTATUS(status) == 0 else f"exit {os.WEXITSTATUS(status)}", lines


def _cases(reader: str, seed: int, first: int, end: int, answers: Any) -> None:
    warnings.simplefilter("ignore")
    np.seterr(all="ignore")
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    limit = pages * resource.getpagesize() + MEMORY
    resource.setrlimit(resource.RLIMIT_AS, (limit, resource.RLIM_INFINITY))
    chosen = reader_named(reader)
    folder = Path(tempfile.mkdtemp(prefix="reader_"))
    os.chdir(folder)
    try:
        for name, content in chosen.beside().items():
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).write_bytes(content)
        for case in range(first, end):
            rng = np.random.default_rng([seed, case, *reader.encode()])
            path = folder / chosen.file
            path.parent.mkdir(exist_ok=True)
            path.write_bytes(chosen.damage(rng))
            began = os.times().elapsed
            outcome = _outcome(chosen, path)
            line = {"case": case, "outcome": outcome, "seconds": os.times().elapsed - began}
            answers.write(json.dumps(line) + "\n")
            answers.flush()
    finally:
        os.chdir("/")
        shutil.rmtree(folder, ignore_errors=True)


def _outcome(chosen: Any, path: Path) -> str:
    from pepper_kin.exceptions import PepperKinError

    for number in (signal.SIGALRM, signal.SIGPROF):
        signal.signal(number, signal.SIG_DFL)
    signal.setitimer(signal.ITIMER_PROF, SECONDS)  # of the processor, whatever else runs
    signal.setitimer(signal.ITIMER_REAL, 12.0 * SECONDS)
    try:
        chosen.read(path)
    except PepperKinError as error:
        if (chosen.named or chosen.file) not in str(error):
            return f"does not name {chosen.named or chosen.file}: {type(error).__name__}: {str(error)[:200]}"
        return (
            "refused"
            if len(str(error)) < 3000
            else f"a message of {len(str(error))} letters: {str(error)[:99]}"
        )
    except BaseException as error:
        places = traceback.extract_tb(error.__traceback__)
        inner = [
            f"{Path(p.filename).name}:{p.lineno}"
            for p in places
            if "pepper_kin" in p.filename or "planners" in p.filename
        ]
        with contextlib.suppress(Exception):
            return f"{type(error).__name__}: {str(error)[:160]} ({' '.join(inner[-3:])})"
        return type(error).__name__
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.setitimer(signal.ITIMER_REAL, 0.0)
    return "read"


if __name__ == "__main__":
    main()
