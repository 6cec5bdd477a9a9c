"""The command line: parses, calls one library function, prints. JAX is loaded only by the commands that fly.

Exit codes: 0 done, 1 an explained error, 2 wrong usage. Results go to standard output, notes and progress to standard
error.
"""

from __future__ import annotations

import gc
import sys
from importlib import import_module
from typing import Annotated

import typer
from typer.core import TyperCommand

from glider_jax import __version__
from glider_jax.errors import GliderJaxError
from glider_jax_cli.examples import epilog

app = typer.Typer(
    name="glider-forecast",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Forecast where a Slocum glider surfaces and how its battery drains, with honest uncertainty.",
    epilog="Most used:\n\n"
    "glider-forecast ensemble --n 5000 --html\n\n"
    "glider-forecast next --dialog unit.log --mission missions --recording from-glider\n\n"
    "Every command has --help with examples; --install-completion teaches the shell to complete them.",
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


class ManyValues(TyperCommand):
    """A command whose repeatable options take several values at once, as a shell expands ``--currents hfr/*.nc``."""

    def parse_args(self, ctx, args: list[str]) -> list[str]:
        """Write ``--currents a b`` as ``--currents a --currents b`` where no argument could be meant."""
        if not any(param.param_type_name == "argument" for param in self.params):
            args = self._repeated(args)
        return super().parse_args(ctx, args)

    def _repeated(self, args: list[str]) -> list[str]:
        many = {name for param in self.params if getattr(param, "multiple", False) for name in param.opts}
        found: list[str] = []
        last, given = "", 0
        for word in args:
            if word.startswith("-") and not word[1:2].isdigit():
                last, given = (word, 0) if word in many else ("", 0)
            elif last:
                given += 1
                if given > 1:
                    found.append(last)
            found.append(word)
        return found


_BEFORE, _DURING, _AFTER, _BOARD, _HOUSE = (
    "Before a mission", "During a mission", "After a mission", "Measuring energy and speed", "The tool itself",
)  # fmt: skip
#: Name, module, function, panel of the tour, purpose in one line of at most 60 characters.
_COMMANDS = (
    ("ensemble", "ensemble", "ensemble", _BEFORE, "Where it surfaces and how its battery drains: the main job"),
    ("plan", "plan", "plan", _BEFORE, "Weigh pitch, depths, sensing and packs; recommend one"),
    ("next", "next", "next_surfacing", _DURING, "When and where it surfaces next, from what was heard"),
    ("dialog", "dialog", "dialog", _DURING, "What a surface dialog says, and how old each part is"),
    ("scores", "scores", "scores", _DURING, "How good the forecasts frozen by 'next' were"),
    ("hindcast", "hindcast", "hindcast", _AFTER, "Forecast every surfacing of a recording again and score"),
    ("recording", "recording", "recording", _AFTER, "What a recording holds, and what was repaired"),
    ("diagnose", "diagnose", "diagnose", _AFTER, "Which physics the forecast left out"),
    ("terms", "terms", "terms", _HOUSE, "The physics: equations, parameters, sources"),
    ("validate", "validate", "validate", _HOUSE, "Fly the published simulations of 2010 again"),
    ("prove", "prove", "prove", _HOUSE, "Test the diagnosis on concealed effects"),
    ("doctor", "doctor", "doctor", _HOUSE, "Check the installation and say what to mend"),
)
_GROUPS = (
    ("mission", "mission", _BEFORE, "Check a mission and its program; write it as Slocum files"),
    ("data", "data", _BEFORE, "List and fetch public currents, seafloor and recordings"),
    ("board", "board", _BOARD, "Decode, capture and check the current-measurement board"),
    ("energy", "energy", _BOARD, "Fit energy models to board logs and recordings"),
    ("speeds", "speeds", _BOARD, "Fit speed distributions to recordings"),
)


def register() -> None:
    """Add every command; each module imports what it needs inside its functions."""
    for name, module, function, panel, purpose in _COMMANDS:
        command = getattr(import_module(f"glider_jax_cli.{module}"), function)
        details = {"short_help": purpose, "rich_help_panel": panel, "epilog": epilog(name), "cls": ManyValues}
        app.command(name, **details)(command)
    for name, module, panel, purpose in _GROUPS:
        group = import_module(f"glider_jax_cli.{module}").app
        for inner in group.registered_commands:
            inner.epilog = inner.epilog or epilog(f"{name} {inner.name or inner.callback.__name__}")
        app.add_typer(group, name=name, help=f"{purpose}.", short_help=purpose, rich_help_panel=panel)


register()


def main() -> None:
    """Entry point: explained errors become one sentence and exit code 1."""
    # Loading modules and tracing programs make many objects and no rubbish: searching it takes a tenth of a start.
    gc.set_threshold(100_000, 50, 50)
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
