import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from steelyard.dynamics import Model
from steelyard.errors import InputError
from steelyard.feasibility import CenterOfMassBox, CenterOfMassSphere, FeasibleSet, check
from steelyard.robot import Robot

seeds = st.integers(0, 2**32 - 1)


def test_box_is_thesis_4_38(two_links):
    delta = np.zeros(22)
    delta[[17, 18, 19, 20]] = 0.2, -0.1, 0.9, 2.0  # lx2 ly2 lz2 m2
    box = CenterOfMassBox("forearm", lower=(-0.1, 0.0, -1.0), upper=(0.05, 0.3, 1.0))
    found = {block.name: float(block.evaluate(delta)[0, 0]) for block in box.blocks(two_links)}
    name = "link 2 (forearm): centre of mass"
    assert found == pytest.approx(
        {
            f"{name} x >= -0.1 m": 0.2 + 0.2,
            f"{name} x <= 0.05 m": 0.1 - 0.2,
            f"{name} y >= 0 m": -0.1,
            f"{name} y <= 0.3 m": 0.6 + 0.1,
            f"{name} z >= -1 m": 0.9 + 2.0,
            f"{name} z <= 1 m": 2.0 - 0.9,
        }
    )


def test_infinite_bounds_are_left_out(two_links):
    box = CenterOfMassBox("forearm", lower=(-np.inf,) * 3, upper=(0.1, np.inf, np.inf))
    assert len(box.blocks(two_links)) == 1


def test_a_known_coordinate_is_an_equation(two_links):
    box = CenterOfMassBox("forearm", lower=(0.0, -0.1, 0.25), upper=(0.0, 0.1, 0.25))
    assert len(box.blocks(two_links)) == 2
    along_x, along_z = box.equalities(two_links)
    assert (along_x.indices.tolist(), along_x.coefficients.tolist(), along_x.value) == ([17], [1.0], 0.0)
    assert (along_z.indices.tolist(), along_z.coefficients.tolist()) == ([19, 20], [1.0, -0.25])
    assert along_z.name == "link 2 (forearm): centre of mass z = 0.25 m: lz2 - 0.25*m2 = 0"


@given(seed=seeds, out=st.sampled_from([-1e-6, -0.3, 1e-6, 0.3]))
def test_sphere_is_the_distance(two_links, seed, out):
    rng = np.random.default_rng(seed)
    center, mass, radius = rng.normal(size=3), rng.uniform(0.1, 9.0), rng.uniform(0.01, 2.0)
    direction = rng.normal(size=3)
    place = center + (1 + out) * radius * direction / np.linalg.norm(direction)
    delta = np.zeros(22)
    delta[17:21] = [*(mass * place), mass]
    (block,) = CenterOfMassSphere("forearm", center, radius).blocks(two_links)
    smallest = block.smallest_eigenvalue(delta)
    assert (smallest > 0) == (out < 0)
    # The eigenvalues are m r and m r -+ |l - m c|.
    assert smallest == pytest.approx(-out * mass * radius, rel=1e-6, abs=1e-13)
    assert block.name == "link 2 (forearm): centre of mass within sphere"


def test_sphere_without_radius_is_a_point(two_links):
    sphere = CenterOfMassSphere("forearm", (0.1, 0, -0.2), 0)
    assert sphere.blocks(two_links) == ()
    delta = np.zeros(22)
    delta[17:21] = 0.3, 0.0, -0.6, 3.0
    residuals = [e.coefficients @ delta[e.indices] - e.value for e in sphere.equalities(two_links)]
    np.testing.assert_allclose(residuals, 0.0, atol=1e-15)


def test_centre_of_mass_bounds_the_moment_of_inertia():
    """A pendulum of mass m with l = 1 kg m has Lzz >= l²/m, and its centre of mass at l/m."""
    model = Model(Robot.from_dh([("0", 0.0, 0.0, "q")], gravity=(0, -9.81, 0)))
    near = [CenterOfMassSphere("link1", (0.6, 0.0, 0.0), 0.1)]
    # 0.5 m <= l/m <= 0.7 m, thus Lzz >= 1 kg m times 0.5 m.
    assert check(FeasibleSet(model, constraints=near), base=[0.501, 1.0, 0.0]).feasible is True
    verdict = check(FeasibleSet(model, constraints=near), base=[0.499, 1.0, 0.0])
    assert verdict.status == "infeasible"
    assert verdict.certificate.verify()
    assert any("centre of mass within sphere" in name for name, _ in verdict.certificate.blocks)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: CenterOfMassBox("a", (0, 0, 0), (1, -1, 1)), "lower y 0 m above upper y -1 m"),
        (lambda: CenterOfMassBox("a", (0, 0), (1, 1, 1)), "three numbers"),
        (lambda: CenterOfMassBox("a", (0, 0, "left"), (1, 1, 1)), "three numbers"),
        (lambda: CenterOfMassBox("a", (np.inf, 0, 0), (np.inf, 1, 1)), "no room along x"),
        (
            lambda: CenterOfMassSphere("a", (0, 0), 1.0),
            "center of .* of link 'a' must be three numbers",
        ),
        (lambda: CenterOfMassSphere("a", (0, 0, 0), -1.0), "at least 0 m, got -1"),
        (lambda: CenterOfMassSphere("a", (0, 0, 0), np.inf), "radius .* must be a number of at least 0 m, got inf"),
    ],
)
def test_impossible_shapes_are_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()


@pytest.mark.parametrize(
    "kind",
    [lambda link: CenterOfMassBox(link, (0, 0, 0), (1, 1, 1)), lambda link: CenterOfMassSphere(link, (0, 0, 0), 1)],
)
def test_unknown_link_suggests_the_closest(two_links, kind):
    with pytest.raises(InputError, match='did you mean "forearm"'):
        FeasibleSet(two_links, constraints=[kind("fore_arm")])
