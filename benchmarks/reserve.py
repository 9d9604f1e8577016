"""Durations, certificates and the twin's distance of reaches that keep more or less in reserve.

    python benchmarks/reserve.py

From Stand a hand reaches for points over a table, and the gaze follows: `plan`, `retime`, `check` and
`Twin.execute`, without further options, of robots with different requirements.
"""

import numpy as np

import pepper_kin as pk
from pepper_kin.model import MotionRequirements

COUNT, LOW, HIGH = 120, (0.30, -0.30, 0.78), (0.50, 0.35, 1.00)
SETTINGS = {
    '`with_requirements("limits")`': MotionRequirements(None, 1.0),
    "balance 10 mm, all of the torque": MotionRequirements(0.01, 1.0),
    "default: balance 10 mm, 90 % of the torque": MotionRequirements(),
    "balance 10 mm, 85 % of the torque": MotionRequirements(0.01, 0.85),
}
TABLE = pk.Scene().add_box("table", size=(0.40, 0.80, 0.03), position=(0.47, 0.05, 0.715))


def reach(pepper: pk.PepperModel, point: np.ndarray) -> tuple[float, bool, float]:
    """Return duration [s], whether the certificate is green, and the twin's greatest distance [rad]."""
    tasks = [pk.ik.HandPosition("left" if point[1] > 0 else "right", point), pk.ik.LookAt(point)]
    plan = pk.plan(pepper, pepper.posture("Stand"), tasks, TABLE)
    if not plan.success:
        return np.nan, False, np.nan
    try:
        motion = pk.retime(pepper, plan)
    except pk.exceptions.InfeasibleError:
        return np.inf, False, np.nan
    run = pk.Twin(pepper).execute(motion, hold_time=0.5)
    behind = float(np.abs(run.position - run.reference_position).max())
    return motion.duration, motion.check(pepper, TABLE).success, behind


def main() -> None:
    """Print the table of the page on trajectories."""
    points = np.random.default_rng(5).uniform(LOW, HIGH, (COUNT, 3))
    print("| keeps | plans | refused | green | twin behind, most | duration, median | 90 % |")
    print("|---|---|---|---|---|---|---|")
    before = None
    for name, requirements in SETTINGS.items():
        pepper = pk.load_pepper().with_requirements(requirements)
        duration, green, behind = map(np.array, zip(*(reach(pepper, p) for p in points), strict=True))
        before = duration if before is None else before
        ratio = (duration / before)[np.isfinite(duration / before)]
        planned, refused = int((~np.isnan(duration)).sum()), int(np.isinf(duration).sum())
        print(
            f"| {name} | {planned} | {refused} | {int(green.sum())} | {1000 * np.nanmax(behind):.1f} mrad "
            f"| {np.median(ratio):.2f} | {np.quantile(ratio, 0.9):.2f} |"
        )


if __name__ == "__main__":
    main()
