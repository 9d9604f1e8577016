"""`pepper-kin check ...`: argument parsing and printing of the checks."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(help="Check a model, its limits and its dynamics.", no_args_is_help=True)

FAILED = 1
Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")]


@app.command()
def model(
    urdf: Annotated[Path | None, typer.Argument(help="A URDF to audit and to compare with ours.")] = None,
    as_json: Json = False,
) -> None:
    """Audit a description: masses, inertias, limits, fingers, frames and meshes.

    Example: pepper-kin check model other_pepper.urdf
    """
    from pepper_kin.model import audit, compare, load_pepper

    ours = load_pepper(hands="mimic")
    found = audit(ours if urdf is None else urdf)
    difference = None if urdf is None else compare(ours, urdf)
    if as_json:
        told = {"audit": found.to_dict()}
        if difference is not None:
            told["comparison"] = difference.to_dict()
        print(json.dumps(told, indent=2))
    else:
        print(found.report())
        if difference is not None:
            print("\n" + difference.report())
    if not found.ok:
        raise typer.Exit(FAILED)


@app.command()
def limits(as_json: Json = False) -> None:
    """Compare our joint limits with the paper's table 4.

    Example: pepper-kin check limits
    """
    from pepper_kin.model import limits_table

    table = limits_table()
    print(json.dumps(table.to_dict(), indent=2) if as_json else table.report())
