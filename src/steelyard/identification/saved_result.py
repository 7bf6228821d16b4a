"""Results that `identify` saved: an estimate, and beside it the record of how it was made."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from steelyard.dynamics import Model
from steelyard.errors import InputError
from steelyard.feasibility import FeasibleSet
from steelyard.feasibility.bounds.quantities import quantities
from steelyard.files import file_hash, read_json, require_format
from steelyard.recording import Processing
from steelyard.recording.formats import content_hash, content_hashes
from steelyard.regression import Estimate
from steelyard.regression.estimate import ESTIMATE, estimate_file
from steelyard.robot import Robot, RobotFile
from steelyard.robot.description import description_format, read_description

from .given import digests

__all__ = ["RECORD", "RECORD_FORMAT", "SavedResult"]

RECORD, RECORD_FORMAT = "run.json", "steelyard-run-1"
DRIVES = "drives.json"


@dataclass(frozen=True, eq=False)
class SavedResult:
    """An estimate from a folder of results, or from a file.

    Attributes
    ----------
    name : str
        As it was given.
    path : Path
        Of the estimate itself.
    record : mapping or None
        What stands in ``run.json`` beside the estimate; None where there is no such file.
    is_description : bool
        Whether the numbers are those of a description (CAD), and not an estimate.
    """

    name: str
    path: Path
    estimate: Estimate = field(repr=False)
    record: Mapping[str, Any] | None = field(default=None, repr=False)
    is_description: bool = False

    @classmethod
    def load(cls, given: str | Path) -> SavedResult:
        """Read the results of a folder, or an estimate with the record beside it.

        Parameters
        ----------
        given : str or Path
            A folder that ``steelyard identify`` wrote, or an ``estimate.json``.

        Raises
        ------
        InputError
            If a file cannot be used.
        """
        path = estimate_file(given)
        if (path / DRIVES).exists():
            raise InputError(
                f"{given}: holds drives that were identified from positions ({DRIVES}), not the estimate of a "
                "model; give the description beside it where a robot is asked for."
            )
        estimate = Estimate.load(path)
        beside = path.parent / RECORD
        # An estimate under another name was saved by hand, and the record beside it may be about another one.
        record = _record(beside) if path.name == ESTIMATE and beside.exists() else None
        return cls(str(given), path, estimate, record)

    @classmethod
    def of_description(cls, given: str | Path, beside: SavedResult, model: Model) -> SavedResult:
        """Take the inertials of a description for exact numbers, in the form of an estimate.

        Parameters
        ----------
        given : str or Path
            Such as a URDF.
        beside : SavedResult
            An estimate of the robot, which tells what its parameters are.
        model : Model
            Of the robot.

        Raises
        ------
        InputError
            If the file cannot be used, is of another robot, or says nothing of any link.
        """
        path, estimate = Path(given), beside.estimate
        described = Model(_described_robot(path, model.robot).with_terms(*model.robot.terms))
        base = described.base_parameters()
        if base.expressions != estimate.base_expressions:
            raise InputError(
                f"{given}: is of another robot than {beside.name}, since its base parameters are others; give the "
                "description with which that was identified, with other inertials at most."
            )
        estimate.require_geometry(described.robot, str(given))
        of_links = np.zeros(described.parameter_count, dtype=np.bool_)
        of_links[np.concatenate(described.link_columns)] = True
        values = np.where(of_links, described.robot.parameters, np.nan)
        unknown = np.isnan(values)
        if unknown[of_links].all():
            raise InputError(f"{given}: says nothing of the inertia of any link, so that nothing can be compared.")
        # What the description does not say is taken from the estimate, so that predictions differ by inertials alone.
        filled = np.where(unknown, 0.0 if estimate.parameters is None else estimate.parameters, values)
        is_open = np.any(base.K[:, unknown] != 0.0, axis=1)
        of_base = base.values(filled)
        if estimate.parameters is None:
            of_base = np.where(is_open, estimate.base, of_base)
        known = {
            quantity.name: float(quantity.value(filled))
            for quantity in quantities(FeasibleSet(described, terms=False))
            if not quantity.slope(filled)[unknown].any()
        }
        rows = [
            {**one, "value": value, "lower": value, "upper": value, "basis": "described"}
            for one in estimate.parameter_table
            if np.isfinite(value := known.get(one["name"], np.nan))
        ]
        return cls(
            str(given),
            path,
            replace(
                estimate,
                method="description",
                base=of_base,
                standard_error=np.where(is_open, np.inf, 0.0),
                parameters=filled,
                unconstrained_base=None,
                error_correlation=None,
                consistency=None,
                certificate=None,
                filtered_torque=False,
                parameter_table=tuple(rows),
                remarks=(),
            ),
            is_description=True,
        )

    @property
    def processing(self) -> Processing | None:
        """How the logs of the estimate were processed, with what the data decided; None where it is not known."""
        if self.record is None:
            return None
        options = self.record["options"]
        where = f"{self.path.parent / RECORD}, options.processing"
        return Processing.from_dict({**options["processing"], **options["decided"]}, where)

    @property
    def decided(self) -> dict[str, object]:
        """What of it the data decided, by the keys of ``[processing]``."""
        return {} if self.record is None else dict(self.record["options"]["decided"])

    @property
    def robot_file(self) -> Path | None:
        """The robot file of the record, where it is still there and the same.

        A relative path is looked for in the current folder, and in those above the results: identification mostly ran
        in one of them.
        """
        for entry in [] if self.record is None else self.record["robot"][:1]:
            for folder in (Path(), *self.path.resolve().parents):
                path = folder / str(entry["path"])
                if path.is_file() and file_hash(path) == entry.get("sha256"):
                    return path
        return None

    def has_seen(self, log: object) -> bool:
        """Return whether a log was used to make the estimate, by its content."""
        if self.record is None:
            return False
        used = {content_hash(entry) for log in self.record["logs"] for entry in log}
        used.update(one for content in self.record.get("contents", ()) for one in content.split("+"))
        hashes = digests([log]).values() or content_hashes(str(log))
        return not used.isdisjoint(hashes)


def _described_robot(path: Path, own: Robot) -> Robot:
    """Read a description as that of an estimate's robot was: up to its tip, with joints that it has not held still."""
    if own.source is not None and own.source.resolve() == path.resolve():
        return own
    if description_format(path) is None:  # a robot file, which says itself how it is read
        return RobotFile.load(path).robot
    tip, held = own.read_with.get("tip"), own.read_with.get("locked", {})
    robot, names = read_description(path, tip), {joint.name for joint in own.joints}
    others = {joint.name: held.get(joint.name, 0.0) for joint in robot.joints if joint.name not in names}
    return read_description(path, tip, others) if others else robot


def _record(path: Path) -> Mapping[str, Any]:
    """Read a record, and make sure that what is used of it is there."""
    remedy = "remove it, or give the folder that steelyard identify wrote"
    record = read_json(path, remedy=remedy)
    if not isinstance(record, dict):
        raise InputError(f"{path}: is a {type(record).__name__}, expected the format {RECORD_FORMAT!r}; {remedy}.")
    require_format(record.get("format"), RECORD_FORMAT, path, remedy)
    options = record.get("options")
    told = isinstance(options, dict) and all(isinstance(options.get(key), dict) for key in ("processing", "decided"))
    logs = record.get("logs")
    files = [record.get("robot"), *(logs if isinstance(logs, list) else [None])]
    named = all(isinstance(entries, list) and all(map(_is_hashed, entries)) for entries in files)
    if not told or not named:
        raise InputError(f"{path}: does not tell how the estimate was made (robot, logs, options); {remedy}.")
    return record


def _is_hashed(entry: object) -> bool:
    """Whether an entry tells a file by its hash, or an object by the entity tag of its store."""
    if not isinstance(entry, dict):
        return False
    content = "etag" if "etag" in entry and "sha256" not in entry else "sha256"
    return all(isinstance(entry.get(key), str) for key in ("path", content))
