"""What numbers rest on, against the truth of a simulated arm and against closed forms."""

import csv
import importlib
import io
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from simulated_arm import MASSES, SimulatedArm, blurred, simulated_arm

import steelyard as sy
from steelyard.dynamics import ByJoint, Coulomb, Model, PolynomialFriction, RotorInertia, Stribeck, Viscous
from steelyard.errors import InputError
from steelyard.estimators import EntropicPrior, proved_estimate
from steelyard.estimators.cross_validation import cross_validation, term_deviations
from steelyard.feasibility import DensityInBox, FeasibleSet, LinearBound, MeasuredMass, TotalMass
from steelyard.identification.parameter_table import LinkRows, ParameterRow, ParameterTable, parameter_table
from steelyard.recording import Samples
from steelyard.regression.drift import friction_drifts
from steelyard.regression.reduction import empty_factors
from steelyard.regression.time_blocks import TimeBlocks
from steelyard.robot import Robot


def table_of(arm: SimulatedArm, seed: int) -> tuple[ParameterTable, FeasibleSet]:
    boxes = [DensityInBox(f"link{k}", [-0.6] * 3, [0.6] * 3) for k in (1, 2, 3)]
    feasible_set = FeasibleSet(arm.model, constraints=[*boxes, TotalMass(maximum=60.0)])
    cad = blurred(arm, seed)
    scales = term_deviations(arm.information, feasible_set)
    prior = EntropicPrior(cad, term_deviations=scales)
    weight = cross_validation(arm.information, arm.stretches, feasible_set, prior).weight
    estimate = sy.fit(arm.information, feasible_set, prior=prior, prior_weight=weight)
    unconstrained = sy.least_squares(arm.information)
    table = parameter_table(arm.information, feasible_set, estimate, unconstrained, cad=cad, term_scales=scales)
    return table, feasible_set


@pytest.fixture(scope="module")
def found() -> tuple[SimulatedArm, ParameterTable]:
    arm = simulated_arm(3)
    return arm, table_of(arm, 3)[0]


def true_values(arm: SimulatedArm, table: ParameterTable) -> dict[str, float]:
    """Of standard parameters, masses and centres of mass, from the parameters themselves."""
    names = list(arm.model.parameter_names)
    values = dict(zip(names, arm.truth, strict=True))
    values["total mass"] = sum(MASSES)
    for link in (1, 2, 3):
        for axis in "xyz":
            values[f"c{axis}{link}"] = values[f"l{axis}{link}"] / values[f"m{link}"]
    return {row.name: values[row.name] for row in table if row.name in values}


def test_every_number_is_there(found) -> None:
    arm, table = found
    names = {row.name for row in table}
    assert names >= {*arm.model.parameter_names, "total mass", "cx1", "cz3", "J1_1", "J3_3"}
    assert len(table) == len(names) == 39 + 1 + 9 + 9
    assert table.count("measured") + table.count("bounded") + table.count("assumed") == len(table)


def test_friction_is_measured_and_the_mass_on_a_vertical_axis_is_assumed(found) -> None:
    _, table = found
    assert all(table[f"Fcj{joint}"].basis == "measured" for joint in (1, 2, 3))
    assert table["m1"].basis == "assumed"
    # One torque offset along gravity and first moments cannot be told apart here: no interval that is narrow.
    assert table["m2"].basis == "assumed"


def test_values_lie_in_their_intervals(found) -> None:
    _, table = found
    for row in table:
        assert row.lower <= row.value <= row.upper, row.name
        assert row.lower >= 0.0 or row.name[0] != "m"


def test_measured_ones_are_as_narrow_as_the_data_allows(found) -> None:
    """The half-width is at most twice that of least squares (Cramér and Rao)."""
    arm, table = found
    deviations = dict(zip(arm.information.base_names, sy.least_squares(arm.information).standard_error, strict=True))
    rows = [row for row in table if row.basis == "measured" and row.name in deviations]
    assert len(rows) >= 6
    for row in rows:
        if list(arm.feasible_set.K[arm.information.base_names.index(row.name)] != 0).count(True) == 1:
            assert 0.5 * (row.upper - row.lower) <= 2.0 * 1.96 * deviations[row.name]


