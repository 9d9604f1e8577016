"""Wall time of `pepper-kin demo`: a new process each time, imports included.

The first run has empty folders for machine code, both of kernels and of numba, as on a machine that has
never seen the library; the others find there what it left.

python benchmarks/demo_time.py [runs]
"""

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path


def main() -> None:
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 3
    with tempfile.TemporaryDirectory() as kernels, tempfile.TemporaryDirectory() as numba:
        environment = {**os.environ, "PEPPER_KIN_CACHE": kernels, "NUMBA_CACHE_DIR": numba}
        first, _ = timed(environment)
        later = [timed(environment) for _ in range(runs)]
    median = statistics.median(seconds for seconds, _ in later)
    print(f"demo, nothing compiled yet: {first:.2f} s (asked: under 20 s)")
    print(f"demo, code on disk, median of {runs}: {median:.2f} s")
    for stage in later[0][1]:
        print(f"  {stage}: {statistics.median(stages[stage] for _, stages in later):.2f} s")


def timed(environment: dict[str, str]) -> tuple[float, dict[str, float]]:
    """Return the wall time of one run and what it says of its stages."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-c", "from pepper_kin.cli import main; main()", "demo", "-o", folder]
        begin = time.perf_counter()
        subprocess.run(
            command, check=True, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        seconds = time.perf_counter() - begin
        summary = json.loads((Path(folder) / "summary.json").read_text())
    return seconds, summary["stage_seconds"]


if __name__ == "__main__":
    main()
