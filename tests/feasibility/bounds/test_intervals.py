"""Intervals that are known in closed form."""

import numpy as np
import pytest

from steelyard.dynamics import Model
from steelyard.errors import InputError
from steelyard.feasibility import CenterOfMassBox, DensityInBox, FeasibleSet, TotalMass, parameter_intervals
from steelyard.robot import Robot

INFINITE = float("inf")


@pytest.fixture(scope="module")
def pendulum():
    """A link about a fixed horizontal axis z: the motion shows Lzz, lx and ly."""
    model = Model(Robot.from_dh([("0", 0.0, 0.0, "q")], gravity=(0, -9.81, 0)))
    assert model.base_parameters().names == ("Lzz1", "lx1", "ly1")
    return model


# With second moments S (Lzz = Sxx + Syy), first moments l and mass m, a body exists where the matrix [[S, l], [lᵀ,
# m]] is positive semidefinite. So Sxx ≥ lx²/m and Syy ≥ ly²/m, hence m ≥ (lx² + ly²) / Lzz, and Sxy lies within lx ly
# / m ± sqrt((Sxx - lx²/m)(Syy - ly²/m)), of which the root is at most (Lzz - (lx² + ly²)/m) / 2. Nothing bounds Szz.
LZZ, LX, LY, HEAVIEST = 0.5, 1.0, 0.4, 7.0
SQUARE = LX**2 + LY**2
LIGHTEST = SQUARE / LZZ


@pytest.mark.parametrize("consistency", ["full", pytest.param("inertia", marks=pytest.mark.slow)])
def test_mass_of_a_pendulum(pendulum, consistency):
    interval = parameter_intervals(FeasibleSet(pendulum, consistency), [LZZ, LX, LY])["m1"]
    assert interval.lower == pytest.approx(LIGHTEST, rel=1e-6)
    assert interval.lower <= LIGHTEST
    assert interval.attained_lower == pytest.approx(LIGHTEST, rel=1e-6)
    assert interval.upper == INFINITE


def test_moments_of_a_pendulum_of_bounded_mass(pendulum):
    feasible = FeasibleSet(pendulum, constraints=[TotalMass(maximum=HEAVIEST)])
    found = parameter_intervals(feasible, [LZZ, LX, LY])
    expected = {
        "m1": (LIGHTEST, HEAVIEST),
        "Lxx1": (LY**2 / HEAVIEST, INFINITE),
        "Lyy1": (LX**2 / HEAVIEST, INFINITE),
        "Lxy1": (-LZZ / 2 + (SQUARE / 2 - LX * LY) / HEAVIEST, LZZ / 2 - (SQUARE / 2 + LX * LY) / HEAVIEST),
        "Lxz1": (-INFINITE, INFINITE),
        "lz1": (-INFINITE, INFINITE),
        "cx1": (LX / HEAVIEST, LX / LIGHTEST),
        "cy1": (LY / HEAVIEST, LY / LIGHTEST),
        "cz1": (-INFINITE, INFINITE),
        "total mass": (LIGHTEST, HEAVIEST),
    }
    for name, (lower, upper) in expected.items():
        interval = found[name]
        assert (interval.lower, interval.upper) == pytest.approx((lower, upper), rel=1e-6, abs=1e-8), name
        assert (interval.attained_lower, interval.attained_upper) == pytest.approx((lower, upper), rel=1e-6), name


def test_what_the_motion_shows_is_decided(pendulum):
    found = parameter_intervals(FeasibleSet(pendulum), [LZZ, LX, LY])
    for name, value in (("Lzz1", LZZ), ("lx1", LX), ("ly1", LY)):
        assert found[name].identifiable
        assert found[name].width == 0.0
        assert found[name].relative_width == 0.0
        assert value in found[name]
    assert not found["m1"].identifiable


def test_box_bounds_what_mass_leaves_open(pendulum):
    """With |z| ≤ 0.2 of the centre of mass, m ≤ 7 kg bounds lz, but the mass may be large wherever it is."""
    box = CenterOfMassBox("link1", (-9.0, -9.0, -0.2), (9.0, 9.0, 0.1))
    found = parameter_intervals(FeasibleSet(pendulum, constraints=[TotalMass(maximum=HEAVIEST), box]), [LZZ, LX, LY])
    assert (found["lz1"].lower, found["lz1"].upper) == pytest.approx((-0.2 * HEAVIEST, 0.1 * HEAVIEST), rel=1e-6)
    assert (found["cz1"].lower, found["cz1"].upper) == pytest.approx((-0.2, 0.1), rel=1e-6)


