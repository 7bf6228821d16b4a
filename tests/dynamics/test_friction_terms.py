"""Friction terms: torques against closed forms, and their conditions against the power at many speeds."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

import steelyard as sy
from steelyard.dynamics import (
    CoulombByDirection,
    PiecewiseFriction,
    PolynomialFriction,
    SmoothCoulomb,
    Stribeck,
    ViscousByDirection,
    term_from_dict,
)
from steelyard.dynamics.terms import is_known_term

SPEEDS = np.concatenate([-np.geomspace(1e-6, 50.0, 4000), np.geomspace(1e-6, 50.0, 4000)])

# Each with its torque as a plain formula of the speed v and the parameters p, and to which speed it must dissipate.
TERMS = [
    (CoulombByDirection(), lambda v, p: np.where(v > 0, p[0], -p[1]), 50.0),
    (ViscousByDirection(), lambda v, p: np.where(v > 0, p[0], p[1]) * v, 50.0),
    (Stribeck(velocity=0.3), lambda v, p: (p[0] + p[1] * np.exp(-((v / 0.3) ** 2))) * np.sign(v), 50.0),
    (Stribeck(0.2, 1.0), lambda v, p: (p[0] + p[1] * np.exp(-np.abs(v) / 0.2)) * np.sign(v), 50.0),
    (Stribeck(0.2, 0.6), lambda v, p: (p[0] + p[1] * np.exp(-((np.abs(v) / 0.2) ** 0.6))) * np.sign(v), 50.0),
    (SmoothCoulomb(velocity=0.05), lambda v, p: p[0] * np.tanh(v / 0.05), 50.0),
    (PolynomialFriction(powers=[1, 3]), lambda v, p: p[0] * v + p[1] * v**3, 50.0),
    (PolynomialFriction(powers=[1, 2], speed=2.0), lambda v, p: p[0] * v + p[1] * v * np.abs(v), 2.0),
    (PolynomialFriction(powers=[0, 1, 2]), lambda v, p: (p[0] + p[1] * abs(v) + p[2] * v**2) * np.sign(v), 50.0),
    (
        PolynomialFriction(powers=[0, 1, 2], speed=3.0),
        lambda v, p: (p[0] + p[1] * abs(v) + p[2] * v**2) * np.sign(v),
        3.0,
    ),
    (
        PiecewiseFriction(speeds=[0.0, 0.4, 2.0]),
        lambda v, p: np.interp(np.abs(v), [0.0, 0.4, 2.0], p) * np.sign(v),
        50.0,
    ),
    (
        PiecewiseFriction(speeds=[0.4, 2.0]),
        lambda v, p: np.interp(np.abs(v), [0.0, 0.4, 2.0], [0.0, *p]) * np.sign(v),
        50.0,
    ),
]
NAMES = [repr(term) for term, _, _ in TERMS]


def torque(term, values):
    """The torque of a term at SPEEDS, by its columns."""
    columns = term.columns(0, [0.0 * SPEEDS], [SPEEDS], [0.0 * SPEEDS], np)
    return sum(value * column[0] for value, column in zip(values, columns, strict=True) if column)


def margin(term, values):
    """The least eigenvalue of the conditions, the most of it where a parameter is free that no torque shows."""
    symbols = [parameter.symbol for parameter in term.parameters]

    def least(slack):
        named = dict(zip(symbols, [*values, *slack], strict=True))
        matrices = [
            condition.constant + sum(named[s] * m for s, m in condition.coefficients.items())
            for condition in term.conditions()
        ]
        return min(float(np.linalg.eigvalsh(matrix)[0]) for matrix in matrices)

    free = len(symbols) - len(values)
    if not free:
        return least(())
    assert free == 1
    found = minimize_scalar(lambda s: -least((s,)), bounds=(-50.0, 50.0), method="bounded", options={"xatol": 1e-11})
    return -found.fun


@pytest.mark.parametrize(("term", "formula", "fastest"), TERMS, ids=NAMES)
def test_torques_are_the_formula_and_the_conditions_are_exact(term, formula, fastest, random):
    """Feasible where the power is nowhere negative, infeasible where it is somewhere."""
    count = sum(bool(column) for column in term.columns(0, [0.0], [0.5], [0.0], np))
    inside = np.abs(SPEEDS) <= fastest
    verdicts = set()
    for scale in [0.3, 1.0] * 12:
        values = random.uniform(-0.4, 1.0, count) * np.array([1.0, *[scale * 2] * (count - 1)])
        expected = formula(SPEEDS, values)
        given = torque(term, [*values, *[0.0] * (len(term.parameters) - count)])
        np.testing.assert_allclose(given, expected, atol=1e-12, rtol=1e-12)
        sizes = sum(np.abs(formula(SPEEDS, value * unit)) for value, unit in zip(values, np.eye(count), strict=True))
        power = (expected * np.sign(SPEEDS) / np.maximum(sizes, 1e-300))[inside].min()
        if abs(power) < 1e-3:
            continue  # too near the boundary for sampled speeds to tell
        # A polynomial that is negative beyond the sampled speeds alone is told by its leading coefficient.
        dissipates = power > 0.0 and (fastest < 50.0 or not isinstance(term, PolynomialFriction) or values[-1] >= 0.0)
        verdicts.add(dissipates)
        assert (margin(term, values) >= -1e-7) == dissipates, values
    assert verdicts == {True, False}


def test_a_polynomial_of_more_powers_dissipates_by_a_sum_of_squares(random):
    """What is hardly above 0 at one speed is found feasible, what is hardly below is not."""
    for powers, speed in (([1, 2, 3, 4], None), ([0, 1, 2, 3], 2.0), ([0, 1, 2, 3, 4], 1.5)):
        robot = sy.Robot.from_dh([("pi/2", 0, 0.3, "q")]).with_terms(PolynomialFriction(powers=powers, speed=speed))
        model = sy.Model(robot)
        names = model.parameter_names
        place = [names.index(f"{parameter.symbol}1") for parameter in robot.terms[0].parameters][: len(powers)]
        base = model.base_parameters()
        where = [list(base.independent).index(k) for k in place]
        beta = base.values(np.array([0.1, 0, 0, 0.1, 0, 0.1, 0, 0, 0, 1.0, *[0.0] * (len(names) - 10)]))
        # (v - 1)² (v + 0.1) or (v - 1)² (v² + 0.1), times the lowest power, has its least value at speed 1: 0.
        touching = np.polynomial.Polynomial([1.0, -2.0, 1.0]) * ([0.1, 1.0] if len(powers) == 4 else [0.1, 0.0, 1.0])
        for lift, possible in ((1e-3, True), (-1e-3, False)):
            beta[where] = touching.coef + np.eye(len(powers))[0] * lift
            assert sy.check(sy.FeasibleSet(model), base=beta).feasible == possible


def test_shapes_are_kept_and_changed():
    for term, *_ in TERMS:
        assert term_from_dict(term.to_dict()) == term
        assert is_known_term(term)
    stribeck = Stribeck(velocity=[0.1, 0.2], joints=[2])
    assert stribeck.with_shape(velocity=0.3) == Stribeck(0.3, 2.0, [2])
    assert stribeck.with_shape(joints=None) == Stribeck([0.1, 0.2])
    assert stribeck.columns(0, [0.0] * 2, [1.0] * 2, [0.0] * 2, np) == ({}, {})
    assert set(stribeck.columns(1, [0.0] * 2, [1.0] * 2, [0.0] * 2, np)[1]) == {1}
    robot = sy.Robot.from_dh([(0, 0.3, 0, "q")] * 3)
    for term, phrase in (
        (stribeck, "velocity of the term 'stribeck' has 2 numbers, but robot has 3 joints"),
        (Stribeck(0.1, joints=[4]), "act at joint 4, but robot has 3"),
    ):
        with pytest.raises(sy.InputError, match=phrase):
            robot.with_terms(term)


@pytest.mark.parametrize(
    ("section", "phrase"),
    [
        ({"kind": "stribeck"}, "lacks 'velocity'"),
        ({"kind": "stribeck", "velocity": -0.1}, "velocity of a term of kind 'stribeck' must be positive"),
        ({"kind": "stribeck", "velocity": "slow"}, "must be a finite number"),
        ({"kind": "coulomb_smooth", "velocity": 0.1, "joints": [0]}, "numbers of joints, from 1"),
        ({"kind": "friction_polynomial", "powers": [3, 1]}, "ascending whole numbers from 0 to 9"),
        ({"kind": "friction_polynomial", "powers": [1, 2], "speed": [1, 2]}, "must be one number"),
        ({"kind": "friction_piecewise", "speeds": [1.0, 0.5]}, "ascending numbers of at least 0"),
    ],
)
def test_what_is_no_shape_is_refused(section, phrase):
    with pytest.raises(sy.InputError) as caught:
        term_from_dict(section)
    assert phrase in str(caught.value)


def test_slow_shapes_are_identifiable():
    """A Stribeck velocity far below the speeds of random motions, and a node far above them."""
    terms = (Stribeck(velocity=1e-4), PiecewiseFriction(speeds=[20.0, 40.0]))
    model = sy.Model(sy.Robot.from_dh([("pi/2", 0, 0.3, "q"), (0, 0.4, 0, "q")]).with_terms(*terms))
    names = model.base_parameters().names
    assert {"Fcj1", "Fsj1", "Fn1j1", "Fn2j1", "Fsj2", "Fn2j2"} <= set(names)
    offset = sy.Model(model.robot.with_terms(CoulombByDirection(), sy.Offset())).base_parameters()
    assert {"Fcpj1 + Foj1", "Fcnj1 - Foj1"} <= set(offset.expressions)


def test_descriptions_get_the_mean_of_both_directions():
    model = sy.Model(sy.Robot.from_dh([("pi/2", 0, 0.3, "q")]).with_terms(CoulombByDirection(), ViscousByDirection()))
    parameters = np.array([0.0] * 10 + [2.0, 1.0, 0.5, 0.7])
    drives = model.drives(parameters)
    damping, friction = drives.damping, drives.friction
    assert damping[0] == pytest.approx(0.6)
    assert friction[0] == pytest.approx(1.5)
