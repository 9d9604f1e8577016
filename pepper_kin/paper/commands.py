"""The commands `pepper-kin check limits` and `pepper-kin check paper`: argument parsing and printing."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated

import typer

from pepper_kin import paper
from pepper_kin.cli.terminal import FAILED, Json, print_found, progress
from pepper_kin.file_access.atomic_file import check_folder

limits_app, paper_app = typer.Typer(add_completion=False), typer.Typer(add_completion=False)


@limits_app.command()
def limits(as_json: Json = False) -> None:
    """Compare our joint limits with the paper's table 4.

    Example: pepper-kin check limits
    """
    table = paper.limits_table()
    print(json.dumps(table.to_dict(), indent=2) if as_json else table.report())


@paper_app.command()
def validation(
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for tables and pictures.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of the sensors' noise.")] = 0,
    as_json: Json = False,
) -> None:
    """Make the published twin's validation again: limits, three movements, and its measuring chain.

    Example: pepper-kin check paper -o validation
    """
    if output is not None:
        check_folder(output)
    with progress("replaying the paper's movements") as report:
        found = paper.check_paper(seed=seed, progress=report)
    print_found(found, as_json)
    if output is not None:
        for path in paper.save_paper_check(found, output).values():
            print(f"wrote {path}", file=sys.stderr)
    if not found.success:
        raise typer.Exit(FAILED)
