"""The search for virtual parameters against exact certificates, on table 6.1 and on random robots."""

import csv
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

import steelyard as sy
from steelyard.errors import InputError
from steelyard.feasibility import MeasuredMass
from steelyard.lmi import AffineBlock
from steelyard_thesis.methods import Yoshida2000
from steelyard_thesis.methods.link_regions import regions_of_links

SYMBOLS = ("Lxx", "Lxy", "Lxz", "Lyy", "Lyz", "Lzz", "lx", "ly", "lz", "m")


@dataclass(frozen=True)
class Base:
    K: Any
    independent: Any
    dependent: Any


@dataclass(frozen=True)
class Links:
    link_names: tuple[str, ...]
    parameters: Any


class ThreeLinks:
    """The robot of table 6.1, known by its base parameters alone."""

    def __init__(self, combinations):
        self.parameter_names = tuple(f"{symbol}{link}" for link in (1, 2, 3) for symbol in SYMBOLS)
        K = np.zeros((len(combinations), 30))
        for row, terms in zip(K, combinations, strict=True):
            for sign, name in terms:
                row[self.parameter_names.index(name)] = sign
        independent = [self.parameter_names.index(terms[0][1]) for terms in combinations]
        dependent = [k for k in range(30) if k not in independent]
        self._base = Base(K, np.array(independent), np.array(dependent))
        self.robot = Links(("link1", "link2", "link3"), np.full(30, np.nan))
        self._arm = sy.Model(sy.Robot.from_dh([("pi/2", 1.0, 0, "q")] * 3))

    def base_parameters(self):
        return self._base

    def conditions(self, consistency):
        return self._arm.conditions(consistency)


@pytest.fixture(scope="module")
def table_6_1(thesis_tables):
    with (thesis_tables / "table_6_1_yoshida_3_link.csv").open() as file:
        rows = list(csv.DictReader(file))
    combinations = []
    for row in rows:
        terms = [term for term in row["combination"].replace("-", "+-").split("+") if term]
        bare = [term.lstrip("-") for term in terms]
        combinations.append(
            [(-1.0 if t.startswith("-") else 1.0, b[0] + b[2:] + b[1]) for t, b in zip(terms, bare, strict=True)]
        )
    columns = {c: np.array([float(row[c]) for row in rows]) for c in ("beta_t1", "beta_t2", "beta_t2_corrected")}
    return ThreeLinks(combinations), columns


@pytest.mark.data
def test_both_columns_as_published(table_6_1):
    model, columns = table_6_1
    feasible = sy.FeasibleSet(model, "inertia")
    first = Yoshida2000().check(feasible, columns["beta_t1"])
    assert first.status == "feasible"
    assert sy.check(feasible, parameters=first.parameters).feasible
    np.testing.assert_allclose(feasible.K @ first.parameters, columns["beta_t1"], atol=1e-12)
    second = Yoshida2000().check(feasible, columns["beta_t2"])
    assert second.status == "infeasible"
    assert second.direction @ columns["beta_t2"] < 0.0
    assert second.direction @ columns["beta_t1"] > 0.0
    assert first.dimensions[:2] == (3, 3)


@pytest.mark.data
def test_the_printed_correction_is_just_outside(table_6_1):
    """Infeasible by 1e-7 or so, which exact arithmetic confirms."""
    model, columns = table_6_1
    feasible = sy.FeasibleSet(model, "inertia")
    search = Yoshida2000().check(feasible, columns["beta_t2_corrected"])
    verdict = sy.check(feasible, base=columns["beta_t2_corrected"])
    assert (search.status, verdict.status) == ("infeasible", "infeasible")
    assert verdict.certificate.verify()


@pytest.mark.data
def test_trial_and_error_cannot_tell_that_the_second_is_infeasible(table_6_1):
    model, columns = table_6_1
    feasible = sy.FeasibleSet(model, "inertia")
    plain = Yoshida2000(learning=False)
    assert plain.check(feasible, columns["beta_t1"]).status == "feasible"
    second = plain.check(feasible, columns["beta_t2"])
    assert second.status == "undecided"
    assert second.feasible is None
    assert any("was empty" in reason for reason in second.reasons)


