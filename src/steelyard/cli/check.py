"""``steelyard check``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .choices import AllowExtensions, ConsistencyOption, Json, Quiet
from .terminal import echo, print_json

__all__ = ["check"]


def check(
    robot: Annotated[
        Path | None, typer.Argument(help="URDF or robot.toml; not needed to verify a certificate by itself.")
    ] = None,
    estimate: Annotated[Path | None, typer.Argument(help="Folder of results, or estimate.json.")] = None,
    certificate: Annotated[
        Path | None,
        typer.Option(
            "--certificate",
            help="Verify this certificate instead, in exact arithmetic; with ROBOT, also that it speaks of this robot.",
        ),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="File for the certificate of the verdict (JSON).")
    ] = None,
    consistency: ConsistencyOption = "full",
    json: Json = False,
    quiet: Quiet = False,
    allow_extensions: AllowExtensions = False,
) -> None:
    """Tell whether a robot with these parameters could exist: exit 0 feasible, 1 not, 2 bad input.

    With --certificate: exit 0 where it proves what it says, 1 where it does not.

    \b
    Examples:
      steelyard check robot.toml estimate.json
      steelyard check robot.toml estimate.json --output certificate.json
      steelyard check --certificate certificate.json
    """
    from steelyard.errors import InputError
    from steelyard.files import plain
    from steelyard.files.writing import require_unread
    from steelyard.identification import check_certificate, check_estimate
    from steelyard.regression.estimate import estimate_file
    from steelyard.robot import RobotFile

    file = None if robot is None else RobotFile.load(robot, allow_extensions=allow_extensions)
    if certificate is not None:
        if output is not None:
            raise InputError("--certificate verifies a certificate and --output saves a new one; give one of them.")
        verified = check_certificate(certificate, file, estimate, consistency)
        if json:
            print_json({"format": "steelyard-certificate-check-1", "certificate": str(certificate), **plain(verified)})
        else:
            echo(verified.sentence)
        if not verified:
            raise typer.Exit(1)
        return
    if file is None or estimate is None:
        raise InputError("steelyard check needs ROBOT and ESTIMATE, or --certificate FILE to verify a certificate.")
    require_unread(output, robot, file.robot.source, estimate_file(estimate))
    verdict = check_estimate(file, estimate, consistency)
    if json:
        print_json(verdict.to_dict())
    else:
        echo(verdict.sentences()[0] if quiet else str(verdict))
    if output is not None:
        if verdict.certificate is None:
            raise InputError(f"{output} was not written: nothing is proved, so that there is no certificate to save.")
        verdict.certificate.save(output)
        if not json and not quiet:
            echo(f"The proof is in {output}; anybody can verify it with: steelyard check --certificate {output}")
    if not verdict.feasible:
        raise typer.Exit(1)
