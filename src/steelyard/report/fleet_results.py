"""The folder of a fleet's results: tables in Parquet, the findings as JSON, and the page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from steelyard.files import replaced_file, replaced_folder, write_json, write_table, write_text
from steelyard.fleet import Fleet

from .fleet_page import fleet_html
from .results import require_apart
from .sections import hashed_file, versions

if TYPE_CHECKING:
    import polars

__all__ = ["FLEET_FILES", "save_fleet"]

RECORD = "fleet.json"
FLEET_FILES = ("fleet.html", "findings.parquet", "parameters.parquet", "robots.parquet", RECORD)


def save_fleet(fleet: Fleet, folder: str | Path, *, stale: Sequence[str] = ()) -> tuple[Path, ...]:
    """Write ``fleet.html``, ``robots.parquet``, ``parameters.parquet``, ``findings.parquet`` and ``fleet.json``.

    They appear together; the same fleet gives the same bytes.

    Parameters
    ----------
    fleet : Fleet
    folder : str or Path
        Made where it is missing; files of the same names are replaced.
    stale : sequence of str
        Names of further files in the folder that go when these appear, such as checkpoints.

    Returns
    -------
    tuple of Path
        The files.

    Raises
    ------
    InputError
        If the folder cannot be written.
    """
    target = Path(folder)
    require_apart(target, (fleet.manifest.path, fleet.manifest.table), FLEET_FILES)
    with replaced_folder(target, record=RECORD, stale=tuple(stale)) as made:
        robots, findings = _frame(fleet.robot_rows(), _ROBOTS), _frame(fleet.finding_rows(), _FINDINGS)
        for name, frame in (("robots", robots), ("findings", findings), ("parameters", _long(fleet))):
            with replaced_file(made / f"{name}.parquet", durable=False) as file:
                write_table(frame, file, ".parquet")
        write_text(fleet_html(fleet), made / "fleet.html")
        document = fleet.to_dict() | {"manifest": hashed_file(fleet.manifest.path), "versions": versions()}
        write_json(document, made / RECORD)
    return tuple(target / name for name in FLEET_FILES)


_TEXT = ("robot", "group", "date", "reason", "least_squares", "prediction", "predicted", "cause", "sentence", "remarks")
_ROBOTS = dict.fromkeys(_TEXT, str) | {
    "batch": str,
    "rows": int,
    "left_out": int,
    "possible": bool,
    "model_error": float,
    "relative_error": float,
    "condition_number": float,
    "total_mass": float,
    "differs": bool,
    "probability": float,
    "unexplained": bool,
    "drifted": bool,
}
_FINDINGS = {
    "kind": str,
    "robot": str,
    "robots": str,
    "group": str,
    "date": str,
    "since": str,
    "cause": str,
    "part": str,
    "what": str,
    "unit": str,
    "change": float,
    "lower": float,
    "upper": float,
    "ratio": float,
    "standard_deviations": float,
    "probability": float,
    "alternatives": str,
    "sentence": str,
}


def _frame(rows: Sequence[Mapping[str, Any]], kinds: Mapping[str, type]) -> polars.DataFrame:
    """A table whose columns have the same types, whether or not there is anything in them; NaN becomes null."""
    import polars as pl

    types = {str: pl.String, int: pl.Int64, float: pl.Float64, bool: pl.Boolean}
    names = list(rows[0]) if rows else list(kinds)
    columns = [pl.Series(name, [row[name] for row in rows], dtype=types[kinds[name]]) for name in names]
    return pl.DataFrame([one.fill_nan(None) if one.dtype == pl.Float64 else one for one in columns])


def _long(fleet: Fleet) -> polars.DataFrame:
    import polars as pl

    columns = fleet.parameter_columns()
    texts = {
        name: pl.Series(name, columns[name], dtype=pl.String) for name in ("robot", "date", "kind", "parameter", "unit")
    }
    numbers = {
        name: pl.Series(name, np.asarray(columns[name]), dtype=pl.Float64).fill_nan(None)
        for name in ("value", "lower", "upper")
    }
    return pl.DataFrame([*texts.values(), *numbers.values()])
