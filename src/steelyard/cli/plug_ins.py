"""Commands that other packages add, through the entry-point group ``steelyard.commands``."""

from __future__ import annotations

import sys
from difflib import get_close_matches
from typing import Any

import typer
import typer.core

from steelyard.errors import InputError
from steelyard.extensions import Extensions

from .screen import sentence

__all__ = ["COMMANDS", "SETTINGS", "Commands", "author"]

# Settings of every command of this program: an error is one sentence, and help is plain text.
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
        """Name the commands; those of other packages that cannot be loaded are reported on standard error."""
        found = super().list_commands(ctx)
        for name in COMMANDS.names():
            try:
                if name in self.commands:
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
        found = super().get_command(ctx, cmd_name) or COMMANDS.get(cmd_name)
        if found is None and cmd_name in _ELSEWHERE:
            raise InputError(_ELSEWHERE[cmd_name])
        return found

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find the command that a line begins with; one of a similar name, also of another package, is suggested."""
        name = args[0]
        if not name.startswith("-") and self.get_command(ctx, name) is None:
            near = [repr(one) for one in get_close_matches(name, [*self.commands, *COMMANDS.names()])]
            ctx.fail(f"No such command {name!r}." + (f" Did you mean {', '.join(near)}?" if near else ""))
        return super().resolve_command(ctx, args)


def author(app: typer.Typer, command: str) -> str:
    """Return the package of a command: steelyard, or the packages that offer it."""
    own = command in {getattr(known.callback, "__name__", "") for known in app.registered_commands}
    return "steelyard itself" if own else COMMANDS.packages(command) or "steelyard itself"


def _command(name: str, offered: Any) -> Any:
    if isinstance(offered, typer.Typer):
        return typer.main.get_command(offered)
    if not callable(offered):
        raise TypeError(f"expected a function with the annotations of Typer, or a Typer, got {type(offered).__name__}")
    app = typer.Typer(**SETTINGS)
    app.command(name)(offered)
    return typer.main.get_command(app)


COMMANDS: Extensions[Any] = Extensions("commands", "command", {}, _command)
