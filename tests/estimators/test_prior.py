"""Fits with a prior, against quasi-Newton minimisation over Cholesky factors, which are always possible."""

import numpy as np
import pytest
import scipy.linalg
import scipy.optimize

from steelyard.errors import InputError
from steelyard.estimators import ConstantPullbackPrior, EntropicPrior, EuclideanPrior, fit_reduced
from steelyard.estimators.fitting_problems import WarmFit
from steelyard.estimators.plausible_fit import PriceOfPlausibility
from steelyard.feasibility import FeasibleSet, TieBreak, TotalMass

ROW, COLUMN = np.tril_indices(4)
OPTIMUM = np.array([0.5, 0.1, 0.25, 0.3, 0.4, -0.05])


def pseudo_inertia(body):
    xx, xy, xz, yy, yz, zz, lx, ly, lz, m = body
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    P = np.empty((4, 4))
    P[:3, :3] = np.trace(tensor) / 2 * np.eye(3) - tensor
    P[:3, 3] = P[3, :3] = lx, ly, lz
    P[3, 3] = m
    return P


def parameters(P):
    tensor = np.trace(P[:3, :3]) * np.eye(3) - P[:3, :3]
    return np.array([*tensor[np.triu_indices(3)], *P[:3, 3], P[3, 3]])


def entropic(P, P0):
    """Divergence of the paper, by eigenvalues of the pencil."""
    eigenvalues = scipy.linalg.eigh(P, P0, eigvals_only=True)
    return float(np.sum(eigenvalues - np.log(eigenvalues) - 1))


def pullback(P, P0):
    """Half the trace of the square, by a square root of P0."""
    root = np.real(scipy.linalg.sqrtm(np.linalg.inv(P0)))
    return 0.5 * float(np.sum((root @ (P - P0) @ root) ** 2))


def euclidean(P, P0):
    body, known = parameters(P), parameters(P0)
    radius = np.sqrt((known[0] + known[3] + known[5]) / (2 * known[9]))
    units = known[9] * radius ** np.array([2, 2, 2, 2, 2, 2, 1, 1, 1, 0])
    return 0.5 * float(np.sum(((body - known) / units) ** 2))


DISTANCES = {EntropicPrior: entropic, ConstantPullbackPrior: pullback, EuclideanPrior: euclidean}


@pytest.fixture
def data(reduced_regression):
    rng = np.random.default_rng(12)
    R = np.triu(rng.normal(size=(6, 6))) + 3 * np.eye(6)
    rho = R @ OPTIMUM
    return reduced_regression(R, rho, 2.0, 1000, 2.0 + float(rho @ rho))


@pytest.fixture
def known(point_cloud_parameters):
    """Two bodies of points; the friction of joint 1 is known, that of joint 2 is not."""
    rng = np.random.default_rng(13)
    bodies = [point_cloud_parameters(rng.uniform(0.1, 0.5, 8), 0.3 * rng.normal(size=(8, 3))) for _ in range(2)]
    return np.array([*bodies[0], 0.2, *bodies[1], np.nan])


def expected(data, K, known, distance, weight):
    """Least ½ residual / variance + weight · distance, over P = L Lᵀ and squares of friction."""
    variance = data.residual2 / (data.count - 6)
    references = [pseudo_inertia(known[:10]), pseudo_inertia(known[11:21])]

    def unpack(x):
        bodies = []
        for part in (x[:10], x[10:20]):
            factor = np.zeros((4, 4))
            factor[ROW, COLUMN] = part
            bodies.append(factor @ factor.T)
        return bodies, x[20:] ** 2

    def value(x):
        bodies, friction = unpack(x)
        delta = np.array([*parameters(bodies[0]), friction[0], *parameters(bodies[1]), friction[1]])
        error = data.R @ (K @ delta) - data.rho
        total = sum(distance(P, P0) for P, P0 in zip(bodies, references, strict=True))
        total += 0.5 * ((friction[0] - 0.2) / 0.2) ** 2
        return 0.5 * (float(error @ error) + data.residual2) / variance + weight * total

    start = [np.linalg.cholesky(P)[ROW, COLUMN] for P in references]
    x = np.array([*start[0], *start[1], 0.4, 0.3])
    for _ in range(3):
        found = scipy.optimize.minimize(value, x, method="BFGS", options={"gtol": 1e-7, "maxiter": 5000})
        done = value(x) - found.fun < 1e-9 * abs(found.fun)
        x = found.x
        if done:
            break
    bodies, friction = unpack(x)
    return found.fun, np.array([*parameters(bodies[0]), friction[0], *parameters(bodies[1]), friction[1]])


