"""The command `pepper-kin learn`: argument parsing and printing, nothing else."""

from __future__ import annotations

import contextlib
import os
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

import pepper_kin as pk
from pepper_kin.cli.terminal import INTERRUPTED, Json, Seed, one_of, print_json, print_written, progress
from pepper_kin.exceptions import InvalidValueError, MissingDependencyError
from pepper_kin.file_access.atomic_file import check_file
from pepper_kin.lazy_names import lazy_module

learning = lazy_module("pepper_kin.learning")

app = typer.Typer()

POLICY_SUFFIX = ".npz"
SHOWN_SUFFIXES = (".mp4", ".gif", ".png", ".html", ".csv")


def complete_task(incomplete: str) -> list[str]:
    """Complete the name of a task."""
    with contextlib.suppress(MissingDependencyError):
        return one_of(tuple(learning.TASKS))(incomplete)
    return []


@app.command()
def learn(
    task: Annotated[
        str,
        typer.Argument(
            help="Reach, ReachBoth, ..., or a policy that was written (.npz), which is then tried only.",
            autocompletion=complete_task,
        ),
    ],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="The policy: .npz; policy.npz if left out.")
    ] = None,
    *,
    ppo: Annotated[
        bool, typer.Option("--ppo", help="By PPO of stable-baselines3 in place of imitation.")
    ] = False,
    rounds: Annotated[
        int | None, typer.Option(help="Rounds of training; 12, or 8 of PPO, if left out.")
    ] = None,
    show: Annotated[
        Path | None,
        typer.Option(
            help="An episode on a twin: film (.mp4, .gif), picture (.png), page (.html), trajectory (.csv)."
        ),
    ] = None,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    r"""Train a policy for a task, by imitation of inverse kinematics; Ctrl-C keeps the best so far.

    Needs: pip install 'pepper_kin\[learning]'

    Example: pepper-kin learn Reach -o reach.npz --show reach.html
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # of small matrices threads wait for each other
    known, whole = task.lower().endswith(POLICY_SUFFIX), True
    if known and (output is not None or ppo or rounds is not None):
        raise InvalidValueError("task", repr(task), "a task's name with --output, --ppo and --rounds")
    if show is not None:
        if show.suffix.lower() not in SHOWN_SUFFIXES:
            allowed = f"a file that ends in {', '.join(SHOWN_SUFFIXES)}"
            raise InvalidValueError("--show", repr(str(show)), allowed)
        check_file(show)
    written = [] if known else [check_file(output or Path(f"policy{POLICY_SUFFIX}"))]
    if known:
        policy = learning.load_policy(task)
    else:
        with progress("learning") as report:

            def report_round(found: Any) -> None:
                report(found.done, found.total)
                if not as_json and not sys.stderr.isatty():
                    share = f"{found.success:.3f} of goals not trained on"
                    print(f"  round {found.done} of {found.total}: {share}", file=sys.stderr, flush=True)

            policy, whole = learning.best_policy(
                task, "ppo" if ppo else "imitation", rounds=rounds, seed=seed,
                on_round=report_round,
            )  # fmt: skip
        policy.save(written[0])
        if not whole:
            print("interrupted: the best policy so far is kept", file=sys.stderr, flush=True)
    trial = learning.try_policy(policy)
    if show is not None:
        written.append(show)
        _show(policy, show, seed, as_json)
    if as_json:
        print_json(trial.as_dict() | {"written": [str(path) for path in written]})
    else:
        print(trial.report())
        if written:
            print_written(written, False)
    if not whole:
        raise typer.Exit(INTERRUPTED)


def _show(policy: Any, path: Path, seed: int, silent: bool) -> None:
    """Write an episode on a twin."""
    env = learning.PepperVectorEnv(1, policy.task, goal_seed=learning.TRIED)
    episode = learning.run_policy(policy, env, env.task.twin(env.pepper), seed=seed)
    if path.suffix.lower() == ".csv":
        pk.files.save(episode.motion, path, unchecked=True)
        return
    if not silent:
        print(f"  rendering {path} ...", file=sys.stderr, flush=True)
    with progress("rendering") as report:
        pk.viewer.render_motion(env.pepper, episode.motion, path, scene=episode.scene, on_frame=report)
