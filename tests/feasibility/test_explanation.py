"""Why estimates are infeasible: conflicts that are known in closed form, brute force, and the WAM of the thesis."""

import numpy as np
import pytest
import scipy.stats

from steelyard.errors import InputError
from steelyard.feasibility import FeasibleSet, TotalMass, check, correct, explain_infeasibility

# The arm of two parallel axes shows a = Lzz1 + m2 and b = Lzz2, lx2, ly2: (lx2² + ly2²) / b ≤ m2 ≤ a. Here the body
# of the forearm needs 1 kg, but that of the upper arm leaves 0.5 kg.
HEAVY = np.array([0.5, 0.1, 0.25, 0.3, 0.4, 0.1])
BODIES = {"link 1 (upper arm): inertia", "link 2 (forearm): inertia"}


@pytest.mark.parametrize("consistency", ["full", "inertia"])
def test_two_bodies_that_conflict(two_links, consistency):
    feasible = FeasibleSet(two_links, consistency)
    found = explain_infeasibility(feasible, HEAVY)
    assert found.status == "infeasible"
    (conflict,) = found.subsystems
    assert set(conflict.conditions) == BODIES
    assert sum(conflict.shares) == pytest.approx(1.0)
    assert conflict.value < conflict.threshold


@pytest.mark.slow
@pytest.mark.parametrize("consistency", ["full", "inertia"])
def test_no_robot_has_less_along_the_direction(two_links, consistency, point_cloud_parameters):
    """Random arms are all on the other side, as far as they like to the threshold."""
    feasible = FeasibleSet(two_links, consistency)
    (conflict,) = explain_infeasibility(feasible, HEAVY).subsystems
    rng = np.random.default_rng(41)
    values = []
    for _ in range(2000):
        links = [
            point_cloud_parameters(rng.uniform(0, 1, 4) ** 4, rng.normal(size=(4, 3)) * rng.uniform(0, 1))
            for _ in range(2)
        ]
        delta = np.concatenate([np.append(link, rng.uniform(0, 1)) for link in links])
        values.append(conflict.direction @ feasible.K @ delta)
    assert min(values) >= conflict.threshold - 1e-9
    assert conflict.direction @ HEAVY == pytest.approx(conflict.value)


def test_change_of_one_parameter_alone(two_links):
    """a ≥ (lx² + ly²) / b; b ≥ (lx² + ly²) / a; ly² ≤ a b - lx²; lx² ≤ a b - ly² has no room, since ly² is more than
    a b."""
    found = explain_infeasibility(FeasibleSet(two_links), HEAVY)
    alone = {degree.name: degree.alone for degree in found.degrees}
    assert alone["Lzz1R"] == pytest.approx(1.0 - 0.5, rel=1e-4)
    assert alone["Lzz2"] == pytest.approx(0.5 - 0.25, rel=1e-4)
    assert alone["ly2"] == pytest.approx(np.sqrt(0.5 * 0.25 - 0.09) - 0.4, rel=1e-4)
    assert alone["lx2"] == alone["Fvj1"] == alone["Fvj2"] == np.inf
    assert "ly2 alone could make it feasible, by a change of -0.2129." in found.sentences()


def test_change_of_a_first_moment_alone(two_links):
    """With ly = 0.1: |lx| must fall from 0.4 to sqrt(a b - ly²)."""
    base = np.array([0.5, 0.1, 0.25, 0.4, 0.1, 0.1])
    found = explain_infeasibility(FeasibleSet(two_links), base)
    alone = {degree.name: degree.alone for degree in found.degrees}
    assert alone["lx2"] == pytest.approx(np.sqrt(0.5 * 0.25 - 0.01) - 0.4, rel=1e-4)


def test_reasons_without_a_condition_in_common(two_links):
    base = HEAVY.copy()
    base[1], base[5] = -0.2, -0.1
    found = explain_infeasibility(FeasibleSet(two_links), base)
    assert [set(conflict.conditions) for conflict in found.subsystems] == [
        {"joint 1: Fvj >= 0"},
        {"joint 2: Fvj >= 0"},
        BODIES,
    ]
    assert all(degree.alone == np.inf for degree in found.degrees)
    assert "No base parameter alone can make it feasible." in found.sentences()
    assert "for 3 reasons" in found.sentences()[0]


def test_leaving_out_any_condition_of_a_conflict_ends_it(two_links):
    feasible = FeasibleSet(two_links, constraints=[TotalMass(maximum=0.8), TotalMass(minimum=0.1, links=["upper arm"])])
    base = np.array([1.5, 0.1, 0.25, 0.3, 0.4, 0.1])  # the forearm needs 1 kg
    (conflict,) = explain_infeasibility(feasible, base).subsystems
    assert set(conflict.conditions) == {
        "link 2 (forearm): inertia",
        "link 1 (upper arm): inertia",
        "total mass <= 0.8 kg",
    } or set(conflict.conditions) == {
        "link 2 (forearm): inertia",
        "mass of upper arm >= 0.1 kg",
        "total mass <= 0.8 kg",
    }
    without = FeasibleSet(two_links, constraints=[TotalMass(minimum=0.1, links=["upper arm"])])
    assert check(without, base=base).feasible


