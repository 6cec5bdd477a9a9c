"""The command line: parses, calls one library function, prints. JAX is loaded only by the commands that fly.

Exit codes: 0 done, 1 an explained error, 2 wrong usage. Results go to standard output, notes and progress to standard
error.
"""

from __future__ import annotations

import sys
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


def register() -> None:
    """Add every command; each module imports what it needs inside its functions."""
    from glider_jax_cli import ensemble

    app.command("ensemble")(ensemble.ensemble)
    _optional()


def _optional() -> None:
    from glider_jax_cli import board, energy, recording, speeds, terms

    app.add_typer(board.app, name="board", help="Decode, capture and check the current-measurement board.")
    app.add_typer(energy.app, name="energy", help="Fit energy models to board logs and recordings.")
    app.add_typer(speeds.app, name="speeds", help="Fit speed distributions to recordings.")
    app.command("recording")(recording.recording)
    app.command("terms")(terms.terms)


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
