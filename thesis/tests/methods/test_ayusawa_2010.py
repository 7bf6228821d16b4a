"""Point masses against brute-force nonnegative least squares on the raw regression."""

import csv
import importlib.util

import numpy as np
import pytest
import scipy.optimize

import steelyard as sy
from steelyard.errors import InputError, MissingExtraError
from steelyard.feasibility import CenterOfMassBox, CenterOfMassSphere, DensityInBox, MeasuredMass, TotalMass
from steelyard_thesis.methods import Ayusawa2010
from steelyard_thesis.methods.point_masses import inertia_of_points, masses_near, points_in_box

ROWS = [("-pi/2", 0.0, 0.3, "q"), ("0", 0.5, 0.0, "q"), ("pi/2", 0.3, 0.0, "q")]
BOX = ([-0.25, -0.2, -0.3], [0.3, 0.2, 0.25])
BOXES = {f"link{link}": BOX for link in (1, 2, 3)}


def grid():
    """The 27 places of the paper, by loops."""
    axes = [(low, 0.5 * (low + high), high) for low, high in zip(*BOX, strict=True)]
    return [np.array([x, y, z]) for x in axes[0] for y in axes[1] for z in axes[2]]


def inertial(mass, point):
    """Ten parameters of one point mass, by the definition of moments."""
    tensor = mass * (point @ point * np.eye(3) - np.outer(point, point))
    return np.concatenate([tensor[np.triu_indices(3)], mass * point, [mass]])


@pytest.fixture(scope="module")
def arm():
    return sy.Model(sy.Robot.from_dh(ROWS, name="arm").with_terms(sy.Viscous(), sy.Offset()))


@pytest.fixture(scope="module")
def regression(arm):
    """The raw regression W δ = ω of a noisy motion, and its Information."""
    random = np.random.default_rng(8)
    truth = np.zeros(len(arm.parameter_names))
    for link in range(3):
        points = random.uniform(BOX[0], BOX[1], size=(6, 3))
        truth[12 * link : 12 * link + 10] = sum(
            inertial(mass, point) for mass, point in zip(random.uniform(0, 1, 6), points, strict=True)
        )
        truth[12 * link + 10 : 12 * link + 12] = 0.3, -0.1
    q, dq, ddq = random.normal(size=(3, 60, 3))
    torque = arm.inverse_dynamics(q, dq, ddq, truth) + 2.0 * random.normal(size=(60, 3))
    information = sy.Information.from_samples(arm, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque))
    return arm.regressor(q, dq, ddq).reshape(180, -1), torque.ravel(), information


def brute_force(W, omega):
    """Least squared residual over masses of points and friction, by SciPy's bounded least squares."""
    columns, lower = [], []
    for link in range(3):
        block = np.column_stack([inertial(1.0, point) for point in grid()])
        columns.append(W[:, 12 * link : 12 * link + 10] @ block)
        columns.append(W[:, 12 * link + 10 : 12 * link + 12])
        lower += [0.0] * 28 + [-np.inf]
    found = scipy.optimize.lsq_linear(np.hstack(columns), omega, (lower, np.inf), method="bvls", tol=1e-14)
    return 2.0 * found.cost


SOLVERS = ("auto", "nnls", "clarabel", "osqp", "piqp")


@pytest.mark.parametrize("solver", SOLVERS)
def test_residual_is_that_of_brute_force(arm, regression, solver):
    if solver in ("osqp", "piqp") and importlib.util.find_spec(solver) is None:
        pytest.skip(f"{solver} is not installed")
    W, omega, information = regression
    estimate = Ayusawa2010(boxes=BOXES, solver=solver).fit(information, sy.FeasibleSet(arm), weights=None)
    assert estimate.consistency == "full"
    squared = np.sum((W @ estimate.parameters - omega) ** 2)
    assert squared == pytest.approx(brute_force(W, omega), rel=2e-6)
    assert estimate.relative_error == pytest.approx(np.sqrt(squared / (omega @ omega)), rel=1e-9)


