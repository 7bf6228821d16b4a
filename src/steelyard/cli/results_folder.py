"""The folder that a command writes its results to."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

import typer

__all__ = ["require_results_folder"]


def require_results_folder(context: typer.Context, folder: Path) -> None:
    """Make sure that results can be written to a folder; one that is still empty when the command ends is taken away.

    Parameters
    ----------
    context : typer.Context
        Of the command.
    folder : Path
        Made where it is missing.

    Raises
    ------
    InputError
        If it is a file, or cannot be written.
    """
    from steelyard.files.writing import remove_unused_folder
    from steelyard.report import require_folder

    missing = [one for one in (folder, *folder.parents) if not os.path.lexists(one)]
    require_folder(folder)

    def take_away() -> None:
        with suppress(OSError):  # where anything is in it, or it is gone
            for made in missing:
                remove_unused_folder(made)

    context.call_on_close(take_away)
