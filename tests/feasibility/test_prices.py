"""What conditions cost, against fits by hand, finite differences and the published optima of the real WAM."""

import json

import numpy as np
import pytest
import scipy.optimize

from steelyard.errors import InputError, SolverError
from steelyard.estimators.shadow_prices import shadow_prices
from steelyard.feasibility import FeasibleSet, TotalMass
from steelyard.regression import Information

# a = Lzz1 + m2, friction, b = Lzz2, lx2, ly2, friction of an arm of two parallel axes; see test_intervals.py.
POSSIBLE = np.array([1.5, 0.1, 0.25, 0.3, 0.4, 0.1])


def data_of(reduced_regression, base, R=None, residual2=1.0):
    R = np.eye(6) if R is None else R
    rho = R @ base
    return reduced_regression(R, rho, residual2, 1000, residual2 + float(rho @ rho))


def test_negative_friction_costs_its_square(two_links, reduced_regression):
    base = POSSIBLE.copy()
    base[5] = -0.2
    reduced = data_of(reduced_regression, base)
    feasible = FeasibleSet(two_links, margin=1e-9)
    found = shadow_prices(reduced, feasible)
    price = found["joint 2: Fvj >= 0"]
    assert price.active
    assert price.squared_saving == pytest.approx(0.04, rel=1e-4)
    assert found.squared_residual == pytest.approx(1.04, rel=1e-6)
    assert price.saving == pytest.approx(1 - np.sqrt(1 / 1.04), rel=1e-4)
    # d sqrt(1 + (0.2 - r)²) / dr at r = 0, relative.
    assert price.marginal == pytest.approx(0.2 / 1.04, rel=1e-4)
    assert [other.name for other in found.active] == ["joint 2: Fvj >= 0"]
    assert found["all terms"].squared_saving == pytest.approx(0.04, rel=1e-4)
    assert found["all links"].squared_saving == pytest.approx(0.0, abs=1e-6)
    assert found["triangle inequality"].squared_saving == pytest.approx(0.0, abs=1e-6)


def test_feasible_data_costs_nothing(two_links, reduced_regression):
    found = shadow_prices(data_of(reduced_regression, POSSIBLE), FeasibleSet(two_links))
    assert found.active == ()
    assert found.relative_error == pytest.approx(found.least_squares_error, rel=1e-9)
    assert all(price.squared_saving == pytest.approx(0.0, abs=1e-6) for price in (*found.groups, *found.prices))


def test_bodies_that_conflict_agree_with_nonlinear_programming(two_links, reduced_regression):
    """(lx² + ly²) / b ≤ a: dropping either body mends it, so that both are priced alike."""
    rng = np.random.default_rng(51)
    R = np.triu(rng.normal(size=(6, 6))) + 3 * np.eye(6)
    base = np.array([0.5, 0.1, 0.25, 0.3, 0.4, 0.1])
    reduced = data_of(reduced_regression, base, R)
    found = shadow_prices(reduced, FeasibleSet(two_links, "inertia", margin=1e-9))

    def residual(unknowns):
        return float(np.sum((R @ unknowns - reduced.rho) ** 2)) + reduced.residual2

    cone = {"type": "ineq", "fun": lambda x: x[0] * x[2] - x[3] ** 2 - x[4] ** 2}
    bounds = [(0, None), (0, None), (0, None), (None, None), (None, None), (0, None)]
    expected = scipy.optimize.minimize(
        residual, POSSIBLE, bounds=bounds, constraints=[cone], method="SLSQP", options={"ftol": 1e-14, "maxiter": 500}
    )
    assert expected.success
    assert found.squared_residual == pytest.approx(expected.fun, rel=1e-6)
    for name in ("link 1 (upper arm): inertia", "link 2 (forearm): inertia", "all links"):
        assert found[name].squared_saving == pytest.approx(expected.fun - 1.0, rel=1e-4)