WEIGHTS = [0.1, 30.0, 1e4]


@pytest.mark.slow
@pytest.mark.parametrize("weight", WEIGHTS)
@pytest.mark.parametrize("prior", DISTANCES)
def test_agrees_with_unconstrained_minimisation(two_links, data, known, prior, weight):
    feasible = FeasibleSet(two_links, margin=1e-9)
    fit = fit_reduced(data, feasible, prior=prior(known), prior_weight=weight)
    least, parameters_ = expected(data, feasible.K, known, DISTANCES[prior], weight)
    variance = data.residual2 / (data.count - 6)
    value = 0.5 * fit.squared_residual / variance + weight * fit.prior_distance
    assert value == pytest.approx(least, rel=2e-6)
    np.testing.assert_allclose(fit.parameters, parameters_, atol=2e-3)
    assert fit.statuses == ("Solved",)
    assert fit.exact
    assert fit.growing_links == ()


@pytest.mark.parametrize("prior", [EntropicPrior, ConstantPullbackPrior])
@pytest.mark.parametrize("weight", [1.0, pytest.param(1e3, marks=pytest.mark.slow)])
def test_the_default_is_the_optimum_of_cvxpy_to_eight_digits(random_arm, prior, weight):
    """Links whose prior is half of the truth, and friction that it does not know but holds near zero."""
    cvxpy = pytest.importorskip("cvxpy")
    model, truth, info = random_arm(21, 3, (1.0, 5.0), (0.3, 0.6), 0.05)
    feasible = FeasibleSet(model, margin=1e-9)
    columns = feasible.link_columns
    known, deviations = np.full(len(truth), np.nan), np.full(len(truth), 0.5)
    known[columns] = 0.5 * truth[columns]
    reduced = info.reduced("joint")
    near = prior(known, term_deviations=deviations)
    fit = fit_reduced(reduced, feasible, prior=near, prior_weight=weight)

    variance = reduced.residual2 / (reduced.count - info.base_count)
    delta = cvxpy.Variable(len(truth))
    terms = np.setdiff1d(np.arange(len(truth)), columns)
    R, rho = reduced.R / np.sqrt(variance), reduced.rho / np.sqrt(variance)
    objective = 0.5 * cvxpy.sum_squares(R @ feasible.K @ delta - rho)
    objective += 0.5 * cvxpy.sum_squares(delta[terms] / deviations[terms])
    conditions = [delta[terms] >= feasible.margin]
    basis = np.array([pseudo_inertia(row) for row in np.eye(10)])
    for own in columns:
        root = np.linalg.inv(np.linalg.cholesky(pseudo_inertia(known[own])))
        P = sum(delta[int(k)] * (root @ basis[i] @ root.T) for i, k in enumerate(own))
        if prior is EntropicPrior:
            objective += weight * (cvxpy.trace(P) - cvxpy.log_det(P) - 4)
        else:
            objective += weight * 0.5 * cvxpy.sum_squares(P - np.eye(4))
            conditions.append(sum(delta[int(k)] * basis[i] for i, k in enumerate(own)) >> feasible.margin * np.eye(4))
    problem = cvxpy.Problem(cvxpy.Minimize(objective), conditions)
    problem.solve("CLARABEL", tol_gap_abs=1e-12, tol_gap_rel=1e-12, tol_feas=1e-12, max_iter=200)
    expected_base = feasible.K @ delta.value
    assert np.abs(fit.base - expected_base).max() < 1e-8 * np.abs(expected_base).max()


