import gc
import weakref

import numpy as np
import pytest
import scipy.optimize

from steelyard.errors import InputError, SolverError
from steelyard.estimators import fit_reduced
from steelyard.feasibility import FeasibleSet, TieBreak, TotalMass

POSSIBLE = np.array([1.5, 0.1, 0.25, 0.3, 0.4, 0.1])
IMPOSSIBLE = np.array([0.5, 0.1, 0.25, 0.3, 0.4, 0.05])


@pytest.fixture
def data(reduced_regression):
    """Reduced regressions with a given unconstrained optimum and a given residual."""

    def make(optimum, residual2=2.0, singular=0):
        rng = np.random.default_rng(12)
        R = np.triu(rng.normal(size=(6, 6))) + 3 * np.eye(6)
        if singular:
            left, values, right = np.linalg.svd(R)
            values[-singular:] = 0.0
            R = left * values @ right
        rho = R @ optimum
        return reduced_regression(R, rho, residual2, 1000, residual2 + float(rho @ rho))

    return make


def optimum_by_hand(data, margin):
    """The least residual over base parameters only: Lzz1 + m2 = a, Lzz2 = b with (a - ε)(b - ...) from the 6 x 6 block.

    Under "inertia" with Lzz1 = ε: m2 = a - ε; the block of link 2 less ε needs (b - ε)(a - 2 ε) ≥ lx² + ly².
    """

    def residual(base):
        return float(np.sum((data.R @ base - data.rho) ** 2))

    cone = {
        "type": "ineq",
        "fun": lambda base: (base[2] - margin) * (base[0] - 2 * margin) - base[3] ** 2 - base[4] ** 2,
    }
    bounds = [(2 * margin, None), (margin, None), (margin, None), (None, None), (None, None), (margin, None)]
    found = scipy.optimize.minimize(
        residual, POSSIBLE, bounds=bounds, constraints=[cone], method="SLSQP", options={"ftol": 1e-14, "maxiter": 500}
    )
    assert found.success
    return found.x, float(found.fun)


@pytest.mark.parametrize("prefer", ["lightest", None])
def test_agrees_with_nonlinear_programming(two_links, data, prefer):
    reduced = data(IMPOSSIBLE)
    feasible = FeasibleSet(two_links, "inertia")
    expected, squared = optimum_by_hand(reduced, feasible.margin)
    fit = fit_reduced(reduced, feasible, prefer, residual_slack=0.0)
    assert fit.squared_residual == pytest.approx(squared + 2.0, rel=1e-6)
    np.testing.assert_allclose(fit.base, expected, atol=1e-3)
    assert fit.attained


@pytest.mark.parametrize("residual2", [0.0, 2.0])
@pytest.mark.parametrize("prefer", ["lightest", None])
def test_feasible_optimum_is_kept(two_links, data, prefer, residual2):
    fit = fit_reduced(data(POSSIBLE, residual2), FeasibleSet(two_links), prefer)
    np.testing.assert_allclose(fit.base, POSSIBLE, atol=1e-4)
    assert fit.squared_residual == pytest.approx(residual2, abs=1e-6)


def test_every_answer_is_proved_feasible(two_links, data):
    rng = np.random.default_rng(13)
    for consistency in ("inertia", "full"):
        feasible = FeasibleSet(two_links, consistency)
        for _ in range(3):
            fit = fit_reduced(data(rng.normal(size=6)), feasible)
            assert feasible.contains(fit.parameters)
            np.testing.assert_allclose(feasible.K @ fit.parameters, fit.base, rtol=1e-12)
            assert fit.squared_residual >= fit.unconstrained_squared_residual


def test_lightest_is_lighter_than_the_raw_answer(two_links, data):
    feasible = FeasibleSet(two_links)
    raw = fit_reduced(data(POSSIBLE), feasible, None)
    light = fit_reduced(data(POSSIBLE), feasible)
    # The forearm weighs at least (lx² + ly²) / Lzz = 1 kg; the upper arm nothing.
    assert light.total_mass == pytest.approx(1.0, rel=0.05)
    assert raw.total_mass > light.total_mass
    assert any("this is the lightest" in remark for remark in light.remarks)


