"""The catalogue of functions: operations, symbolic lengths, gravity as an argument, terms of users."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from published_arms import PUMA_ROWS, STANFORD_ROWS, WAM_ROWS

import steelyard as sy
from steelyard.graph import operation_count

# Multiplications and additions that SymPyBotics needs: inverse dynamics (squares counted), inverse dynamics in base
# parameters (squares not counted), regressor (squares counted); and the shares that are the goal here.
PUBLISHED = {
    "WAM": (WAM_ROWS, (1051, 879, 2301), (0.66, 0.68, 0.65)),
    "Puma 560": (PUMA_ROWS, (904, 548, 1700), (0.66, 0.90, 0.53)),
    "Stanford": (STANFORD_ROWS, (810, 466, 1092), (0.66, 0.90, 0.72)),
}


def operations(function, squares=True):
    count = operation_count(function.nodes)
    total = count["mul"] + count["add"]
    if not squares:
        seen, stack = set(), list(function.nodes)
        while stack:
            node = stack.pop()
            if node.index in seen:
                continue
            seen.add(node.index)
            stack.extend(node.arguments)
            total -= node.operation == "mul" and node.arguments[0] is node.arguments[1]
    return total


@pytest.mark.parametrize("name", PUBLISHED)
def test_fewer_operations_than_published(name):
    rows, published, shares = PUBLISHED[name]
    model = sy.Model(sy.Robot.from_dh(rows))
    ours = (
        operations(model.function("inverse_dynamics")),
        operations(model.function("inverse_dynamics", base=True), squares=False),
        operations(model.function("regressor")),
    )
    for mine, theirs, share in zip(ours, published, shares, strict=True):
        assert mine <= share * theirs


def random_parameters(random, model):
    """Physically possible ones: point masses, and positive values for the terms."""
    values = np.abs(random.normal(size=model.parameter_count)) + 0.1
    for columns in model.link_columns:
        body = sy.Inertia.zero()
        for _ in range(6):
            body = body + sy.Inertia.from_com(random.uniform(0.1, 2.0), random.normal(size=3), np.zeros((3, 3)))
        values[columns] = body.parameters
    return values


CELLS = st.sampled_from([0.0, 0.3, -0.2])
ROWS = st.lists(
    st.tuples(st.sampled_from(["pi/2", "-pi/2", 0, "pi", 0.4]), CELLS, CELLS, st.booleans()), min_size=1, max_size=6
)


def robot_of(rows, **options):
    cells = [(alpha, a, "q", d) if slides else (alpha, a, d, "q + pi/2") for alpha, a, d, slides in rows]
    return sy.Robot.from_dh(cells, **options)


@settings(max_examples=settings.default.max_examples // 4)
@given(ROWS, st.sampled_from(["standard", "modified"]), st.integers(0, 10_000))
def test_moving_mass_between_links_changes_no_torque(rows, convention, seed):
    """Inverse dynamics and regressor take other ways: mass moved towards the base, columns read from the parent's."""
    model = sy.Model(robot_of(rows, convention=convention))
    random = np.random.default_rng(seed)
    q, dq, ddq = random.normal(size=(3, len(rows)))
    delta = random_parameters(random, model)
    given = {"q": q, "dq": dq, "ddq": ddq, "parameters": delta}
    torque = model.function("inverse_dynamics").evaluate(given)["torque"]
    terms = model.function("regressor").evaluate(given)["matrix"] * delta
    np.testing.assert_allclose(torque, terms.sum(axis=1), atol=1e-13 * np.abs(terms).sum())
    inertia = model.function("inertia_matrix").evaluate(given)["matrix"]
    columns = [
        model.function("momentum").evaluate({"q": q, "dq": unit, "parameters": delta})["momentum"]
        for unit in np.eye(len(rows))
    ]
    np.testing.assert_allclose(inertia, np.transpose(columns), atol=1e-13 * np.abs(delta).sum())


