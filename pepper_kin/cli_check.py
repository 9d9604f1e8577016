"""The commands `pepper-kin check ...`: argument parsing and printing, nothing else."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

FAILED = 1

app = typer.Typer(
    name="check",
    help="Check a robot's description, dynamics or limits; exit code 1 says that something is wrong.",
    no_args_is_help=True,
)


@app.callback()
def _group() -> None:
    """Keep the name of a sub-command in front even where there is only one."""


@app.command()
def dynamics(
    urdf: Annotated[Path | None, typer.Argument(help="URDF file of a robot; Pepper by default.")] = None,
    states: Annotated[int, typer.Option(help="Number of random states.")] = 200,
    seed: Annotated[int, typer.Option(help="Seed of all random choices.")] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
) -> None:
    """Hold dynamics against Newton-Euler, finite differences and the balance of energy.

    Example: pepper-kin check dynamics my_robot.urdf --states 500
    """
    from pepper_kin.jobs import check_dynamics
    from pepper_kin.model import load_pepper, load_robot

    pepper = load_pepper() if urdf is None else load_robot(urdf)
    found = check_dynamics(pepper, states=states, seed=seed)
    print(json.dumps(found.as_dict(), indent=2) if as_json else found.report())
    if not found.ok:
        raise typer.Exit(FAILED)
