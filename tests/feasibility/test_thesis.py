"""Published numbers: thesis 4.5 (the WAM) and 6.2 (Yoshida's robot)."""

import csv
from fractions import Fraction

import numpy as np
import pytest

from steelyard.feasibility import CenterOfMassBox, FeasibleSet, TotalMass, check, correct

PUBLISHED = ("WLS_corrected", "WLS_feasible", "WLS_feasible_extra")

# Values in the table are rounded to 1e-4, 76 of them.
ROUNDING = 76 * 5e-5**2


@pytest.mark.parametrize("consistency", ["inertia", "full"])
def test_wls_is_infeasible_with_a_proof(thesis_wam, table_4_9, consistency):
    verdict = check(FeasibleSet(thesis_wam, consistency), base=table_4_9["WLS"])
    assert verdict.status == "infeasible"
    assert verdict.certificate.verify()
    named = {violation.block: violation.amount for violation in verdict.violations}
    assert named["joint 2: Fcj >= 0"] == pytest.approx(0.0703, abs=1e-6)
    assert named["joint 4: Iam >= 0"] == pytest.approx(0.0458, abs=1e-6)


def test_wls_is_infeasible_by_its_links_alone(thesis_wam, table_4_9):
    verdict = check(FeasibleSet(thesis_wam, "inertia", terms=False), base=table_4_9["WLS"])
    assert verdict.status == "infeasible"
    assert verdict.certificate.verify()
    assert all("link" in name for name, _ in verdict.certificate.blocks)


def test_corrected_wls_of_table_4_9(thesis_wam, table_4_9):
    correction = correct(FeasibleSet(thesis_wam, "inertia", margin=1e-6), base=table_4_9["WLS"])
    assert correction.squared_distance == pytest.approx(0.00774, abs=2e-5)
    np.testing.assert_allclose(correction.base, table_4_9["WLS_corrected"], atol=1e-4)
    assert correction.certificate.verify()


def test_corrected_wls_with_full_consistency(thesis_wam, table_4_9):
    correction = correct(FeasibleSet(thesis_wam, "full"), base=table_4_9["WLS"])
    assert correction.squared_distance == pytest.approx(0.01345, abs=2e-5)
    assert correction.certificate.verify()


@pytest.mark.parametrize("column", PUBLISHED)
def test_published_estimates_are_in_the_inertia_set(thesis_wam, table_4_9, column):
    assert correct(FeasibleSet(thesis_wam, "inertia"), base=table_4_9[column]).squared_distance <= ROUNDING


@pytest.mark.parametrize(("column", "squared"), list(zip(PUBLISHED, (0.0048, 0.0026, 0.0023), strict=True)))
def test_published_estimates_are_outside_the_full_set(thesis_wam, table_4_9, column, squared):
    feasible = FeasibleSet(thesis_wam, "full")
    verdict = check(feasible, base=table_4_9[column])
    assert verdict.status == "infeasible"
    assert verdict.certificate.verify()
    assert correct(feasible, base=table_4_9[column]).squared_distance == pytest.approx(squared, abs=5e-5)


def test_extra_constraints_of_table_4_8(thesis_wam, table_4_9, thesis_tables):
    """The estimate with extra constraints meets them within rounding, the one without does not (thesis 4.5.4)."""
    with (thesis_tables / "table_4_8_com_boxes.csv").open() as file:
        boxes = [
            CenterOfMassBox(
                f"link{row['link']}",
                [float(row[f"{axis}_min_m"]) for axis in "xyz"],
                [float(row[f"{axis}_max_m"]) for axis in "xyz"],
            )
            for row in csv.DictReader(file)
        ]
    feasible = FeasibleSet(thesis_wam, "inertia", [TotalMass(maximum=27.0), *boxes])
    assert correct(feasible, base=table_4_9["WLS_feasible_extra"]).squared_distance <= ROUNDING
    verdict = check(feasible, base=table_4_9["WLS_feasible"])
    assert verdict.status == "infeasible"
    assert verdict.certificate.verify()


