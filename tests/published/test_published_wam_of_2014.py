"""The WAM as published in 2014 (98 parameters, rotors without coupling): its feasible answer and its distance."""

import csv
import json
import re

import numpy as np
import pytest

import steelyard as sy

pytestmark = pytest.mark.data

TERMS = {"fv": "Fvj", "fc": "Fcj", "fo": "Foj", "Ia": "Ia"}


def our_name(name: str) -> str:
    """Lxx1 of L_1xx, lx1 of l_1x, Fvj1 of fv_1."""
    symbol, link, axes = re.fullmatch(r"([A-Za-z]+)_(\d)(\w*)", name).groups()
    return f"{TERMS.get(symbol, symbol)}{axes}{link}"


@pytest.fixture(scope="module")
def published(shared_data):
    """Model, base parameters by name of column in our order, standard parameters, boxes."""
    folder = shared_data / "wam7"
    robot = sy.Robot.from_dh(json.loads((folder / "dh.json").read_text())["rows"], name="wam")
    model = sy.Model(robot.with_terms(sy.RotorInertia(), sy.Viscous(), sy.Coulomb(), sy.Offset()))
    names = {name: index for index, name in enumerate(model.parameter_names)}
    K = model.base_parameters().K
    columns = ("beta_ols", "beta_star_e", "beta_star_e_fullprec_from_delta", "beta_triangle_e")
    values = {column: np.full(len(K), np.nan) for column in columns}
    with (folder / "base_parameters_ijrr2014.csv").open() as file:
        for row in csv.DictReader(file):
            combination = np.zeros(len(names))
            for sign, number, name in re.findall(r"([+-]?)\s*(?:([\d.e-]+)\*)?([A-Za-z]+_\d\w*)", row["expression"]):
                combination[names[our_name(name)]] += (-1.0 if sign == "-" else 1.0) * float(number or 1.0)
            (match,) = np.flatnonzero(np.all(np.isclose(K, combination, atol=1e-6), axis=1))
            for column in columns:
                values[column][match] = float(row[column])
    delta = np.zeros(len(names))
    for name, value in json.loads((folder / "delta_star_e_ijrr2014.json").read_text())["delta"].items():
        delta[names[our_name(name)]] = value
    boxes = [
        sy.CenterOfMassBox(f"link{k + 1}", lower=[low for low, _ in box], upper=[high for _, high in box])
        for k, box in enumerate(json.loads((folder / "notebook_numbers_ijrr2014.json").read_text())["com_boxes_m"])
    ]
    return model, values, delta, boxes


def test_base_parameters_are_the_published_combinations(published):
    model, values, delta, _ = published
    assert (model.parameter_count, model.base_parameters().count) == (98, 69)
    ours = model.base_parameters().values(delta)
    np.testing.assert_allclose(ours, values["beta_star_e_fullprec_from_delta"], rtol=1e-9, atol=1e-9)


def test_the_feasible_answer_passes_with_its_boxes(published):
    model, values, delta, boxes = published
    feasible = sy.FeasibleSet(model, "inertia", [sy.TotalMass(maximum=27.0), *boxes])
    verdict = sy.check(feasible, parameters=delta)
    assert verdict.status == "feasible"
    assert verdict.certificate.verify()
    verdict = sy.check(feasible, base=values["beta_star_e_fullprec_from_delta"])
    assert verdict.feasible
    assert verdict.certificate.verify()
    # It was found without the triangle inequality, and violates it.
    verdict = sy.check(sy.FeasibleSet(model, "full"), base=values["beta_star_e_fullprec_from_delta"])
    assert verdict.status == "infeasible"
    assert verdict.certificate.verify()


def test_least_squares_is_infeasible_at_the_published_distance(published, shared_data):
    """The printed estimate has four digits, which moves the squared distance by about one in a hundred."""
    model, values, _, _ = published
    feasible = sy.FeasibleSet(model, "inertia", margin=1e-6)
    verdict = sy.check(feasible, base=values["beta_ols"])
    assert verdict.status == "infeasible"
    assert verdict.certificate.verify()
    numbers = json.loads((shared_data / "wam7" / "notebook_numbers_ijrr2014.json").read_text())
    found = sy.correct(feasible, base=values["beta_ols"])
    assert found.squared_distance == pytest.approx(numbers["u_prime_BPFC"], rel=0.02)


def test_the_answer_with_triangle_inequality_is_full(published):
    """Printed with four digits, it is within their rounding of the full set with its boxes."""
    model, values, _, boxes = published
    feasible = sy.FeasibleSet(model, "full", [sy.TotalMass(maximum=27.0), *boxes])
    digits = 10.0 ** np.floor(np.log10(np.maximum(np.abs(values["beta_triangle_e"]), 1e-12)) - 3)
    found = sy.correct(feasible, base=values["beta_triangle_e"])
    assert found.squared_distance <= 2 * float(np.sum((0.5 * digits) ** 2))
