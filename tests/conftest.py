"""Fixtures that several rooms share: Chromium, a cache of kernels, commands and examples in this process."""

from __future__ import annotations

import contextlib
import io
import os
import runpy
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from subprocess import CompletedProcess
from unittest import mock

import pytest

import pepper_kin as pk
from pepper_kin.cli import main
from pepper_kin.viewer import find_chromium
from pepper_kin.viewer.browser import CHROMIUM_FLAGS


def pytest_configure(config: pytest.Config) -> None:
    """Keep bytecode even where the environment says otherwise: assertions take long to rewrite."""
    sys.dont_write_bytecode = False
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put tests in a browser first: one process then has them all, and no two browsers draw at once."""
    items.sort(key=lambda item: item.get_closest_marker("browser") is None)


@pytest.fixture(scope="session", autouse=True)
def kernel_cache(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A cache of kernels apart from the user's, shared by all processes and kept from run to run.

    Files are named by a hash of all that their code depends on, so a stale one is never read; `--cache-clear`
    empties the folder.  Tests of what a first use does have an empty folder of their own.
    """
    kept = getattr(request.config, "cache", None)
    folder = kept.mkdir("kernels") if kept is not None else tmp_path_factory.mktemp("kernels")
    with mock.patch.dict(os.environ, {"PEPPER_KIN_CACHE": str(folder)}):
        yield folder


@pytest.fixture(scope="session")
def pepper() -> pk.PepperModel:
    """The default Pepper; tests that change its Pinocchio model load one of their own."""
    return pk.load_pepper()


@pytest.fixture(scope="session")
def chromium_path() -> str:
    """Path of a Chromium; without one the test is skipped on a bare machine and fails where CI=true."""
    path = find_chromium()
    if path is not None:
        return path
    message = "no Chromium found: browser tests need one (apt-get install chromium)"
    if os.environ.get("CI") == "true":
        pytest.fail(message)
    pytest.skip(message)


@pytest.fixture(scope="session")
def browser(chromium_path: str) -> Iterator[object]:
    """A headless Chromium, driven by playwright."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        arguments = [flag for flag in CHROMIUM_FLAGS if flag != "--headless"]
        chromium = playwright.chromium.launch(executable_path=chromium_path, args=arguments)
        yield chromium
        chromium.close()


def said(
    words: list[str], action: Callable[[], object], cwd: Path | str, environment: dict[str, str]
) -> CompletedProcess[str]:
    """What an action says in a folder, and how it ends, told as of a process with these words."""
    out, error, code = io.StringIO(), io.StringIO(), 0
    with (
        contextlib.chdir(cwd),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(error),
        mock.patch.object(sys, "argv", words),
        mock.patch.object(sys.modules["__main__"], "__package__", None),  # not `python -m pytest`
        mock.patch.dict(os.environ, environment),
    ):
        try:
            action()
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else int(end.code is not None)
    return CompletedProcess(words, code, out.getvalue(), error.getvalue())


@pytest.fixture(scope="session")
def run() -> Callable[..., CompletedProcess[str]]:
    """Run `pepper-kin` in this process, which spares a test the start of another.

    That a process of its own ends likewise is seen in `tests/cli/test_cli_contract.py`.
    """

    def run_command(*arguments: str, cwd: Path | str, **environment: str) -> CompletedProcess[str]:
        return said(["pepper-kin", *arguments], main, cwd, environment)

    return run_command


@pytest.fixture(scope="session")
def run_example() -> Callable[..., CompletedProcess[str]]:
    """Run a script of the folder `examples` in this process, as the main module that it is."""
    folder = Path(__file__).parents[1] / "examples"

    def run_script(name: str, *arguments: str, cwd: Path | str) -> CompletedProcess[str]:
        path = str(folder / name)
        return said([path, *arguments], lambda: runpy.run_path(path, run_name="__main__"), cwd, {})

    return run_script