def test_description_stands_beside(found) -> None:
    arm, table = found
    cad = blurred(arm, 3)
    names = list(arm.model.parameter_names)
    assert table["m2"].cad == cad[names.index("m2")]
    assert table["cx2"].cad == pytest.approx(arm.truth[names.index("lx2")] / arm.truth[names.index("m2")])
    assert np.isnan(table["Fvj1"].cad)
    # Boxes of 0.3 m by 0.1 m by 0.1 m: the moments about the centre of mass, scaled with the blurred mass.
    mass = cad[names.index("m3")]
    assert table["J1_3"].cad == pytest.approx(mass * 0.02 / 12)
    assert table["J3_3"].cad == pytest.approx(mass * 0.10 / 12)


def test_combinations_are_named(found) -> None:
    _, table = found
    sums, rotors = table.sentences
    assert "only the sum is measured" in sums
    assert "m2" in sums
    assert "where no rotor turns with a joint" in rotors  # the model has none


def test_what_the_prior_draws_out_of_its_interval_is_not_measured(found) -> None:
    """With all weight on links three times as heavy, least squares contradict what they alone would tell.

    The intervals hold the true values nevertheless, since they are those of data and physics, and not the answer.
    """
    arm, _ = found
    unconstrained = sy.least_squares(arm.information)
    prior = EntropicPrior(3.0 * blurred(arm, 3))
    estimate = sy.fit(arm.information, arm.feasible_set, prior=prior, prior_weight=1e8)
    table = parameter_table(arm.information, arm.feasible_set, estimate, unconstrained)
    error = dict(zip(unconstrained.base_expressions, unconstrained.standard_error, strict=True))
    value = dict(zip(unconstrained.base_expressions, unconstrained.base, strict=True))
    far = [row for row in table if row.name in value and abs(row.value - value[row.name]) > 6.0 * error[row.name]]
    assert len(far) >= 3
    assert "measured" not in {row.basis for row in far}
    told = table.conflict
    assert re.search(r"\(link1.*\) lie outside their intervals: the prior draws the answer that far away", told)
    assert "check the description of link1" in told
    truth = true_values(arm, table)
    assert all(not row.lower <= row.value <= row.upper for row in far)
    assert all(row.interval.startswith("outside its interval of ") for row in far)
    assert np.mean([row.lower <= truth[row.name] <= row.upper for row in far]) >= 0.9
    assert np.mean([table[name].lower <= one <= table[name].upper for name, one in truth.items()]) >= 0.93


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(8))
def test_no_value_is_silently_outside_its_interval(seed) -> None:
    """Whatever the prior says, and however much it counts, short logs of random arms too."""
    arm = simulated_arm(seed, seconds=(2.0, 10.0)[seed % 2])
    feasible_set = FeasibleSet(arm.model, constraints=[TotalMass(maximum=(11.6, 60.0)[seed % 2])])
    random = np.random.default_rng(seed)
    prior = EntropicPrior(np.exp(random.normal()) * blurred(arm, seed))
    unconstrained = sy.least_squares(arm.information)
    said = []
    for weight in (1e-2, 1e2, 1e6):
        estimate = sy.fit(arm.information, feasible_set, prior=prior, prior_weight=weight)
        table = parameter_table(arm.information, feasible_set, estimate, unconstrained)
        rows = list(csv.DictReader(io.StringIO(table.to_csv())))
        outside = [row["name"] for row in rows if not float(row["lower"]) <= float(row["value"]) <= float(row["upper"])]
        count = re.match(r"\w+(?:, \w+)*(?: and (\d+) more)?", table.conflict)
        named = re.findall(r"\w+", table.conflict.partition(" (")[0].partition(" and ")[0].partition(" lie")[0])
        assert named == outside[: len(named)]
        assert len(outside) == (len(named) + int(count[1] or 0) if count else 0)
        by_chance = 0.05 * len(rows)  # of intervals of 95 %
        assert ("by chance" in table.conflict) == (0 < len(outside) <= by_chance)
        assert ("--prior-weight" in table.conflict) == (len(outside) > by_chance)
        assert [", outside" in line for line in str(table).splitlines()[1:]].count(True) == len(outside)
        links = [link for link in (1, 2, 3) if re.search(rf"m{link}|c[xyz]{link}", " ".join(outside))]
        _, shown = table.link_table()
        assert all(any("outside" in cell for cell in shown[link - 1]) for link in links)
        said.append(len(outside))
    assert said[0] <= said[-1]


