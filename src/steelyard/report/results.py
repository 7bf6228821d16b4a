"""The folder of results: estimate, report, URDF, and what is needed to run it again."""

from __future__ import annotations

import hashlib
import json
import os
import platform
import shutil
import tempfile
from importlib import metadata
from pathlib import Path
from typing import Any

from steelyard import __version__
from steelyard.errors import InputError
from steelyard.identification import Identification

from .html import write_report

__all__ = ["require_folder", "save_results"]

FORMAT = "steelyard-run-1"
_LIBRARIES = ("numpy", "scipy", "clarabel", "llvmlite", "polars", "lxml", "plotly")


def require_folder(folder: Path) -> None:
    """Make sure that results can be written to a folder, before the work that leads to them.

    Parameters
    ----------
    folder : Path
        Made where it is missing.

    Raises
    ------
    InputError
        If it is a file, or cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise InputError(f"{folder}: is a file, but the results need a folder; give another --output.") from None
    except OSError as error:
        raise InputError(f"{folder}: cannot be made ({error.strerror}); give another --output.") from None
    if not os.access(folder, os.W_OK):
        raise InputError(f"{folder}: cannot be written; give another --output.")


def save_results(identification: Identification, folder: Path) -> tuple[Path, ...]:
    """Write ``estimate.json``, ``report.html``, ``run.json`` and, where the robot came as URDF, ``robot.urdf``.

    All are made beside the folder first and then moved into it, so that it never holds half a result.

    Parameters
    ----------
    identification : Identification
    folder : Path
        Made where it is missing; files of the same names are replaced.

    Returns
    -------
    tuple of Path
        The files.

    Raises
    ------
    InputError
        If the folder cannot be written, or the URDF cannot take the estimate.
    """
    require_folder(folder)
    source = identification.model.robot.source
    beside = Path(tempfile.mkdtemp(prefix=".steelyard-", dir=folder))
    try:
        identification.estimate.save(beside / "estimate.json")
        if source is not None:
            identification.estimate.write_urdf(source, beside / "robot.urdf")
        text = json.dumps(run_record(identification), indent=1, allow_nan=False)
        (beside / "run.json").write_text(text, encoding="utf-8")
        write_report(identification, beside / "report.html")
        made = sorted(beside.iterdir())
        for path in made:
            os.replace(path, folder / path.name)
    finally:
        shutil.rmtree(beside, ignore_errors=True)
    return tuple(folder / path.name for path in made)


def run_record(identification: Identification) -> dict[str, Any]:
    """Return inputs with hashes, versions and options: what is needed to run an identification again."""
    robot = identification.model.robot
    description = [p for p in (identification.robot_file, robot.source) if p is not None]
    return {
        "format": FORMAT,
        "robot": [_input(path) for path in dict.fromkeys(description)],
        "logs": [_log(text) for text in identification.logs],
        "validation_logs": [_log(text) for text in identification.validation_logs],
        "options": identification.options,
        "versions": {
            "steelyard": __version__,
            "python": platform.python_version(),
            **{name: metadata.version(name) for name in _LIBRARIES},
        },
    }


def _log(text: str) -> list[dict[str, str]]:
    return [_input(Path(part)) for part in ([text] if Path(text).exists() else text.split("+"))]


def _input(path: Path) -> dict[str, str]:
    with path.open("rb") as file:
        return {"path": str(path), "sha256": hashlib.file_digest(file, "sha256").hexdigest()}
