"""The ``steelyard`` command: registers the commands, and turns errors into one sentence and an exit code."""

from __future__ import annotations

import platform
import sys
import tempfile
import traceback
from typing import NoReturn

import typer

from steelyard import __version__
from steelyard.errors import SteelyardError

from .check import check
from .compare import compare
from .correct import correct
from .demo import demo
from .excite import excite
from .explain import explain
from .generate import generate
from .identify import identify
from .inspect import inspect
from .payload import payload
from .plug_ins import SETTINGS, Commands, author
from .screen import echo, guarded, sentence
from .simulate import simulate
from .validate import validate

__all__ = ["app", "main"]

app = typer.Typer(
    name="steelyard",
    help="Weigh a robot by moving it: physically feasible dynamic parameters from a description and a log.",
    cls=Commands,
    no_args_is_help=True,
    **SETTINGS,
)
app.command()(demo)
app.command()(inspect)
app.command()(generate)
app.command()(excite)
app.command()(identify)
app.command()(payload)
app.command()(validate)
app.command()(compare)
app.command()(check)
app.command()(correct)
app.command()(explain)
app.command()(simulate)


def _version(value: bool) -> None:
    if value:
        echo(f"steelyard {__version__}")
        raise typer.Exit


@app.callback()
def options(
    version: bool = typer.Option(
        False, "--version", callback=_version, is_eager=True, help="Show the version and exit."
    ),
) -> None:
    """Weigh a robot by moving it."""


def main() -> None:
    """Run the command line: exit 0 when all went well, 1 for a negative answer, 2 for bad input, 3 where the data does
    not do, 70 for a fault.
    """
    with guarded():
        try:
            app()
        except (SystemExit, GeneratorExit):
            raise
        except SteelyardError as error:
            _end(2, sentence(error))
        except KeyboardInterrupt:
            _end(130, "interrupted")
        except OSError as error:
            _end(2, sentence(f"{error.filename or 'the system'}: {error.strerror or error}."))
        except BaseException as error:  # a panic of Polars is no Exception
            _end(70, sentence(_told(error)))


def _end(code: int, message: str) -> NoReturn:
    print(f"steelyard: {message}", file=sys.stderr)
    sys.exit(code)


def _told(error: BaseException) -> str:
    """Return a sentence on an unexpected error, with the place of its trace."""
    if isinstance(error, MemoryError):
        what = "there is not enough memory for this"
    else:
        said = " ".join(str(error).split())[:300]
        what = f"a fault of {author(app, ''.join(sys.argv[1:2]))}, {type(error).__name__}{f' ({said})' if said else ''}"
    command = " ".join(map(repr, sys.argv[1:]))
    system = f"steelyard {__version__}, Python {platform.python_version()}, {platform.platform()}"
    trace = "".join(traceback.format_exception(error))
    try:
        # Readable by the user alone, since it holds names and values of theirs.
        handle, path = tempfile.mkstemp(prefix="steelyard-fault-", suffix=".txt")
        with open(handle, "w", encoding="utf-8", errors="backslashreplace") as file:
            file.write(f"{system}\n{command}\n\n{trace}")
    except OSError:
        return f"{what}; its trace could not be saved"
    return f"{what}; the trace is in {path}: please report it with that file."