def test_unattained_optimum_is_said(stand_in, reduced_regression):
    """x = lx1 wants 1, y = Lzz1 wants 0: Lzz1 m1 ≥ lx1² lets the residual fall for ever as m1 grows."""
    names = ["Lxx1", "Lxy1", "Lxz1", "Lyy1", "Lyz1", "Lzz1", "lx1", "ly1", "lz1", "m1"]
    model = stand_in(names, [[(1.0, "Lzz1")], [(1.0, "lx1")]], ("arm",))
    rho = np.array([0.0, 1.0])
    fit = fit_reduced(reduced_regression(np.eye(2), rho, 0.01, 100, 1.01), FeasibleSet(model), residual_slack=1e-2)
    assert not fit.attained
    assert fit.remarks[0].startswith(f"No optimum below {fit.mass_bound:.4g} kg")
    assert 100 < fit.mass_bound < 1000
    # lx1 is about 1 and Lzz1 about 1 / m1, so that the squared residual is about 0.01 + 1 / m1²; 1 % more is allowed.
    allowed = 1.01 * (0.01 + 1 / fit.mass_bound**2)
    assert fit.total_mass == pytest.approx(1 / np.sqrt(allowed - 0.01), rel=0.02)
    raw = fit_reduced(reduced_regression(np.eye(2), rho, 0.01, 100, 1.01), FeasibleSet(model), None)
    assert raw.total_mass == pytest.approx(raw.mass_bound, rel=1e-2)
    bounded = FeasibleSet(model, constraints=[TotalMass(maximum=20.0)])
    assert fit_reduced(reduced_regression(np.eye(2), rho, 0.01, 100, 1.01), bounded).attained


@pytest.mark.parametrize("singular", [1, 3, 6])
def test_data_that_does_not_determine_everything(two_links, data, singular):
    reduced = data(POSSIBLE, singular=singular)
    if singular == 6:
        reduced = type(reduced)(reduced.R, reduced.rho, 2.0, 1000, 2.0)
    fit = fit_reduced(reduced, FeasibleSet(two_links))
    assert fit.squared_residual == pytest.approx(2.0, rel=1e-5)
    assert np.abs(fit.parameters).max() < 10


def test_closest_to_cad(stand_in, data, point_cloud_parameters, inertial_symbols):
    rng = np.random.default_rng(14)
    cad = np.full(22, np.nan)
    cad[:10] = point_cloud_parameters(np.full(8, 0.5), 0.2 * rng.normal(size=(8, 3)))
    cad[11:21] = point_cloud_parameters(np.full(8, 0.4), 0.3 * rng.normal(size=(8, 3)))
    names = [f"{s}{i}" for i in (1, 2) for s in (*inertial_symbols, "Fvj")]
    combinations = [[(1.0, "Lzz1"), (1.0, "m2")], [(1.0, "Fvj1")], [(1.0, "Lzz2")], [(1.0, "lx2")], [(1.0, "ly2")]]
    combinations.append([(1.0, "Fvj2")])
    model = stand_in(names, combinations, ("upper arm", "forearm"), ("Fvj",), cad)
    truth = np.where(np.isnan(cad), 0.3, cad)
    fit = fit_reduced(data(FeasibleSet(model).K @ truth), FeasibleSet(model), "cad")
    np.testing.assert_allclose(fit.parameters, truth, atol=2e-3)
    assert any("closest to CAD" in remark for remark in fit.remarks)


def test_bad_options_are_refused(two_links, data, reduced_regression):
    feasible, reduced = FeasibleSet(two_links), data(POSSIBLE)
    with pytest.raises(InputError, match='"lightest", "cad" or None'):
        fit_reduced(reduced, feasible, "heaviest")
    with pytest.raises(InputError, match="needs inertial parameters in the robot description"):
        fit_reduced(reduced, feasible, "cad")
    with pytest.raises(InputError, match="residual_slack must be a number of at least 0"):
        fit_reduced(reduced, feasible, residual_slack=-1.0)
    with pytest.raises(InputError, match="belongs to another model"):
        fit_reduced(reduced_regression(np.eye(5), np.ones(5), 1.0, 10, 6.0), feasible)
    contradiction = FeasibleSet(two_links, constraints=[TotalMass(maximum=1.0), TotalMass(minimum=2.0)])
    with pytest.raises(SolverError, match="loosen the constraints"):
        fit_reduced(reduced, contradiction)


def test_robots_of_tonnes_have_room(two_links, data):
    feasible = FeasibleSet(two_links, constraints=[TotalMass(equal=3000.0)])
    fit = fit_reduced(data(POSSIBLE), feasible)
    assert fit.total_mass == pytest.approx(3000.0)
    assert fit.mass_bound >= 3000.0