@pytest.fixture
def yoshida(thesis_tables, stand_in, inertial_symbols):
    """Table 6.1: base parameters of a robot of three links, and the two estimates."""
    with (thesis_tables / "table_6_1_yoshida_3_link.csv").open() as file:
        rows = list(csv.DictReader(file))

    def name(symbol):
        return symbol[0] + symbol[2:] + symbol[1]

    combinations = []
    for row in rows:
        terms = row["combination"].replace("-", "+-").split("+")
        combinations.append([(-1.0 if term.startswith("-") else 1.0, name(term.lstrip("-"))) for term in terms if term])
    names = [f"{s}{i}" for i in (1, 2, 3) for s in inertial_symbols]
    model = stand_in(names, combinations, ("link1", "link2", "link3"))
    columns = ("beta_t1", "beta_t2", "beta_t2_corrected")
    return model, {column: np.array([float(row[column]) for row in rows]) for column in columns}


def test_yoshida_estimates(yoshida):
    model, columns = yoshida
    feasible = FeasibleSet(model, "inertia")
    first = check(feasible, base=columns["beta_t1"])
    second = check(feasible, base=columns["beta_t2"])
    assert (first.status, second.status) == ("feasible", "infeasible")
    assert first.certificate.verify()
    assert second.certificate.verify()


def is_positive_definite_exactly(matrix):
    """By elimination in rational arithmetic."""
    rows = [list(row) for row in matrix]
    for k, pivot in enumerate(rows):
        if pivot[k] <= 0:
            return False
        for i in range(k + 1, len(rows)):
            factor = rows[i][k] / pivot[k]
            rows[i] = [value - factor * other for value, other in zip(rows[i], pivot, strict=True)]
    return True


def test_yoshida_distance(yoshida):
    """The thesis printed 1.65e-3 (6.2); the nearest points hold a link of more than a tonne."""
    model, columns = yoshida
    feasible = FeasibleSet(model, "inertia")
    correction = correct(feasible, base=columns["beta_t2"])
    assert np.sqrt(correction.squared_distance) == pytest.approx(1.65e-3, rel=5e-3)
    exact = [Fraction(float(value)) for value in correction.parameters]
    for block in feasible.blocks:
        matrix = [
            [
                sum(
                    Fraction(float(c)) * exact[k]
                    for c, k in zip(block.coefficients[:, i, j], block.indices, strict=True)
                )
                for j in range(6)
            ]
            for i in range(6)
        ]
        assert is_positive_definite_exactly(matrix)


def test_nothing_is_nearer_to_yoshidas_second_estimate(yoshida):
    """The distance is between 1.647e-3 and 1.6516e-3, both proved; the point that the thesis printed is outside."""
    model, columns = yoshida
    feasible = FeasibleSet(model, "inertia", margin=1e-8)
    given = columns["beta_t2"]
    nearest = correct(feasible, base=given)
    assert nearest.certificate.verify()
    assert np.linalg.norm(nearest.base - given) < 1.6516e-3
    # A direction y with y·β >= 0 for all feasible β keeps them all at least -y·given / |y| away.
    refuted = check(feasible, base=given + 0.998 * (nearest.base - given))
    assert refuted.certificate.verify()
    direction = refuted.certificate.direction
    assert -direction @ given / np.linalg.norm(direction) > 1.647e-3
    printed = check(feasible, base=columns["beta_t2_corrected"])
    assert printed.status == "infeasible"
    assert printed.certificate.verify()


def test_yoshidas_distance_with_a_robot_of_moderate_mass(yoshida):
    """Nearer than 1.751e-3 the robot weighs more than 54 kg or so; no estimate of a distance should go without this."""
    model, columns = yoshida
    feasible = FeasibleSet(model, "inertia", [TotalMass(maximum=54.5)])
    correction = correct(feasible, base=columns["beta_t2"])
    assert np.sqrt(correction.squared_distance) == pytest.approx(1.751e-3, rel=1e-2)
    assert correction.certificate.verify()