@pytest.mark.parametrize("prior", DISTANCES)
def test_distances_are_those_of_the_definitions(two_links, known, prior, point_cloud_parameters):
    rng = np.random.default_rng(14)
    bodies = [point_cloud_parameters(rng.uniform(0.1, 0.5, 8), 0.3 * rng.normal(size=(8, 3))) for _ in range(2)]
    delta = np.array([*bodies[0], 0.3, *bodies[1], 7.0])
    total = sum(
        DISTANCES[prior](pseudo_inertia(body), pseudo_inertia(reference))
        for body, reference in zip(bodies, (known[:10], known[11:21]), strict=True)
    )
    total += 0.5 * ((0.3 - 0.2) / 0.2) ** 2
    assert prior(known).distance(FeasibleSet(two_links), delta) == pytest.approx(total, rel=1e-9)


@pytest.mark.parametrize("prior", [EntropicPrior, ConstantPullbackPrior])
def test_distances_do_not_depend_on_frames_or_units(two_links, known, prior, point_cloud_parameters):
    """Points moved, turned and scaled together keep their distance, since every frame sees the same bodies."""
    rng = np.random.default_rng(15)
    masses, points = rng.uniform(0.1, 1, (4, 8)), rng.normal(size=(4, 8, 3))
    turned = 3.0 * points @ np.linalg.qr(rng.normal(size=(3, 3)))[0] + [0.3, -0.2, 1.0]
    feasible = FeasibleSet(two_links)
    distances = []
    for place in (points, turned):
        bodies = [point_cloud_parameters(m, p) for m, p in zip(masses, place, strict=True)]
        reference = np.array([*bodies[0], 0.2, *bodies[1], np.nan])
        distances.append(prior(reference).distance(feasible, np.array([*bodies[2], 0.2, *bodies[3], 0.0])))
    assert distances[1] == pytest.approx(distances[0], rel=1e-9)


def test_entropy_is_infinite_without_mass(two_links, known):
    delta = known.copy()
    delta[np.isnan(delta)] = 1.0
    delta[20] = -1.0
    assert EntropicPrior(known).distance(FeasibleSet(two_links), delta) == np.inf


def test_conditions_and_constraints_hold_beside_a_prior(two_links, data, known):
    free = fit_reduced(data, FeasibleSet(two_links), prior=EntropicPrior(known), prior_weight=10.0)
    bound = 0.8 * free.total_mass
    feasible = FeasibleSet(two_links, constraints=[TotalMass(maximum=bound)])
    fit = fit_reduced(data, feasible, prior=EntropicPrior(known), prior_weight=10.0)
    assert fit.total_mass == pytest.approx(bound, rel=1e-4)
    assert feasible.contains(fit.parameters)
    inertia = FeasibleSet(two_links, "inertia")
    assert inertia.contains(fit_reduced(data, inertia, prior=ConstantPullbackPrior(known)).parameters)


@pytest.mark.parametrize("prefer", [*DISTANCES, None])
def test_priors_choose_among_equals(two_links, reduced_regression, known, prefer):
    """Feasible least squares keep their base parameters; what the motion does not show is nearest to the prior."""
    feasible = FeasibleSet(two_links)
    truth = np.where(np.isnan(known), 0.3, known)
    base = feasible.K @ truth
    data = reduced_regression(10 * np.eye(6), 10 * base, 2.0, 1000, 2.0 + float(base @ base) * 100)
    chosen = TieBreak.closest(truth, np.ones(22)) if prefer is None else prefer(truth)
    fit = fit_reduced(data, feasible, chosen)
    np.testing.assert_allclose(fit.base, base, rtol=1e-7)
    np.testing.assert_allclose(fit.parameters, truth, atol=2e-3)


