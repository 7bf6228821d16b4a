"""The choices that options offer."""

from __future__ import annotations

from enum import Enum
from typing import Literal

__all__ = [
    "Consistency",
    "Criterion",
    "DistanceMetric",
    "Family",
    "Gravity",
    "NuisanceParameters",
    "Preference",
    "Sign",
    "Weights",
]


class Consistency(Enum):
    """What counts as physically possible."""

    FULL = "full"
    INERTIA = "inertia"

    value: Literal["full", "inertia"]


class DistanceMetric(Enum):
    """In what the distance to an estimate is measured."""

    DEVIATION = "deviation"
    EUCLIDEAN = "euclidean"

    value: Literal["deviation", "euclidean"]


class Weights(Enum):
    """How the joints are weighted."""

    JOINT = "joint"
    NONE = "none"


class Preference(Enum):
    """The choice among near-equal answers."""

    AUTO = "auto"
    CAD = "cad"
    LIGHTEST = "lightest"

    value: Literal["auto", "cad", "lightest"]


class Sign(Enum):
    """The sign of Coulomb friction in generated source."""

    EXACT = "exact"
    SMOOTH = "smooth"


class Gravity(Enum):
    """Where generated source has gravity from."""

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
    """What is known of the parameters that an excitation is not about."""

    UNKNOWN = "unknown"
    KNOWN = "known"
