"""The folder of results: estimate, report, URDF, and what is needed to run it again."""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from steelyard.errors import InputError
from steelyard.files import read_json, replaced_folder, write_json, write_text
from steelyard.files.writing import require_unread
from steelyard.identification import Identification
from steelyard.identification.saved_result import RECORD, RECORD_FORMAT
from steelyard.recording.formats import hashed_log
from steelyard.regression.estimate import ESTIMATE
from steelyard.robot import Robot
from steelyard.robot.description import DESCRIPTION_FORMATS, URDF, description_format

from .html import write_report
from .sections import hashed_file, versions

__all__ = ["require_apart", "require_folder", "require_replaceable", "save_results"]

TABLE = "parameters.csv"
ELASTIC = "robot_elastic.xml"
FILES = (ESTIMATE, "report.html", "robot.urdf", ELASTIC, RECORD, TABLE)
DESCRIPTION = r"robot\.(?!toml$)\w+"


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
        what = "a link that leads nowhere" if folder.is_symlink() else "a file"
        raise InputError(f"{folder}: is {what}, but the results need a folder; give another --output.") from None
    except OSError as error:
        raise InputError(f"{folder}: cannot be made ({error.strerror}); give another --output.") from None
    if not os.access(folder, os.W_OK):
        raise InputError(f"{folder}: cannot be written; give another --output.")


def require_apart(folder: Path, inputs: Iterable[Path | None], names: Sequence[str] = ()) -> None:
    """Make sure that no input is one of the files that results replace.

    Parameters
    ----------
    folder : Path
        For the results.
    inputs : iterable of Path or None
        What is read.
    names : sequence of str
        Of the files; by default those of an identification, among them the description.

    Raises
    ------
    InputError
        If one of them would be replaced.
    """
    given = [one for one in inputs if one is not None]
    descriptions = [name for one in given if re.fullmatch(DESCRIPTION, name := f"robot{one.suffix.lower()}")]
    for name in names or (*FILES, *descriptions):
        require_unread(folder / name, *given)


def require_replaceable(folder: Path, robot: Robot) -> None:
    """Make sure that the description of results takes the place of an earlier result alone.

    ``robot.urdf`` is what users call their own files, too.

    Parameters
    ----------
    folder : Path
        For the results.
    robot : Robot

    Raises
    ------
    InputError
        If a file of its name is there that the record of the folder does not tell of.
    """
    name = None if robot.source is None else _described(robot.source, robot)
    if name is not None and (folder / name).exists() and name not in _earlier(folder):
        raise InputError(
            f"{folder / name}: is no result of an earlier identification, and the results would replace it; move it, "
            "or give another --output."
        )


def save_results(
    identification: Identification, folder: Path, *, force: bool = False, stale: Collection[str] = ()
) -> tuple[Path, ...]:
    """Write ``estimate.json``, ``parameters.csv``, ``report.html``, ``run.json`` and the description.

    The description, such as ``robot.urdf``, is left out where the model does not predict the robot, so that nobody
    takes it for one. Beside an MJCF of a robot with elastic joints stands ``robot_elastic.xml``, in which motors drive
    them through springs.

    They appear together, see :func:`steelyard.files.replaced_folder`.

    Parameters
    ----------
    identification : Identification
    folder : Path
        Made where it is missing; files of the same names are replaced.
    force : bool
        Write the description in any case.
    stale : collection of str
        Names of further files in the folder that go when these appear, such as checkpoints.

    Returns
    -------
    tuple of Path
        The files.

    Raises
    ------
    InputError
        If the folder cannot be written, or one of the files is that of the robot or, under the name of the description,
        of the user; and, when all other files have been written, if the description cannot take the estimate.
    """
    refused: InputError | None = None
    source = identification.model.robot.source
    require_apart(folder, (identification.robot_file, source))
    require_replaceable(folder, identification.model.robot)
    with replaced_folder(folder, record=RECORD, stale={*_earlier(folder), *stale}) as made:
        identification.estimate.save(made / ESTIMATE)
        if identification.parameters is not None:
            write_text(identification.parameters.to_csv(), made / TABLE)
        if source is not None and (force or identification.prediction.word != "wrong"):
            name = _described(source, identification.model.robot)
            if name is not None:
                try:
                    identification.estimate.write_description(source, made / name)
                    elastic = identification.elastic_model
                    is_mjcf = description_format(source) is DESCRIPTION_FORMATS.get("mjcf")
                    if elastic is not None and elastic.is_proved and is_mjcf:
                        elastic.write_mjcf(identification.estimate, source, made / ELASTIC)
                except InputError as error:  # such as of links behind a locked joint; nothing else depends on it
                    refused = error
        write_report(identification, made / "report.html")
        names = sorted([RECORD, *(path.name for path in made.iterdir())])
        write_json({**run_record(identification), "files": names}, made / RECORD)
    if refused is not None:
        why = str(refused).rstrip(".")
        raise InputError(f"{why}. No robot description was written; all other results are in {folder}.") from refused
    return tuple(folder / name for name in names)


def _described(source: Path, robot: Robot) -> str | None:
    """Name the file for the description with the identified parameters; None where it cannot be written."""
    kind = description_format(source) or URDF
    if kind.refusal(robot):
        return None
    if kind is URDF:
        return "robot.urdf"
    return f"robot{source.suffix.lower()}" if kind.is_written else None


def _earlier(folder: Path) -> tuple[str, ...]:
    """Return the files of an earlier run in a folder, as named in its record."""
    try:
        record = read_json(folder / RECORD)
    except InputError:
        return ()
    if (
        not isinstance(record, dict)
        or record.get("format") != RECORD_FORMAT
        or not isinstance(record.get("files"), list)
    ):
        return ()
    return tuple(name for name in record["files"] if name in FILES or re.fullmatch(DESCRIPTION, str(name)))


def run_record(identification: Identification) -> dict[str, Any]:
    """Return inputs with hashes, versions and options: what is needed to run an identification again."""
    robot, plausible = identification.model.robot, identification.plausible
    price = None if plausible is None else plausible.price
    description = [p for p in (identification.robot_file, robot.source) if p is not None]
    return {
        "format": RECORD_FORMAT,
        "robot": [hashed_file(path) for path in dict.fromkeys(description)],
        "logs": [_log(text, identification.in_memory) for text in identification.logs],
        "validation_logs": [_log(text, identification.in_memory) for text in identification.validation_logs],
        "informations": [hashed_file(Path(path)) for path in identification.informations],
        "contents": identification.information.contents,
        "options": identification.options,
        "columns": identification.columns_to_list(),
        "prediction": identification.prediction.to_dict(),
        "price": None if price is None else price.to_dict(),
        "prior": [] if plausible is None else list(plausible.prior.sentences),
        "remarks": list(dict.fromkeys((*identification.estimate.remarks, *identification.remarks))),
        "versions": versions(),
    }


def _log(text: str, in_memory: Mapping[str, str]) -> list[dict[str, str]]:
    return [{"path": text, "sha256": in_memory[text]}] if text in in_memory else hashed_log(text)
