"""What an examination of a recording found, and the lines of robot.toml that mend it."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Literal

from steelyard.display import html_table, text_table
from steelyard.recording import LogColumns, Processing, Recording
from steelyard.recording.correction import Settings, toml_text
from steelyard.recording.recognition import Layout
from steelyard.regression import Information

__all__ = ["Examination", "Finding", "Harm", "merged", "stated_remedy"]

Harm = Literal["refused", "wrong", "worse"]
HARMS: dict[Harm, str] = {
    "refused": "the log is refused",
    "wrong": "the answer would be wrong",
    "worse": "the answer would be worse",
}
"""What findings lead to, the most harmful first."""
_LOG_KEYS = frozenset(one.name for one in fields(LogColumns))
_PROCESSING_KEYS = frozenset(one.name for one in fields(Processing))


@dataclass(frozen=True, eq=False)
class Finding:
    """Something that is wrong with a recording.

    Attributes
    ----------
    kind : str
        "repeated stamps", "unit", "saturation", and so on; of what `find_mistakes` finds, its kind.
    statement : str
        What was found, in a sentence or several.
    harm : {"refused", "wrong", "worse"}
        What it leads to: the log is refused, the answer would be wrong, or it would be worse.
    weight : float
        By which findings of equal harm are sorted: the share of the rows or of the error that is concerned.
    remedy : dict
        What robot.toml must say, section by section; empty where no line of it mends the log.
    advice : str
        What to do where no line mends it; otherwise empty.
    """

    kind: str
    statement: str
    harm: Harm
    weight: float = 0.0
    remedy: Settings = field(default_factory=dict)
    advice: str = ""

    @property
    def toml(self) -> str:
        """`remedy` as TOML."""
        return toml_text(self.remedy)

    def __repr__(self) -> str:
        return f"Finding({self.kind}: {self.statement})"


@dataclass(frozen=True, eq=False)
class Examination:
    """The findings of `examine` about a recording.

    Attributes
    ----------
    source : str
        The log.
    findings : tuple of Finding
        The most harmful first; empty where nothing is wrong.
    remedies : dict
        Those of all findings together.
    facts : dict from str to str
        Rate, stamps, cutoff and so on, in words.
    joint_heads, joint_rows : tuple
        A table of measures of each joint.
    layout : Layout or None
        Which columns are what; None where the log could not be read.
    recording : Recording or None
        As it was read with the remedies.
    information : Information or None
        What the log tells of the robot, with the remedies; None without a robot.
    """

    source: str
    findings: tuple[Finding, ...]
    remedies: Settings
    facts: Mapping[str, str]
    joint_heads: tuple[str, ...] = ()
    joint_rows: tuple[tuple[str, ...], ...] = ()
    layout: Layout | None = None
    recording: Recording | None = None
    information: Information | None = None

    @property
    def toml(self) -> str:
        """The lines of robot.toml that mend what can be mended."""
        return toml_text(self.remedies)

    def to_dict(self) -> dict[str, Any]:
        """Return everything as plain data."""
        return {
            "log": self.source,
            "findings": [
                {
                    "kind": one.kind,
                    "statement": one.statement,
                    "harm": one.harm,
                    "remedy": one.remedy,
                    "toml": one.toml,
                    "advice": one.advice,
                }
                for one in self.findings
            ],
            "remedies": self.remedies,
            "facts": dict(self.facts),
            "joints": [dict(zip(self.joint_heads, row, strict=True)) for row in self.joint_rows],
            "columns": [] if self.layout is None else [vars(one) for one in self.layout.table],
        }

    def __repr__(self) -> str:
        count = len(self.findings)
        found = f"{count} finding{'s' * (count > 1)}" if count else "nothing is wrong"
        return f"Examination({self.source!r}: {found})"

    def __str__(self) -> str:
        parts = [repr(self)]
        if self.joint_rows:
            parts.append(text_table(self.joint_heads, self.joint_rows, range(1, len(self.joint_heads))))
        parts += [f"{name}: {value}" for name, value in self.facts.items()]
        for one in self.findings:
            parts.append(f"{HARMS[one.harm]}: {one.statement}")
            parts.append(one.toml or one.advice)
        return "\n".join(parts)

    def _repr_html_(self) -> str:
        told = [f"{one.statement} {one.toml or one.advice}" for one in self.findings]
        return html_table(repr(self), self.joint_heads, self.joint_rows, told)


def merged(first: Settings, second: Settings) -> Settings:
    """Return settings of robot.toml with others on top; lists of joints that are left out are joined.

    Examples
    --------
    >>> merged({"log": {"rate": 100.0}}, {"log": {"time_unit": "ms"}, "processing": {"saturation": True}})
    {'log': {'rate': 100.0, 'time_unit': 'ms'}, 'processing': {'saturation': True}}
    """
    result: Settings = {name: dict(table) if isinstance(table, dict) else table for name, table in first.items()}
    for section, table in second.items():
        if not isinstance(table, dict):
            result[section] = table
            continue
        own = result.setdefault(section, {})
        for key, value in table.items():
            both = key == "exclude_joints" and key in own
            own[key] = [*own[key], *(one for one in value if one not in own[key])] if both else value
    return result


def stated_remedy(sentence: str) -> Settings:
    """Return the first line of TOML that a message names in backticks, by its section; empty where there is none.

    Messages on logs say how they are mended, in lines of [log] or [processing]: what is tested of these lines here is
    that they mend.

    Examples
    --------
    >>> stated_remedy('the times are in ms: state `time_unit = "ms"` in [log].')
    {'log': {'time_unit': 'ms'}}
    """
    for piece in sentence.split("`")[1::2]:
        try:
            table = tomllib.loads(piece)
        except tomllib.TOMLDecodeError:
            continue
        for section, keys in (("log", _LOG_KEYS), ("processing", _PROCESSING_KEYS)):
            if table and keys.issuperset(table) and "..." not in piece and "…" not in piece:
                return {section: table}
    return {}
