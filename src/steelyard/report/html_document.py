"""HTML documents that need neither a server nor the network: escaped text, numbers, tables and whole pages."""

from __future__ import annotations

import base64
import html
import json
import math
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from hashlib import sha256
from importlib import resources

from steelyard.errors import printable
from steelyard.graph import ObjectCache

__all__ = [
    "WITHOUT_SCRIPTS",
    "Markup",
    "Section",
    "bullets",
    "compressed",
    "escape",
    "figures",
    "html_document",
    "number",
    "package_text",
    "paragraphs",
    "percent",
    "plotly_text",
    "script_data",
    "table",
]


class Markup(str):
    """Text that is HTML already, and is not escaped again.

    Examples
    --------
    >>> escape("a < b"), escape(Markup("<b>bold</b>"))
    ('a &lt; b', '<b>bold</b>')
    """

    __slots__ = ()


WITHOUT_SCRIPTS = Markup(
    "<noscript><p>The figures are drawn by a script, and scripts are turned off here.</p></noscript>"
)
"""What stands in the place of figures where no script draws them."""


def escape(text: object) -> Markup:
    """Return text as it may stand in an element or between the quotes of an attribute, with nothing in it unseen."""
    return text if isinstance(text, Markup) else Markup(html.escape(printable(str(text)), quote=True))


def plotly_text(text: str) -> str:
    """Return text as Plotly shows it: links and other markup in it would be drawn as such.

    Examples
    --------
    >>> plotly_text('<a href="https://example.org">elbow</a>')
    '&lt;a href="https://example.org"&gt;elbow&lt;/a&gt;'
    """
    return html.escape(printable(text), quote=False)


def bullets(sentences: Iterable[str]) -> Markup:
    """Return a list of sentences; nothing where there is none.

    Examples
    --------
    >>> bullets(["a < b"]), bullets([])
    ('<ul><li>a &lt; b</li></ul>', '')
    """
    items = "".join(f"<li>{escape(sentence)}</li>" for sentence in sentences)
    return Markup(f"<ul>{items}</ul>" if items else "")


def paragraphs(sentences: Iterable[str]) -> Markup:
    """Return sentences as a paragraph each.

    Examples
    --------
    >>> paragraphs(["a < b", "c"])
    '<p>a &lt; b</p><p>c</p>'
    """
    return Markup("".join(f"<p>{escape(sentence)}</p>" for sentence in sentences))


def figures(told: Iterable[tuple[str, str, str]]) -> Markup:
    """Return the elements of a list of key figures: of each its name, its value and a note."""
    return Markup(
        "".join(
            f"<div><dt>{escape(name)}</dt><dd>{escape(value)}<span>{escape(note)}</span></dd></div>"
            for name, value, note in told
        )
    )