@pytest.mark.data
@pytest.mark.parametrize("terms", [True, False])
@pytest.mark.parametrize("consistency", ["inertia", "full"])
def test_table_4_9(wam, thesis_tables, consistency, terms):
    """Estimates of the WAM, of which the feasible ones lie on the boundary but for rounding of what was printed."""
    with (thesis_tables / "table_4_9_feasible_estimates.csv").open() as file:
        rows = list(csv.DictReader(file))
    feasible = sy.FeasibleSet(wam, consistency, terms=terms)
    for column in ("WLS", "WLS_corrected", "WLS_feasible"):
        base = np.array([float(row[column]) for row in rows])
        search = Yoshida2000(tries=150).check(feasible, base)
        assert search.feasible in (sy.check(feasible, base=base).feasible, None)
        if column == "WLS" or consistency == "full":
            assert search.status == "infeasible"


@pytest.fixture(scope="module")
def arm():
    rows = [("-pi/2", 0.0, 0.3, "q"), ("pi/2", 0.1, 0.4, "q"), ("0", 0.5, 0.0, "q"), ("pi/2", 0.3, 0.1, "q")]
    return sy.Model(sy.Robot.from_dh(rows).with_terms(sy.Viscous(), sy.RotorInertia()))


def bodies(count, random):
    values = []
    for _ in range(count):
        masses, points = random.uniform(0.1, 1.0, 8), 0.15 * random.normal(size=(8, 3))
        tensor = sum(m * (p @ p * np.eye(3) - np.outer(p, p)) for m, p in zip(masses, points, strict=True))
        values += [*tensor[np.triu_indices(3)], *(masses @ points), masses.sum(), 0.3, 0.02]
    return np.array(values)


@pytest.mark.slow
@pytest.mark.parametrize("consistency", ["inertia", "full"])
@pytest.mark.parametrize("learning", [True, False])
def test_it_never_contradicts_an_exact_certificate(arm, consistency, learning):
    random = np.random.default_rng(11)
    feasible = sy.FeasibleSet(arm, consistency)
    answers = []
    for noise in (0.0, 0.05, 0.3, 1.0, 3.0) * 2:
        base = feasible.K @ bodies(4, random)
        base = base * (1.0 + noise * random.normal(size=len(base)))
        verdict = sy.check(feasible, base=base)
        search = Yoshida2000(learning=learning, tries=200).check(feasible, base)
        assert search.feasible in (verdict.feasible, None)
        if search.status == "feasible":
            assert feasible.contains(search.parameters)
        if search.status == "infeasible":
            assert search.direction @ base < 0.0
            # Nobody's parameters are on that side.
            assert all(search.direction @ feasible.K @ bodies(4, random) > 0.0 for _ in range(20))
        answers.append(search.status)
    assert {"feasible", "infeasible"} <= set(answers)
    if learning:
        assert "undecided" not in answers


def test_regions_hold_every_unknown_once(arm):
    feasible = sy.FeasibleSet(arm)
    regions, known = regions_of_links(feasible)
    columns = np.concatenate([region.columns for region in regions])
    assert sorted(columns) == list(range(feasible.unidentifiable.shape[1]))
    assert sum(len(region.blocks) for region in regions) + len(known) == len(feasible.blocks)
    assert [region.link for region in regions] == [3, 2, 1, 0]
    # Three regroup (Mayeda et al. 1990; Gautier and Khalil 1990).
    assert [region.dimension for region in regions[:2]] == [3, 3]
    assert all(isinstance(block, AffineBlock) for block in known)


def test_tries_that_run_out_are_said(arm):
    feasible = sy.FeasibleSet(arm, "inertia")
    base = feasible.K @ bodies(4, np.random.default_rng(1))
    search = Yoshida2000(tries=2).check(feasible, base)
    assert search.status == "undecided"
    assert search.reasons[0] == "No choice was found within 2 tries."


def test_what_base_parameters_determine_alone(arm):
    feasible = sy.FeasibleSet(arm)
    base = feasible.K @ bodies(4, np.random.default_rng(1))
    base[list(arm.base_parameters().names).index("Fvj2")] = -0.5
    search = Yoshida2000().check(feasible, base)
    assert (search.status, search.tries) == ("infeasible", 0)
    assert "Fvj >= 0 at joint2" in search.reasons[0]
    assert "fails by 0.5" in search.reasons[0]
    assert search.direction @ base < 0.0


def test_bad_input(arm):
    with pytest.raises(InputError, match="tries must be a positive integer"):
        Yoshida2000(tries=0)
    with pytest.raises(InputError, match="knows inequalities alone"):
        Yoshida2000().check(sy.FeasibleSet(arm, constraints=[MeasuredMass(1.0, ["link1"])]), np.zeros(1))
    with pytest.raises(InputError, match="base must hold"):
        Yoshida2000().check(sy.FeasibleSet(arm), np.zeros(2))