def test_table_as_text_and_data(found) -> None:
    _, table = found
    lines = str(table).splitlines()
    assert lines[0].split() == ["name", "value", "from", "to", "CAD", "unit", "rests", "on", "meaning"]
    rows = list(csv.DictReader(io.StringIO(table.to_csv())))
    assert [row["name"] for row in rows] == [row.name for row in table]
    assert float(rows[9]["value"]) == table["m1"].value
    assert rows[10]["cad"] == ""
    data = json.loads(json.dumps(table.to_list(), allow_nan=False))
    assert data[9]["basis"] == "assumed"
    assert "<table>" in table._repr_html_()
    with pytest.raises(InputError, match="did you mean"):
        table["Fvj9"]


def test_still_joint_is_said() -> None:
    arm = simulated_arm(4, still=(2,))
    table, _ = table_of(arm, 4)
    assert any("do not show" in sentence for sentence in table.sentences)
    assert table["Fvj3"].basis == "assumed"
    assert table["Fvj1"].basis == "measured"


@pytest.mark.parametrize("still", [False, True])
def test_friction_at_rest_is_no_offset_that_was_measured(still) -> None:
    """Where the third joint stands still, 0.4 N·m of friction hold a part of its load."""
    arm = simulated_arm(4, still=(2,) * still)
    truth = dict(zip(arm.model.parameter_names, arm.truth, strict=True))
    held = replace(arm.samples, torque=arm.samples.torque - [0.0, 0.0, 0.4 * still])
    info, feasible_set = sy.Information.from_samples(arm.model, held), FeasibleSet(arm.model)
    table = parameter_table(info, feasible_set, sy.fit(info, feasible_set), sy.least_squares(info))
    for joint in (1, 2, 3):
        row = table[f"Foj{joint}"]
        assert row.lower <= truth[row.name] <= row.upper
        assert (row.basis == "assumed" and np.isinf([row.lower, row.upper]).all()) == (still and joint == 3)
    told = [sentence for sentence in table.sentences if "friction of joints that stand still" in sentence]
    assert [sentence.split()[0] for sentence in told] == ["Foj3"] * still


PAN_TILT = """<robot name="pan_tilt"><link name="base"/>
<link name="yoke"><inertial><origin xyz="0.01 0.02 -0.01"/><mass value="0.8"/>
  <inertia ixx="2e-3" ixy="1e-4" ixz="-2e-4" iyy="3e-3" iyz="2e-4" izz="2.5e-3"/></inertial></link>
<joint name="pan" type="revolute"><parent link="base"/><child link="yoke"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="9" velocity="3"/></joint>
<link name="head"><inertial><origin xyz="0.03 -0.02 0.015"/><mass value="0.4"/>
  <inertia ixx="6e-4" ixy="5e-5" ixz="-4e-5" iyy="8e-4" iyz="3e-5" izz="7e-4"/></inertial></link>
<joint name="tilt" type="revolute"><parent link="yoke"/><child link="head"/><origin xyz="0 0 .1"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="9" velocity="3"/></joint></robot>"""


