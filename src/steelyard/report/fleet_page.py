"""The page of a fleet: which robots differ from their siblings, which have drifted, and what is usual among them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from steelyard.display import few_digits, shortened
from steelyard.fleet import Batch, Cause, Finding, Fleet, RobotGroup, SiblingComparison
from steelyard.fleet.causes import FACTORS
from steelyard.fleet.siblings import deviations_of
from steelyard.fleet.variation import known_amplitudes

from .html_document import Markup, Section, bullets, escape, figures, html_document, number, percent, table
from .interval_bars import BAR, DRAWN, across, bar, interval_bar
from .picture import round_ticks
from .sections import versions

__all__ = ["fleet_html"]

MOST_FINDINGS, MOST_FAILED, MOST_ROBOTS = 200, 100, 300
"""Rows of tables: a page of 2000 robots opens at once, and the Parquet files have all."""
_WIDTH, _ROW, _LEFT = 720.0, 22, 210  # of the picture
_REACH = 10.0  # standard deviations to either side that the picture shows
_BARS = 120  # of the picture of two heaps, which the style draws 5 pixels wide
_WORDS = {"good": "predicts well", "usable": "usable", "poor": "poor", "wrong": "wrong"}


def fleet_html(fleet: Fleet) -> str:
    """Return the page of a fleet, an HTML document without references to anything outside.

    Parameters
    ----------
    fleet : Fleet
        What :func:`steelyard.fleet.identify_fleet` returned.
    """
    parts = (
        ("batches", "Batches", _batches(fleet)),
        ("siblings", "Robots that differ from their siblings", _findings(fleet, "siblings")),
        ("drift", "Robots that have drifted", _findings(fleet, "drift")),
        ("picture", "How far out each robot is", _pictures(fleet)),
        ("usual", "What is usual among siblings", _usual(fleet)),
        ("verdicts", "Verdicts", _verdicts(fleet)),
        ("failed", "Entries of which nothing came", _failed(fleet)),
        ("left-out", "Logs that were left out", _left_out(fleet)),
        ("robots", "All robots", _robots(fleet)),
        ("remarks", "Remarks", bullets(fleet.remarks)),
        ("how", "How robots are compared", _how(fleet)),
        ("sources", "Versions", table("Versions", ("", ""), list(versions().items()), identifier="run", texts=(1,))),
    )
    return html_document(
        f"{fleet.manifest.name}: fleet",
        "Steelyard fleet",
        fleet.manifest.name,
        _lead(fleet),
        [Section(key, title, content) for key, title, content in parts if content],
    )


def _lead(fleet: Fleet) -> Markup:
    robots = len({row.entry.id for row in fleet.rows})
    of_batches = {(one.group, robot) for one in fleet.batches for robot in one.robots}
    told = [("Robots", f"{robots}", f"{len(fleet.rows)} entries" if len(fleet.rows) != robots else "")]
    if of_batches:
        told.append(("Of another batch", f"{len(of_batches)}", ""))
    told.append(("Differ from their siblings", f"{len(fleet.differing)}", ""))
    if any(group.drift for group in fleet.groups):
        told.append(("Have drifted", f"{len(fleet.drifted)}", ""))
    if fleet.unexplained:
        told.append(("Not explained", f"{len({row.entry.id for row in fleet.unexplained})}", "see the remarks"))
    if fleet.unpredicted:
        told.append(("Not predicted", f"{len(fleet.unpredicted)}", "see the remarks"))
    told.append(("Nothing came of", f"{len(fleet.failed)}", "the reasons are below" if fleet.failed else ""))
    if fleet.left_out:
        told.append(("Logs left out", f"{len(fleet.left_out)}", "the reasons are below"))
    return Markup(f'<p class="lead">{escape(fleet.headline)}</p><dl class="figures">{figures(told)}</dl>')


def _batches(fleet: Fleet) -> Markup:
    sentences = {(one.robots, one.deviation.cause.name): one.sentence for one in fleet.batches}
    drawn = []
    for group in fleet.groups:
        if group.siblings is None:
            continue
        for batch in group.siblings.batches:
            names = tuple(fleet.rows[group.latest[k]].entry.id for k in batch.robots)
            told = (
                ("Robots", f"{len(names)}", f"of {len(group.latest)}{_named(group)}"),
                ("The two heaps lie apart", f"{batch.apart:.1f}", "standard deviations of one robot"),
                ("Two heaps are likelier than one of any skew by", f"{batch.odds / np.log(10.0):.0f}", "powers of ten"),
            )
            drawn.append(
                f'<p>{escape(sentences[names, batch.deviation.cause.name])}</p><dl class="figures">{figures(told)}</dl>'
                f"{_heaps(group, group.siblings, batch)}"
                f"<details><summary>The robots of this batch</summary><p>{escape(', '.join(names))}</p></details>"
            )
    if not drawn:
        return Markup("")
    text = (
        "Robots fall into two heaps, as after a change of a supplier, or where some were recorded in another way. The "
        "smaller heap is told here, beside the others, or that whose torques read wrong; which of the two is as it "
        "should be, nobody knows by that. Its robots are compared with their siblings without what they have in "
        "common, and are named below where they differ by more. Intervals are of 95\u00a0%."
    )
    return Markup(f"<p>{text}</p>{''.join(drawn)}")


def _heaps(group: RobotGroup, compared: SiblingComparison, batch: Batch) -> Markup:
    """The robots along what a batch has in common, in bars of those that are alike."""
    number = compared.causes.index(batch.deviation.cause)
    if not np.isfinite(batch.deviation.amplitude):  # a link as a whole has no single amplitude
        return Markup("")
    error = compared.error[:, number]
    known = known_amplitudes(compared.amplitude[:, number], error**-2)
    scores = known / np.nanmedian(error[np.isfinite(known)])
    inside = np.isin(np.arange(len(scores)), batch.robots)
    usual = scores[np.isfinite(scores) & ~np.isin(np.arange(len(scores)), compared.differs)]
    low, high = float(usual.min(initial=-1.0)), float(usual.max(initial=1.0))
    edges = np.linspace(low, high, _BARS + 1)
    scores = np.clip(scores, low, high)  # those that differ by more stand at the edge
    counts = [np.histogram(scores[chosen & np.isfinite(scores)], edges)[0] for chosen in (~inside, inside)]
    tallest, base = max(int(np.max(one)) for one in counts), 120.0
    parts = []
    for kind, own in zip(("span", "batch"), counts, strict=True):
        for place in np.flatnonzero(own):
            x = across(0.5 * float(edges[place] + edges[place + 1]), (low, high), _WIDTH)
            parts.append(f'<path class="{kind}" d="M{x:.1f} {base}V{base - 110.0 * own[place] / tallest:.1f}"/>')
    parts.append(f'<path d="M0 {base}H{_WIDTH:.0f}"/>')
    for value in round_ticks(low, high):
        x = across(value, (low, high), _WIDTH)
        parts.append(f'<text x="{x:.1f}" y="{base + 18:.0f}" text-anchor="middle">{value:g}</text>')
    legend = (
        (0.0, "span", f"{np.sum(np.isfinite(scores) & ~inside)} others"),
        (140.0, "batch", f"{len(batch.robots)} of this batch"),
    )
    for x, kind, told in legend:
        parts.append(f'<path class="{kind}" d="M{x + 3:.1f} {base + 46:.0f}V{base + 34:.0f}"/>')
        parts.append(f'<text x="{x + 12:.1f}" y="{base + 45:.0f}">{told}</text>')
    parts.append(
        f'<text x="{_WIDTH:.0f}" y="{base + 45:.0f}" text-anchor="end">standard deviations of one robot</text>'
    )
    label = (
        f"{batch.deviation.cause.name} of {len(scores)} robots{_named(group)}, beside that of the others, in standard "
        f"deviations of one robot; {len(batch.robots)} of another batch"
    )
    return _svg(label, parts, 172)


def _findings(fleet: Fleet, kind: str) -> Markup:
    found = [one for one in fleet.findings if one.kind == kind]
    compared = [g for g in fleet.groups if (g.siblings if kind == "siblings" else g.drift) is not None]
    if not compared:
        return Markup("")
    if not found:
        what = "differs from its siblings" if kind == "siblings" else "has drifted"
        return Markup(f"<p>No robot {what} by more than noise and what siblings vary by make likely.</p>")
    several = len(fleet.groups) > 1
    rows = []
    for one in found[:MOST_FINDINGS]:
        deviation = one.deviation
        rows.append(
            (
                one.robot,
                *((one.group,) if several else ()),
                _day(one.date),
                one.sentence,
                f"{deviation.deviations:.1f}",
                _bar(one),
            )
        )
    heads = (
        "Robot",
        *(("Group",) if several else ()),
        "Date",
        "What differs" if kind == "siblings" else "What changed",
        "Standard deviations",
        DRAWN,
    )
    texts = tuple(k for k in range(1, len(heads)) if k != len(heads) - 2)
    left = len(found) - len(rows)
    count = len({one.robot for one in found})
    rate = fleet.manifest.false_discovery_rate
    text = (
        f"{count} robot{'s' * (count != 1)}, the surest first. Intervals are of 95 %. Of the robots that are named "
        f"here, at most {100 * rate:g} % are so by chance as a rule."
        + (f" {left} more findings are in findings.parquet." if left else "")
    )
    caption = "Differences from siblings" if kind == "siblings" else "Changes between the first date and the latest"
    return Markup(f"<p>{escape(text)}</p>{table(caption, heads, rows, identifier=f'{kind}-found', texts=texts)}")


def _day(date: str) -> Markup:
    """A date that is not broken at its hyphens."""
    return Markup(f'<span class="change">{escape(date)}</span>')


def _bar(one: Finding) -> Markup:
    """The interval of the amplitude beside zero; or how it came, where there are several dates."""
    deviation = one.deviation
    if not np.isfinite(deviation.amplitude):
        return Markup("")
    if len(one.history) > 1:
        values = [0.0, *(value for _, value in one.history)]
        scale = (min(values), max(max(values), min(values) + 1e-9))
        points = " ".join(
            f"{4 + (BAR - 8) * k / (len(values) - 1):.1f},{22 - across(v, scale, 24.0):.1f}"
            for k, v in enumerate(values)
        )
        return bar(f'<path class="cad" d="M{points.replace(" ", "L")}"/>', BAR, 24, "assumed")
    low, high = min(deviation.lower, 0.0), max(deviation.upper, 0.0)
    margin = 0.15 * (high - low) or 1.0
    interval = (deviation.lower, deviation.upper)
    return interval_bar(interval, deviation.amplitude, (low - margin, high + margin), "assumed")


def _named(group: RobotGroup) -> str:
    return group.alike + (f" of {group.name}" if group.name else "")


def _pictures(fleet: Fleet) -> Markup:
    drawn = []
    for group in fleet.groups:
        for compared, kind in ((group.siblings, "siblings"), (group.drift, "drift")):
            if compared is not None:
                title = "Beside siblings" if kind == "siblings" else "Change in time, beside that of siblings"
                title += ", robots" * bool(group.alike) + _named(group)
                drawn.append(f"<h3>{escape(title)}</h3>{_picture(fleet, group, compared, kind)}")
    if not drawn:
        return Markup("")
    text = (
        "Each line is a part of the robot. The thick bar holds 90 of 100 of the robots that are not named, the thin "
        "one all of them, by how unlikely noise and the variation of siblings make them: at 4 as unlikely as 4 "
        "standard deviations of a normal distribution. A dot is a robot that is named; those beyond 10 stand at the "
        "edge. Between the dashed lines nobody is named."
    )
    return Markup(f"<p>{text}</p>{''.join(drawn)}")


def _picture(fleet: Fleet, group: RobotGroup, compared: SiblingComparison, kind: str) -> Markup:
    chosen = [k for k, one in enumerate(compared.causes) if _is_drawn(one, compared) and not compared.hidden[k]]
    away = (compared.amplitude - compared.common)[:, chosen]
    scores = np.copysign(np.vectorize(deviations_of, otypes=[float])(compared.probability[:, chosen]), away)
    scores[np.isnan(away)] = np.nan
    limit = deviations_of(compared.threshold)
    height = _ROW * len(chosen) + 34
    scale = (-_REACH, _REACH)

    def x(value: float) -> float:
        return _LEFT + across(value, scale, _WIDTH - _LEFT)

    parts = [
        f'<path stroke-dasharray="4 4" d="M{x(-limit):.1f} 4V{height - 28}"/>',
        f'<path stroke-dasharray="4 4" d="M{x(limit):.1f} 4V{height - 28}"/>',
        f'<path class="cad" d="M{x(0.0):.1f} 4V{height - 28}"/>',
    ]
    differs = {one.robot for one in compared.deviations}
    usual = np.array([k not in differs for k in range(len(scores))], dtype=bool)
    numbers = group.latest if kind == "siblings" else group.last
    for line, k in enumerate(chosen):
        y = 14 + _ROW * line
        own = scores[:, line]
        own = own[usual & np.isfinite(own)]
        name = escape(shortened(compared.causes[k].name, 30))
        parts.append(f'<text x="{_LEFT - 10}" y="{y + 4}" text-anchor="end">{name}</text>')
        if own.size:
            low, five, most, high = np.quantile(own, (0.0, 0.05, 0.95, 1.0))
            parts.append(f'<path d="M{x(low):.1f} {y}H{x(high):.1f}"/>')
            parts.append(f'<path class="span" d="M{x(five):.1f} {y}H{x(most):.1f}"/>')
        for one in compared.deviations:
            if compared.causes[k] is one.cause:
                score = np.copysign(one.deviations, one.amplitude)
                robot = escape(fleet.rows[numbers[one.robot]].entry.id)
                parts.append(f'<circle cx="{x(score):.1f}" cy="{y}" r="4"><title>{robot}</title></circle>')
    for value in range(-int(_REACH), int(_REACH) + 1, 2):
        parts.append(f'<text x="{x(value):.1f}" y="{height - 10}" text-anchor="middle">{value}</text>')
    count = len(compared.deviations)
    label = f"{len(chosen)} parts of {len(scores)} robots; {count} findings stand out, all of them in the table above"
    return _svg(label, parts, height)


def _svg(label: str, parts: Sequence[str], height: int) -> Markup:
    return Markup(
        f'<div class="scroll" role="region" tabindex="0" aria-label="Picture">'
        f'<svg class="interval assumed fleet" role="img" aria-label="{escape(label)}" '
        f'viewBox="0 0 {_WIDTH:.0f} {height}" width="{_WIDTH:.0f}" height="{height}" font-size="13" '
        f'fill="currentColor">{"".join(parts)}</svg></div>'
    )


def _is_drawn(cause: Cause, compared: SiblingComparison) -> bool:
    """Friction, masses and gains, and what was found."""
    return cause.kind in FACTORS or any(
        one.cause is cause and np.isfinite(one.amplitude) for one in compared.deviations
    )


def _usual(fleet: Fleet) -> Markup:
    drawn = []
    for place, group in enumerate(fleet.groups):
        compared = group.siblings
        if compared is None:
            continue
        rows = []
        for k, cause in enumerate(compared.causes):
            if cause.kind == "link" or compared.hidden[k]:
                continue
            spread, least = float(compared.spread[k]), float(compared.least_named[k])
            has_size = cause.has_ratio and cause.unit != ""
            rows.append(
                (
                    cause.name if cause.kind != "term" else f"{cause.name}: {cause.what} of {cause.part}",
                    cause.unit,
                    f"{cause.nominal:.3g}" if has_size else "",
                    _amount(spread, cause),
                    _amount(least, cause),
                )
            )
        heads = ("Part", "Unit", "Usual", "Siblings vary by", "Change that half would be named for")
        count = len(compared.robot_probability)
        caption = f"{count} robots{_named(group)}"
        drawn.append(table(caption, heads, rows, identifier=f"usual-{place + 1}", texts=(1,)))
    if not drawn:
        return Markup("")
    text = (
        "Siblings vary by the standard deviation that is left when the noise of the logs is taken away. Of robots with "
        "a change as large as in the last column, half would be named: smaller changes mostly go unseen in logs like "
        "these. In fleets of twenty it takes a fifth more, as the robot itself widens what is usual there. Above "
        "100 % the logs do not show the part by itself."
    )
    return Markup(f"<p>{text}</p>{''.join(drawn)}")


def _amount(value: float, cause: Cause) -> str:
    if not np.isfinite(value):
        return "–"
    return f"{few_digits(100.0 * value, 2)} %" if cause.has_ratio else few_digits(value * cause.nominal, 2)


def _verdicts(fleet: Fleet) -> Markup:
    values = [row.values for row in fleet.rows if not row.reason]
    if not values:
        return Markup("")
    words = Counter(v["word"] for v in values)
    feasible = Counter(v["feasible"] for v in values)
    errors = np.array([v["relative_error"] for v in values])
    rows = [(f"The model: {_WORDS[word]}", f"{words[word]}") for word in _WORDS if words[word]]
    rows += [(f"Plain least squares: {status}", f"{count}") for status, count in sorted(feasible.items())]
    rows.append(("The answer can exist", f"{sum(bool(v['possible']) for v in values)}"))
    middle = f"{percent(float(np.median(errors)))} % ({percent(float(errors.min()))} to {percent(float(errors.max()))})"
    rows.append(("Error of the torques: median, least and largest", middle))
    sources = Counter(v["source"] for v in values).most_common(1)[0][0]
    text = f"What was predicted is {sources}." if len({v["source"] for v in values}) == 1 else ""
    counted = table("Entries by their verdicts", ("Verdict", "Entries"), rows, identifier="verdict-counts")
    return Markup(f"<p>{escape(text)}</p>{counted}" if text else counted)


def _failed(fleet: Fleet) -> Markup:
    rows = [(row.entry.id, row.entry.date, row.reason) for row in fleet.failed]
    return _reasons("Entries and reasons", ("Robot", "Date", "Reason"), rows, "reasons", "robots.parquet")


def _left_out(fleet: Fleet) -> Markup:
    rows = [(row.entry.id, row.entry.date, log, reason) for row, log, reason in fleet.left_out]
    return _reasons("Logs and reasons", ("Robot", "Date", "Log", "Reason"), rows, "left-out-logs", "fleet.json")


def _reasons(title: str, heads: Sequence[str], rows: Sequence[Sequence[str]], identifier: str, others: str) -> Markup:
    if not rows:
        return Markup("")
    left = len(rows[MOST_FAILED:])
    text = f"<p>{left} more are in {others}.</p>" if left else ""
    texts = tuple(range(1, len(heads)))
    return Markup(table(title, heads, rows[:MOST_FAILED], identifier=identifier, texts=texts) + text)


def _robots(fleet: Fleet) -> Markup:
    rows: list[Sequence[str]] = []
    for told in fleet.robot_rows()[:MOST_ROBOTS]:
        if told["reason"]:
            rows.append((told["robot"], told["group"], told["date"], "nothing came of it", "", "", ""))
            continue
        words = {"another batch": "batch", "differs": "differs", "drifted": "drifted", "not explained": "unexplained"}
        named = [word for word, key in words.items() if told[key]]
        rows.append(
            (
                told["robot"],
                told["group"],
                told["date"],
                _WORDS.get(told["prediction"], told["prediction"]),
                percent(told["relative_error"]),
                number(told["total_mass"], 2),
                ", ".join(named),
            )
        )
    heads = ("Robot", "Group", "Date", "Prediction", "Error, %", "Mass, kg", "Named")
    left = len(fleet.rows) - len(rows)
    text = f"<p>{left} more are in robots.parquet.</p>" if left else ""
    drawn = table("Robots in the order of the manifest", heads, rows, identifier="all-robots", texts=(1, 2, 3, 6))
    return Markup(f"<details><summary>{len(rows)} robots</summary>{drawn}{text}</details>")


def _how(fleet: Fleet) -> Markup:
    rate = fleet.manifest.false_discovery_rate
    return Markup(
        "<p>Each robot is estimated from its own data. What plain least squares make of it is held against the mean of "
        "the others, with the covariance of its own error and that by which siblings vary, which is estimated from all "
        "of them (restricted maximum likelihood, with the influence of unusual robots bounded). For each cause, such "
        "as more friction in one joint, a heavier link or a torque sensor of another scale, generalised least squares "
        "tell the amplitude and its standard error. Of those that are beyond chance over all robots and causes "
        f"(Benjamini and Hochberg, a rate of false discoveries of {100 * rate:g} %) the likeliest is kept; what is "
        "left beside it is tried in turn.</p>"
        "<p>Before that, each cause is tried for two heaps of robots: two of one shape must be surely likelier than "
        "one heap of any skew and any tails, by the integrated likelihood of the classification. Then all robots are "
        "compared without what a batch has in common. A cause that is not in the list, such as an encoder whose zero "
        "is off, shows as one or several of the others.</p>"
    )