def test_it_costs_more_than_the_feasible_optimum_and_less_with_more_points(arm, regression):
    feasible = sy.FeasibleSet(arm, constraints=[DensityInBox(link, *BOX) for link in BOXES])
    best = sy.fit(regression[2], feasible, weights=None, residual_slack=0.0).relative_error
    errors = [
        Ayusawa2010(subdivisions=parts, solver="clarabel").fit(regression[2], feasible, weights=None).relative_error
        for parts in (2, 4, 8)
    ]
    assert best < errors[2] < errors[1] < errors[0]
    assert errors[2] < best * 1.01


def test_points_and_parameters_by_definition():
    R = inertia_of_points(np.array([BOX]), points_in_box())
    expected = np.column_stack([inertial(1.0, point) for point in grid()])
    np.testing.assert_allclose(R[0], expected, atol=1e-15)


def test_kinds_of_points():
    counts = [len(points_in_box(kinds)) for kinds in (("vertices", "edges"), ("edges", "faces"), ("vertices", "faces"))]
    assert counts == [20, 18, 14]
    assert len(points_in_box(subdivisions=4)) == 125
    # All at the same distance from the centre: the mass is a multiple of the trace.
    with pytest.raises(InputError, match="12 points can combine only 9 of the ten"):
        points_in_box(("edges",))
    np.testing.assert_array_equal(points_in_box(points=points_in_box(("edges", "faces"))).shape, (18, 3))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"kinds": ("corners",)}, "kinds must be some of centre, faces, edges, vertices"),
        ({"kinds": ("vertices",)}, "8 points can combine only"),
        ({"subdivisions": 0}, "subdivisions must be a positive integer"),
        ({"points": [[2.0, 0.0, 0.0]]}, "between -1 and 1"),
        ({"prior_weight": 0.0}, "prior_weight must be a positive number"),
        ({"solver": "clarabell"}, "and auto, nnls, osqp, piqp"),
    ],
)
def test_bad_settings(settings, message):
    with pytest.raises(InputError, match=message):
        Ayusawa2010(**settings)


def test_boxes_of_constraints_hold_the_centre_of_mass(arm, regression):
    feasible = sy.FeasibleSet(arm, constraints=[CenterOfMassBox(link, *BOX) for link in BOXES])
    estimate = Ayusawa2010().fit(regression[2], feasible)
    assert estimate.consistency == "full"
    assert not estimate.remarks
    given = Ayusawa2010(boxes=BOXES).fit(regression[2], sy.FeasibleSet(arm))
    np.testing.assert_allclose(estimate.base, given.base, atol=1e-9)


def test_linear_constraints_and_equations_are_met(arm, regression):
    masses = [MeasuredMass(4.0, ["link1"]), TotalMass(maximum=6.0)]
    feasible = sy.FeasibleSet(arm, constraints=masses)
    with pytest.raises(InputError, match="takes lower bounds alone"):
        Ayusawa2010(boxes=BOXES, solver="nnls").fit(regression[2], feasible)
    estimate = Ayusawa2010(boxes=BOXES).fit(regression[2], feasible)
    assert estimate.parameters[9] == pytest.approx(4.0, abs=1e-9)
    assert estimate.parameters[[9, 21, 33]].sum() <= 6.0
    assert estimate.consistency == "full"


def test_matrix_constraints_are_refused(arm, regression):
    feasible = sy.FeasibleSet(arm, constraints=[CenterOfMassSphere("link2", (0, 0, 0), 0.1)])
    with pytest.raises(InputError, match="takes linear conditions alone"):
        Ayusawa2010(boxes=BOXES).fit(regression[2], feasible)


def test_unknown_boxes_are_remarked(arm, regression):
    estimate = Ayusawa2010(boxes={"link2": BOX}, default_size=0.4).fit(regression[2], sy.FeasibleSet(arm))
    assert estimate.remarks[0].startswith("No box is known of link1, link3, so a cube with sides of 0.8 m was taken")
    with pytest.raises(InputError, match="names the link 'forearm'"):
        Ayusawa2010(boxes={"forearm": BOX}).fit(regression[2], sy.FeasibleSet(arm))
    with pytest.raises(InputError, match="lower below upper"):
        Ayusawa2010(boxes={"link1": (BOX[1], BOX[0])}).fit(regression[2], sy.FeasibleSet(arm))


