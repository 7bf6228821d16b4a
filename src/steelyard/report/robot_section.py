"""The part of the report that shows the robot: its drawing, which can be turned, and its links beside it."""

from __future__ import annotations

import numpy as np

from steelyard.display import few_digits
from steelyard.identification import Identification

from .drawing import LOOKS, turnable
from .html_document import Markup, bullets, escape
from .robot_picture import KEY, DrawnLink, drawing_of_links, drawn_links, remarks_on_drawing
from .robot_scene import robot_scene

__all__ = ["robot"]


def robot(identification: Identification) -> Markup:
    """Return the robot with all joints at zero, and what each link weighs."""
    links, scene = drawn_links(identification), robot_scene(identification.model.robot)
    has_cad = any(not np.isnan(link.cad_mass) for link in links)
    has_answer = any(link.body is not None for link in links)
    told = identification.parameters
    text = ["Discs are joints that turn, squares joints that slide; grey bars lead from joint to joint."]
    if has_answer:
        text.append(
            "Each ellipsoid is the solid one of uniform density with the mass, centre of mass and moments of inertia "
            "of the answer; it need not look like the link."
        )
    if has_cad:
        text.append("Thin black ellipses and crosses are those of the description (CAD).")
    key = ""
    if told is not None and told.confidence is not None:
        text.append(
            "The area is coloured by what the mass rests on, the outline by the weakest of the moments of inertia, the "
            "dot by the weakest coordinate of the centre of mass; lines through it are intervals of coordinates that "
            "are measured or bounded."
        )
        key = f'<p class="key">{"".join(KEY.format(basis) for basis in ("measured", "bounded", "assumed"))}</p>'
    remarks = bullets(remarks_on_drawing(links, scene))
    shows = [("answer", "Answer", has_answer), ("cad", "CAD", has_cad), ("numbers", "Numbers", True)]
    boxes = "".join(
        f'<label><input type="checkbox" checked autocomplete="off" data-shows="{name}">{label}</label>'
        for name, label, is_there in shows
        if is_there
    )
    zoom = "".join(
        f'<button type="button" data-look="{name}" aria-label="{label}">{sign}</button>'
        for name, label, sign in (("+", "Larger", "+"), ("-", "Smaller", "−"))
    )
    items = "".join(f"<li>{_item(link)}</li>" for link in links)
    drawing = turnable(
        drawing_of_links(identification.model.robot, links),
        "the robot",
        f"{boxes}{LOOKS}{zoom}",
        f'<ol class="links-of-drawing" tabindex="0" aria-label="Links">{items}</ol>',
    )
    return Markup(f"<p>The robot with all joints at zero.</p>{key}{remarks}{drawing}<p>{escape(' '.join(text))}</p>")


def _item(link: DrawnLink) -> str:
    found = []
    if link.body is not None:
        basis = "" if link.rows is None or link.rows.mass.basis == "unknown" else link.rows.mass.basis
        badge = f' <span class="basis {basis}">{basis}</span>' if basis else ""
        found.append(f"{few_digits(link.body.mass)} kg{badge}")
    if not np.isnan(link.cad_mass):
        found.append(f"CAD {few_digits(link.cad_mass)} kg{', impossible' if link.cad_is_impossible else ''}")
    return (
        f'<button type="button" data-number="{link.number}" aria-pressed="false">'
        f'<span class="number-of-link">{link.number}</span><span>{escape(link.name)}</span>'
        f'<span class="what">{"; ".join(found) or "no mass"}</span></button>'
    )
