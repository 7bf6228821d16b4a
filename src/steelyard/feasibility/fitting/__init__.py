"""Least squares within the feasible set: the optimum, the choice among near-equal answers, and the way inside."""

from .constrained import FeasibleFit as FeasibleFit
from .constrained import fit_reduced as fit_reduced
from .interior import MARGIN_FACTORS as MARGIN_FACTORS
from .interior import least_eigenvalue as least_eigenvalue
from .interior import pull_inside as pull_inside
from .l_curve import LCurve as LCurve
from .l_curve import l_curve as l_curve
from .preference import Preference as Preference
from .preference import closest_to_cad as closest_to_cad
from .preference import lightest as lightest
from .prior import ConstantPullbackPrior as ConstantPullbackPrior
from .prior import EntropicPrior as EntropicPrior
from .prior import EuclideanPrior as EuclideanPrior
from .prior import Prior as Prior
from .robust import HuberWeights as HuberWeights
from .robust import RobustInformation as RobustInformation
from .robust import robust_information as robust_information
from .smallest_mass import SmallestMass as SmallestMass
from .smallest_mass import smallest_total_mass as smallest_total_mass
from .witness import lightest_witness as lightest_witness

__all__ = [
    "MARGIN_FACTORS",
    "ConstantPullbackPrior",
    "EntropicPrior",
    "EuclideanPrior",
    "FeasibleFit",
    "HuberWeights",
    "LCurve",
    "Preference",
    "Prior",
    "RobustInformation",
    "SmallestMass",
    "closest_to_cad",
    "fit_reduced",
    "l_curve",
    "least_eigenvalue",
    "lightest",
    "lightest_witness",
    "pull_inside",
    "robust_information",
    "smallest_total_mass",
]
