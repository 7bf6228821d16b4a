"""The report: one HTML file that needs nothing else, neither a server nor the network."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from steelyard.files import write_text
from steelyard.identification import Identification

from . import answer_sections as answer
from . import sections
from .drive_sections import elastic_joints, friction
from .excitation_section import excitation
from .head import head, remarks
from .html_document import Markup, Section, html_document
from .impossible_section import impossible
from .proof import PROOF_SCRIPTS, proof
from .robot_section import robot
from .torque_section import TORQUE_SCRIPTS, sources, torques

__all__ = ["report_html", "write_report"]

_SECTIONS: tuple[tuple[str, str, Callable[[Identification], Markup]], ...] = (
    ("robot", "The robot", robot),
    ("prediction", "Does it predict?", answer.prediction),
    ("remarks", "Remarks", remarks),
    ("rests-on", "What each number rests on", answer.parameters),
    ("elastic", "Elastic joints", elastic_joints),
    ("torques", "Measured and predicted torques", torques),
    ("parts", "Where the torque comes from", sources),
    ("excitation", "What the motion shows", excitation),
    ("beforehand", "What is known beforehand", answer.prior),
    ("price", "The price of plausibility", answer.price),
    ("errors", "Errors of each log", sections.errors),
    ("impossible", "What was impossible", impossible),
    ("proof", "The proof, verified here", proof),
    ("base", "Base parameters", sections.base_parameters),
    ("joint-parameters", "Joint friction", sections.joints),
    ("friction", "How the friction was chosen", friction),
    ("columns", "Columns of the logs", sections.columns),
    ("processing", "Processing of the logs", sections.processing),
    ("sources", "Provenance", sections.provenance),
)


def report_html(identification: Identification) -> str:
    """Return the report on an identification, an HTML document without references to anything outside.

    The same identification gives the same text, as long as the versions that it names are the same.

    Parameters
    ----------
    identification : Identification
        What :func:`steelyard.identify` returned.

    Examples
    --------
    A pendulum without a mass, driven by the torque of a spring, with its report and two pictures:

    >>> import tempfile
    >>> from pathlib import Path
    >>> import numpy as np
    >>> import steelyard as sy
    >>> urdf = (
    ...     '<robot name="pendulum"><link name="base"/><link name="rod"/><joint name="pivot" type="continuous">'
    ...     '<parent link="base"/><child link="rod"/><axis xyz="0 1 0"/></joint></robot>'
    ... )
    >>> t = np.arange(500) / 50
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     robot, log = Path(folder, "pendulum.urdf"), Path(folder, "log.csv")
    ...     _ = robot.write_text(urdf)
    ...     _ = sy.Recording(t=t, q=np.sin(t)[:, None], torque=np.sin(t)[:, None], source="log").save(log)
    ...     result = sy.identify(robot, [log])
    >>> "The answer can exist" in report_html(result)
    True
    >>> "An impossible robot" in sy.report.torque_svg(result), "<title>1 rod: " in sy.report.robot_svg(result)
    (True, True)
    """
    # Of what was reduced before nothing is known of single logs.
    empty = () if identification.predictions else ("errors", "columns", "processing")
    parts = [
        Section(key, title, text)
        for key, title, write in _SECTIONS
        if key not in empty and (text := write(identification))
    ]
    name = identification.model.robot.name
    return html_document(
        f"{name}: identified parameters",
        "Steelyard identification report",
        name,
        head(identification),
        parts,
        plain_scripts=("page.js", "drawing.js", *PROOF_SCRIPTS),
        styles=("drawing.css", "charts.css"),
        scripts=(*TORQUE_SCRIPTS, *(["charts.js"] if answer.has_price(identification) else [])),
    )


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
    write_text(report_html(identification), target)
