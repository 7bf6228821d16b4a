"""``reproduction.html``: all the sections on one page, with the count of what agrees on top."""

from __future__ import annotations

from collections.abc import Sequence

from steelyard import report
from steelyard.report import charts_markup, html_document
from steelyard.report.html_document import Markup, escape, table

from .comparison import Comparison
from .section import Section, SectionResult, Table

__all__ = ["reproduction_page", "shown"]


def reproduction_page(results: Sequence[tuple[Section, SectionResult]], missing: Sequence[tuple[Section, str]]) -> str:
    """Return the page.

    Parameters
    ----------
    results : sequence of (Section, SectionResult)
    missing : sequence of (Section, str)
        Sections that were not computed, and why.
    """
    rows = [row for _, result in results for row in result.comparisons]
    agreeing = sum(row.agrees for row in rows)
    lead = [
        f'<p class="lead"><strong>{agreeing} of {len(rows)}</strong> published values agree within their printed '
        "precision. Each of the others says by how much it differs, and why.</p>"
    ]
    if missing:
        items = "".join(f"<li>{escape(f'{section.heading}: {why}')}</li>" for section, why in missing)
        lead.append(f"<p>Not computed:</p><ul>{items}</ul>")
    lead.append(_overview(results))
    parts = [
        report.Section(f"section-{section.key}", section.heading, section_markup(section, result))
        for section, result in results
    ]
    return html_document(
        "The thesis, reproduced",
        "Steelyard reproduction",
        "C. D. Sousa (2014), reproduced",
        Markup("\n".join(lead)),
        parts,
        scripts=("charts.js",),
    )


def section_markup(section: Section, result: SectionResult) -> Markup:
    """Return the content of one section."""
    pieces = [f"<p>{escape(remark)}</p>" for remark in result.remarks]
    if result.comparisons:
        # What differs comes first; what agrees is folded away where it is long.
        different = [row for row in result.comparisons if not row.agrees]
        equal = [row for row in result.comparisons if row.agrees]
        if different:
            pieces.append(_comparisons("Differs", different, f"different-{section.key}"))
        if equal:
            text = _comparisons("Agrees", equal, f"equal-{section.key}")
            fold = f"<details><summary>{len(equal)} values that agree</summary>{text}</details>"
            pieces.append(fold if len(equal) > 12 else text)
    pieces += [_table(item, f"table-{section.key}-{k}") for k, item in enumerate(result.tables)]
    if result.charts:
        pieces.append(charts_markup(result.charts, identifier=f"chart-{section.key}"))
    return Markup("\n".join(pieces))


def shown(value: float | str) -> str:
    """Return a value as it stands in a table.

    Examples
    --------
    >>> shown(107.93812), shown(0.00774), shown(3.0), shown("feasible")
    ('107.938', '0.00774', '3', 'feasible')
    """
    return value if isinstance(value, str) else f"{value:.6g}"


def _overview(results: Sequence[tuple[Section, SectionResult]]) -> Markup:
    rows = [
        (
            section.heading,
            str(sum(r.agrees for r in result.comparisons)),
            str(len(result.comparisons)),
        )
        for section, result in results
    ]
    return table("Sections", ("section", "agree", "published values"), rows, identifier="overview")


def _comparisons(title: str, rows: Sequence[Comparison], identifier: str) -> Markup:
    cells = [(row.what, shown(row.published), shown(row.ours), _margin(row), row.why) for row in rows]
    return table(title, ("value", "published", "ours", "difference", "why"), cells, identifier=identifier, texts=(4,))


def _margin(row: Comparison) -> str:
    return "" if row.difference != row.difference else f"{row.difference:+.2g}"


def _table(item: Table, identifier: str) -> Markup:
    cells = [[shown(value) for value in row] for row in item.rows]
    texts = [k for k in range(1, len(item.columns)) if any(isinstance(row[k], str) for row in item.rows)]
    return table(item.title, item.columns, cells, identifier=identifier, texts=texts)
