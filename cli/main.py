"""The command line: parses, calls one library function, prints. JAX is loaded only by the commands that fly.

Exit codes: 0 done, 1 an explained error, 2 wrong usage. Results go to standard output, notes and progress to standard
error.
"""

from __future__ import annotations

import sys
from importlib import import_module
from typing import Annotated

import typer

from glider_jax import __version__
from glider_jax.errors import GliderJaxError

app = typer.Typer(
    name="glider-forecast",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Forecast where a Slocum glider surfaces and how its battery drains, with honest uncertainty.",
    epilog="Start with: glider-forecast ensemble --n 5000",
)


def _version(asked: bool) -> None:
    if asked:
        print(f"glider-forecast {__version__}")
        raise typer.Exit


@app.callback()
def common(
    debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")] = False,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Options of every command."""
    _State.debug = debug


class _State:
    debug = False


_COMMANDS = (
    ("ensemble", "ensemble", "ensemble"),
    ("next", "next", "next_surfacing"),
    ("hindcast", "hindcast", "hindcast"),
    ("scores", "scores", "scores"),
    ("diagnose", "diagnose", "diagnose"),
    ("prove", "prove", "prove"),
    ("validate", "validate", "validate"),
    ("plan", "plan", "plan"),
    ("recording", "recording", "recording"),
    ("dialog", "dialog", "dialog"),
    ("terms", "terms", "terms"),
)
_GROUPS = (
    ("board", "board", "Decode, capture and check the current-measurement board."),
    ("mission", "mission", "Check a mission and its program; write it as Slocum files."),
    ("energy", "energy", "Fit energy models to board logs and recordings."),
    ("speeds", "speeds", "Fit speed distributions to recordings."),
)


def register() -> None:
    """Add every command; each module imports what it needs inside its functions."""
    for name, module, function in _COMMANDS:
        app.command(name)(getattr(import_module(f"glider_jax_cli.{module}"), function))
    for name, module, text in _GROUPS:
        app.add_typer(import_module(f"glider_jax_cli.{module}").app, name=name, help=text)


register()


def main() -> None:
    """Entry point: explained errors become one sentence and exit code 1."""
    try:
        app()
    except GliderJaxError as error:
        if _State.debug:
            raise
        print(f"error: {error}", file=sys.stderr)
        sys.exit(1)
    except BrokenPipeError:
        sys.exit(1)


if __name__ == "__main__":
    main()
