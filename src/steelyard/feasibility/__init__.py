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
from .conic import solve as solve
from .constraints import CenterOfMassBox as CenterOfMassBox
from .constraints import Constraint as Constraint
from .constraints import Equality as Equality
from .constraints import TotalMass as TotalMass
from .constraints import constraints_from_dict as constraints_from_dict
from .correct import Correction as Correction
from .correct import correct as correct
from .feasible_set import FeasibleSet as FeasibleSet
from .fit import fit as fit
from .fitting import FeasibleFit as FeasibleFit
from .fitting import fit_reduced as fit_reduced
from .lmi import AffineBlock as AffineBlock
from .lmi import AffineStack as AffineStack
from .proof import CertificateCheck as CertificateCheck
from .proof import FeasibilityCertificate as FeasibilityCertificate
from .proof import InfeasibilityCertificate as InfeasibilityCertificate

__all__ = [
    "AffineBlock",
    "AffineStack",
    "CenterOfMassBox",
    "CertificateCheck",
    "Cone",
    "ConicProblem",
    "ConicSolution",
    "Constraint",
    "Correction",
    "Equality",
    "FeasibilityCertificate",
    "FeasibleFit",
    "FeasibleSet",
    "InfeasibilityCertificate",
    "Outcome",
    "PolynomialCondition",
    "TotalMass",
    "Verdict",
    "Violation",
    "check",
    "closed_form_conditions",
    "constraints_from_dict",
    "correct",
    "feasibility_polynomials",
    "fit",
    "fit_reduced",
    "solve",
]