@pytest.mark.parametrize(("stated", "tilting"), [(False, 5e-4), (False, 3e-3), (True, 5e-4)])
def test_an_inertia_that_may_hold_a_rotor_is_not_measured(stated, tilting, tmp_path) -> None:
    """Torques by Pinocchio, and a rotor at either joint that no motion tells apart from the links.

    As heavy as the second one, it made two other moments of the head larger than they are: no body has one moment that
    is larger than the two others together.
    """
    pinocchio = pytest.importorskip("pinocchio")
    (tmp_path / "robot.urdf").write_text(PAN_TILT)
    oracle = pinocchio.buildModelFromXML(PAN_TILT)
    data, rotors = oracle.createData(), np.array([1e-3, tilting])
    random = np.random.default_rng(17)
    q, dq, ddq = random.uniform(-1.0, 1.0, (3, 400, 2)) * np.array([1.0, 3.0, 10.0])[:, None, None]
    torque = np.array([pinocchio.rnea(oracle, data, *row) for row in zip(q, dq, ddq, strict=True)]) + rotors * ddq
    torque += 1e-4 * random.normal(size=torque.shape)
    robot = Robot.from_urdf(tmp_path / "robot.urdf")
    model = Model(robot.with_terms(*[RotorInertia()] * stated))
    known = [LinearBound("Ia1", equal=rotors[0]), LinearBound("Ia2", equal=rotors[1])]
    feasible_set = FeasibleSet(model, constraints=known * stated)
    samples = Samples(q=q, dq=dq, ddq=ddq, torque=torque, t=0.01 * np.arange(400))
    info = sy.Information.from_chunks(model, [samples])
    table = parameter_table(info, feasible_set, sy.fit(info, feasible_set), sy.least_squares(info))
    truth = dict(zip(Model(robot).parameter_names, robot.parameters, strict=True))
    outside = [name for name, value in truth.items() if not table[name].lower <= value <= table[name].upper]
    assert len(outside) <= 0.05 * len(truth)  # intervals of 95 %
    assert not {"Lxx2", "Lyy2", "Lzz2"} & set(outside)
    assert sum(row.basis == "measured" and row.name in truth for row in table) >= 5
    if tilting > 1e-3:
        return
    # Sums that are told as measured are sums of what is there: links of the oracle and the rotors that were added.
    (sums,) = (one.partition("themselves: ")[2] for one in table.sentences if one.startswith("Of these only the sum"))
    there = truth | {"Ia1": rotors[0], "Ia2": rotors[1]}
    told_sums = re.findall(r"([^;(]+) \(([-\de.]+) ± ([-\de.]+)\)", sums)
    assert any("Ia1" in expression for expression, *_ in told_sums)
    for expression, value, error in told_sums:  # within three standard errors
        assert eval(expression.strip(), dict(there)) == pytest.approx(float(value), abs=1.5 * float(error))
    told = [sentence for sentence in table.sentences if "inertia of a rotor at tilt (Ia2)" in sentence]
    width = table["Lyy2"].upper - table["Lyy2"].lower
    if stated:
        assert not told
        assert width < 0.01 * truth["Lyy2"]
    else:
        assert len(told) == 1
        assert told[0].startswith("Lyy2 would hold")
        assert table["Lyy2"].basis == "assumed"
        assert table["Lyy2"].value == pytest.approx(truth["Lyy2"] + rotors[1], rel=0.01)


GANTRY = """<robot name="gantry"><link name="base"/>
<link name="bridge"><inertial><mass value="8"/>
  <inertia ixx=".1" ixy="0" ixz="0" iyy=".1" iyz="0" izz=".1"/></inertial></link>
<joint name="along" type="prismatic"><parent link="base"/><child link="bridge"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" effort="9" velocity="3"/></joint>
<link name="lift"><inertial><mass value="3"/>
  <inertia ixx=".1" ixy="0" ixz="0" iyy=".1" iyz="0" izz=".1"/></inertial></link>
<joint name="up" type="prismatic"><parent link="bridge"/><child link="lift"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="9" velocity="3"/></joint></robot>"""


