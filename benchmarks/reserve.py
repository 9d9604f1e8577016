"""Durations, certificates and the twin's distance of reaches that keep more or less in reserve.

    python benchmarks/reserve.py [--save FILE] [--beside FILE]

From Stand a hand reaches for points over a table, and the gaze follows: `plan`, `retime`, `check` and
`Twin.execute`, without further options but `smooth=True` in the last row, of robots with different
requirements.  `--save` keeps the durations with `with_requirements("limits")`; `--beside` adds ratios to
those that another commit has saved.  The last column is processor time of `plan` and `retime`.
"""

import argparse
import time
from pathlib import Path

import numpy as np

import pepper_kin as pk
from pepper_kin.model import MotionRequirements

COUNT, LOW, HIGH = 120, (0.30, -0.30, 0.78), (0.50, 0.35, 1.00)
SETTINGS = {
    '`with_requirements("limits")`': (MotionRequirements(None, 1.0), False),
    "balance 10 mm, all of the torque": (MotionRequirements(0.01, 1.0), False),
    "default: balance 10 mm, 90 % of the torque": (MotionRequirements(), False),
    "balance 10 mm, 85 % of the torque": (MotionRequirements(0.01, 0.85), False),
    "default, `plan(smooth=True)`": (MotionRequirements(), True),
}
TABLE = pk.Scene().add_box("table", size=(0.40, 0.80, 0.03), position=(0.47, 0.05, 0.715))


def reach(pepper: pk.PepperModel, point: np.ndarray, smooth: bool) -> tuple[float, bool, float, float]:
    """Return duration [s], whether the certificate is green, the twin's most [rad], and planning time [s]."""
    tasks = [pk.ik.HandPosition("left" if point[1] > 0 else "right", point), pk.ik.LookAt(point)]
    begin = time.process_time()
    plan = pk.plan(pepper, pepper.posture("Stand"), tasks, TABLE, smooth=smooth)
    if not plan.success:
        return np.nan, False, np.nan, np.nan
    try:
        motion = plan.trajectory or pk.retime(pepper, plan)
    except pk.exceptions.InfeasibleError:
        return np.inf, False, np.nan, np.nan
    spent = time.process_time() - begin
    run = pk.Twin(pepper).execute(motion, hold_time=0.5)
    behind = float(np.abs(run.position - run.reference_position).max())
    return motion.duration, motion.check(pepper, TABLE).success, behind, spent


def main() -> None:
    """Print the table of the page on trajectories."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--save", type=Path)
    parser.add_argument("--beside", type=Path)
    arguments = parser.parse_args()
    points = np.random.default_rng(5).uniform(LOW, HIGH, (COUNT, 3))
    earlier = [] if arguments.beside is None else [np.loadtxt(arguments.beside)]
    more = " duration beside FILE: median, 90 % |" if earlier else ""
    print(
        f"| keeps | green, refused | twin behind, most | duration: median, 90 % |{more} median [s] | [ms] |"
    )
    print("|---|---|---|---|" + "---|" * (2 + len(earlier)))
    first = None
    for name, (requirements, smooth) in SETTINGS.items():
        pepper = pk.load_pepper().with_requirements(requirements)
        reach(pepper, points[0], smooth)  # compiles what it needs
        found = [reach(pepper, point, smooth) for point in points]
        duration, green, behind, spent = map(np.array, zip(*found, strict=True))
        if requirements.balance is None and arguments.save is not None:
            np.savetxt(arguments.save, duration)
        first = duration if first is None else first
        ratios = [(duration / other)[np.isfinite(duration / other)] for other in (first, *earlier)]
        cells = [
            name, f"{int(green.sum())}, {int((~np.isfinite(duration)).sum())}",
            f"{1000 * np.nanmax(behind):.1f} mrad",
            *(f"{np.median(ratio):.2f}, {np.quantile(ratio, 0.9):.2f}" for ratio in ratios),
            f"{np.nanmedian(duration):.2f}", f"{1000 * np.nanmedian(spent):.1f}",
        ]  # fmt: skip
        print("| " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
