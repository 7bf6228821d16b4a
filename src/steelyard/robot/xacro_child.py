"""A program that expands a xacro for another process, because its expressions may take all the time and memory.

It reads one request as JSON from standard input: the path and the arguments. It writes one answer as JSON: the text of
the URDF and the files that it was made of, or the problem.
"""

from __future__ import annotations

import ast
import io
import json
import os
import sys
from pathlib import Path
from typing import Any, BinaryIO

from steelyard.errors import InputError
from steelyard.files import read_bytes
from steelyard.robot.references import find_package, package_root, search_folders

__all__ = ["expanded", "main", "require_harmless"]

DEEPEST = 50
"""Files within files; those of robots are at most five deep."""

INTERIOR = ("gi_", "cr_", "ag_", "f_", "tb_", "co_", "func_", "im_")
"""Beginnings of the attributes by which an expression would reach the frames of the interpreter."""


class Refused(Exception):  # noqa: N818
    """Raised for what a description may not do; never caught by xacro, which wraps other errors."""


def require_harmless(expression: str) -> None:
    """Refuse an expression that could reach beyond the functions that xacro gives it.

    xacro itself refuses names with two underscores, but not within comprehensions and lambdas.
    """
    for node in ast.walk(ast.parse(expression.strip(), mode="eval")):
        name = node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""
        if name.startswith("__") or (isinstance(node, ast.Attribute) and name.startswith(INTERIOR)):
            raise Refused(f"the expression {expression[:100]!r} uses {name}, which no description needs")


def expanded(path: str, arguments: dict[str, str]) -> tuple[str, list[str]]:
    """Return the URDF of a xacro, and the files that were read for it."""
    import xacro
    from xacro import substitution_args

    top = Path(path)
    allowed = {package_root(top), *search_folders()}
    safe_eval, parse = xacro.safe_eval, xacro.parse
    files: list[str] = []

    def find(name: str) -> str:
        folder = find_package(name, Path(xacro.filestack[-1] or path))
        allowed.add(folder)
        return str(folder)

    def evaluate(expression: str, *scopes: Any) -> Any:
        require_harmless(expression)
        return safe_eval(expression, *scopes)

    def opened(file: str, *_: Any) -> io.StringIO:
        place = Path(os.path.normpath(os.path.abspath(file)))
        if not any(place.is_relative_to(os.path.abspath(folder)) for folder in allowed):
            raise Refused(
                f"{place} lies outside of the package and of the folders in ROS_PACKAGE_PATH; name its package with "
                "$(find ...)"
            )
        try:
            content = read_bytes(place)
            files.append(str(place))
        except InputError as error:
            raise OSError(0, str(error).removeprefix(f"{place}: ").rstrip("."), str(place)) from None
        if b"<!DOCTYPE" in content or b"<!ENTITY" in content:
            raise Refused(f"{place} has a DOCTYPE declaration, which a description does not need; remove it")
        return io.StringIO(content.decode("utf-8-sig"))

    def parsed(given: Any, file: str | None = None) -> Any:
        if len(xacro.filestack) > DEEPEST:
            way = " -> ".join(Path(one).name for one in xacro.filestack[-3:])
            raise Refused(f"files include each other more than {DEEPEST} deep ({way})")
        return parse(given, file)

    xacro.safe_eval, xacro.parse, xacro.open = evaluate, parsed, opened
    xacro._global_symbols["python"].pop("vars", None)  # the contents of types are more than a description needs
    substitution_args._eval_find = find
    substitution_args._eval_dict["find"] = find
    evaluate_argument = substitution_args._eval

    def checked(expression: str, context: Any) -> Any:
        require_harmless(expression)
        return evaluate_argument(expression, context)

    substitution_args._eval = checked
    xacro.init_stacks(path)
    document = xacro.parse(None, path)
    xacro.process_doc(document, mappings=dict(arguments))
    return str(document.toprettyxml(indent="  ")), files


def reason(error: BaseException) -> str:
    """Return the cause of an error of xacro, and the file in which it was."""
    import xacro

    cause = error
    while isinstance(getattr(cause, "exc", None), BaseException):
        cause = cause.exc  # type: ignore[attr-defined]
    said = " ".join(str(error).split()) if not isinstance(error, RecursionError) else "a macro or property needs itself"
    if isinstance(cause, InputError | Refused):
        return str(cause)
    if isinstance(cause, xacro.substitution_args.ArgException):
        said = f"the argument {cause} has no value"
    stack = [one for one in xacro.filestack or [] if one]
    where = f"in {Path(stack[-1]).name}: " if stack else ""
    return f"{where}{said or type(error).__name__}"


def main(answers: BinaryIO) -> None:
    """Answer the request on standard input."""
    request = json.load(sys.stdin)
    try:
        text, files = expanded(request["path"], request["arguments"])
        answer: dict[str, Any] = {"text": text, "files": files}
    except ImportError as error:
        answer = {"missing": error.name or "xacro"}
    except (Refused, InputError) as error:
        answer = {"problem": str(error)}
    except Exception as error:  # xacro raises exceptions of many types
        answer = {"problem": reason(error)}
    answers.write(json.dumps(answer).encode("ascii"))
