"""The command `pepper-kin`: argument parsing and printing, nothing else."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pepper_kin import cli_check
from pepper_kin.exceptions import InvalidValueError, PepperKinError

if TYPE_CHECKING:
    from pepper_kin.jobs import ReachOutcome
    from pepper_kin.model import PepperModel

FAILED = 1
MISUSED = 2

app = typer.Typer(
    name="pepper-kin",
    help="Kinematics, dynamics, whole-body IK, planning, timing and a twin for Pepper.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)
app.add_typer(cli_check.app)

Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")]
Output = Annotated[Path, typer.Option("--output", "-o", help="Folder for the files; made if missing.")]
Seed = Annotated[int, typer.Option(help="Seed of all random choices.")]
Point = tuple[float, float, float]


@app.command()
def demo(output: Output = Path("pepper-kin-demo"), seed: Seed = 0, as_json: Json = False) -> None:
    """Reach over a table's edge, look at the spot, and report.

    Example: pepper-kin demo -o demo
    """
    from pepper_kin.jobs import run_demo
    from pepper_kin.model import load_pepper

    pepper = load_pepper()
    outcome = run_demo(pepper, seed=seed, on_stage=_announce(as_json))
    _finish_reach(pepper, outcome, output, as_json)


@app.command()
def reach(
    hand: Annotated[str, typer.Option(help="left or right.")],
    at: Annotated[Point, typer.Option(help="Where the palm should go: X Y Z [m].")],
    look_at: Annotated[Point | None, typer.Option(help="Where the camera should look: X Y Z [m].")] = None,
    avoid_box: Annotated[
        list[str] | None,
        typer.Option(help='A box "SX,SY,SZ,X,Y,Z": full lengths and centre [m]; may be repeated.'),
    ] = None,
    output: Output = Path("pepper-kin-reach"),
    seed: Seed = 0,
    timeout: Annotated[float, typer.Option(help="Time budget of IK and planning [s].")] = 10.0,
    as_json: Json = False,
) -> None:
    """Reach with a hand, look at a point, and do it safely.

    Example: pepper-kin reach --hand left --at 0.38 0.22 0.82 --look-at 0.5 0.1 0.8
    --avoid-box 0.4,0.8,0.03,0.47,0.05,0.715 -o out
    """
    from pepper_kin.jobs import reach as run_reach
    from pepper_kin.model import load_pepper

    pepper = load_pepper()
    outcome = run_reach(
        pepper, hand, at, look_at, _scene(avoid_box or []), seed=seed, timeout=timeout,
        on_stage=_announce(as_json),
    )  # fmt: skip
    _finish_reach(pepper, outcome, output, as_json)


@app.command()
def gesture(
    name: Annotated[str, typer.Argument(help="left-arm, right-arm or head.")],
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Folder for the files.")] = None,
    as_json: Json = False,
) -> None:
    """Replay a movement of the paper's table 5 on the twin and compare the errors.

    Example: pepper-kin gesture left-arm -o gesture
    """
    from pepper_kin.jobs import write_gesture
    from pepper_kin.model import load_pepper
    from pepper_kin.twin import replay

    report = replay(load_pepper(), name)
    if output is not None:
        write_gesture(report, output)
    print(json.dumps(report.as_dict(), indent=2) if as_json else report.report())


def _scene(boxes: list[str]) -> Any:
    from pepper_kin.collision import Scene

    scene = Scene()
    for index, text in enumerate(boxes):
        try:
            numbers = [float(part) for part in text.replace(",", " ").split()]
        except ValueError:
            numbers = []
        if len(numbers) != 6:
            raise InvalidValueError("--avoid-box", repr(text), "six numbers SX,SY,SZ,X,Y,Z [m]")
        scene = scene.add_box(f"box{index + 1}", size=numbers[:3], position=numbers[3:])
    return scene


def _announce(quiet: bool) -> Any:
    """Return what is told of each stage: a line on the error stream, so that output stays clean."""
    return (lambda stage: None) if quiet else (lambda stage: print(f"  {stage} ...", file=sys.stderr))


def _finish_reach(pepper: PepperModel, outcome: ReachOutcome, output: Path, as_json: bool) -> None:
    """Write the files, print the report, and exit with an error where the job was not done."""
    from pepper_kin.jobs import result_files
    from pepper_kin.viewer import save_reach_html

    if outcome.run is None:
        if as_json:
            print(json.dumps(result_files.summary(pepper, outcome), indent=2))
        print(outcome.message, file=sys.stderr)
        raise typer.Exit(FAILED)
    files = result_files.write_outcome(pepper, outcome, output)
    files["motion.html"] = save_reach_html(pepper, outcome, output / "motion.html")
    if as_json:
        print(json.dumps(result_files.summary(pepper, outcome), indent=2))
    else:
        _print_reach(outcome)
        print("Written: " + ", ".join(str(path) for path in files.values()))
        print(f"Open {files['motion.html']} in a browser to see the motion.")
    if not outcome.success:
        print(outcome.message, file=sys.stderr)
        raise typer.Exit(FAILED)


def _print_reach(outcome: ReachOutcome) -> None:
    from rich.console import Console
    from rich.table import Table

    figures = outcome.figures
    table = Table(title="Reach", show_header=False)
    gaze = figures["gaze_error_rad"]
    rows = [
        ("hand error", f"{figures['hand_error_m'] * 1000:.2f} mm"),
        ("gaze error", "free" if gaze is None else f"{gaze * 57.29578:.3f} deg"),
        ("path length, joints", f"{figures['path_length_joint']:.3f} rad"),
        ("path length, hand", f"{figures['hand_path_length_m']:.3f} m"),
        ("duration", f"{figures['duration_s']:.3f} s"),
        ("smallest clearance, planned", f"{figures['smallest_clearance_planned_m'] * 1000:.1f} mm"),
        ("smallest clearance, executed", f"{figures['smallest_clearance_executed_m'] * 1000:.1f} mm"),
        ("largest tracking error", f"{figures['tracking_error_max'] * 1000:.2f} mrad"),
    ]
    for row in rows:
        table.add_row(*row)
    joints = Table(title="Joints")
    for heading in ("joint", "peak torque use", "rms tracking error [mrad]"):
        joints.add_column(heading, justify="left" if heading == "joint" else "right")
    for joint, use in figures["peak_torque_use"].items():
        joints.add_row(joint, f"{use * 100:.1f} %", f"{figures['tracking_error_rms'][joint] * 1000:.3f}")
    console = Console()
    console.print(table)
    console.print(joints)
    console.print(outcome.message)


def main() -> None:
    """Run the command line; misuse ends with one line and exit code 2, "not found" with 1."""
    try:
        app()
    except PepperKinError as error:
        print(f"pepper-kin: {error}", file=sys.stderr)
        sys.exit(MISUSED)
