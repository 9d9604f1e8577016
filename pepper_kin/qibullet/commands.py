"""The commands `pepper-kin qibullet ...`: argument parsing and printing, nothing else."""

from __future__ import annotations

import sys
import traceback
from contextlib import redirect_stdout
from pathlib import Path
from typing import Annotated

import typer

from pepper_kin.cli.terminal import FAILED, Json, print_json
from pepper_kin.lazy_names import lazy_module

programs = lazy_module("pepper_kin.qibullet.programs")

app = typer.Typer(add_completion=False, help="Programs for qiBullet over the twin.")


@app.callback()
def main() -> None:
    """Programs for qiBullet over the twin."""


@app.command(context_settings={"allow_extra_args": True, "ignore_unknown_options": True})
def run(
    context: typer.Context,
    program: Annotated[Path, typer.Argument(help="A program for qiBullet, in Python 3 or 2.", exists=True)],
    max_time: Annotated[float | None, typer.Option(help="Interrupt it after this time, in seconds.")] = None,
    *,
    as_json: Json = False,
) -> None:
    """Run an unmodified program for qiBullet; what follows its name is handed to it.

    Example: pepper-kin qibullet run basic.py --max-time 20
    """
    with redirect_stdout(sys.stderr if as_json else sys.stdout):
        result = programs.run_program(program, context.args, longest=max_time)
    if as_json:
        print_json({"ended": result.ended, "code": result.code, "duration": result.duration})
    print(f"{program.name}: {result.ended} after {result.duration:.2f} s", file=sys.stderr)
    if result.error is not None and result.ended == "failed":
        traceback.print_exception(result.error)
    if not result.success:
        raise typer.Exit(result.code or FAILED)