def script_data(content: object) -> Markup:
    """Return plain data as JSON that may stand in a script element, which no text of the data can end.

    Examples
    --------
    >>> print(script_data({"name": "</script>"}))
    {"name":"\\u003c/script\\u003e"}
    """
    text = json.dumps(content, allow_nan=False, separators=(",", ":"))
    return Markup(text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026"))


def number(value: float, decimals: int = 5) -> str:
    """Return a number with fixed decimals, so that columns align; small and large ones with an exponent.

    Examples
    --------
    >>> number(0.123456789), number(-2.5e-5), number(41234.5), number(0.0), number(float("nan"))
    ('0.12346', '-2.50e-05', '4.12e+04', '0.00000', '–')
    """
    if math.isnan(value):
        return "–"
    if math.isinf(value):
        return "∞" if value > 0 else "-∞"
    size = abs(value)
    if size >= 1e4 or 0.0 < size < 10.0 ** (1 - decimals):
        return f"{value:.2e}"
    return f"{value:.{decimals}f}"


def percent(fraction: float) -> str:
    """Return a fraction as a number of per cent.

    Examples
    --------
    >>> percent(0.04531), percent(12.0), percent(float("inf"))
    ('4.53', '1200', '∞')
    """
    if not math.isfinite(fraction):
        return number(fraction)
    return f"{100.0 * fraction:.2f}" if abs(fraction) < 10.0 else f"{100.0 * fraction:.0f}"


def table(
    caption: str,
    columns: Sequence[str],
    rows: Iterable[Sequence[str]],
    *,
    identifier: str,
    texts: Sequence[int] = (),
    muted: Sequence[int] = (),
    total: bool = False,
) -> Markup:
    """Return a table whose first column heads its rows; the others are numbers.

    Parameters
    ----------
    caption : str
    columns : sequence of str
    rows : iterable of sequence of str
    identifier : str
        The element's id.
    texts : sequence of int
        Further columns that hold text and not numbers.
    muted : sequence of int
        Rows that matter less.
    total : bool
        Whether the last row sums up the others.
    """

    def cells(row: Sequence[str]) -> str:
        first, *others = row
        tags = [f'<th scope="row">{escape(first)}</th>']
        for index, cell in enumerate(others, start=1):
            tags.append(f"<td>{escape(cell)}</td>" if index in texts else f'<td class="number">{escape(cell)}</td>')
        return "".join(tags)

    def heads() -> Iterable[str]:
        for index, title in enumerate(columns):
            kind = "" if index == 0 or index in texts else ' class="number"'
            yield f'<th scope="col"{kind}>{escape(title)}</th>'

    opening = {True: '<tr class="muted">', False: "<tr>"}
    lines = [f"{opening[index in muted]}{cells(row)}</tr>" for index, row in enumerate(rows)]
    foot = f"<tfoot>{lines.pop()}</tfoot>" if total and lines else ""
    body = "\n".join(lines)
    return Markup(
        f'<div class="scroll" role="region" tabindex="0" aria-labelledby="{identifier}-caption">'
        f'<table id="{identifier}"><caption id="{identifier}-caption">{escape(caption)}</caption>'
        f"<thead><tr>{''.join(heads())}</tr></thead>\n<tbody>{body}</tbody>{foot}</table></div>"
    )


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
    title: str,
    kind: str,
    heading: str,
    lead: Markup,
    sections: Sequence[Section],
    *,
    scripts: Sequence[str] = (),
    plain_scripts: Sequence[str] = (),
    styles: Sequence[str] = (),
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
    scripts : sequence of str
        Names of scripts of this package, which may use Plotly.
    plain_scripts : sequence of str
        Names of scripts of this package that run at once, without Plotly.
    styles : sequence of str
        Names of styles of this package beside those of every page.

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
    code = "".join(f"<script>\n{package_text(name)}</script>\n" for name in plain_scripts)
    if scripts:
        code += f'<script id="plotly" type="text/plain">{_compressed_plotly()}</script>\n'
        code += "".join(
            f'<script class="uses-plotly" type="text/plain">\n{package_text(name)}</script>\n' for name in scripts
        )
        code += f"<script>\n{package_text('plotly_loader.js')}</script>\n"
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
{"".join(package_text(name) for name in ("page.css", *styles))}</style>
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
{code}</body>
</html>
"""


@lru_cache(maxsize=1)
def _compressed_plotly() -> str:
    """Return Plotly's script, deflated and in base 64: 1.9 MB in place of 4.8.

    It is kept beside compiled models: deflating it takes longer than all the charts of a page.
    """
    from plotly.offline import get_plotlyjs

    script = get_plotlyjs().encode()
    kept, key = ObjectCache.default(), f"{sha256(script).hexdigest()}-zlib-{zlib.ZLIB_RUNTIME_VERSION}"
    found = kept.read(key)
    if found is None:
        found = compressed(script).encode()
        kept.write(key, found)
    return found.decode("ascii")


def compressed(content: bytes) -> Markup:
    """Return bytes as they may stand in a script element, deflated and in base 64, which browsers undo.

    Examples
    --------
    >>> import base64, zlib
    >>> zlib.decompress(base64.b64decode(compressed(b"</script>"))).decode()
    '</script>'
    """
    return Markup(base64.b64encode(zlib.compress(content, 9)).decode("ascii"))


def package_text(name: str) -> str:
    """Return a style or a script of this package."""
    return resources.files(__package__).joinpath(name).read_text(encoding="utf-8")