@pytest.fixture
def gantry(tmp_path) -> tuple[Model, sy.Information]:
    """The model of a gantry, and data by hand."""
    (tmp_path / "robot.urdf").write_text(GANTRY)
    model, random = Model(Robot.from_urdf(tmp_path / "robot.urdf")), np.random.default_rng(5)
    q, dq, ddq = random.uniform(-1.0, 1.0, (3, 400, 2))
    torque = np.column_stack([(8.0 + 3.0) * ddq[:, 0], 3.0 * (ddq[:, 1] + 9.81)]) + 0.01 * random.normal(size=q.shape)
    info = sy.Information.from_samples(model, Samples(q=q, dq=dq, ddq=ddq, torque=torque))
    return model, info


def test_all_links_weigh_what_each_of_them_does_at_least(gantry) -> None:
    """Gravity weighs the lift alone; a rotor at the bridge may hold all that the bridge seems to weigh."""
    model, info = gantry
    feasible_set = FeasibleSet(model)
    table = parameter_table(info, feasible_set, sy.fit(info, feasible_set), sy.least_squares(info))
    assert table["m2"].lower == pytest.approx(3.0, abs=0.01)
    assert table["m1"].lower == 0.0
    assert table["total mass"].lower == table["m2"].lower
    assert table["total mass"].upper == pytest.approx(11.0, abs=0.01)


def test_a_mass_that_is_stated_is_that_and_in_no_conflict(gantry) -> None:
    """It lay "outside its interval of 11 to 11 kg", and that of a link was assumed, since a rotor might hold it."""
    model, info = gantry
    for stated, name in ((TotalMass(equal=10.99), "total mass"), (MeasuredMass(7.99, links=["bridge"]), "m1")):
        feasible_set = FeasibleSet(model, constraints=[stated])
        table = parameter_table(info, feasible_set, sy.fit(info, feasible_set), sy.least_squares(info))
        row = table[name]
        assert not row.is_outside
        assert (row.lower, row.upper) == pytest.approx((row.value, row.value), abs=1e-6)
        assert row.basis == "bounded"
        assert not table.conflict


@pytest.mark.slow
@pytest.mark.parametrize("has_rotors", [False, True])
def test_moments_that_a_rotor_would_make_others_are_named(has_rotors, example, tmp_path) -> None:
    """The joints of the SO-101 have rotors; a model without them told two moments of its second link wrongly."""
    folder = example("so101")
    text = (folder / "robot.toml").read_text()
    term = '[[terms]]\nkind = "rotor_inertia"\n'
    assert term in text
    (tmp_path / "robot.urdf").write_bytes((folder / "robot.urdf").read_bytes())
    (tmp_path / "robot.toml").write_text(text if has_rotors else text.replace(term, ""))
    table = sy.identify(tmp_path / "robot.toml", folder / "train.csv").parameters
    told = sy.Estimate.load(folder / "truth.json")
    truth = dict(zip(told.parameter_names, told.parameters, strict=True))
    moments = [row for row in table if row.name[:3] in ("Lxx", "Lyy", "Lzz") and row.basis in ("measured", "bounded")]
    wrong = [row.name for row in moments if not row.lower <= truth[row.name] <= row.upper]
    sentences = [one for one in table.sentences if "where no rotor turns with a joint" in one]
    assert len(sentences) == len(moments[:1])
    assert bool(moments) == (not has_rotors)
    assert not wrong
    assert all(set(re.findall(r"L\w\w\d", one)) <= {row.name for row in moments} for one in sentences)


RAILS = """<robot name="rails"><link name="base"/>
<link name="bridge"><inertial><mass value="5"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
</link><joint name="x" type="prismatic"><parent link="base"/><child link="bridge"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" effort="9" velocity="3"/></joint>
<link name="carriage"><inertial><mass value="2"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
</link><joint name="y" type="prismatic"><parent link="bridge"/><child link="carriage"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="9" velocity="3"/></joint></robot>"""