@settings(max_examples=settings.default.max_examples // 4)
@given(ROWS, st.integers(0, 10_000))
def test_both_methods_of_forward_dynamics_undo_inverse_dynamics(rows, seed):
    model = sy.Model(robot_of(rows).with_terms(sy.Viscous(), sy.Coulomb(), sy.Offset(), sy.RotorInertia()))
    random = np.random.default_rng(seed)
    q, dq, ddq = random.normal(size=(3, len(rows)))
    delta = random_parameters(random, model)
    given = {"q": q, "dq": dq, "ddq": ddq, "parameters": delta}
    given["tau"] = model.function("inverse_dynamics").evaluate(given)["torque"]
    for name in ("forward_dynamics", "forward_dynamics_articulated"):
        ours = model.function(name).evaluate(given)["acceleration"]
        np.testing.assert_allclose(ours, ddq, atol=1e-8 * max(1.0, np.abs(given["tau"]).max()))


def test_symbolic_lengths_are_an_argument():
    rows = [("pi/2", 0, "d1", "q"), (0, "a2", "0.1 - d3", "q"), ("-pi/2", "2*a2", "q", 0.3)]
    lengths = {"d1": 0.4, "a2": 0.3, "d3": 0.25}
    symbolic = sy.Robot.from_dh(rows)
    assert symbolic.lengths == ("d1", "d3", "a2")
    numeric = sy.Robot.from_dh([("pi/2", 0, 0.4, "q"), (0, 0.3, -0.15, "q"), ("-pi/2", 0.6, "q", 0.3)])
    models = sy.Model(symbolic), sy.Model(numeric), sy.Model(symbolic.with_lengths(lengths))
    random = np.random.default_rng(0)
    q, dq, ddq = random.normal(size=(3, 3))
    given = {"q": q, "dq": dq, "ddq": ddq, "tau": q, "point": dq, "parameters": random_parameters(random, models[0])}
    for name in models[0].functions:
        outputs = [
            model.function(name).evaluate(given | {"lengths": [lengths[n] for n in model.robot.lengths]})
            for model in models
        ]
        for key, value in outputs[0].items():
            np.testing.assert_allclose(value, outputs[1][key], atol=1e-12 * max(1.0, np.abs(value).max()))
            np.testing.assert_allclose(outputs[2][key], outputs[1][key], atol=1e-12 * max(1.0, np.abs(value).max()))
    with pytest.raises(sy.InputError, match="has lengths without a value: d1, d3, a2; give them with"):
        models[0].gravity(q, given["parameters"])
    with pytest.raises(sy.InputError, match='no symbolic length "a9"'):
        symbolic.with_lengths({"a9": 1.0})
    with pytest.raises(sy.InputError, match="lengths without a value"):
        models[0].base_parameters()


@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_symbolic_lengths_stand_where_the_numbers_would(convention):
    """Every pose with lengths as symbols is the pose with the numbers in the table, flipped axes included."""
    rows = [(0.3, "a", "d", "-q"), ("pi/2", "a", "d - q", 0.7), (-0.4, "a/2", "d", "q + 1")]
    values = {"a": 0.31, "d": -0.2}
    numbers = [(0.3, 0.31, -0.2, "-q"), ("pi/2", 0.31, "-q - 0.2", 0.7), (-0.4, 0.155, -0.2, "q + 1")]
    q = np.array([0.2, 0.4, -1.0])
    symbolic = sy.Model(sy.Robot.from_dh(rows, convention=convention).with_lengths(values))
    numeric = sy.Model(sy.Robot.from_dh(numbers, convention=convention))
    np.testing.assert_allclose(symbolic.pose(q, "link3"), numeric.pose(q, "link3"), atol=1e-15)


def test_gravity_as_an_argument(wam):
    random = np.random.default_rng(1)
    q, dq, ddq = random.normal(size=(3, 4, 7))
    delta = random_parameters(random, wam)
    tilted = sy.Model(sy.Robot.from_dh(WAM_ROWS, gravity=(1.0, 2.0, -3.0)).with_terms(*wam.robot.terms))
    down = (1.0, 2.0, -3.0)
    np.testing.assert_allclose(
        wam.inverse_dynamics(q, dq, ddq, delta, gravity=down), tilted.inverse_dynamics(q, dq, ddq, delta), atol=1e-10
    )
    np.testing.assert_allclose(wam.gravity(q, delta, gravity=down), tilted.gravity(q, delta), atol=1e-10)
    np.testing.assert_allclose(
        wam.potential_energy(q, delta, gravity=down), tilted.potential_energy(q, delta), atol=1e-10
    )
    with pytest.raises(sy.InputError, match="has 3 elements of gravity"):
        wam.gravity(q, delta, gravity=9.81)


class Spring(sy.Term):
    kind = "spring"
    parameters = (sy.TermParameter("Ks", "N·m/rad", "N/m", "stiffness", nonnegative=True),)

    def __init__(self, scale):
        self.scale = scale

    def columns(self, k, q, dq, ddq, algebra):
        return ({k: self.scale * q[k]},)

    def potential(self, k, q, algebra):
        return (0.5 * self.scale * q[k] * q[k],)


def test_energy_changes_by_the_power_of_torques_with_springs_and_rotors():
    random = np.random.default_rng(2)
    model = sy.Model(sy.Robot.from_dh(PUMA_ROWS).with_terms(Spring(1.0), sy.RotorInertia()))
    delta = random_parameters(random, model)
    q, dq, ddq = random.normal(size=(3, 6))

    def energy(step):
        at, speed = q + step * dq, dq + step * ddq
        given = {"q": at, "dq": speed, "parameters": delta}
        return sum(model.function(f"{kind}_energy").evaluate(given)["energy"] for kind in ("kinetic", "potential"))

    rate = energy(1e-30j).imag / 1e-30
    assert rate == pytest.approx(model.inverse_dynamics(q, dq, ddq, delta) @ dq, rel=1e-12)
    kinetic, potential = model.energy_regressor(q, dq)
    assert kinetic @ delta == pytest.approx(model.kinetic_energy(q, dq, delta), rel=1e-12)
    assert potential @ delta == pytest.approx(model.potential_energy(q, delta), rel=1e-12)
    by_q = model.inverse_dynamics_derivatives(q, dq, ddq, delta)[0]
    step = {"q": q + 1e-30j * np.eye(6), "dq": dq, "ddq": ddq, "parameters": delta}
    exact = model.function("inverse_dynamics").evaluate(step)["torque"].imag.T / 1e-30
    np.testing.assert_allclose(by_q, exact, atol=1e-12 * np.abs(exact).max())


def test_terms_of_users_are_told_apart_by_what_they_compute():
    """Two springs that look the same from outside: neither may run the other's code from the cache."""
    results = []
    for scale in (1.0, 3.0):
        model = sy.Model(sy.Robot.from_dh([(0, 1, 0, "q")], gravity=(0, 0, -9.81)).with_terms(Spring(scale)))
        results.append(model.inverse_dynamics([0.5], [0.0], [0.0], np.eye(11)[10])[0])
    assert results == [0.5, 1.5]


def test_the_torque_of_each_term_alone(wam):
    random = np.random.default_rng(4)
    dq, ddq = random.normal(size=(2, 5, 7))
    delta = random_parameters(random, wam)
    kinds = [term.kind for term in wam.robot.terms]
    parts = [wam.drive_torque(dq, ddq, delta, term=kind) for kind in kinds]
    np.testing.assert_allclose(np.sum(parts, axis=0), wam.drive_torque(dq, ddq, delta), atol=1e-12)
    viscous = [wam.parameter_names.index(f"Fvj{k}") for k in range(1, 8)]
    np.testing.assert_allclose(parts[kinds.index("viscous")], delta[viscous] * dq, atol=1e-14)
    with pytest.raises(sy.InputError, match="has no term 'spring'"):
        wam.drive_torque(dq, ddq, delta, term="spring")


def test_threads_share_a_batch_and_change_nothing(wam):
    random = np.random.default_rng(5)
    q, dq, ddq = random.normal(size=(3, 5003, 7))
    delta = random_parameters(random, wam)
    shared = sy.Model(wam.robot, threads=3)
    assert np.array_equal(shared.inverse_dynamics(q, dq, ddq, delta), wam.inverse_dynamics(q, dq, ddq, delta))
    assert np.array_equal(shared.regressor(q, dq, ddq), wam.regressor(q, dq, ddq))
    with pytest.raises(sy.InputError, match="threads must be a positive integer, got 0"):
        sy.Model(wam.robot, threads=0)


def test_coupled_motors_have_no_articulated_bodies(wam):
    with pytest.raises(sy.InputError, match="coupled motors"):
        wam.forward_dynamics(np.zeros(7), np.zeros(7), np.zeros(7), np.ones(119), method="articulated_body")
    with pytest.raises(sy.InputError, match="method must be 'automatic'"):
        wam.forward_dynamics(np.zeros(7), np.zeros(7), np.zeros(7), np.ones(119), method="fast")


def test_descriptions_say_what_each_element_is(wam):
    function = wam.function("inverse_dynamics")
    parameters = function.arguments[-1]
    assert parameters.elements[10] == "Fvj1: viscous friction at joint 'joint1', N·m·s/rad"
    assert parameters.elements[9] == "m1: mass of link 'link1', kg"
    assert function.arguments[0].elements[6] == "position of joint 'joint7', rad"
    base = wam.function("gravity", base=True).arguments[-1]
    assert base.width == 76
    assert base.elements[0].startswith("beta1 = Lyy1 ")
    assert "in order, to Lxx1, Lxy1, Lxz1" in wam.function("regressor").outputs[0].description
    assert "in order, to Lyy1 " in wam.function("regressor", base=True).outputs[0].description


@pytest.mark.slow
def test_a_regressor_is_the_same_where_its_kernel_leaves_the_zeros_out(monkeypatch):
    arm = sy.Robot.from_dh(PUMA_ROWS, gravity=(0, 0, -9.81)).with_terms(sy.Viscous(), sy.Coulomb())
    dense, sparse = sy.Model(arm), sy.Model(arm)
    random = np.random.default_rng(7)
    q, dq, ddq = random.normal(size=(3, 20, 6))
    expected = dense.regressor(q, dq, ddq)
    monkeypatch.setattr("steelyard.dynamics.functions._LARGEST_DENSE", 10)
    assert sparse.kernel("regressor").width < dense.kernel("regressor").width
    np.testing.assert_allclose(sparse.regressor(q, dq, ddq), expected, rtol=0, atol=1e-14)
    np.testing.assert_allclose(sparse.regressor(q[0], dq[0], ddq[0]), expected[0], rtol=0, atol=1e-14)
    parameters = random.normal(size=dense.parameter_count)
    np.testing.assert_allclose(
        expected @ parameters, dense.inverse_dynamics(q, dq, ddq, parameters), rtol=1e-12, atol=1e-12
    )
