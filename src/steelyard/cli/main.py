"""The ``steelyard`` command: its own commands and those of other packages; errors are one sentence and an exit code."""

from __future__ import annotations

import platform
import sys
import tempfile
import traceback
from collections.abc import Sequence
from contextlib import suppress
from difflib import get_close_matches
from itertools import pairwise
from typing import Any, NoReturn

import typer
import typer.core

from steelyard import __version__
from steelyard.errors import InputError, SteelyardError
from steelyard.extensions import Extensions

from .robot_argument import lines_told
from .terminal import echo, guarded, print_json, sentence

__all__ = ["COMMANDS", "SETTINGS", "Commands", "app", "author", "main"]

# Settings of every command of this program: an error is one sentence, and help is plain text.
SETTINGS: dict[str, Any] = {
    "add_completion": False,
    "pretty_exceptions_enable": False,
    "rich_markup_mode": None,
    "context_settings": {"help_option_names": ["-h", "--help"]},
}
_ELSEWHERE = {
    "reproduce": "The command `reproduce` belongs to the package steelyard-thesis, which is not installed: install it "
    "with `pip install ./thesis` in a copy of Steelyard's source."
}


class Commands(typer.core.TyperGroup):
    """The commands of this package, and behind them those of others.

    A command is imported when it is called, or when all commands are listed: all of them take a tenth of a second, and
    none depends on the package of another.
    """

    def list_commands(self, ctx: Any) -> list[str]:
        """Name the commands; those of other packages that cannot be loaded are reported on standard error."""
        found, installed = [*COMMANDS.own], COMMANDS.installed()
        for name in COMMANDS.names():
            if name in COMMANDS.own and name not in installed:
                continue
            try:
                if name in COMMANDS.own:
                    whose = COMMANDS.packages(name)
                    raise InputError(f"The command `{name}` of {whose} is left out: steelyard has one of that name.")
                COMMANDS.get(name)
            except InputError as error:
                print(f"steelyard: {sentence(error)}", file=sys.stderr)
            else:
                found.append(name)
        return found

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a command, or None where there is none of this name.

        Raises
        ------
        InputError
            If it is that of a package that cannot be imported, or that is known and not installed.
        """
        if cmd_name in COMMANDS.own and cmd_name not in self.commands:
            self.commands[cmd_name] = _command(cmd_name, COMMANDS.get(cmd_name))
        found = super().get_command(ctx, cmd_name) or COMMANDS.get(cmd_name)
        if found is None and cmd_name in _ELSEWHERE:
            raise InputError(_ELSEWHERE[cmd_name])
        return found

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find the command that a line begins with; one of a similar name, also of another package, is suggested."""
        name = args[0]
        if not name.startswith("-") and self.get_command(ctx, name) is None:
            near = [repr(one) for one in get_close_matches(name, COMMANDS.names())]
            ctx.fail(f"No such command {name!r}." + (f" Did you mean {', '.join(near)}?" if near else ""))
        return super().resolve_command(ctx, args)


def author(command: str) -> str:
    """Return the package of a command: steelyard, or the packages that offer it."""
    return "steelyard itself" if command in COMMANDS.own else COMMANDS.packages(command) or "steelyard itself"


def _command(name: str, offered: Any) -> Any:
    if isinstance(offered, typer.Typer):
        return typer.main.get_command(offered)
    if not callable(offered):
        raise TypeError(f"expected a function with the annotations of Typer, or a Typer, got {type(offered).__name__}")
    app = typer.Typer(**SETTINGS)
    app.command(name)(offered)
    return typer.main.get_command(app)


COMMANDS: Extensions[Any] = Extensions(
    "commands",
    "command",
    {
        name: f"{__package__}.{name}:{name}"
        for name in (
            "demo",
            "init",
            "doctor",
            "inspect",
            "generate",
            "excite",
            "identify",
            "payload",
            "validate",
            "deflections",
            "compare",
            "reduce",
            "fleet",
            "check",
            "correct",
            "explain",
            "simulate",
            "view",
            "example",
        )
    },
    _command,
)
"""In the order of the help; a file is imported when its command is called."""


app = typer.Typer(
    name="steelyard",
    help="Weigh a robot by moving it: physically feasible dynamic parameters from a description and a log.",
    cls=Commands,
    no_args_is_help=True,
    **{**SETTINGS, "add_completion": True},
)


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
            _require_addresses()
            _require_places(sys.argv[1:])
            try:
                app()
            finally:  # a short answer may not have been written yet; a reader may go away before the end
                with suppress(BrokenPipeError):
                    sys.stdout.flush()
        except GeneratorExit:
            raise
        except SystemExit as ended:
            if isinstance(ended.code, int) and ended.code in _ENDED:  # as Typer ends what the user interrupts
                _end(ended.code, _ENDED[ended.code])
            raise
        except SteelyardError as error:
            _end(2, "\n".join(sentence(lines_told(line, sys.argv[1:])) for line in error.lines))
        except KeyboardInterrupt:
            _end(_INTERRUPTED, "interrupted")
        except OSError as error:
            _end(2, sentence(f"{error.filename or 'the system'}: {error.strerror or error}."))
        except BaseException as error:  # a panic of Polars is no Exception
            _end(70, sentence(_told(error)))


LEAST_ADDRESSES = 2 << 30
"""Bytes of addresses, as ``ulimit -v`` counts them, that libraries take before the first row is read. With less their
threads end the process without a word, wait for ever, or raise what sounds like a damaged file (seen on two cores from
0.4 to 1.9 GB)."""


def _require_addresses() -> None:
    """Refuse to begin where a limit of the shell leaves libraries too little."""
    with suppress(ImportError):
        import resource  # of POSIX

        allowed = resource.getrlimit(resource.RLIMIT_AS)[0]
        if allowed != resource.RLIM_INFINITY and allowed < LEAST_ADDRESSES:
            raise InputError(
                f"This shell allows a process {allowed >> 20} MiB of addresses, and the libraries need "
                f"{LEAST_ADDRESSES >> 20} MiB; raise the limit by `ulimit -v {LEAST_ADDRESSES >> 10}` or more."
            )


def _require_places(line: Sequence[str]) -> None:
    """Refuse an empty place for results, which a variable that is not set leaves: it would be the current folder."""
    given = line[: line.index("--")] if "--" in line else line
    if "--output=" in given or any(name in ("-o", "--output") and not place for name, place in pairwise(given)):
        raise InputError("--output is empty, as a variable of the shell that is not set leaves it; give a place.")


_INTERRUPTED = 130  # by Ctrl-C, as shells say it
_ENDED = {_INTERRUPTED: "interrupted", 143: "ended by SIGTERM"}


def _end(code: int, message: str) -> NoReturn:
    print(f"steelyard: {message}", file=sys.stderr)
    if "--json" in sys.argv:  # who reads the answer gets a document, whatever it is
        with suppress(OSError):  # standard output may be what failed
            print_json({"format": "steelyard-error-1", "error": message, "exit_code": code})
    sys.exit(code)


def _told(error: BaseException) -> str:
    """Return a sentence on an unexpected error, with the place of its trace."""
    if isinstance(error, MemoryError):
        what = "there is not enough memory for this"
    else:
        said = " ".join(str(error).split())[:300]
        what = f"a fault of {author(''.join(sys.argv[1:2]))}, {type(error).__name__}{f' ({said})' if said else ''}"
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
