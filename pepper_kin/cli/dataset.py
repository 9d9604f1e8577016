"""The commands `pepper-kin dataset ...`: argument parsing and printing, nothing else."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated, Any

import typer

from pepper_kin.cli.terminal import FAILED, INTERRUPTED, Json, Seed, print_found, print_json, progress
from pepper_kin.lazy_names import lazy_module

datasets = lazy_module("pepper_kin.datasets")

app = typer.Typer(no_args_is_help=True, help="Datasets made by many processes or machines, and examined.")

_EVERY = 5.0  # [s] between lines where there is no terminal

Folder = Annotated[str, typer.Argument(help="Folder of the dataset, or an address that fsspec knows.")]
Workers = Annotated[int | None, typer.Option(help="Processes; one for each core if left out.")]
Dask = Annotated[str | None, typer.Option(help="Address of a Dask scheduler, whose workers are used.")]


@app.command()
def make(
    job: Annotated[Path, typer.Argument(help="What it shall hold: a job (.yaml).")],
    output: Annotated[
        str, typer.Option("--output", "-o", help="New folder, or an address that fsspec knows.")
    ] = "dataset",
    workers: Workers = None,
    dask: Dask = None,
    as_json: Json = False,
) -> None:
    r"""Make a dataset, or what a folder still lacks of it; Ctrl-C keeps what is written.

    Needs: pip install 'pepper_kin\[datasets]'

    Example: pepper-kin dataset make job.yaml -o my_data
    """
    wanted = datasets.load_job(job)
    _print_made(lambda **options: datasets.make(wanted, output, **options), workers, dask, as_json)


@app.command()
def resume(folder: Folder, workers: Workers = None, dask: Dask = None, as_json: Json = False) -> None:
    """Make what a dataset still lacks that was begun in a folder.

    Example: pepper-kin dataset resume my_data
    """
    _print_made(lambda **options: datasets.resume(folder, **options), workers, dask, as_json)


@app.command()
def check(
    folder: Folder,
    sample: Annotated[int, typer.Option(help="Rows that are recomputed.")] = 5,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Prove that no row is missing or there twice, that no file has changed, and recompute some rows.

    Example: pepper-kin dataset check my_data --sample 20
    """
    with progress("files") as report:
        found = datasets.check(folder, sample=sample, seed=seed, on_progress=report)
    print_found(found, as_json)
    if not found.success:
        raise typer.Exit(FAILED)


@app.command()
def show(
    folder: Folder,
    row: Annotated[int | None, typer.Option(help="A row to print, from 0; from the end if below 0.")] = None,
    as_json: Json = False,
) -> None:
    """Print what a dataset holds, or one of its rows.

    Example: pepper-kin dataset show my_data --row 3
    """
    found = datasets.open(folder)
    if row is None:
        about = found.about()
    else:
        values = found.row(row)
        about = {k: v.tolist() if hasattr(v, "tolist") else v for k, v in values.items()}
    if as_json:
        print_json(about)
        return
    for name, value in about.items():
        text = str(value)
        print(f"{name}: {text if len(text) < 300 else text[:297] + '...'}")


def _print_made(run: Callable[..., Any], workers: int | None, dask: str | None, as_json: bool) -> None:
    """Run what makes a dataset, and print how far it is and what was made."""
    with _reported(as_json) as on_progress:
        try:
            found = run(workers=workers, client=dask, on_progress=on_progress)
        except KeyboardInterrupt:
            print("interrupted: what is written stays, and resume goes on", file=sys.stderr, flush=True)
            raise typer.Exit(INTERRUPTED) from None
    about = found.about()
    if as_json:
        print_json(about)
    else:
        ends = ", ".join(f"{count} {status}" for status, count in about["statuses"].items())
        print(f"{about['rows']} rows in {about['folder']}: {ends}; {about['bytes'] / 1e6:.1f} MB")


@contextlib.contextmanager
def _reported(silent: bool) -> Iterator[Callable[[Any], None]]:
    """Yield what reports progress: a bar on a terminal, else a line now and then."""
    last = [float("-inf")]
    terminal = sys.stderr is not None and sys.stderr.isatty()
    with progress("rows") as report:

        def tell(state: Any) -> None:
            report(state.done, state.total)
            now = time.monotonic()
            due = not terminal and now - last[0] >= _EVERY
            if not silent and (due or state.done == state.total):
                last[0] = now
                print(f"  {state.sentence()}", file=sys.stderr, flush=True)

        yield tell