def test_equations_take_part(two_links):
    base = np.array([1.5, 0.1, 0.25, 0.3, 0.4, 0.1])
    feasible = FeasibleSet(two_links, constraints=[TotalMass(equal=0.8, links=["forearm"])])
    (conflict,) = explain_infeasibility(feasible, base).subsystems
    assert set(conflict.conditions) == {"link 2 (forearm): inertia", "mass of forearm = 0.8 kg"}


def test_triangle_inequality_of_one_body(stand_in, inertial_symbols):
    """Lxx ≤ Lyy + Lzz is a plane: 3 > 1 + 1 is 1 / √3 from it, a third of it by each moment, each of which could mend
    it."""
    names = [f"{symbol}1" for symbol in inertial_symbols]
    model = stand_in(names, [[(1.0, name)] for name in names], ("body",))
    found = explain_infeasibility(FeasibleSet(model, margin=1e-9), [3.0, 0, 0, 1.0, 0, 1.0, 0, 0, 0, 1.0])
    assert found.distance == pytest.approx(1 / np.sqrt(3), rel=1e-6)
    degrees = {degree.name: degree for degree in found.degrees}
    for name, sign in (("Lxx1", -1), ("Lyy1", 1), ("Lzz1", 1)):
        assert degrees[name].share == pytest.approx(1 / 3, rel=1e-5)
        assert degrees[name].change == pytest.approx(sign / 3, rel=1e-5)
        assert degrees[name].alone == pytest.approx(sign, rel=1e-5)
    (conflict,) = found.subsystems
    np.testing.assert_allclose(conflict.direction[[0, 3, 5]], [-1, 1, 1], atol=1e-6)
    assert explain_infeasibility(FeasibleSet(model, "inertia"), found.base).status == "feasible"


def test_small_distances_are_exact(two_links):
    base = np.array([1.5, 0.1, 0.25, 0.3, 0.4, -1e-4])
    assert explain_infeasibility(FeasibleSet(two_links), base).distance == pytest.approx(1e-4 + 1e-6, rel=1e-2)


def test_boundary_is_told(two_links):
    found = explain_infeasibility(FeasibleSet(two_links), np.zeros(6))
    assert found.status == "undecided"
    assert str(found).startswith("It cannot be told whether")


def test_friction_alone_has_the_whole_share(two_links):
    base = np.array([1.5, 0.1, 0.25, 0.3, 0.4, -0.1])
    found = explain_infeasibility(FeasibleSet(two_links), base)
    shares = {degree.name: degree.share for degree in found.degrees}
    assert shares["Fvj2"] == pytest.approx(1.0, abs=1e-4)
    assert found.distance == pytest.approx(0.1, rel=1e-4)
    assert dict(found.shares) == pytest.approx({"joint 2: Fvj >= 0": 1.0}, abs=1e-4)
    assert next(d.alone for d in found.degrees if d.name == "Fvj2") == pytest.approx(0.1, rel=1e-6)


@pytest.mark.parametrize("consistency", ["full", pytest.param("inertia", marks=pytest.mark.slow)])
def test_shares_add_up(two_links, consistency):
    rng = np.random.default_rng(42)
    feasible = FeasibleSet(two_links, consistency)
    for _ in range(5):
        base = rng.normal(size=6)
        found = explain_infeasibility(feasible, base)
        assert sum(degree.share for degree in found.degrees) == pytest.approx(1.0)
        assert sum(share for _, share in found.shares) == pytest.approx(1.0, abs=1e-3)
        assert found.distance**2 == pytest.approx(correct(feasible, base=base).squared_distance, rel=1e-3)


@pytest.mark.slow
def test_distance_in_standard_deviations_agrees_with_descent_over_factors(two_links, least_by_descent):
    rng = np.random.default_rng(43)
    feasible = FeasibleSet(two_links)
    factor = rng.normal(size=(6, 6)) + 2 * np.eye(6)
    covariance = factor @ factor.T
    whitening = np.linalg.inv(np.linalg.cholesky(covariance))
    nearest, squared = least_by_descent(feasible, lambda delta: whitening @ (feasible.K @ delta - HEAVY))
    found = explain_infeasibility(feasible, HEAVY, covariance=covariance)
    assert found.distance == pytest.approx(np.sqrt(squared), rel=1e-4)
    change = feasible.K @ nearest - HEAVY
    np.testing.assert_allclose([degree.change for degree in found.degrees], change, atol=1e-3)
    expected = change * np.linalg.solve(covariance, change) / squared
    np.testing.assert_allclose([degree.share for degree in found.degrees], expected, atol=1e-3)
    deviations = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose([d.change_in_deviations for d in found.degrees], change / deviations, atol=1e-3)
    assert found.probability == pytest.approx(scipy.stats.chi2.cdf(found.distance**2, 6))
    assert found.region == pytest.approx(np.sqrt(scipy.stats.chi2.ppf(0.95, 6)))


