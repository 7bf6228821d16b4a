"""A program that reads a file of MATLAB for another process, because damaged files crash SciPy's reader.

Of 250 files with some bits changed three ended the process that read them. It is started with the path of the file and
a folder, into which it writes the arrays as ``0.npy``, ``1.npy`` and so on, and columns of texts as ``text0.npy``; it
answers with an index as JSON.
"""

from __future__ import annotations

import json
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

__all__ = ["main"]

DEEPEST = 20
MOST_ELEMENTS = 1000
"""The most elements of an array of structs, such as the signals of a block of Simulink."""
LONGEST_DATE = 240
"""Bytes of a text of which there is one in each row, for it may be a date; larger ones are something else."""
LONGEST = 1_000_000
"""Characters of an array of texts."""


def variables(path: str) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Yield the arrays of a file, its texts as lists, and None for each object that cannot be read."""
    from scipy.io import loadmat

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # names that stand twice, objects that are not read
        content = loadmat(path, struct_as_record=False, chars_as_strings=True, appendmat=False)
    for name, value in content.items():
        if not name.startswith("__"):
            yield from _arrays((name,), value)
        elif not isinstance(value, str | bytes | list):  # the workspace of functions
            yield (name,), None


def _arrays(path: tuple[str, ...], value: Any) -> Iterator[tuple[tuple[str, ...], Any]]:
    kind = type(value).__name__
    if len(path) > DEEPEST:
        return
    if kind == "mat_struct":
        for name in value._fieldnames:
            yield from _arrays((*path, name), getattr(value, name))
    elif kind in ("MatlabOpaque", "MatlabObject", "MatlabFunction"):
        yield path, None
    elif not isinstance(value, np.ndarray) or value.ndim == 0 or value.size == 0:
        return
    elif value.dtype.kind in "fiub":
        yield path, value
    elif value.dtype.kind == "U":
        yield path, _texts(value.ravel()) if value.size <= MOST_ELEMENTS else value.ravel()
    elif value.dtype.kind == "O" and value.size > MOST_ELEMENTS and _is_text(value.flat[0]):
        if all(_is_text(item) for item in value.flat):
            yield path, np.array(["".join(item.ravel().tolist()) for item in value.flat])
    elif value.dtype.kind == "O" and value.size <= MOST_ELEMENTS:
        items = list(value.ravel())
        if all(isinstance(item, np.ndarray) and item.dtype.kind == "U" for item in items):
            yield path, _texts(["".join(map(str, item.ravel())) for item in items])
            return
        for number, item in enumerate(items, start=1):
            yield from _arrays((*path[:-1], path[-1] if len(items) == 1 else f"{path[-1]}({number})"), item)


def _is_text(item: Any) -> bool:
    return isinstance(item, np.ndarray) and item.dtype.kind == "U" and item.size <= 1


def _texts(values: Any) -> list[str]:
    texts = [str(value) for value in values]
    return texts if sum(map(len, texts)) <= LONGEST else []


def main(answers: BinaryIO) -> None:
    """Read the file that is named first into the folder that is named second."""
    source, folder = sys.argv[1], Path(sys.argv[2])
    index: dict[str, Any] = {"arrays": [], "columns": [], "texts": [], "objects": []}
    try:
        for path, value in variables(source):
            if value is None:
                index["objects"].append(path)
            elif isinstance(value, list):
                index["texts"].append((path, value))
            elif value.dtype.kind == "U":
                if value.dtype.itemsize <= LONGEST_DATE:
                    np.save(folder / f"text{len(index['columns'])}.npy", value, allow_pickle=False)
                    index["columns"].append(path)
            else:
                np.save(folder / f"{len(index['arrays'])}.npy", value, allow_pickle=False)
                index["arrays"].append(path)
    except Exception as error:  # SciPy raises whatever it meets in a damaged file
        said = "" if isinstance(error, MemoryError) else " ".join(str(error).split())[:200].rstrip(".")
        index = {"problem": said or type(error).__name__}
    answers.write(json.dumps(index).encode("ascii"))