def test_density_in_a_box_bounds_the_second_moments_too(pendulum):
    """Szz ≤ h² m, so that Lxx = Syy + Szz ≤ (Lzz - lx²/m) + h² m, which grows with m."""
    box = DensityInBox("link1", lower=(-9.0, -9.0, -0.2), upper=(9.0, 9.0, 0.2))
    found = parameter_intervals(FeasibleSet(pendulum, constraints=[TotalMass(maximum=HEAVIEST), box]), [LZZ, LX, LY])
    assert (found["lz1"].lower, found["lz1"].upper) == pytest.approx((-0.2 * HEAVIEST, 0.2 * HEAVIEST), rel=1e-5)
    assert (found["cz1"].lower, found["cz1"].upper) == pytest.approx((-0.2, 0.2), rel=1e-5)
    assert found["Lxx1"].upper == pytest.approx(LZZ - LX**2 / HEAVIEST + 0.04 * HEAVIEST, rel=1e-5)
    assert found["Lyy1"].upper == pytest.approx(LZZ - LY**2 / HEAVIEST + 0.04 * HEAVIEST, rel=1e-5)


# The arm of two parallel axes shows a = Lzz1 + m2 and b = Lzz2, lx2, ly2: Lzz1 ≥ 0 leaves m2 ≤ a, and m2 ≥ (lx2² +
# ly2²) / b.
ARM = np.array([1.5, 0.1, 0.25, 0.3, 0.4, 0.1])


@pytest.mark.slow
@pytest.mark.parametrize("consistency", ["full", "inertia"])
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_mass_of_a_forearm(two_links, consistency, scale):
    a, _, b, lx, ly, _ = ARM
    found = parameter_intervals(FeasibleSet(two_links, consistency), scale * ARM)
    least = (lx**2 + ly**2) / b
    expected = {"m2": (least, a), "Lzz1": (0.0, a - least), "m1": (0.0, INFINITE), "total mass": (least, INFINITE)}
    for name, (lower, upper) in expected.items():
        assert (found[name].lower, found[name].upper) == pytest.approx((scale * lower, scale * upper), abs=1e-6 * scale)
    assert (found["cx2"].lower, found["cx2"].upper) == pytest.approx((lx / a, lx / least), rel=1e-6)
    assert (found["cy2"].lower, found["cy2"].upper) == pytest.approx((ly / a, ly / least), rel=1e-6)


def test_links_of_50_g_and_of_50_kg(two_links):
    """The forearm of 50 g at least, on an upper arm whose inertia leaves room for 50 kg."""
    a, b, lx, ly = 50.0, 2e-5, 6e-4, 8e-4
    found = parameter_intervals(FeasibleSet(two_links), [a, 0.1, b, lx, ly, 0.1], names=["m2", "cx2"])
    assert (found["m2"].lower, found["m2"].upper) == pytest.approx((0.05, 50.0), rel=1e-5)
    assert (found["cx2"].lower, found["cx2"].upper) == pytest.approx((lx / 50.0, lx / 0.05), rel=1e-5)


def test_combinations_and_groups(two_links):
    feasible = FeasibleSet(two_links, constraints=[TotalMass(maximum=4.0)])
    row = np.zeros(22)
    row[[9, 20]] = 1.0
    combinations = {"both": row, "difference": {"m2": 1.0, "m1": -1.0}}
    found = parameter_intervals(feasible, ARM, names=["total mass"], combinations=combinations)
    assert [interval.name for interval in found] == ["total mass", "both", "difference"]
    assert (found["both"].lower, found["both"].upper) == pytest.approx((1.0, 4.0), rel=1e-6)
    assert (found["difference"].lower, found["difference"].upper) == pytest.approx((-3.0 + 1.0, 1.5), rel=1e-6)


def test_equations_count(two_links):
    feasible = FeasibleSet(two_links, constraints=[TotalMass(equal=3.0)])
    found = parameter_intervals(feasible, ARM, names=["m1", "m2", "total mass"])
    assert (found["m1"].lower, found["m1"].upper) == pytest.approx((1.5, 2.0), rel=1e-6)
    assert found["total mass"].identifiable
    assert found["total mass"].attained_lower == pytest.approx(3.0)


@pytest.mark.slow
def test_attained_ends_are_robots(two_links):
    feasible = FeasibleSet(two_links, constraints=[TotalMass(maximum=4.0)])
    for interval in parameter_intervals(feasible, ARM):
        for parameters, value in (
            (interval.lower_parameters, interval.attained_lower),
            (interval.upper_parameters, interval.attained_upper),
        ):
            if parameters is None:
                assert np.isinf(value)
                continue
            assert feasible.contains(parameters)
            np.testing.assert_allclose(feasible.K @ parameters, ARM, atol=1e-9)
            assert interval.lower <= value <= interval.upper


def test_every_solver_agrees(two_links):
    pytest.importorskip("scs", reason="needs SCS (pip install 'steelyard[scs]')")
    found = parameter_intervals(FeasibleSet(two_links), ARM, names=["m2"], solver="scs")["m2"]
    assert (found.lower, found.upper) == pytest.approx((1.0, 1.5), rel=1e-3)
    # However roughly the solver works, the bounds hold.
    assert found.lower <= 1.0
    assert found.upper >= 1.5