def test_no_link_may_be_heavier_than_all_together(tmp_path) -> None:
    """Two rails in a plane: 6 kg and 2 kg of them are all that the forces show, be it links or rotors."""
    (tmp_path / "rails.urdf").write_text(RAILS)
    model = Model(Robot.from_urdf(tmp_path / "rails.urdf"))
    random = np.random.default_rng(3)
    q, dq, ddq = random.uniform(-1.0, 1.0, (3, 400, 2))
    force = np.array([6.0, 2.0]) * ddq + 1e-3 * random.normal(size=q.shape)
    info = sy.Information.from_samples(model, Samples(q=q, dq=dq, ddq=ddq, torque=force, t=0.01 * np.arange(400)))
    feasible_set = FeasibleSet(model)
    table = parameter_table(info, feasible_set, sy.fit(info, feasible_set), sy.least_squares(info))
    assert table["total mass"].upper == pytest.approx(6.0, abs=0.01)
    for name, heaviest in (("m1", 6.0), ("m2", 2.0)):
        assert table[name].lower == 0.0  # all of it may be a rotor
        assert heaviest <= table[name].upper <= 6.01


def test_friction_that_drifts_has_an_interval_from_begin_to_end() -> None:
    """Coulomb friction falls from 1.3 to 0.7 of its mean, which the rows of the log as a whole tell to a percent."""
    arm = simulated_arm(6, seconds=60.0)
    mean = dict(zip(arm.model.parameter_names, arm.truth, strict=True))["Fcj2"]
    change = np.zeros_like(arm.samples.torque)
    change[:, 1] = np.linspace(0.3, -0.3, len(change)) * mean * np.sign(arm.samples.dq[:, 1])
    blocks = TimeBlocks(empty_factors(arm.model))
    samples = replace(arm.samples, torque=arm.samples.torque + change)
    info = sy.Information.from_chunks(arm.model, [samples], blocks=blocks)
    drifts = friction_drifts(blocks, arm.model.base_parameters().names)
    feasible_set = FeasibleSet(arm.model)
    tables = [
        parameter_table(info, feasible_set, sy.fit(info, feasible_set), sy.least_squares(info), drifts=found)
        for found in ((), drifts)
    ]
    assert [table["Fcj2"].basis for table in tables] == ["measured", "bounded"]
    assert tables[1]["Fcj2"].lower < 0.75 * mean < 1.25 * mean < tables[1]["Fcj2"].upper
    assert repr(tables[0]["Fcj3"]) == repr(tables[1]["Fcj3"])
    assert any("Fcj2 change in the course" in sentence for sentence in tables[1].sentences)


@pytest.mark.slow
def test_intervals_hold_the_truth() -> None:
    inside = []
    for seed in range(30):
        arm = simulated_arm(200 + seed, size=(0.3, 0.8)[seed % 2])
        table, _ = table_of(arm, seed)
        truth = true_values(arm, table)
        inside.append([table[name].lower <= value <= table[name].upper for name, value in truth.items()])
    assert np.mean(inside) >= 0.93


def test_large_robots_have_the_intervals_of_least_squares(found, monkeypatch) -> None:
    arm, table = found
    module = importlib.import_module("steelyard.identification.parameter_table")
    monkeypatch.setattr(module, "MANY_PARAMETERS", 30)
    large, _ = table_of(arm, 3)
    least_squares = sy.least_squares(arm.information)
    index = least_squares.base_expressions.index("Fvj1")
    ends = least_squares.base[index] + np.array([-1.96, 1.96]) * least_squares.standard_error[index]
    assert [large["Fvj1"].lower, large["Fvj1"].upper] == pytest.approx(ends, abs=2e-4)
    assert large["m1"].upper == np.inf
    assert large["m1"].lower == 0.0
    assert large["m1"].basis == "assumed"
    assert "of the data alone" in large.sentences[0]
    assert large["Fvj1"].basis == table["Fvj1"].basis == "measured"


