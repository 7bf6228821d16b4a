"""Writing recordings."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from steelyard.errors import InputError
from steelyard.files import replaced_file

if TYPE_CHECKING:
    from .recording import Recording

__all__ = ["save_recording"]


def save_recording(recording: Recording, path: Path) -> Path:
    """Write a recording; the file appears whole or not at all."""
    kind = path.suffix.lower()
    if kind not in (".npz", ".csv", ".parquet"):
        raise InputError(f"{path} has the suffix {path.suffix!r}; recordings are saved as .npz, .csv or .parquet.")
    arrays = {
        "t": recording.t,
        "q": recording.q,
        "dq": recording.velocity,
        "ddq": recording.acceleration,
        "tau": recording.torque,
    }
    # What was filled in is no measurement, and is left out again.
    gone = {"tau": recording.torque_missing, **dict.fromkeys(("q", "dq", "ddq"), recording.position_missing)}
    present = {}
    for key, values in arrays.items():
        if values is not None:
            flags = gone.get(key)
            present[key] = values if flags is None else np.where(flags, np.nan, values)
    with replaced_file(path) as file:
        if kind == ".npz":
            np.savez(file, **present)  # type: ignore[arg-type]
        else:
            import polars as pl

            columns = {}
            for key, array in present.items():
                if array.ndim == 1:
                    columns[key] = array
                else:
                    columns.update({f"{key}{j + 1}": np.ascontiguousarray(array[:, j]) for j in range(array.shape[1])})
            frame = pl.DataFrame(columns)
            if kind == ".csv":
                frame.write_csv(file)
            else:
                frame.write_parquet(file, row_group_size=100_000)
    return path