def test_impossible_priors_are_refused(two_links, data, known):
    feasible = FeasibleSet(two_links)

    def refused(prior, match, among=feasible):
        with pytest.raises(InputError, match=match):
            fit_reduced(data, among, prior=prior)

    refused(EntropicPrior(), r"the robot description has no inertial parameters for link 1 \(upper arm\); give par")
    refused(EntropicPrior(known), 'needs a FeasibleSet with consistency="full", got', FeasibleSet(two_links, "inertia"))
    thin = known.copy()
    thin[11:17] = [2.0, 0.0, 0.0, 0.1, 0.0, 0.1]
    refused(EntropicPrior(thin), r"link 2 \(forearm\) belongs to no body with positive density")
    refused(ConstantPullbackPrior(thin), "use EuclideanPrior")
    assert fit_reduced(data, feasible, prior=EuclideanPrior(thin)).exact
    flat = known.copy()
    flat[:10] = [0.2, 0.0, 0.0, 0.1, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0]
    refused(EntropicPrior(flat), r"link 1 \(upper arm\) is flat")
    massless = known.copy()
    massless[9] = 0.0
    refused(EuclideanPrior(massless), r"link 1 \(upper arm\) has a mass of 0 kg")
    refused(EuclideanPrior(known[:5]), "must hold the model's 22 standard parameters")


def test_bad_preferences_are_refused(two_links, data):
    with pytest.raises(InputError, match="of 3 parameters, but the model has 22"):
        fit_reduced(data, FeasibleSet(two_links), TieBreak.closest(np.ones(3), np.ones(3)))
    with pytest.raises(InputError, match="symmetric and positive semidefinite"):
        TieBreak.closest(np.ones(2), [[1.0, 2.0], [2.0, 1.0]])
    with pytest.raises(InputError, match="got shapes"):
        TieBreak.closest(np.ones(2), np.ones(3))
    with pytest.raises(InputError, match="finite parameters and a finite metric"):
        TieBreak.closest([1.0, np.nan], np.ones(2))


@pytest.mark.parametrize(
    ("without", "said"), [(0.02011, "as much as without"), (0.0195, "2.01% of the torques unexplained on the data")]
)
def test_the_price_of_a_prior_is_one_where_it_shows(without: float, said: str) -> None:
    one = np.ones(1)
    price = PriceOfPlausibility(one, 0.02013 * one, 0.03 * one, 0, 0, without, 0.019, 0.04)
    assert said in price.sentence
    assert ("1.95% without a prior" in price.sentence) == (without < 0.02)
    assert price.sentence.count("2.01%") == 1


@pytest.mark.slow
def test_a_search_from_within_goes_on_from_the_edge_of_the_set(two_links, random):
    """A convex problem has one optimum, wherever a search begins, be it the last point before the edge."""
    feasible = FeasibleSet(two_links)
    body = parameters(np.eye(4))
    inside = np.array([*body, 1.0, *body, 1.0])
    search, prior = WarmFit(feasible), EntropicPrior(inside).prepare(feasible, 0.2)
    count = len(two_links.base_parameters().K)
    problem = np.eye(count), random.normal(size=count), 1.0, prior, 0.2
    search.begin(inside)
    best = search.solve(*problem)
    assert best.converged
    for _ in range(20):
        direction, lower, upper = random.normal(size=len(inside)), 0.0, 10.0
        for _ in range(80):
            middle = 0.5 * (lower + upper)
            lower, upper = (middle, upper) if search.inside(inside + middle * direction) else (lower, middle)
        search.begin(inside + lower * direction)
        search.solve(*problem)
        search.begin(inside + 0.9 * lower * direction)
        np.testing.assert_allclose(search.solve(*problem).parameters, best.parameters, atol=1e-4)
