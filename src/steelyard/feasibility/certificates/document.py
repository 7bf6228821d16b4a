"""Certificates as documents, which are verified with Python's integers alone."""

from collections.abc import Mapping
from fractions import Fraction
from pathlib import Path
from typing import Any

from steelyard.errors import InputError
from steelyard.files import read_json, require_format, shown

from .rational import parse_number
from .statement import FORMAT, Matrix, Statement
from .verification import CertificateCheck, refused, verify_dual_point, verify_witness

__all__ = ["load_certificate", "verify_certificate", "verify_document"]


def load_certificate(path: str | Path) -> dict[str, Any]:
    """Read a certificate from its own file, or from that of a saved estimate.

    Raises
    ------
    InputError
        If the file cannot be read or is no certificate.
    """
    return _certificate_of(_read(path), path)


def _read(path: str | Path) -> Any:
    return read_json(Path(path), remedy="give a certificate that steelyard saved")


def _certificate_of(document: Any, source: str | Path) -> dict[str, Any]:
    if _is_estimate(document):
        document = document["certificate"]
    if not isinstance(document, dict):
        raise InputError(f"{source}: is not a certificate but a {type(document).__name__}; expected {FORMAT!r}.")
    if document.get("format") != FORMAT:
        if "certificate" in document and document["certificate"] is None:
            raise InputError(
                f"{source}: is an estimate without a proof; make one with: steelyard check ROBOT {source} --output FILE"
            )
        require_format(document.get("format"), FORMAT, source, "give a certificate that steelyard saved")
    return document


def _is_estimate(document: Any) -> bool:
    return isinstance(document, dict) and isinstance(document.get("certificate"), dict)


def verify_certificate(path: str | Path) -> CertificateCheck:
    """Verify a certificate in a file with integers alone, without a solver, floating point or the robot.

    Parameters
    ----------
    path : str or Path
        File that `save` of a certificate or of an estimate wrote. The numbers of an estimate must agree with its
        certificate.

    Returns
    -------
    CertificateCheck
        True if the proof is valid; its sentence says what is proved, or what is wrong. Whether the statement is about a
        certain robot is checked by `speaks_of`, which needs the robot.

    Raises
    ------
    InputError
        If the file is not a certificate or is damaged.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([("0", 0.0, 0.0, "q")], gravity=(0, -9.81, 0)))
    >>> verdict = sy.check(sy.FeasibleSet(model), base=[-0.6, 1.0, 0.0])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder) / "certificate.json"
    ...     verdict.certificate.save(path)
    ...     print(verify_certificate(path).sentence)
    Proved in exact arithmetic: no parameters with these base parameters satisfy the one condition stated.
    """
    from steelyard.regression.certified_numbers import certified_numbers_differ  # loaded where certificates are read

    document = _read(path)
    verified = verify_document(_certificate_of(document, path), str(path))
    different = certified_numbers_differ(document) if verified and _is_estimate(document) else ""
    return refused(f"the certificate is valid, but not for this estimate: {different}") if different else verified


def verify_document(document: Mapping[str, Any], where: str = "certificate") -> CertificateCheck:
    """Verify a certificate as plain data, as `to_dict` of a certificate gives it.

    Raises
    ------
    InputError
        If something is missing or damaged; `where` is named in the message.
    """
    statement = Statement.from_dict(_mapping(document.get("statement"), where), where)
    proof = _mapping(document.get("proof"), where)
    verdict = document.get("verdict")
    try:
        if verdict == "feasible":
            return verify_witness(statement, [parse_number(value) for value in proof["parameters"]])
        if verdict == "infeasible":
            return verify_dual_point(
                statement,
                [parse_number(value) for value in proof["direction"]],
                _duals(proof["duals"], statement),
                [parse_number(value) for value in proof["multipliers"]],
                parse_number(proof["shift"]),
            )
    except (KeyError, TypeError, ValueError, IndexError) as error:
        reason = f"lacks {error}" if isinstance(error, KeyError) else str(error)
        raise InputError(f"{where}: its proof is damaged ({reason[:300]}); save the certificate anew.") from None
    raise InputError(f'{where}: its verdict is {shown(verdict)}; expected "feasible" or "infeasible".')


def _mapping(value: Any, where: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise InputError(f"{where}: lacks its statement or its proof; save the certificate anew.")
    return value


def _duals(entries: Any, statement: Statement) -> dict[int, Matrix]:
    found: dict[int, Matrix] = {}
    for index, elements in entries:
        if isinstance(index, bool) or not isinstance(index, int) or not 0 <= index < len(statement.conditions):
            raise ValueError(f"there is no condition number {index!r}")
        if index in found:
            raise ValueError(f"condition number {index} has two dual matrices")
        size = statement.conditions[index].size
        matrix = [[Fraction(0)] * size for _ in range(size)]
        places: set[tuple[int, int]] = set()
        for i, j, value in elements:
            if not (isinstance(i, int) and isinstance(j, int) and 0 <= i <= j < size):
                raise ValueError(f"({i!r}, {j!r}) is no place in a matrix of {size} rows")
            if (i, j) in places:
                raise ValueError(f"the place ({i}, {j}) of a dual matrix is there twice")
            places.add((i, j))
            matrix[i][j] = matrix[j][i] = parse_number(value)
        found[index] = matrix
    return found
