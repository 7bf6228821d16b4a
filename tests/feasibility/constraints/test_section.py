"""The section [constraints] of robot.toml."""

import tomllib

import numpy as np
import pytest

from steelyard.dynamics import Model, Viscous
from steelyard.errors import InputError
from steelyard.feasibility import (
    CenterOfMassBox,
    CenterOfMassHull,
    CenterOfMassSphere,
    ConfidenceInterval,
    DensityInBox,
    DensityInEllipsoid,
    EqualLinks,
    FeasibleSet,
    LinearBound,
    MeasuredMass,
    SymmetricLink,
    TotalMass,
)
from steelyard.feasibility.constraints import constraints_from_dict
from steelyard.regression import Information, least_squares
from steelyard.robot import Robot

WHOLE = """
total_mass = { maximum = 27.0 }

[[measured_mass]]
links = ["link2"]
value = 3.2
standard_deviation = 0.05

[[linear_bound]]
expression = "Lyy1 + Lzz2"
minimum = 0.1

[[confidence_interval]]
expression = "beta2"
value = 0.31
standard_deviation = 0.004
deviations = 2

[[center_of_mass_box]]
link = "link1"
lower = [-0.1, -0.1, 0.0]
upper = [0.1, 0.1, 0.5]

[[center_of_mass_sphere]]
link = "link1"
center = [0, 0, 0.2]
radius = 0.3

[[center_of_mass_hull]]
link = "link2"
mesh = "meshes/link2.csv"
scale = 0.001
placement = { xyz = [0, 0, 0.1], rpy = [0, 0, 0] }

[[center_of_mass_hull]]
link = "link1"
points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]

[[density_in_box]]
link = "link1"
lower = [-1, -1, -1]
upper = [1, 1, 1]

[[density_in_ellipsoid]]
link = "link1"
center = [0, 0, 0]
semi_axes = [1, 1, 2]
rotation = [0, 0, 1.5]

[[symmetric_link]]
link = "link1"
plane = ["xz", [1, 0, 0]]

[[symmetric_link]]
link = "link2"
axis = "z"
order = 2
through = [0.1, 0, 0]

[[equal_links]]
first = "link1"
second = "link2"
mirror = "xz"
terms = ["Fvj"]
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "meshes").mkdir()
    corners = 100 * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    np.savetxt(tmp_path / "meshes" / "link2.csv", corners, delimiter=",")
    return tmp_path


@pytest.fixture(scope="module")
def model():
    return Model(Robot.from_dh([("0", 0.5, 0.0, "q"), ("pi/2", 0.5, 0.0, "q")]).with_terms(Viscous()))


def test_every_kind_is_read(folder, model):
    found = constraints_from_dict(tomllib.loads(WHOLE), folder)
    mesh = CenterOfMassHull.from_mesh("link2", folder / "meshes" / "link2.csv", 0.001, {"xyz": (0, 0, 0.1)})
    assert found == (
        TotalMass(maximum=27.0),
        MeasuredMass(3.2, ["link2"], 0.05),
        LinearBound("Lyy1 + Lzz2", minimum=0.1),
        ConfidenceInterval("beta2", 0.31, 0.004, 2),
        CenterOfMassBox("link1", (-0.1, -0.1, 0.0), (0.1, 0.1, 0.5)),
        CenterOfMassSphere("link1", (0, 0, 0.2), 0.3),
        mesh,
        CenterOfMassHull("link1", [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]),
        DensityInBox("link1", (-1, -1, -1), (1, 1, 1)),
        DensityInEllipsoid("link1", (0, 0, 0), (1, 1, 2), (0, 0, 1.5)),
        SymmetricLink("link1", plane=("xz", (1, 0, 0))),
        SymmetricLink("link2", axis="z", order=2, through=(0.1, 0, 0)),
        EqualLinks("link1", "link2", mirror="xz", terms=("Fvj",)),
    )
    assert mesh.points[0] == pytest.approx((-0.1, -0.1, 0.0))
    names = [block.name for block in FeasibleSet(model, constraints=found).blocks]
    assert len(set(names)) == len(names)


def test_one_table_or_a_list_of_them():
    assert constraints_from_dict({"total_mass": {"maximum": 27.0}}) == (TotalMass(maximum=27.0),)
    assert constraints_from_dict({"total_mass": [{"maximum": 27.0}]}) == (TotalMass(maximum=27.0),)
    assert constraints_from_dict({}) == ()


def test_intervals_of_a_saved_estimate(tmp_path, model):
    count = model.base_parameters().count
    base = model.base_parameters()
    information = Information.from_factor(np.eye(count), np.arange(count), 0.1, 90, base.expressions)
    least_squares(information).save(tmp_path / "estimate.json")
    section = {"confidence_interval": {"estimate": "estimate.json", "deviations": 4}}
    found = constraints_from_dict(section, tmp_path)
    assert [interval.value for interval in found] == pytest.approx(list(range(count)))
    assert {interval.deviations for interval in found} == {4.0}
    assert len(FeasibleSet(model, constraints=found).blocks) == 4 + 2 * count
    section["confidence_interval"]["combinations"] = ["beta1 + beta2"]
    assert [interval.value for interval in constraints_from_dict(section, tmp_path)] == pytest.approx([1.0])


@pytest.mark.parametrize(
    ("section", "message"),
    [
        ({"totalmass": {}}, 'did you mean "total_mass"'),
        ({"total_mass": {"maximun": 3.0}}, 'did you mean "maximum"'),
        ({"total_mass": 27.0}, "must be a table"),
        ({"center_of_mass_box": [{"link": "a", "lower": [0, 0, 0]}]}, "lacks 'upper'; give link, lower and upper"),
        ({"measured_mass": {"links": "a"}}, "lacks 'value'; give value"),
        ({"linear_bound": {"expression": "m1"}}, "needs a finite bound"),
        ({"linear_bound": {"expression": "m1 m2", "equal": 2}}, "expression of LinearBound 'm1 m2' cannot be read"),
        ({"linear_bound": {"minimum": 2}}, "lacks 'expression'"),
        ({"center_of_mass_hull": {"link": "a"}}, "either points or mesh"),
        ({"center_of_mass_hull": {"link": "a", "mesh": 3}}, "mesh must be a path, got 3"),
        ({"center_of_mass_hull": {"link": "a", "mesh": "none.stl"}}, "none.stl: cannot be read"),
        ({"center_of_mass_hull": {"link": "a", "points": [[0, 0, 0]], "scale": 2}}, "takes scale with a mesh only"),
        ({"confidence_interval": {"expression": "m1", "value": 1}}, "lacks 'standard_deviation'"),
        ({"confidence_interval": {"estimate": 3}}, "estimate must be a path, got 3"),
        ({"confidence_interval": {"estimate": "none.json", "value": 3}}, "'value' is not known here"),
        ({"confidence_interval": {"estimate": "a", "combinations": "beta1"}}, "combinations must be a list of texts"),
        ({"symmetric_link": {"link": "a", "plain": "xz"}}, 'did you mean "plane"'),
        ({"equal_links": {"first": "a"}}, "lacks 'second'; give first and second"),
        ({"density_in_box": {"link": "a", "lower": 1, "upper": 2}}, "must be three numbers"),
    ],
)
def test_impossible_sections_are_refused(section, message, tmp_path):
    with pytest.raises(InputError, match=message):
        constraints_from_dict(section, tmp_path)
