"""The ``steelyard`` command: registers the commands, and turns errors into one sentence and an exit code."""

from __future__ import annotations

import sys

import typer

from steelyard import __version__

from .check import check
from .correct import correct
from .demo import demo
from .excite import excite
from .explain import explain
from .generate import generate
from .identify import identify
from .inspect import inspect
from .reproduce import reproduce
from .simulate import simulate

__all__ = ["app", "main"]

app = typer.Typer(
    name="steelyard",
    help="Weigh a robot by moving it: physically feasible dynamic parameters from a description and a log.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
app.command()(demo)
app.command()(inspect)
app.command()(generate)
app.command()(excite)
app.command()(identify)
app.command()(check)
app.command()(correct)
app.command()(explain)
app.command()(simulate)
app.command()(reproduce)


def _version(value: bool) -> None:
    if value:
        typer.echo(f"steelyard {__version__}")
        raise typer.Exit


@app.callback()
def options(
    version: bool = typer.Option(
        False, "--version", callback=_version, is_eager=True, help="Show the version and exit."
    ),
) -> None:
    """Weigh a robot by moving it."""


def main() -> None:
    """Run the command line: exit 0 when all went well, 1 for a negative answer, 2 for bad input."""
    from steelyard.errors import SteelyardError

    try:
        app()
    except SteelyardError as error:
        print(f"steelyard: {error}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        print("steelyard: interrupted", file=sys.stderr)
        sys.exit(130)
    except OSError as error:
        print(f"steelyard: {error.filename or 'the system'}: {error.strerror or error}.", file=sys.stderr)
        sys.exit(2)
