"""The names that users call: where they are, what they take, and that importing them is cheap."""

import importlib
import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import steelyard as sy

NAMES = (
    "BaseParameters",
    "CenterOfMassBox",
    "Coulomb",
    "Estimate",
    "FeasibleSet",
    "Identification",
    "Inertia",
    "Information",
    "InputError",
    "Joint",
    "Link",
    "Model",
    "MotorSide",
    "Offset",
    "Recording",
    "Robot",
    "RobotFile",
    "RotorInertia",
    "Samples",
    "Term",
    "TotalMass",
    "Verdict",
    "Viscous",
    "check",
    "correct",
    "design_excitation",
    "fit",
    "identify",
    "least_squares",
    "play",
    "simulate",
)
STUB = Path(sy.__file__).with_suffix(".pyi")
HEAVY = ("clarabel", "llvmlite", "lxml", "plotly", "polars", "rich", "scipy", "typer")


@pytest.mark.parametrize("name", NAMES)
def test_name_is_public(name: str) -> None:
    assert name in sy.__all__
    assert name in dir(sy)
    found = getattr(sy, name)
    assert callable(found)
    assert found.__module__.startswith("steelyard.")
    assert found.__doc__


# Names that most programs call stand at the top, what a specialist calls stands in its room, and what nobody calls in
# the file that defines it. A name above these bounds needs one that leaves.
@pytest.mark.parametrize(("package", "most"), [("steelyard", 48), ("steelyard.feasibility", 37)])
def test_few_names_are_public(package: str, most: int) -> None:
    assert len(importlib.import_module(package).__all__) <= most


def test_rooms_need_no_import_of_their_own() -> None:
    rooms = [line.split()[-1] for line in STUB.read_text(encoding="utf-8").splitlines() if line.startswith("from . ")]
    assert len(rooms) > 12
    assert set(rooms) <= set(dir(sy))
    assert not set(rooms) & set(sy.__all__)
    used = "; ".join(f"assert steelyard.{room}.__all__" for room in rooms)
    assert "steelyard" in _loaded_after(f"import steelyard; {used}")


def test_unknown_name_is_refused() -> None:
    with pytest.raises(AttributeError, match="no attribute 'Robott'"):
        _ = sy.Robott


@pytest.mark.parametrize(
    ("function", "expected"),
    [
        ("Robot.from_urdf", "path tip locked"),
        ("Robot.from_dh", "rows convention name gravity"),
        ("Robot.with_terms", "self terms"),
        ("MotorSide", "coupling"),
        ("Model", "robot"),
        ("Model.load", "path"),
        ("Model.inverse_dynamics", "self q dq ddq parameters"),
        ("Model.regressor", "self q dq ddq"),
        ("Model.inertia_matrix", "self q parameters"),
        ("Model.coriolis", "self q dq parameters"),
        ("Model.gravity", "self q parameters"),
        ("Model.drive_torque", "self dq ddq parameters"),
        ("Model.pose", "self q link"),
        ("Model.operation_count", "self function base"),
        ("Recording.read", "source"),
        ("Samples", "q dq ddq torque mask"),
        ("Information.from_samples", "model samples"),
        ("Information.relative_error", "self base"),
        ("least_squares", "info weights"),
        ("FeasibleSet", "model consistency constraints"),
        ("TotalMass", "maximum minimum equal"),
        ("CenterOfMassBox", "link lower upper"),
        ("check", "feasible_set base parameters"),
        ("correct", "feasible_set base parameters"),
        ("fit", "info feasible_set weights"),
        ("Estimate.write_urdf", "self source target"),
        ("Estimate.save", "self path"),
        ("Estimate.load", "path"),
        ("identify", "robot data validate"),
    ],
)
def test_arguments_come_in_the_published_order(function: str, expected: str) -> None:
    found: object = sy
    for part in function.split("."):
        found = getattr(found, part)
    assert callable(found)
    names = list(inspect.signature(found).parameters)
    assert names[: len(expected.split())] == expected.split()


@pytest.mark.parametrize(
    ("owner", "attributes"),
    [
        ("Robot", "joint_names link_names dof parameters"),
        ("Model", "parameter_names base_parameters"),
        ("BaseParameters", "count names expressions K Pb Pd"),
        ("Recording", "process"),
        ("Information", "condition_number save load from_factor __add__"),
    ],
)
def test_attributes_are_there(owner: str, attributes: str) -> None:
    cls = getattr(sy, owner)
    assert [name for name in attributes.split() if not hasattr(cls, name)] == []


def _loaded_after(statement: str) -> set[str]:
    command = f"import sys; {statement}; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", command], capture_output=True, text=True, check=True)
    return {name.partition(".")[0] for name in done.stdout.split()}


def test_import_leaves_heavy_libraries_alone() -> None:
    loaded = _loaded_after("import steelyard")
    assert "steelyard" in loaded
    assert loaded.isdisjoint(HEAVY)


def test_command_line_starts_without_heavy_libraries() -> None:
    assert _loaded_after("import steelyard.cli").isdisjoint(set(HEAVY) - {"typer", "rich"})
