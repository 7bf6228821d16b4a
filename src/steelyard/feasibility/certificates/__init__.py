"""Proofs of feasibility and infeasibility that are checked without a solver, in exact arithmetic."""

from .certificate import FeasibilityCertificate as FeasibilityCertificate
from .certificate import InfeasibilityCertificate as InfeasibilityCertificate
from .document import load_certificate as load_certificate
from .document import verify_certificate as verify_certificate
from .document import verify_document as verify_document
from .exact_set import speaks_of as speaks_of
from .verification import CertificateCheck as CertificateCheck

__all__ = [
    "CertificateCheck",
    "FeasibilityCertificate",
    "InfeasibilityCertificate",
    "load_certificate",
    "speaks_of",
    "verify_certificate",
    "verify_document",
]