def test_marginal_price_is_the_slope(two_links, reduced_regression):
    """Of a bound on the mass of the forearm: by finite differences of the fit."""
    reduced = data_of(reduced_regression, POSSIBLE, 3 * np.eye(6))

    def at(bound):
        return shadow_prices(reduced, FeasibleSet(two_links, constraints=[TotalMass(maximum=bound, links=["forearm"])]))

    found = at(0.8)
    price = found["mass of forearm <= 0.8 kg"]
    assert price.unit == "kg"
    assert price.active
    step = 1e-3
    slope = (at(0.8 - step).relative_error - at(0.8 + step).relative_error) / (2 * step)
    assert price.marginal * found.relative_error == pytest.approx(slope, rel=1e-3)
    assert found.prices[0].squared_saving >= found.prices[-1].squared_saving


def test_unattained_optimum_is_told(stand_in, reduced_regression):
    """x = lx1 wants 1, y = Lzz1 wants 0: the residual falls for ever as m1 grows."""
    names = ["Lxx1", "Lxy1", "Lxz1", "Lyy1", "Lyz1", "Lzz1", "lx1", "ly1", "lz1", "m1"]
    model = stand_in(names, [[(1.0, "Lzz1")], [(1.0, "lx1")]], ("arm",))
    reduced = reduced_regression(np.eye(2), np.array([0.0, 1.0]), 0.01, 100, 1.01)
    found = shadow_prices(reduced, FeasibleSet(model))
    assert found.stopped_by_bound
    assert f"at its bound of {found.mass_bound:g} kg" in str(found)
    assert found.optimality_gap < 2e-6
    lower = shadow_prices(reduced, FeasibleSet(model), mass_bound=10.0)
    assert lower.mass_bound == 10.0
    # Lzz1 m1 ≥ lx1²: minimise (lx1²/10)² + (lx1 - 1)².
    best = scipy.optimize.minimize_scalar(
        lambda x: (x**2 / 10) ** 2 + (x - 1) ** 2, bounds=(0, 2), method="bounded"
    ).fun
    assert lower.squared_residual == pytest.approx(0.01 + best, rel=1e-4)


def test_data_without_noise(two_links, reduced_regression):
    found = shadow_prices(data_of(reduced_regression, POSSIBLE, residual2=0.0), FeasibleSet(two_links))
    assert found.active == ()
    assert found.sentences()[0].endswith("raises the relative error from 0 % to 0 %.")


def test_information_and_its_weights(two_links):
    base = POSSIBLE.copy()
    base[1] = -0.3
    info = Information.from_factor(np.eye(6), base, 0.5, 100, [f"base {i}" for i in range(6)])
    found = shadow_prices(info, FeasibleSet(two_links))
    assert found["joint 1: Fvj >= 0"].squared_saving == pytest.approx(0.09, rel=1e-4)
    assert found.least_squares_error == pytest.approx(np.sqrt(0.5 / (0.5 + base @ base)))


def test_words(two_links, reduced_regression):
    base = POSSIBLE.copy()
    base[5] = -0.2
    found = shadow_prices(data_of(reduced_regression, base), FeasibleSet(two_links))
    assert "1 of 4 conditions are active." in found.sentences()
    assert any(line.endswith("joint 2: Fvj >= 0") for line in str(found).splitlines())
    assert "<td>joint 2: Fvj &gt;= 0</td>" in found._repr_html_()
    plain = found.to_dict()
    assert next(p for p in plain["prices"] if p["active"])["squared_saving"] == pytest.approx(0.04, rel=1e-4)
    with pytest.raises(InputError, match="no price of 'link 9'"):
        found["link 9"]


def test_bad_arguments_are_told(two_links, reduced_regression):
    feasible = FeasibleSet(two_links)
    with pytest.raises(InputError, match="belongs to another model"):
        shadow_prices(reduced_regression(np.eye(5), np.ones(5), 1.0, 10, 6.0), feasible)
    with pytest.raises(InputError, match="mass_bound must be a positive number"):
        shadow_prices(data_of(reduced_regression, POSSIBLE), feasible, mass_bound=-1.0)
    with pytest.raises(InputError, match="must be an Information"):
        shadow_prices(3.0, feasible)
    contradiction = FeasibleSet(two_links, constraints=[TotalMass(maximum=1.0), TotalMass(minimum=2.0)])
    with pytest.raises(SolverError, match="loosen the constraints"):
        shadow_prices(data_of(reduced_regression, POSSIBLE), contradiction)


