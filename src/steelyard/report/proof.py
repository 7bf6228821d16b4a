"""The proofs that a report carries, which the page itself verifies in the browser, in exact arithmetic."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from steelyard.identification import Identification

from .html_document import Markup, compressed, escape

__all__ = ["PROOF_SCRIPTS", "proof"]

PROOF_SCRIPTS = ("certificate.js", "proof.js")
"""The verifier, which reads a text and knows nothing of a page, and what shows its answer in the page."""

_CLAIMS = {
    "answer": "The answer can exist",
    "possible": "A real robot can have the base parameters of plain least squares",
    "impossible": "No real robot has the base parameters of plain least squares",
}


def proof(identification: Identification) -> Markup:
    """Return the proofs of both verdicts with the places where the page says what it verified of them.

    Returns
    -------
    Markup
        Empty where nothing is proved.
    """
    found: list[tuple[str, str, Mapping[str, Any]]] = []
    if identification.estimate.certificate is not None:
        found.append(("answer", _CLAIMS["answer"], identification.estimate.certificate))
    verdict = identification.verdict
    if verdict.certificate is not None and verdict.feasible is not None:
        claim = _CLAIMS["possible" if verdict.feasible else "impossible"]
        found.append(("least-squares", claim, verdict.certificate.to_dict()))
    if not found:
        return Markup("")
    first = (
        "<p>A certificate states a question in exact numbers and proves the answer. This page carries it, and verifies "
        "it as it is opened, with integers of any length in place of floating point: a few lines of JavaScript that "
        "know neither the solver nor the robot. It also compares the numbers that its tables show with those that are "
        "proved.</p>"
    )
    last = (
        "<p>A proof is about its statement. That the statement is the one of your robot is seen with "
        "<code>steelyard check ROBOT --certificate FILE</code>, which makes it anew from the description; "
        "<code>verify_certificate.py</code>, which the documentation carries, verifies the same file with Python "
        "alone.</p>"
    )
    return Markup(first + "".join(_one(*one) for one in found) + last)


def _one(role: str, claim: str, certificate: Mapping[str, Any]) -> str:
    content = dict(certificate)
    text = json.dumps(content, ensure_ascii=False, separators=(",", ":"))
    name = f"certificate-{role}"
    return (
        f'<div class="certificate"><h3>{escape(claim)}</h3>'
        f'<p class="proof" data-certificate="{name}" data-role="{role}" data-verdict="{escape(content["verdict"])}" '
        'aria-live="polite">The page verifies the proof where scripts may run, in a browser of 2023 or later.</p>'
        f'<p><a class="save" download="{name}.json" hidden>Save this certificate</a></p>'
        f'<script type="text/plain" id="{name}">{compressed(text.encode())}</script></div>'
    )
