"""Least squares within the feasible set: the optimum, the choice among near-equal answers, and the way inside."""

from .constrained import FeasibleFit as FeasibleFit
from .constrained import fit_reduced as fit_reduced
from .interior import MARGIN_FACTORS as MARGIN_FACTORS
from .interior import pull_inside as pull_inside
from .preference import Preference as Preference
from .preference import closest_to_cad as closest_to_cad
from .preference import lightest as lightest
from .preference import lightest_witness as lightest_witness

__all__ = [
    "MARGIN_FACTORS",
    "FeasibleFit",
    "Preference",
    "closest_to_cad",
    "fit_reduced",
    "lightest",
    "lightest_witness",
    "pull_inside",
]