def test_a_strong_prior_decides(arm, regression):
    """The masses of the prior are found, and with a great weight the answer is the prior."""
    prior = np.full(36, np.nan)
    for link in range(3):
        masses = np.linspace(0.01, 0.1, 27)
        prior[12 * link : 12 * link + 10] = sum(inertial(m, p) for m, p in zip(masses, grid(), strict=True))
    strong = Ayusawa2010(boxes=BOXES, prior_weight=1e8).fit(regression[2], sy.FeasibleSet(arm), prior=prior)
    inertia = np.isfinite(prior)
    np.testing.assert_allclose(strong.parameters[inertia], prior[inertia], atol=2e-4)
    weak = Ayusawa2010(boxes=BOXES, prior_weight=1e-6).fit(regression[2], sy.FeasibleSet(arm), prior=prior)
    without = Ayusawa2010(boxes=BOXES).fit(regression[2], sy.FeasibleSet(arm))
    assert without.relative_error <= weak.relative_error < strong.relative_error
    assert weak.relative_error == pytest.approx(without.relative_error, rel=1e-6)


def test_masses_near_a_body_that_points_can_make():
    R = inertia_of_points(np.array([BOX]), points_in_box())
    body = R[0] @ np.linspace(0.0, 0.2, 27)
    masses = masses_near(R, body[None], np.full((1, 10), 0.1), np.array([0.1]))
    assert masses.min() >= 0.0
    np.testing.assert_allclose(R[0] @ masses[0], body, atol=1e-5)


def test_missing_solver_is_said(arm, regression, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(MissingExtraError, match="pip install osqp"):
        Ayusawa2010(boxes=BOXES, solver="osqp").fit(regression[2], sy.FeasibleSet(arm))


def test_friction_that_cannot_be_told_apart(random):
    """Offsets of joint and motor add up, and a mass on the axis has no effect: both solvers have the same residual."""
    robot = sy.Robot.from_dh(ROWS[:2]).with_terms(sy.Offset(), sy.MotorSide(coupling=[[1.0, 1.0], [0.0, 1.0]]))
    model = sy.Model(robot)
    truth = random.uniform(0.1, 0.2, len(model.parameter_names))
    for link in ("1", "2"):
        places = [model.parameter_names.index(f"{symbol}{link}") for symbol in ("Lxx", "Lyy", "Lzz", "m")]
        truth[places] = 1.0, 1.0, 1.0, 2.0
    q, dq, ddq = random.normal(size=(3, 50, 2))
    torque = model.inverse_dynamics(q, dq, ddq, truth) + random.normal(size=(50, 2))
    information = sy.Information.from_samples(model, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque))
    feasible = sy.FeasibleSet(model)
    estimates = [Ayusawa2010(solver=solver).fit(information, feasible) for solver in ("nnls", "clarabel")]
    assert all(estimate.consistency == "full" for estimate in estimates)
    assert estimates[0].relative_error == pytest.approx(estimates[1].relative_error, rel=1e-6)
    assert estimates[0].relative_error < 1.0


@pytest.mark.data
def test_order_of_table_6_2_on_the_real_wam(real_wam, thesis_tables):
    """As in table 6.2: least squares, then the feasible optimum, then points in the boxes of table 4.8."""
    model, information = real_wam
    with (thesis_tables / "table_4_8_com_boxes.csv").open() as file:
        boxes = {
            f"link{row['link']}": (
                [float(row[f"{axis}_min_m"]) for axis in "xyz"],
                [float(row[f"{axis}_max_m"]) for axis in "xyz"],
            )
            for row in csv.DictReader(file)
        }
    feasible = sy.FeasibleSet(model, "inertia")
    plain = sy.least_squares(information).relative_error
    best = sy.fit(information, feasible, weights=None).relative_error
    points = Ayusawa2010(boxes=boxes).fit(information, feasible)
    assert points.consistency == "inertia"
    assert plain < best < points.relative_error
    assert sy.check(sy.FeasibleSet(model, "full"), parameters=points.parameters).feasible
