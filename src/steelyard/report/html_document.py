"""An HTML document that needs nothing else, neither a server nor the network."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources

from .markup import Markup, escape

__all__ = ["Section", "html_document"]

# Everything is in the file; the browser is told to fetch nothing, whatever the file may hold.
_POLICY = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"


@dataclass(frozen=True)
class Section:
    """A part of a document.

    Attributes
    ----------
    key : str
        Identifier of its heading.
    title : str
    content : Markup
    """

    key: str
    title: str
    content: Markup


def html_document(
    title: str, kind: str, heading: str, lead: Markup, sections: Sequence[Section], *, script: str = ""
) -> str:
    """Return a document without references to anything outside.

    Parameters
    ----------
    title : str
        Of the window.
    kind : str
        What the document is, above the heading.
    heading : str
    lead : Markup
        What stands before the list of the sections.
    sections : sequence of Section
    script : str
        Name of a script of this package, which may use Plotly; none where it is empty.

    Returns
    -------
    str

    Examples
    --------
    >>> text = html_document("Arm", "Steelyard simulation", "Arm", Markup(""), [Section("a", "A", Markup("<p>b</p>"))])
    >>> '<h2 id="a">A</h2>' in text, "src=" in text
    (True, False)
    """
    links = "".join(f'<li><a href="#{part.key}">{escape(part.title)}</a></li>' for part in sections)
    body = "\n".join(
        f'<section aria-labelledby="{part.key}"><h2 id="{part.key}">{escape(part.title)}</h2>\n{part.content}</section>'
        for part in sections
    )
    scripts = ""
    if script:
        from plotly.offline import get_plotlyjs

        scripts = f"<script>{get_plotlyjs()}</script>\n<script>\n{_text(script)}</script>\n"
    return f"""\
<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="{_POLICY}">
<title>{escape(title)}</title>
<link rel="icon" href="data:,">
<style>
{_text("page.css")}</style>
</head>
<body>
<header>
<p class="kind">{escape(kind)}</p>
<h1>{escape(heading)}</h1>
</header>
<main>
{lead}
<nav aria-label="Sections"><ul>{links}</ul></nav>
{body}
</main>
{scripts}</body>
</html>
"""


def _text(name: str) -> str:
    return resources.files(__package__).joinpath(name).read_text(encoding="utf-8")