def test_rank_correlation_is_that_of_scipy(two_links):
    rng = np.random.default_rng(44)
    base = np.array([0.5, -0.1, 0.25, 0.3, 0.4, -0.2])
    covariance = np.diag(rng.uniform(0.01, 0.3, 6) ** 2)
    found = explain_infeasibility(FeasibleSet(two_links), base, covariance=covariance)
    relative = [degree.relative_deviation for degree in found.degrees]
    degrees = [abs(degree.change / degree.value) for degree in found.degrees]
    expected = scipy.stats.spearmanr(relative, degrees)
    assert (found.correlation, found.chance) == pytest.approx((expected.statistic, expected.pvalue))
    np.testing.assert_allclose(relative, np.sqrt(np.diag(covariance)) / np.abs(base))


def test_feasible_estimate_needs_no_explanation(two_links):
    found = explain_infeasibility(FeasibleSet(two_links), [1.5, 0.1, 0.25, 0.3, 0.4, 0.1])
    assert found.status == "feasible"
    assert found.subsystems == ()
    assert str(found).startswith("Nothing to explain")
    assert all(degree.change == degree.alone == 0.0 for degree in found.degrees)


def test_words(two_links):
    found = explain_infeasibility(FeasibleSet(two_links), HEAVY, covariance=0.01 * np.eye(6))
    sentences = found.sentences()
    assert sentences[0].startswith('The estimate is infeasible under "full" consistency: ')
    assert "cannot hold together" in sentences[0]
    assert "standard deviations away" in sentences[1]
    lines = str(found).splitlines()
    assert any(line.split()[0] == "Lzz1R" and line.endswith("Lzz1 + m2") for line in lines[len(sentences) :])
    assert "<strong>The estimate is infeasible" in found._repr_html_()
    plain = found.to_dict()
    assert plain["subsystems"][0]["value"] < plain["subsystems"][0]["threshold"]
    assert {entry["name"]: entry["alone"] for entry in plain["degrees"]}["lx2"] is None


def test_nothing_given_is_told(two_links):
    with pytest.raises(InputError, match="neither base= nor info= was given"):
        explain_infeasibility(FeasibleSet(two_links))


@pytest.mark.data
@pytest.mark.parametrize("consistency", ["inertia", "full"])
def test_culprits_of_the_wam(thesis_wam, table_4_9, consistency):
    """Table 4.9: Coulomb friction of joints 2 and 5, the rotor of joint 4, and bodies, of which some conflict in
    pairs."""
    feasible = FeasibleSet(thesis_wam, consistency)
    found = explain_infeasibility(feasible, table_4_9["WLS"])
    alone = {conflict.conditions[0]: conflict.value for conflict in found.subsystems if len(conflict.conditions) == 1}
    assert alone["joint 2: Fcj >= 0"] == pytest.approx(-0.0703)
    assert alone["joint 4: Iam >= 0"] == pytest.approx(-0.0458)
    assert alone["joint 5: Fcj >= 0"] == pytest.approx(-0.002)
    bodies = [conflict for conflict in found.subsystems if "link" in conflict.conditions[0]]
    assert bodies
    assert all("link" in name for conflict in bodies for name in conflict.conditions)
    changes = {degree.name: degree.change for degree in found.degrees}
    assert changes["Fcj2"] == pytest.approx(0.0703, abs=2e-5)
    assert changes["Iam4"] == pytest.approx(0.0458, abs=2e-5)
    squared = {"inertia": 0.00774, "full": 0.01345}[consistency]
    assert found.distance**2 == pytest.approx(squared, abs=2e-5)
    largest = [name for name, _ in found.shares[:3]]
    assert "joint 2: Fcj >= 0" in largest


@pytest.mark.data
def test_without_the_conflicts_the_wam_is_feasible(thesis_wam, table_4_9):
    """Every conflict is needed: the links alone, whose conflicts are the same, are infeasible too."""
    feasible = FeasibleSet(thesis_wam, "inertia", terms=False)
    found = explain_infeasibility(feasible, table_4_9["WLS"])
    assert check(feasible, base=table_4_9["WLS"]).status == "infeasible"
    named = {name for conflict in found.subsystems for name in conflict.conditions}
    assert named
    assert all("link" in name for name in named)


@pytest.mark.data
def test_poorly_identified_parameters_of_the_real_wam(real_wam):
    """Thesis 8.1 asks whether the poorly identified parameters are the infeasible ones: on the real WAM they are."""
    model, reduced = real_wam
    found = explain_infeasibility(FeasibleSet(model, "full"), info=reduced)
    relative = np.array([degree.relative_deviation for degree in found.degrees])
    changes = np.array([abs(degree.change / degree.value) for degree in found.degrees])
    expected = scipy.stats.spearmanr(relative, changes)
    assert found.correlation == pytest.approx(expected.statistic, abs=1e-9)
    assert found.correlation > 0.7
    assert found.chance < 1e-6
