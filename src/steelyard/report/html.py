"""The report: one HTML file that needs nothing else, neither a server nor the network."""

from __future__ import annotations

import os
from collections.abc import Callable
from importlib import resources
from pathlib import Path

from steelyard.errors import InputError
from steelyard.identification import Identification

from . import sections
from .figures import torque_figures
from .markup import Markup, escape
from .summary import summary

__all__ = ["report_html", "write_report"]

_SECTIONS: tuple[tuple[str, str, Callable[[Identification], Markup]], ...] = (
    ("errors", "Errors", sections.errors),
    ("impossible", "What was impossible", sections.violations),
    ("torques", "Measured and predicted torques", torque_figures),
    ("base", "Base parameters", sections.base_parameters),
    ("link-parameters", "Links", sections.links),
    ("joint-parameters", "Joints", sections.joints),
    ("sources", "Provenance", sections.provenance),
)
# Everything is in the file; the browser is told to fetch nothing, whatever the file may hold.
_POLICY = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"


def report_html(identification: Identification) -> str:
    """Return the report on an identification, an HTML document without references to anything outside.

    The same identification gives the same text, as long as the versions that it names are the same.

    Parameters
    ----------
    identification : Identification
        What :func:`steelyard.identify` returned.

    Returns
    -------
    str

    Examples
    --------
    >>> import tempfile
    >>> from steelyard.identification import demonstrate
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     text = report_html(demonstrate(folder))
    >>> "Plain least squares describes a robot that cannot exist" in text
    True
    """
    from plotly.offline import get_plotlyjs

    name = escape(identification.model.robot.name)
    links = "".join(f'<li><a href="#{key}">{title}</a></li>' for key, title, _ in _SECTIONS)
    body = "\n".join(
        f'<section aria-labelledby="{key}"><h2 id="{key}">{title}</h2>\n{write(identification)}</section>'
        for key, title, write in _SECTIONS
    )
    return f"""\
<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="{_POLICY}">
<title>{name}: identified parameters</title>
<link rel="icon" href="data:,">
<style>
{_text("page.css")}</style>
</head>
<body>
<header>
<p class="kind">Steelyard identification report</p>
<h1>{name}</h1>
</header>
<main>
{summary(identification)}
<nav aria-label="Sections"><ul>{links}</ul></nav>
{body}
</main>
<script>{get_plotlyjs()}</script>
<script>
{_text("figures.js")}</script>
</body>
</html>
"""


def write_report(identification: Identification, target: str | Path) -> None:
    """Write the report on an identification; the file appears whole or not at all.

    Parameters
    ----------
    identification : Identification
    target : str or Path
        An ``.html`` file, replaced where it is there.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    path = Path(target)
    part = path.with_name(path.name + ".part")
    content = report_html(identification).encode("utf-8", "replace")  # names of files need not be valid Unicode
    try:
        part.write_bytes(content)
        os.replace(part, path)
    except OSError as error:
        part.unlink(missing_ok=True)
        raise InputError(f"{path}: cannot be written ({error.strerror}); give another place for the report.") from None


def _text(name: str) -> str:
    return resources.files(__package__).joinpath(name).read_text(encoding="utf-8")
