"""The commands `pepper-kin check ...`: argument parsing and printing, nothing else."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated

import typer

import pepper_kin as pk
from pepper_kin.cli.terminal import FAILED, Json, print_found, print_json, progress, registered
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.file_access.atomic_file import check_file, check_folder, make_folder, write_text

app = typer.Typer(
    name="check",
    cls=registered("checks"),
    help="Check a robot's description, dynamics or limits; exit code 1 says that something is wrong.\n\n"
    "Example: pepper-kin check dynamics",
    no_args_is_help=True,
)


@app.command()
def dynamics(
    urdf: Annotated[Path | None, typer.Argument(help="URDF file of a robot; Pepper by default.")] = None,
    states: Annotated[int, typer.Option(help="Number of random states.")] = 200,
    seed: Annotated[int, typer.Option(help="Seed of all random choices.")] = 0,
    as_json: Json = False,
) -> None:
    """Hold dynamics against Newton-Euler, finite differences and the balance of energy.

    Example: pepper-kin check dynamics my_robot.urdf --states 500
    """
    pepper = pk.load_pepper() if urdf is None else pk.load_robot(urdf)
    with progress("checking dynamics") as report:
        found = pk.jobs.check_dynamics(pepper, states=states, seed=seed, progress=report)
    print_found(found, as_json)
    if not found.success:
        raise typer.Exit(FAILED)


@app.command()
def model(
    urdf: Annotated[Path | None, typer.Argument(help="A URDF to audit and to compare with ours.")] = None,
    as_json: Json = False,
) -> None:
    """Audit a description: masses, inertias, limits, fingers, frames and meshes.

    Example: pepper-kin check model other_pepper.urdf
    """
    ours = pk.load_pepper(hands="mimic")
    found = pk.model.audit(ours if urdf is None else urdf)
    # A file without a link would differ in every name, which hides its faults.
    difference = None if urdf is None or not found.frames else pk.model.compare(ours, urdf)
    if as_json:
        summary = {"audit": found.to_dict()}
        if difference is not None:
            summary["comparison"] = difference.to_dict()
        print_json(summary)
    else:
        print(found.report())
        if difference is not None:
            print("\n" + difference.report())
    if not found.success:
        raise typer.Exit(FAILED)


@app.command()
def physics(
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Folder for the files.")] = None,
    seed: Annotated[int, typer.Option(help="Seed of the free swing's start.")] = 0,
    as_json: Json = False,
) -> None:
    """Run the twin beside MuJoCo: free swing, step responses, a gesture, a push (needs mujoco).

    Example: pepper-kin check physics -o validation
    """
    if output is not None:
        check_folder(output)
    with progress("running both engines") as report:
        found = pk.jobs.check_physics(seed=seed, progress=report)
    print_found(found, as_json)
    if output is not None:
        make_folder(output)
        for name, text in (
            ("physics.txt", found.report()),
            ("physics.json", json.dumps(found.as_dict(), indent=2)),
        ):
            print(f"wrote {write_text(output / name, text + chr(10))}", file=sys.stderr)
    if not found.success:
        raise typer.Exit(FAILED)


@app.command()
def log(
    files: Annotated[list[Path], typer.Argument(help="Logs of a robot: .csv, .csv.xz or .mcap.")],
    share: Annotated[
        float | None, typer.Option(help="Share of the fastest speed that went with the commands.")
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Picture of robot and twin: PNG.")] = None,
    page: Annotated[
        Path | None, typer.Option(help="Page that plays robot and twin over each other, of one log: HTML.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Give a robot's commands to the twin, and hold the twin beside the robot.

    Example: pepper-kin check log session_1.csv.xz session_2.csv.xz --plot log.png
    """
    if page is not None and len(files) > 1:
        raise InvalidValueError("--page", str(page), f"to be left out with {len(files)} logs: it shows one")
    for path in filter(None, (plot, page)):
        check_file(path)
    with progress("replaying logs") as report:
        found = pk.identification.check_logs(files, share=share, progress=report)
    print_found(found, as_json)
    if plot is not None:
        print(f"wrote {pk.identification.save_replay_picture(found.replays, plot)}", file=sys.stderr)
    if page is not None:
        (only,) = found.replays
        with pk.Viewer(pk.load_pepper()) as viewer:
            print(f"wrote {viewer.save_html(page, only, title=only.log.name)}", file=sys.stderr)
