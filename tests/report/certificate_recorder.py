"""A plugin of pytest that writes down each certificate that the tests verify, and what our own verifier said of it."""

import functools
import json
import os
from pathlib import Path

from steelyard.feasibility.certificates import certificate as certificates
from steelyard.feasibility.certificates import document as documents


def _write(text: str, valid: bool) -> None:
    with open(os.environ["STEELYARD_RECORDED_CERTIFICATES"], "a", encoding="utf-8") as file:
        file.write(json.dumps([text, valid]) + "\n")


def _text_of(document: object) -> str | None:
    try:
        return json.dumps(dict(document))
    except (TypeError, ValueError):
        return None


def _recording(verify, text_of):
    @functools.wraps(verify)
    def verified(given, *arguments, **options):
        text, valid = text_of(given), False
        try:
            found = verify(given, *arguments, **options)
            valid = bool(found)
            return found
        finally:
            if text is not None:
                _write(text, valid)

    return verified


def _content(path: object) -> str | None:
    try:
        return Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return None


def pytest_configure() -> None:
    """Watch the verifiers, before any test module has imported them by name."""
    documents.verify_certificate = _recording(documents.verify_certificate, _content)
    documents.verify_document = _recording(documents.verify_document, _text_of)
    for kind in (certificates.FeasibilityCertificate, certificates.InfeasibilityCertificate):
        kind.verify = _recording(kind.verify, lambda one: _text_of(one.to_dict()))
