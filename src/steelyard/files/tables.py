"""What the library of tables, Polars, raises while it reads files."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator

from steelyard.errors import InputError

__all__ = ["reading_table"]


@contextlib.contextmanager
def _silent() -> Iterator[None]:
    """Keep what a panic prints from the terminal: Rust writes it to the file of standard error itself."""
    try:
        kept = os.dup(2)
    except OSError:  # there is no standard error
        yield
        return
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


@contextlib.contextmanager
def reading_table(path: str | os.PathLike[str], kind: str) -> Iterator[None]:
    """Say in one sentence why Polars cannot read a file.

    Parameters
    ----------
    path : str or path
    kind : str
        What the file should be, such as "Parquet".

    Raises
    ------
    InputError
        For whatever Polars raises, a panic of its Rust code among it, which is no `Exception`.
    """
    from polars.exceptions import PanicException, PolarsError

    try:
        with _silent():
            yield
    except InputError:
        raise
    except (PolarsError, PanicException, OSError, ValueError, TypeError, OverflowError) as error:
        lines = str(error).splitlines() or [type(error).__name__]
        raise InputError(f"{path} cannot be read as {kind}: {lines[0][:200]}; save it again.") from None
