"""Logs as HDF5, and MATLAB's files of version 7.3, which are HDF5 too."""

from __future__ import annotations

import math
import weakref
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError, require_package

from .array_log import MOST_JOINTS, ArrayLog, StoredArray, dates_stored, part_of, texts_of
from .decoded import decoded_once
from .log_file import reading_as

__all__ = ["Hdf5File"]

MOST_DATASETS = 5000
MOST_COMPRESSED = 1100  # gzip makes at most 1032 bytes of one
DEEPEST = 20
LARGEST_TEXTS = 1_000_000
"""Bytes of an array of texts, and of the structures of MATLAB that point to them."""
LARGEST_DATES = 200_000_000
"""The most bytes of an array with a date in each row."""


class Hdf5File(ArrayLog):
    """An HDF5 file: datasets of numbers in any groups, and fields of compound datasets.

    Arrays that stand in other files are not read. In files of MATLAB rows and columns are exchanged back, and structs
    and cells of texts understood.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        library = require_package(
            "h5py", "HDF5 files, and MATLAB's files of version 7.3, are read with the module", "hdf5"
        )
        with reading_as(path, "HDF5"):
            # Without a lock, files can be read on all file systems, and while a recorder still has them open.
            self._file = library.File(path, "r", locking=False)
            weakref.finalize(self, self._file.close)
            with path.open("rb") as file:
                self._is_matlab = file.read(10) == b"MATLAB 7.3"
            self._h5py = library
            self._arrays: list[StoredArray] = []
            self._texts: dict[tuple[str, ...], tuple[str, ...]] = {}
            self._has_objects = False
            self._collect(self._file, ())
        if self._is_matlab:
            self.joiner = "."  # type: ignore[misc]
        self._store(self._arrays, self._texts, self._has_objects)

    def _collect(self, group: Any, path: tuple[str, ...]) -> None:
        """List what stands in a group; links into other files and circles of links are not followed."""
        if len(path) > DEEPEST:
            raise InputError(f"{self.path} has groups nested more than {DEEPEST} times; a log is flat.")
        labels = self._labels_in_attributes(group)
        if labels:
            self._texts.setdefault((*path, "joint_names"), labels)
        for name in group:
            if isinstance(group.get(name, getlink=True), self._h5py.HardLink) and not name.startswith("#"):
                item = group[name]
                if isinstance(item, self._h5py.Dataset):
                    self._add(item, (*path, name))
                elif isinstance(item, self._h5py.Group):
                    self._collect(item, (*path, name))

    def _labels_in_attributes(self, item: Any) -> tuple[str, ...]:
        for key in ("joint_names", "joints", "names"):
            if key in item.attrs and len(found := texts_of(item.attrs[key])) > 1:
                return found
        return ()

    def _add(self, dataset: Any, path: tuple[str, ...]) -> None:
        if len(self._arrays) >= MOST_DATASETS:
            raise InputError(f"{self.path} holds more than {MOST_DATASETS} arrays; a log has a few.")
        if dataset.shape is None or dataset.external is not None or dataset.is_virtual:
            return
        matlab = dataset.attrs.get("MATLAB_class") if self._is_matlab else None
        if "MATLAB_empty" in dataset.attrs:
            return
        if matlab is not None and "MATLAB_object_decode" in dataset.attrs:
            self._has_objects = True
            return
        kind = dataset.dtype
        labels = self._labels_in_attributes(dataset)
        if labels:
            self._texts.setdefault((*path, "joint_names"), labels)
        if matlab in (b"char", b"cell"):
            texts = self._matlab_texts(dataset, matlab == b"cell")
            if texts:
                self._texts[path] = texts
        elif self._h5py.check_string_dtype(kind) is not None:
            if dataset.nbytes <= LARGEST_TEXTS and dataset.size <= MOST_JOINTS:
                self._texts[path] = texts_of(dataset[()])
            elif dataset.ndim == 1 and dataset.nbytes <= LARGEST_DATES and dates_stored(path, dataset[:1]) is not None:
                self._require_room(dataset, path)
                dates = decoded_once(self.path, (Hdf5File, path), lambda: dates_stored(path, dataset[()]))
                self._arrays += [] if dates is None else [dates]
        elif kind.names is not None and len(dataset.shape) == 1:
            for field in kind.names:
                base, shape = (kind[field].base, kind[field].shape)
                if base.kind in "fiu":
                    self._require_room(dataset, path)
                    of_field = partial(_take_field, dataset, field)
                    self._arrays.append(StoredArray.of_numbers((*path, field), (*dataset.shape, *shape), of_field))
        elif kind.kind in "fiu":
            self._require_room(dataset, path)
            take: Callable[[int, int, int], NDArray[Any]] = partial(part_of, dataset)
            shape = dataset.shape
            if self._is_matlab:
                take, shape = partial(_take_reversed, dataset), shape[::-1]
            self._arrays.append(StoredArray.of_numbers(path, shape, take))

    def _require_room(self, dataset: Any, path: tuple[str, ...]) -> None:
        """Refuse an array that claims more than the file can hold."""
        claimed, stored = math.prod(dataset.shape) * dataset.dtype.itemsize, dataset.id.get_storage_size()
        if claimed > MOST_COMPRESSED * stored + 1000:
            raise InputError(
                f"{self.path}: its array {'/'.join(path)} claims {claimed} bytes, from {stored} stored ones, which no "
                "compression reaches; save it again."
            )

    def _matlab_texts(self, dataset: Any, is_cell: bool) -> tuple[str, ...]:
        """Return the texts of a cell, or those in the rows of a matrix of characters."""
        if dataset.nbytes > LARGEST_TEXTS:
            return ()
        if not is_cell:
            rows = np.atleast_2d(np.asarray(dataset[()]).T)
            return texts_of(["".join(map(chr, row)) for row in rows])
        found = []
        for reference in np.ravel(dataset[()]):
            text = self._file[reference] if isinstance(reference, self._h5py.Reference) else None
            if text is None or text.attrs.get("MATLAB_class") != b"char" or text.size > LARGEST_TEXTS:
                return ()
            found += ["".join(map(chr, np.ravel(np.asarray(text[()]))))]
        return texts_of(found)


def _take_reversed(dataset: Any, start: int, stop: int, axis: int) -> NDArray[Any]:
    return part_of(dataset, start, stop, len(dataset.shape) - 1 - axis).T


def _take_field(dataset: Any, field: str, start: int, stop: int, axis: int) -> NDArray[Any]:
    if axis == 0:
        return np.asarray(dataset[start:stop][field])
    return part_of(dataset[field], start, stop, axis)
