"""Writing recordings."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from steelyard.errors import InputError

if TYPE_CHECKING:
    from steelyard.recording.recording import Recording

__all__ = ["save_recording"]


def save_recording(recording: Recording, path: Path) -> Path:
    """Write to a file beside `path`, then rename, so that there is never half a file."""
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
    try:
        handle, name = tempfile.mkstemp(dir=path.parent, suffix=kind)
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror}.") from None
    temporary = Path(name)
    try:
        # mkstemp makes the file private; a result has the usual permissions.
        mask = os.umask(0)
        os.umask(mask)
        os.fchmod(handle, 0o666 & ~mask)
        os.close(handle)
        if kind == ".npz":
            np.savez(temporary, **present)  # type: ignore[arg-type]
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
                frame.write_csv(temporary)
            else:
                frame.write_parquet(temporary, row_group_size=100_000)
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    return path
