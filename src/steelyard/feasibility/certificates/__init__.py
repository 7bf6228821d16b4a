"""Proofs of feasibility and infeasibility that are checked without a solver, in exact arithmetic."""

from typing import TYPE_CHECKING

from steelyard.first_use import import_at_first_use

if TYPE_CHECKING:
    from .certificate import FeasibilityCertificate as FeasibilityCertificate
    from .certificate import InfeasibilityCertificate as InfeasibilityCertificate
    from .certificate import speaks_of as speaks_of
    from .document import load_certificate as load_certificate
    from .document import verify_certificate as verify_certificate
    from .document import verify_document as verify_document
    from .verification import CertificateCheck as CertificateCheck

__all__ = import_at_first_use(__name__, __file__)
