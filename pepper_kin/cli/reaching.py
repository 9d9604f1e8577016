"""The commands `pepper-kin demo` and `reach`: argument parsing and printing, nothing else."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

import typer

import pepper_kin as pk
from pepper_kin.cli.terminal import (
    FAILED,
    SIDES,
    Json,
    Output,
    Seed,
    Solvers,
    complete_posture,
    one_of,
    print_json,
    stages,
)
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.file_access.atomic_file import check_folder
from pepper_kin.lazy_names import lazy_module

first_run = lazy_module("pepper_kin.jobs.first_run")
result_files = lazy_module("pepper_kin.jobs.result_files")

app = typer.Typer()

Point = tuple[float, float, float]


@app.command()
def demo(
    output: Output = Path("pepper-kin-demo"),
    seed: Seed = 0,
    solvers: Solvers = "fast",
    as_json: Json = False,
) -> None:
    """Reach over a table's edge, look at the spot, and report.

    Example: pepper-kin demo -o demo
    """
    check_folder(output)
    pepper = pk.load_pepper().with_solvers(solvers)
    options = ["-o", str(output), "--seed", str(seed), "--solvers", solvers, *["--json"] * as_json]
    code = first_run.run_interpreted(
        ["demo", *options], "pepper_kin.jobs.demo", lambda text: print(text, file=sys.stderr, flush=True)
    )
    if code is not None:
        raise typer.Exit(code)
    with stages(as_json) as on_stage:
        outcome = pk.jobs.run_demo(pepper, seed=seed, on_stage=on_stage)
    _finish_reach(pepper, outcome, output, as_json)


@app.command()
def reach(
    hand: Annotated[str, typer.Option(help="left or right.", autocompletion=one_of(SIDES))],
    at: Annotated[Point, typer.Option(help="Where the palm should go: X Y Z, in meters.")],
    look_at: Annotated[
        Point | None, typer.Option(help="Where the camera should look: X Y Z, in meters.")
    ] = None,
    avoid_box: Annotated[
        list[str] | None,
        typer.Option(help='A box "SX,SY,SZ,X,Y,Z": full lengths and center, in meters; may be repeated.'),
    ] = None,
    start_from: Annotated[
        str | None,
        typer.Option(help="Posture to start from; Ready if left out.", autocompletion=complete_posture),
    ] = None,
    output: Output = Path("pepper-kin-reach"),
    *,
    seed: Seed = 0,
    timeout: Annotated[float, typer.Option(help="Time budget of IK and planning, in seconds.")] = 10.0,
    solvers: Solvers = "fast",
    as_json: Json = False,
) -> None:
    """Reach with a hand and look at a point, without collisions and within all limits.

    Example: pepper-kin reach --hand left --at 0.38 0.22 0.82 -o out
    """
    check_folder(output)
    pepper = pk.load_pepper().with_solvers(solvers)
    begin = None if start_from is None else pepper.posture(start_from)
    scene = _scene(avoid_box or [])
    with stages(as_json) as on_stage:
        outcome = pk.jobs.reach(
            pepper, hand, at, look_at, scene, start=begin, seed=seed, timeout=timeout, on_stage=on_stage
        )
    _finish_reach(pepper, outcome, output, as_json)


def _scene(boxes: list[str]) -> pk.Scene:
    scene = pk.Scene()
    for index, text in enumerate(boxes):
        try:
            numbers = [float(part) for part in text.replace(",", " ").split()]
        except ValueError:
            numbers = []
        if len(numbers) != 6:
            raise InvalidValueError("--avoid-box", repr(text), "six numbers SX,SY,SZ,X,Y,Z [m]")
        scene = scene.add_box(f"box{index + 1}", size=numbers[:3], position=numbers[3:])
    return scene


def _finish_reach(pepper: pk.PepperModel, outcome: pk.jobs.ReachOutcome, output: Path, as_json: bool) -> None:
    """Write the files, print the report, and exit with an error where the job was not done."""
    if outcome.run is None:
        if as_json:
            print_json(result_files.summary(pepper, outcome))
        print(outcome.message, file=sys.stderr)
        raise typer.Exit(FAILED)
    files = result_files.save_outcome(pepper, outcome, output)
    files["motion.html"] = pk.viewer.save_reach_html(pepper, outcome, output / "motion.html")
    if as_json:
        print_json(result_files.summary(pepper, outcome))
    else:
        _print_reach(outcome)
        print("Written: " + ", ".join(str(path) for path in files.values()))
        print(f"Open {files['motion.html']} in a browser to see the motion.")
    if not outcome.success:
        print(outcome.message, file=sys.stderr)
        raise typer.Exit(FAILED)


def _clearances(figures: dict[str, Any]) -> list[tuple[str, str]]:
    """Return the rows of clearances, planned and executed: first what matters, the distance to obstacles."""
    rows = []
    for key, name in (("obstacles", "clearance from obstacles"), ("itself", "clearance from itself")):
        pair = [figures[f"clearance_{when}_m"][key] for when in ("planned", "executed")]
        words = [f"{value * 1000:.1f} mm" for value in pair if value is not None]
        rows.append((f"{name}, planned / executed", " / ".join(words) or "nothing there"))
    return rows


def _print_reach(outcome: pk.jobs.ReachOutcome) -> None:
    from rich.console import Console
    from rich.markup import escape
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
        *_clearances(figures),
        ("largest tracking error", f"{figures['tracking_error_max'] * 1000:.2f} mrad"),
    ]
    for row in rows:
        table.add_row(*row)
    joints = Table(title="Joints")
    for heading in ("joint", "peak torque [% of limit]", "rms tracking error [mrad]"):
        # Escaped: in brackets rich looks for its own commands, and drops what it takes for one.
        joints.add_column(escape(heading), justify="left" if heading == "joint" else "right")
    for joint, use in figures["peak_torque_use"].items():
        joints.add_row(
            escape(joint), f"{use * 100:.1f}", f"{figures['tracking_error_rms'][joint] * 1000:.3f}"
        )
    console = Console()
    console.print(table)
    console.print(joints)
    console.print(outcome.message, markup=False)