def test_rounding_is_no_number_of_a_link(found) -> None:
    """A solver's zero is 0 in what is proved and written; 1e-9 of the size of a link is a number."""
    arm, _ = found
    symmetric = arm.truth.copy()
    for columns in arm.model.link_columns:
        symmetric[columns] = [0.02, 0.0, 0.0, 0.1, 0.0, 0.1, 0.0, 0.0, 0.0, 2.0]
    names = list(arm.model.parameter_names)
    given = symmetric.copy()
    given[[names.index("Lxy1"), names.index("lx2"), names.index("Lyz3")]] = 1e-49, -1e-17, 1e-10
    symmetric[names.index("Lyz3")] = 1e-10
    estimate = proved_estimate(arm.information, arm.feasible_set, given, "a solver")
    assert np.array_equal(estimate.parameters, symmetric)
    assert estimate.certificate["proof"]["parameters"][names.index("Lxy1")] == "0"


def test_values_are_shown_as_far_as_their_intervals_resolve_them() -> None:
    row = ParameterRow("Lxy6", "moment of inertia xy of link_6", "kg m²", 4.1e-11, -0.0022, 0.0021, 0.0, "assumed")
    assert " 0 " in str(ParameterTable((row,))).splitlines()[1]
    assert repr(row).startswith("ParameterRow(Lxy6 = 0 kg m²")
    assert "4.1e-11" in ParameterTable((row,)).to_csv()
    # Nothing is known of how far an open interval resolves.
    assert "4.1e-11" in str(ParameterTable((replace(row, upper=np.inf),)))
    assert "4.1e-11" in str(ParameterTable((replace(row, value=4.1e-11, lower=4.0e-11, upper=4.2e-11),)))


def test_rows_and_links_are_printed_in_a_line():
    row = ParameterRow("m3", "mass of link3", "kg", 1.10197, 0.0482226, 2.652368, 0.84, "bounded")
    assert repr(row) == "ParameterRow(m3 = 1.102 kg, 0.048 to 2.653, bounded)"
    assert repr(replace(row, lower=0.0, upper=np.inf)) == "ParameterRow(m3 = 1.102 kg, 0 to ∞, bounded)"
    assert repr(replace(row, lower=np.nan, upper=np.nan)) == "ParameterRow(m3 = 1.102 kg, ? to ?, bounded)"
    link = LinkRows("link3", row, (row, replace(row, value=-0.25), row), ())
    assert repr(link) == "LinkRows('link3': 1.102 kg at (1.1, -0.25, 1.1) m)"


@pytest.mark.slow
def test_laws_of_other_joints_are_no_numbers_of_a_joint() -> None:
    """Stribeck's friction acts at the second of two joints: the first has no number of it, and no further one."""
    laws = ByJoint([Stribeck(velocity=0.2, joints=[2]), Coulomb(), Viscous()])
    robot = sy.Robot.from_dh([("pi/2", 0.0, 0.3, "q"), (0, 0.5, 0, "q")], gravity=(0, 0, -9.81)).with_terms(laws)
    model, random = sy.Model(robot), np.random.default_rng(5)
    q, dq, ddq, torque = random.normal(size=(4, 400, 2))
    named = {row.name for row in sy.identify(robot, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque)).parameters}
    of_links = {name for name in model.parameter_names if not name.startswith("F")}
    assert named >= of_links
    assert {name for name in named if name.startswith("F")} == {"Fcj1", "Fvj1", "Fcj2", "Fsj2", "Fvj2"}


@pytest.mark.slow
def test_what_states_that_friction_dissipates_is_no_number_of_a_joint() -> None:
    """A polynomial of degree 3 has three numbers; the elements of the matrices of its condition are none of them."""
    robot = sy.Robot.from_dh([(0, 0.5, 0, "q")], gravity=(0, -9.81, 0)).with_terms(PolynomialFriction([0, 1, 2, 3]))
    q, dq, ddq, torque = np.random.default_rng(6).normal(size=(4, 400, 1))
    result = sy.identify(robot, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque))
    named = {row.name for row in result.parameters if row.name.startswith("F")}
    assert named == {"Fcj1", "Fvj1", "Fv2j1", "Fv3j1"}
    assert {"Fx1j1", "Fx2j1"} < set(result.model.parameter_names)
