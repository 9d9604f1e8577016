"""Wall time of `pepper-kin demo`, cold: a new process each time, imports included.

python benchmarks/demo_time.py [runs]
"""

import json
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path


def main() -> None:
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 3
    seconds, stages = [], []
    for _ in range(runs):
        with tempfile.TemporaryDirectory() as folder:
            begin = time.perf_counter()
            command = [sys.executable, "-c", "from pepper_kin.cli import main; main()", "demo", "-o", folder]
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            seconds.append(time.perf_counter() - begin)
            summary = json.loads((Path(folder) / "summary.json").read_text())
            stages.append(summary["stage_seconds"])
    median, worst = statistics.median(seconds), max(seconds)
    print(f"demo, {runs} runs: median {median:.2f} s, worst {worst:.2f} s (asked: under 20 s)")
    for stage in stages[0]:
        print(f"  {stage}: {statistics.median(run[stage] for run in stages):.2f} s")


if __name__ == "__main__":
    main()
