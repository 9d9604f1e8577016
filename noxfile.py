#!/usr/bin/env -S uv run --script
# /// script
# dependencies = ["nox>=2024.3.2"]
# ///
"""Parts of continuous integration by name: `nox -s lint tests docs`."""

import nox

nox.needs_version = ">=2024.3.2"
nox.options.default_venv_backend = "uv|virtualenv"


@nox.session
def lint(session: nox.Session) -> None:
    """Style and format."""
    session.install("ruff")
    session.run("ruff", "check", ".")
    session.run("ruff", "format", "--check", ".")


@nox.session
def tests(session: nox.Session) -> None:
    """Run the README's test command, or the tests that are named."""
    session.install("-e", ".[test]")
    session.run("pytest", *session.posargs)


@nox.session(default=False)
def docs(session: nox.Session) -> None:
    """Build the documentation into `site/`."""
    session.install("-e", ".[docs]")
    session.run("mkdocs", "build", env={"NO_MKDOCS_2_WARNING": "1"})


@nox.session(default=False)
def build(session: nox.Session) -> None:
    """Build wheel and source archive into `dist/`."""
    session.install("build")
    session.run("python", "-m", "build")


@nox.session(default=False)
def all_of_ci(session: nox.Session) -> None:
    """Run what continuous integration does."""
    session.run("bash", ".ci/run", external=True)


if __name__ == "__main__":
    nox.main()
