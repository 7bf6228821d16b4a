"""The folder of a simulation: its samples, a record of how it ended, and a page of figures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from steelyard.files import replaced_folder, write_json, write_text
from steelyard.identification.simulated import FileSimulation

from .charts import Chart, Curve, charts_markup, motion_charts
from .html_document import Markup, Section, escape, html_document, table
from .sections import hashed_file, versions

__all__ = ["SIMULATION_FILES", "save_simulation", "simulation_html"]

FORMAT = "steelyard-simulation-1"
SIMULATION_FILES = ("simulation.csv", "simulation.json", "simulation.html")
_LIBRARIES = ("numpy", "scipy", "llvmlite", "polars")


def save_simulation(simulation: FileSimulation, folder: Path) -> tuple[Path, ...]:
    """Write ``simulation.csv``, ``simulation.json`` and ``simulation.html``.

    They appear together, see :func:`steelyard.files.replaced_folder`.

    Parameters
    ----------
    folder : Path
        Made where it is missing; files of the same names are replaced.

    Returns
    -------
    tuple of Path
        The files.

    Raises
    ------
    InputError
        If the folder cannot be written.
    """
    with replaced_folder(folder, record="simulation.json") as made:
        table, record, page = (made / name for name in SIMULATION_FILES)
        simulation.result.save(table)
        write_json(simulation_record(simulation), record)
        write_text(simulation_html(simulation), page)
    return tuple(folder / name for name in sorted(SIMULATION_FILES))


def simulation_record(simulation: FileSimulation) -> dict[str, Any]:
    """Return how it ended, inputs with hashes, versions and options: what is needed to run it again."""
    result = simulation.result
    return {
        "format": FORMAT,
        "status": str(result.status),
        "end_time": result.end_time,
        "message": result.message,
        "final_position": result.final_q.tolist(),
        "final_velocity": result.final_dq.tolist(),
        "parameters": simulation.parameters,
        "inputs": [hashed_file(path) for path in simulation.inputs],
        "options": simulation.options,
        "versions": versions(_LIBRARIES),
    }


def simulation_html(simulation: FileSimulation) -> str:
    """Return the page: how it ended, joints and energy over time, provenance."""
    result, robot = simulation.result, simulation.model.robot
    unit, effort = (" or ".join(dict.fromkeys(units)) for units in (robot.position_units, robot.torque_units))

    motion = motion_charts(result, unit, f"{unit} per s", effort)
    energy = Chart(
        "Energy",
        "time, s",
        "J",
        (
            Curve("total", result.t, result.energy),
            Curve("kinetic", result.t, result.kinetic_energy),
            Curve("potential", result.t, result.potential_energy),
            Curve("dissipated", result.t, result.dissipated, "dashed"),
        ),
    )
    ending = f"{result.status} at {result.end_time:.6g} s" + (f": {result.message}" if result.message else "")
    lead = Markup(f"<p>{escape(ending)}.</p><p>Parameters of {escape(simulation.parameters)}.</p>")
    record = simulation_record(simulation)
    rows = [(key, "" if value is None else str(value)) for key, value in simulation.options.items()]
    rows += [(entry["path"], entry["sha256"]) for entry in record["inputs"]]
    rows += [(name, version) for name, version in record["versions"].items()]
    sections = [
        Section("motion", "Joints", charts_markup(motion, identifier="joints")),
        Section("energy", "Energy", charts_markup([energy], identifier="energy-chart")),
        Section("extent", "Extent of the motion", _extent(simulation)),
        Section(
            "sources", "Provenance", table("Options, inputs, versions", ("", ""), rows, identifier="run", texts=(1,))
        ),
    ]
    title = f"{robot.name}: simulation"
    return html_document(title, "Steelyard simulation", robot.name, lead, sections, scripts=("charts.js",))


def _extent(simulation: FileSimulation) -> Markup:
    result = simulation.result
    rows = [
        (
            name,
            f"{result.q[:, k].min():.4g}",
            f"{result.q[:, k].max():.4g}",
            f"{np.abs(result.dq[:, k]).max():.4g}",
            f"{np.abs(result.torque[:, k]).max():.4g}",
        )
        for k, name in enumerate(result.joint_names)
    ]
    columns = ("joint", "least position", "greatest position", "greatest speed", "greatest torque")
    return table("SI units", columns, rows, identifier="extent-table")
