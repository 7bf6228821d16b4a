"""Proofs of feasibility and infeasibility that are checked without a solver."""

from .certificate import CertificateCheck as CertificateCheck
from .certificate import FeasibilityCertificate as FeasibilityCertificate
from .certificate import InfeasibilityCertificate as InfeasibilityCertificate

__all__ = ["CertificateCheck", "FeasibilityCertificate", "InfeasibilityCertificate"]
