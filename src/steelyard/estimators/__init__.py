"""Least squares within the feasible set: the optimum, the choice among near-equal answers, and the way inside."""

from typing import TYPE_CHECKING

from steelyard.first_use import import_at_first_use

if TYPE_CHECKING:
    from .carried_body import CarriedBody as CarriedBody
    from .cross_validation import CrossValidation as CrossValidation
    from .cross_validation import cross_validation as cross_validation
    from .cross_validation import term_deviations as term_deviations
    from .drive_gains import DriveGains as DriveGains
    from .drive_gains import KnownPayload as KnownPayload
    from .drive_gains import estimate_drive_gains as estimate_drive_gains
    from .drive_gains import gains_from_equations as gains_from_equations
    from .energy_and_momentum import energy as energy
    from .energy_and_momentum import energy_information as energy_information
    from .energy_and_momentum import momentum as momentum
    from .energy_and_momentum import momentum_information as momentum_information
    from .estimator import ESTIMATORS as ESTIMATORS
    from .estimator import Estimator as Estimator
    from .estimator import estimate_with as estimate_with
    from .estimator import proved_estimate as proved_estimate
    from .fit import fit as fit
    from .friction_selection import ChosenFriction as ChosenFriction
    from .friction_selection import FrictionSelection as FrictionSelection
    from .friction_selection import FrictionTrial as FrictionTrial
    from .friction_selection import select_friction as select_friction
    from .instrumental_variables import instrumental_variables as instrumental_variables
    from .joint_stiffness import DeflectionRows as DeflectionRows
    from .joint_stiffness import JointStiffness as JointStiffness
    from .joint_stiffness import estimate_joint_stiffness as estimate_joint_stiffness
    from .l_curve import LCurve as LCurve
    from .l_curve import l_curve as l_curve
    from .maximum_likelihood import LikelihoodInformation as LikelihoodInformation
    from .maximum_likelihood import likelihood_information as likelihood_information
    from .maximum_likelihood import maximum_likelihood as maximum_likelihood
    from .output_error import output_error as output_error
    from .payload_estimate import KnownRobot as KnownRobot
    from .payload_estimate import PayloadEstimate as PayloadEstimate
    from .payload_estimate import PayloadQuantity as PayloadQuantity
    from .payload_estimate import estimate_payload as estimate_payload
    from .posterior import Posterior as Posterior
    from .posterior import PosteriorRow as PosteriorRow
    from .posterior import bayesian as bayesian
    from .posterior import posterior as posterior
    from .prior import ConstantPullbackPrior as ConstantPullbackPrior
    from .prior import EntropicPrior as EntropicPrior
    from .prior import EuclideanPrior as EuclideanPrior
    from .prior import Prior as Prior
    from .reduced_fit import FeasibleFit as FeasibleFit
    from .reduced_fit import fit_reduced as fit_reduced
    from .robust import HuberWeights as HuberWeights
    from .robust import RobustInformation as RobustInformation
    from .robust import robust_information as robust_information
    from .shadow_prices import ShadowPrice as ShadowPrice
    from .shadow_prices import ShadowPrices as ShadowPrices
    from .shadow_prices import shadow_prices as shadow_prices
    from .total_least_squares import total_least_squares as total_least_squares

__all__ = import_at_first_use(__name__, __file__)