@pytest.mark.slow
def test_words(two_links):
    found = parameter_intervals(FeasibleSet(two_links), ARM)
    assert str(found["m2"]) == "The mass of forearm (m2) lies between 1 and 1.5 kg."
    assert str(found["m1"]) == "The mass of upper arm (m1) is at least 0 kg; nothing bounds it from above."
    assert str(found["lz1"]) == "The first moment z of upper arm (lz1) may have any value."
    assert str(found["Lzz2"]) == "The moment of inertia zz of forearm (Lzz2) is 0.25 kg m²: it is identifiable."
    assert found["m2"].relative_width == pytest.approx(1 / 3, rel=1e-5)
    lines = str(found).splitlines()
    assert lines[0] == 'Possible values under "full" consistency, given these base parameters.'
    assert any(line.split()[:4] == ["m2", "1", "1.5", "kg"] for line in lines)
    assert "<td>forearm" not in found._repr_html_()
    assert "mass of forearm" in found._repr_html_()
    plain = found.to_dict()
    entry = next(item for item in plain["intervals"] if item["name"] == "m1")
    assert entry["upper"] is None
    assert entry["lower"] == pytest.approx(0.0, abs=1e-6)


def body_of(stand_in, inertial_symbols):
    names = [f"{symbol}1" for symbol in inertial_symbols]
    return stand_in(names, [[(1.0, name)] for name in names], ("body",))


def test_all_is_told_identifiable_where_everything_is_identifiable(stand_in, inertial_symbols):
    base = [1.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.1, 0.0, 0.0, 2.0]
    found = parameter_intervals(FeasibleSet(body_of(stand_in, inertial_symbols)), base)
    assert all(interval.identifiable for interval in found)
    assert found["cx1"].attained_lower == pytest.approx(0.05)
    assert "14 are identifiable" in str(found)


def test_point_on_the_boundary_is_told(pendulum):
    """A pendulum of at most 2 kg whose moments need 2 kg: one robot only, a point mass."""
    feasible = FeasibleSet(pendulum, constraints=[TotalMass(maximum=2.0)])
    with pytest.raises(InputError, match="closer to the boundary of what is possible than can be told"):
        parameter_intervals(feasible, [0.5, 1.0, 0.0])


def test_very_little_room(pendulum):
    feasible = FeasibleSet(pendulum, constraints=[TotalMass(maximum=2.0 + 1e-6)])
    found = parameter_intervals(feasible, [0.5, 1.0, 0.0], names=["m1"])["m1"]
    assert found.lower == pytest.approx(2.0, abs=1e-9)
    assert found.upper == pytest.approx(2.0 + 1e-6, abs=1e-9)
    assert found.width == pytest.approx(1e-6, rel=1e-3)


def test_infeasible_base_parameters_have_no_interval(two_links):
    with pytest.raises(InputError, match="no physically possible robot has these base parameters"):
        parameter_intervals(FeasibleSet(two_links), [0.5, 0.1, 0.25, 0.3, 0.4, 0.1])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({}, "neither base= nor info= was given"),
        ({"base": [1.0]}, "6 base parameters"),
        ({"base": ARM, "names": ["m3"]}, 'did you mean "m2"'),
        ({"base": ARM, "combinations": {"m1": np.ones(22)}}, "must not use the name 'm1'"),
        ({"base": ARM, "combinations": {"arm": np.ones(3)}}, "one coefficient for each of the 22"),
        ({"base": ARM, "combinations": {"arm": {"mm": 1.0}}}, 'did you mean "m'),
        ({"base": ARM, "combinations": {"arm": {"m1": "x"}}}, "must be numbers"),
        ({"base": ARM, "combinations": {"arm": np.zeros(22)}}, "not all of them zero"),
        ({"base": ARM, "info": 3.0}, "must be an Information"),
        ({"base": ARM, "covariance": np.eye(6), "info": 3.0}, "only one of them"),
        ({"covariance": np.eye(6)}, "give base= too"),
        ({"base": ARM, "covariance": np.eye(5)}, "6 x 6 finite numbers"),
        ({"base": ARM, "covariance": np.triu(np.ones((6, 6)))}, "must be symmetric"),
        ({"base": ARM, "covariance": -np.eye(6)}, "positive semidefinite"),
        ({"base": ARM, "covariance": np.eye(6), "confidence": 95}, "between 0 and 1"),
        ({"base": ARM, "solver": "abacus"}, "no solver 'abacus'"),
    ],
)
def test_bad_arguments_are_told(two_links, arguments, message):
    with pytest.raises(InputError, match=message):
        parameter_intervals(FeasibleSet(two_links), **arguments)


def test_unknown_interval_is_told(two_links):
    with pytest.raises(InputError, match="no interval of 'm9'"):
        parameter_intervals(FeasibleSet(two_links), ARM, names=["m1"])["m9"]