def optimum_below(data, margin, bound):
    """The same with a total mass of at most `bound`, m2 an unknown, too, and m1 at its margin.

    What must not be negative is a square, so that only the range of m2 is left to keep to.
    """

    def base(x):
        mass, spare, friction, inertia, lx, ly, last = x
        needed = (lx**2 + ly**2) / (mass - margin)
        return np.array([mass + margin + spare**2, margin + friction**2, margin + needed + inertia**2, lx, ly, 0.0]) + (
            np.eye(6)[5] * (margin + last**2)
        )

    low, high = [2 * margin, *[-np.inf] * 6], [bound - margin, *[np.inf] * 6]
    runs = [
        scipy.optimize.least_squares(
            lambda x: data.R @ base(x) - data.rho,
            [part * bound, 0.5, 0.3, 0.5, 0.2, 0.2, 0.3],
            bounds=(low, high),
            xtol=1e-15,
            ftol=1e-15,
            gtol=1e-12,
            max_nfev=5000,
        )
        for part in (0.5, 0.9)
    ]
    best = min(runs, key=lambda run: run.cost)
    return base(best.x), 2 * best.cost


@pytest.mark.parametrize("bound", [pytest.param(0.3, marks=pytest.mark.slow), 0.6])
def test_bounded_mass_gives_the_exact_optimum_with_default_options(two_links, data, bound):
    """Nothing is spent on the tie-break, though plain least squares is far from possible."""
    reduced = data(np.array([1.5, 0.1, 0.25, 0.6, 0.8, 0.05]))
    feasible = FeasibleSet(two_links, "inertia", [TotalMass(maximum=bound)], margin=1e-8)
    expected, squared = optimum_below(reduced, feasible.margin, bound)
    known = TieBreak.closest(np.ones(22), np.ones(22))
    for prefer in ("lightest", None, known):
        fit = fit_reduced(reduced, feasible, prefer)
        assert fit.squared_residual == pytest.approx(squared + 2.0, rel=1e-6)
        np.testing.assert_allclose(fit.base, expected, atol=1e-4)
        assert fit.exact
        assert fit.growing_links == ()
        assert fit.mass_bound == np.inf


def test_preference_moves_only_what_the_motion_does_not_show(two_links, data):
    reduced = data(np.array([1.5, 0.1, 0.25, 0.6, 0.8, 0.05]))
    feasible = FeasibleSet(two_links, "full", [TotalMass(maximum=3.0)])
    light = fit_reduced(reduced, feasible)
    target = np.full(22, 0.5)
    near = fit_reduced(reduced, feasible, TieBreak.closest(target, np.ones(22), "nearest to a half"))
    np.testing.assert_allclose(light.base, near.base, atol=1e-7)
    assert np.sum((near.parameters - target) ** 2) < np.sum((light.parameters - target) ** 2)
    assert light.total_mass < near.total_mass
    assert any("this is nearest to a half" in remark for remark in near.remarks)
    assert any(f"No robot lighter than {light.total_mass:.3g} kg" in remark for remark in light.remarks)


def test_near_equals_only_where_masses_may_grow(two_links, data):
    """Without a bound the tolerance is spent, and the answer says on what."""
    reduced = data(IMPOSSIBLE)
    free, best = FeasibleSet(two_links), fit_reduced(data(IMPOSSIBLE), FeasibleSet(two_links), residual_slack=0.0)
    fit = fit_reduced(reduced, free, residual_slack=1e-2)
    assert fit.growing_links == ("upper arm",)
    assert not fit.exact
    assert 1 + 0.9e-2 < fit.squared_residual / best.squared_residual < 1 + 1.1e-2
    assert fit.total_mass < best.total_mass
    assert any("Among all answers within 1 % of the least squared residual" in remark for remark in fit.remarks)
    bounded = FeasibleSet(two_links, constraints=[TotalMass(maximum=50.0)])
    assert fit_reduced(reduced, bounded, residual_slack=1e-2).squared_residual == pytest.approx(
        best.squared_residual, rel=1e-6
    )


def test_answers_do_not_depend_on_the_unit_of_mass(two_links, data):
    """A thousandth of all masses and torques gives a thousandth of all parameters."""
    reduced = data(IMPOSSIBLE)
    for size in (1e-3, 1e3):
        scaled = type(reduced)(
            reduced.R, size * reduced.rho, size**2 * reduced.residual2, reduced.count, size**2 * reduced.norm2
        )
        feasible = FeasibleSet(two_links, constraints=[TotalMass(maximum=2.0 * size)])
        fit = fit_reduced(scaled, feasible)
        usual = fit_reduced(reduced, FeasibleSet(two_links, constraints=[TotalMass(maximum=2.0)]))
        np.testing.assert_allclose(fit.base / size, usual.base, atol=1e-4)


@pytest.mark.usefixtures("other_objects_aside")
def test_what_is_kept_for_a_set_dies_with_it(two_links, data):
    feasible = FeasibleSet(two_links)
    fit_reduced(data(IMPOSSIBLE), feasible)
    known = weakref.ref(feasible)
    del feasible
    gc.collect()
    assert known() is None
