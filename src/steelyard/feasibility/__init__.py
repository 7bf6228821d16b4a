"""Physical feasibility: linear matrix inequalities, the feasible set, and check, correct and fit."""

from .check import Verdict as Verdict
from .check import Violation as Violation
from .check import check as check
from .closed_form import PolynomialCondition as PolynomialCondition
from .closed_form import closed_form_conditions as closed_form_conditions
from .closed_form import feasibility_polynomials as feasibility_polynomials
from .conic import Cone as Cone
from .conic import ConicProblem as ConicProblem
from .conic import ConicSolution as ConicSolution
from .conic import Outcome as Outcome
from .conic import SemidefiniteProgram as SemidefiniteProgram
from .conic import Solver as Solver
from .conic import SolverTable as SolverTable
from .conic import register_solver as register_solver
from .conic import solve as solve
from .conic import solver_table as solver_table
from .conic import unregister_solver as unregister_solver
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
from .constraints import constraints_from_dict as constraints_from_dict
from .correct import Correction as Correction
from .correct import correct as correct
from .feasible_set import FeasibleSet as FeasibleSet
from .fit import fit as fit
from .fitting import ConstantPullbackPrior as ConstantPullbackPrior
from .fitting import EntropicPrior as EntropicPrior
from .fitting import EuclideanPrior as EuclideanPrior
from .fitting import FeasibleFit as FeasibleFit
from .fitting import HuberWeights as HuberWeights
from .fitting import LCurve as LCurve
from .fitting import Preference as Preference
from .fitting import Prior as Prior
from .fitting import RobustInformation as RobustInformation
from .fitting import SmallestMass as SmallestMass
from .fitting import fit_reduced as fit_reduced
from .fitting import l_curve as l_curve
from .fitting import robust_information as robust_information
from .fitting import smallest_total_mass as smallest_total_mass
from .insight import BaseParameterDegree as BaseParameterDegree
from .insight import Conflict as Conflict
from .insight import ConstraintPrice as ConstraintPrice
from .insight import ConstraintPrices as ConstraintPrices
from .insight import InfeasibilityExplanation as InfeasibilityExplanation
from .insight import LeastMass as LeastMass
from .insight import LightestRobot as LightestRobot
from .insight import ParameterInterval as ParameterInterval
from .insight import ParameterIntervals as ParameterIntervals
from .insight import constraint_prices as constraint_prices
from .insight import explain_infeasibility as explain_infeasibility
from .insight import lightest_robot as lightest_robot
from .insight import parameter_intervals as parameter_intervals
from .lmi import AffineBlock as AffineBlock
from .lmi import AffineStack as AffineStack
from .lmi import LinearExpression as LinearExpression
from .lmi import LinearMatrixInequality as LinearMatrixInequality
from .lmi import base_variable_names as base_variable_names
from .lmi import block_diagonal as block_diagonal
from .lmi import distance_inequality as distance_inequality
from .lmi import inequality_of_program as inequality_of_program
from .lmi import parse_expression as parse_expression
from .lmi import residual_inequality as residual_inequality
from .lmi import to_base_dependent as to_base_dependent
from .lmi import to_standard as to_standard
from .lmi import variables as variables
from .proof import CertificateCheck as CertificateCheck
from .proof import FeasibilityCertificate as FeasibilityCertificate
from .proof import InfeasibilityCertificate as InfeasibilityCertificate
from .proof import load_certificate as load_certificate
from .proof import speaks_of as speaks_of
from .proof import verify_certificate as verify_certificate
from .proof import verify_document as verify_document

__all__ = [
    "AffineBlock",
    "AffineStack",
    "BaseParameterDegree",
    "CenterOfMassBox",
    "CenterOfMassHull",
    "CenterOfMassSphere",
    "CertificateCheck",
    "Cone",
    "ConfidenceInterval",
    "Conflict",
    "ConicProblem",
    "ConicSolution",
    "ConstantPullbackPrior",
    "Constraint",
    "ConstraintPrice",
    "ConstraintPrices",
    "Correction",
    "DensityInBox",
    "DensityInEllipsoid",
    "EntropicPrior",
    "EqualLinks",
    "Equality",
    "EuclideanPrior",
    "FeasibilityCertificate",
    "FeasibleFit",
    "FeasibleSet",
    "HuberWeights",
    "InfeasibilityCertificate",
    "InfeasibilityExplanation",
    "LCurve",
    "LeastMass",
    "LightestRobot",
    "LinearBound",
    "LinearExpression",
    "LinearMatrixInequality",
    "MeasuredMass",
    "Outcome",
    "ParameterInterval",
    "ParameterIntervals",
    "PolynomialCondition",
    "Preference",
    "Prior",
    "RobustInformation",
    "SemidefiniteProgram",
    "SmallestMass",
    "Solver",
    "SolverTable",
    "SymmetricLink",
    "TotalMass",
    "Verdict",
    "Violation",
    "base_variable_names",
    "block_diagonal",
    "check",
    "closed_form_conditions",
    "confidence_intervals",
    "constraint_prices",
    "constraints_from_dict",
    "correct",
    "distance_inequality",
    "explain_infeasibility",
    "feasibility_polynomials",
    "fit",
    "fit_reduced",
    "inequality_of_program",
    "l_curve",
    "lightest_robot",
    "load_certificate",
    "parameter_intervals",
    "parse_expression",
    "register_solver",
    "residual_inequality",
    "robust_information",
    "smallest_total_mass",
    "solve",
    "solver_table",
    "speaks_of",
    "to_base_dependent",
    "to_standard",
    "unregister_solver",
    "variables",
    "verify_certificate",
    "verify_document",
]
