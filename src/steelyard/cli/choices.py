"""The values that options with a fixed choice accept."""

from __future__ import annotations

from enum import Enum
from typing import Annotated, Literal

import typer

__all__ = [
    "AllowExtensions",
    "Changes",
    "Consistency",
    "ConsistencyOption",
    "Criterion",
    "DistanceMetric",
    "Family",
    "Gravity",
    "NuisanceParameters",
    "PriorName",
    "Sign",
    "TieBreakName",
    "Topic",
    "Weights",
]


class Changes(Enum):
    """What of the joints may be other while a payload is carried."""

    NOTHING = "nothing"
    FRICTION = "friction"
    FRICTION_AND_OFFSET = "friction-and-offset"

    value: Literal["nothing", "friction", "friction-and-offset"]


class Consistency(Enum):
    """What counts as physically possible."""

    FULL = "full"
    INERTIA = "inertia"

    value: Literal["full", "inertia"]


class DistanceMetric(Enum):
    """The metric of the distance to an estimate."""

    DEVIATION = "deviation"
    EUCLIDEAN = "euclidean"

    value: Literal["deviation", "euclidean"]


class Weights(Enum):
    """How the joints are weighted."""

    JOINT = "joint"
    NONE = "none"


class TieBreakName(Enum):
    """The choice among near-equal answers."""

    AUTO = "auto"
    CAD = "cad"
    LIGHTEST = "lightest"

    value: Literal["auto", "cad", "lightest"]


class PriorName(Enum):
    """What an answer stays near."""

    AUTO = "auto"
    NONE = "none"


class Sign(Enum):
    """The sign of Coulomb friction in generated source."""

    EXACT = "exact"
    SMOOTH = "smooth"


class Gravity(Enum):
    """Whether generated source has the robot's gravity, or gravity as an argument."""

    FIXED = "fixed"
    ARGUMENT = "argument"


class Family(Enum):
    """Kinds of excitation."""

    FOURIER = "fourier"
    SPLINE = "spline"
    QUINTIC = "quintic"


class Criterion(Enum):
    """What makes an excitation good: condition number, D- or A-optimality."""

    CONDITION = "condition"
    D = "d"
    A = "a"


class NuisanceParameters(Enum):
    """Whether the parameters that an excitation need not show are known already."""

    UNKNOWN = "unknown"
    KNOWN = "known"


AllowExtensions = Annotated[
    bool,
    typer.Option("--allow-extensions", help="Run code that robot.toml names by import path; only for files you trust."),
]

Topic = Annotated[
    str | None,
    typer.Option("--topic", help="Topic of a bag that is read, as `topic` in [log] of robot.toml."),
]

ConsistencyOption = Annotated[
    Consistency,
    typer.Option(
        "--consistency",
        help="What counts as physically possible: full, a body of positive mass density; inertia, positive mass and "
        "inertia alone (the thesis).",
    ),
]
