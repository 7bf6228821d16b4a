"""Physical feasibility: the feasible set and its constraints, check and correct, certificates, bounds and diagnosis."""

from typing import TYPE_CHECKING

from steelyard.first_use import import_at_first_use

if TYPE_CHECKING:
    from .bounds import LeastMass as LeastMass
    from .bounds import LightestRobot as LightestRobot
    from .bounds import ParameterInterval as ParameterInterval
    from .bounds import ParameterIntervals as ParameterIntervals
    from .bounds import lightest_robot as lightest_robot
    from .bounds import parameter_intervals as parameter_intervals
    from .certificates import CertificateCheck as CertificateCheck
    from .certificates import FeasibilityCertificate as FeasibilityCertificate
    from .certificates import InfeasibilityCertificate as InfeasibilityCertificate
    from .certificates import load_certificate as load_certificate
    from .certificates import verify_certificate as verify_certificate
    from .certificates import verify_document as verify_document
    from .check import Verdict as Verdict
    from .check import Violation as Violation
    from .check import check as check
    from .constraints import CenterOfMassBox as CenterOfMassBox
    from .constraints import CenterOfMassHull as CenterOfMassHull
    from .constraints import CenterOfMassSphere as CenterOfMassSphere
    from .constraints import ConfidenceInterval as ConfidenceInterval
    from .constraints import Constraint as Constraint
    from .constraints import DensityInBox as DensityInBox
    from .constraints import DensityInEllipsoid as DensityInEllipsoid
    from .constraints import Equality as Equality
    from .constraints import EqualLinks as EqualLinks
    from .constraints import LinearBound as LinearBound
    from .constraints import MeasuredMass as MeasuredMass
    from .constraints import SymmetricLink as SymmetricLink
    from .constraints import TotalMass as TotalMass
    from .constraints import confidence_intervals as confidence_intervals
    from .correct import Correction as Correction
    from .correct import correct as correct
    from .explanation import BaseParameterDegree as BaseParameterDegree
    from .explanation import InfeasibilityExplanation as InfeasibilityExplanation
    from .explanation import explain_infeasibility as explain_infeasibility
    from .feasible_set import FeasibleSet as FeasibleSet
    from .irreducible_subsystem import IrreducibleInfeasibleSubsystem as IrreducibleInfeasibleSubsystem
    from .tie_break import TieBreak as TieBreak

__all__ = import_at_first_use(__name__, __file__)