@pytest.mark.slow
def test_weak_excitation_does_not_decide_the_prices(two_links, reduced_regression):
    """Plain least squares lies far out along what the data hardly shows; CVXPY tells every optimum."""
    cvxpy = pytest.importorskip("cvxpy", reason="CVXPY (the oracle) is not installed")
    rng = np.random.default_rng(7)
    left, right = (np.linalg.qr(rng.normal(size=(6, 6)))[0] for _ in range(2))
    R = left @ np.diag(np.logspace(2, -4, 6)) @ right
    rho = R @ POSSIBLE + 0.03 * rng.normal(size=6)
    reduced = reduced_regression(np.linalg.qr(R)[1], np.linalg.qr(R)[0].T @ rho, 1e-3, 1000, 1e-3 + float(rho @ rho))
    feasible = FeasibleSet(two_links, "inertia", margin=1e-9)
    found = shadow_prices(reduced, feasible, mass_bound=50.0)

    def optimum(without):
        """δ scaled by nothing, every block as it stands in the set."""
        delta = cvxpy.Variable(feasible.parameter_count)
        rules = [cvxpy.sum(delta[feasible.mass_indices]) <= 50.0]
        if without is not None:
            others = [i for i in feasible.mass_indices if i not in feasible.blocks[without].indices]
            rules = [cvxpy.sum(delta[others]) <= 50.0]
        for index, block in enumerate(feasible.blocks):
            if index != without:
                matrix = sum(
                    (delta[i] * c for i, c in zip(block.indices, block.coefficients, strict=True)), start=block.constant
                )
                rules.append(matrix >> 0 if block.size > 1 else matrix[0, 0] >= 0)
        problem = cvxpy.Problem(cvxpy.Minimize(cvxpy.sum_squares(R @ (feasible.K @ delta) - rho)), rules)
        problem.solve(solver="CLARABEL", tol_gap_abs=1e-11, tol_gap_rel=1e-11, tol_feas=1e-11)
        return problem.value + 1e-3

    whole = optimum(None)
    assert found.squared_residual == pytest.approx(whole, rel=1e-5)
    assert found.optimality_gap < 2e-6
    assert found.active
    for price in found.active:
        index = [block.name for block in feasible.blocks].index(price.name)
        assert price.squared_saving == pytest.approx(whole - optimum(index), abs=1e-5 * whole)


@pytest.mark.data
def test_prices_of_the_real_wam(real_wam, shared_data):
    """Friction signs and the triangle inequality cost what independent optima of the three problems differ by."""
    model, reduced = real_wam
    published = json.loads((shared_data / "wam7" / "iros2013_independent_optima_clarabel.json").read_text())
    links, terms, triangle = (published[key]["u"] for key in PUBLISHED)
    inertia = shadow_prices(reduced, FeasibleSet(model, "inertia"))
    # The published optima scatter by 1, and have no bound on the mass.
    assert inertia["all terms"].squared_saving == pytest.approx(terms - links, abs=2.0)
    assert inertia["all terms"].squared_saving == pytest.approx(61699.62 - 61647.79, abs=2.0)
    assert inertia["joint 5: fc >= 0"].squared_saving == pytest.approx(terms - links, abs=2.0)
    full = shadow_prices(reduced, FeasibleSet(model, "full"))
    assert full["triangle inequality"].squared_saving == pytest.approx(triangle - terms, abs=3.0)
    assert full.least_squares_error == pytest.approx(0.0561657801, abs=1e-9)
    assert full.stopped_by_bound
    assert {price.name for price in full.active} >= {f"link {i} (link{i}): inertia" for i in (3, 4, 5, 6, 7)}


PUBLISHED = (
    "paper (semi-physical, no friction sign)",
    "correct (semi-physical, fv,fc>=0)",
    "physical (pseudo-inertia, fv,fc>=0)",
)
