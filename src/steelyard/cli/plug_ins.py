"""Commands that other packages add, through the entry-point group ``steelyard.commands``."""

from __future__ import annotations

import sys
from importlib.metadata import EntryPoint, entry_points
from typing import Any

import typer
import typer.core

from steelyard.errors import InputError

from .screen import sentence

__all__ = ["GROUP", "SETTINGS", "Commands", "author"]

GROUP = "steelyard.commands"
# Of every command of this program: errors are told in one sentence, and help is plain text.
SETTINGS: dict[str, Any] = {"add_completion": False, "pretty_exceptions_enable": False, "rich_markup_mode": None}
_ELSEWHERE = {
    "reproduce": "The command `reproduce` belongs to the package steelyard-thesis, which is not installed: install it "
    "with `pip install ./thesis` in a copy of Steelyard's source."
}


class Commands(typer.core.TyperGroup):
    """The commands of this package, and behind them those of others.

    A package is imported when its command is called, or when all commands are listed; no other command depends on it.
    """

    def list_commands(self, ctx: Any) -> list[str]:
        """Name the commands; one of another package that cannot be had is told on standard error and left out."""
        found = super().list_commands(ctx)
        for name in sorted({entry.name for entry in entry_points(group=GROUP)}):
            try:
                if name in self.commands:
                    raise InputError(
                        f"The command `{name}` of {_packages(name)} is left out: steelyard has one of that name."
                    )
                _load(name)
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
        own = super().get_command(ctx, cmd_name)
        if own is not None:
            return own
        if entry_points(group=GROUP, name=cmd_name):
            return _load(cmd_name)
        if cmd_name in _ELSEWHERE:
            raise InputError(_ELSEWHERE[cmd_name])
        return None


def author(app: typer.Typer, command: str) -> str:
    """Return whose a command is: steelyard's own, or that of the packages that offer it."""
    own = command in {getattr(known.callback, "__name__", "") for known in app.registered_commands}
    return "steelyard itself" if own else _packages(command) or "steelyard itself"


def _package(entry: EntryPoint) -> str:
    return entry.dist.name if entry.dist is not None else entry.value


def _packages(name: str) -> str:
    return " and ".join(sorted({_package(entry) for entry in entry_points(group=GROUP, name=name)}))


def _load(name: str) -> Any:
    """Return the command that another package offers under a name."""
    entry, *others = entry_points(group=GROUP, name=name)
    if others:
        raise InputError(f"The command `{name}` is offered by {_packages(name)}: uninstall all of them but one.")
    try:
        return _command(name, entry.load())
    except (Exception, SystemExit) as error:
        raise InputError(
            f"The command `{name}` of {_package(entry)} cannot be loaded ({type(error).__name__}: {error}); upgrade or "
            "uninstall that package."
        ) from error


def _command(name: str, offered: object) -> Any:
    if isinstance(offered, typer.Typer):
        return typer.main.get_command(offered)
    if not callable(offered):
        raise TypeError(f"expected a function with the annotations of Typer, or a Typer, got {type(offered).__name__}")
    app = typer.Typer(**SETTINGS)
    app.command(name)(offered)
    return typer.main.get_command(app)
