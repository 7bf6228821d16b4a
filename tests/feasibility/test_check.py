from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from steelyard.dynamics import Coulomb, Model
from steelyard.errors import InputError
from steelyard.feasibility import CenterOfMassBox, FeasibleSet, TotalMass, Verdict, check
from steelyard.robot import Inertia, Robot


def possible(base):
    """Whether Lzz1 + m2, Lzz2, lx2, ly2 and friction of the planar arm are possible, by hand.

    m2 is at most the first one, and Lzz2 at least (lx2² + ly2²) / m2; all else is free.
    """
    total, friction1, moment, x, y, friction2 = base
    return total > 0 and moment * total > x**2 + y**2 and friction1 >= 0 and friction2 >= 0


@pytest.mark.parametrize("consistency", [pytest.param("inertia", marks=pytest.mark.slow), "full"])
@given(
    moment=st.floats(1e-3, 10.0),
    x=st.floats(-1.0, 1.0),
    y=st.floats(-1.0, 1.0),
    excess=st.sampled_from([-0.5, -1e-2, -1e-4, 1e-4, 1e-2, 0.5, 5.0]),
)
@settings(max_examples=settings.default.max_examples // 4)
def test_agrees_with_the_condition_worked_out_by_hand(two_links, consistency, moment, x, y, excess):
    total = (x**2 + y**2 + 1e-3) / moment * (1 + excess)
    base = np.array([total, 0.5, moment, x, y, 0.25])
    feasible = FeasibleSet(two_links, consistency)
    verdict = check(feasible, base=base)
    assert verdict.feasible in (possible(base), None)
    if abs(moment * total - x**2 - y**2) > 1e-4 * (x**2 + y**2 + moment + 1e-2):
        assert verdict.feasible == possible(base)
    if verdict.feasible is not None:
        assert verdict.certificate.verify()
    if verdict.feasible:
        np.testing.assert_allclose(feasible.K @ verdict.parameters, base, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("offset", [-1e-9, -1e-12, 0.0, 1e-12, 1e-9])
def test_never_wrong_beside_the_boundary(two_links, offset):
    base = np.array([1.0, 0.5, 0.25 * (1 + offset), 0.3, 0.4, 0.25])
    assert check(FeasibleSet(two_links), base=base).feasible in (possible(base), None)


@pytest.mark.parametrize("scale", [1e-4, *(pytest.param(scale, marks=pytest.mark.slow) for scale in (1e-2, 1e2)), 1e4])
def test_scale_of_the_robot_does_not_matter(two_links, scale):
    for total in (0.8, 1.2):
        base = scale * np.array([total, 0.5, 0.25, 0.3, 0.4, 0.25])
        assert check(FeasibleSet(two_links), base=base).feasible == possible(base)


def test_margin_is_the_largest(two_links):
    # With friction 0.01 at joint 2 and much room elsewhere nothing can be better than that.
    verdict = check(FeasibleSet(two_links), base=[50.0, 5.0, 20.0, 0.1, 0.0, 0.01])
    assert verdict.feasible is True
    assert verdict.margin == pytest.approx(0.01, rel=1e-6)


def test_margin_against_the_analytic_one(two_links):
    # 1.5 = Lzz1 + m2 and the 6 x 6 block hold Lzz1 >= t and (Lzz2 - t)(m2 - t) >= lx2², so that t is a root.
    base = np.array([1.5, 9.0, 1.0, 0.6, 0.0, 9.0])
    verdict = check(FeasibleSet(two_links, "inertia"), base=base)
    # (1 - t)(1.5 - t - t) = 0.36  =>  2 t² - 3.5 t + 1.14 = 0
    assert verdict.margin == pytest.approx((3.5 - np.sqrt(3.5**2 - 8 * 1.14)) / 4, abs=1e-6)


def test_negative_friction_is_named_with_its_amount(two_links):
    verdict = check(FeasibleSet(two_links), base=[5.0, -0.07, 2.0, 0.1, 0.0, 0.01])
    assert verdict.status == "infeasible"
    assert [violation.block for violation in verdict.violations] == ["joint 1: Fvj >= 0"]
    assert verdict.violations[0].amount == pytest.approx(0.07)
    assert verdict.certificate.verify()
    assert str(verdict).splitlines() == [
        'Physically infeasible under "full" consistency: no real robot has these values (largest margin -0.07).',
        "joint 1: Fvj >= 0 fails by 0.07.",
        "Proved in exact arithmetic: no parameters with these base parameters satisfy all 4 conditions stated.",
    ]
    assert "<li>joint 1: Fvj &gt;= 0 fails by 0.07.</li>" in verdict._repr_html_()


def test_link_that_fails_is_named(two_links):
    verdict = check(FeasibleSet(two_links), base=[0.5, 0.1, 0.25, 0.3, 0.4, 0.1])
    assert verdict.status == "infeasible"
    assert verdict.violations[0].block in ("link 2 (forearm): inertia", "link 1 (upper arm): inertia")


def test_certificate_of_another_vector_is_refused(two_links):
    feasible = FeasibleSet(two_links)
    infeasible = check(feasible, base=[0.5, 0.1, 0.25, 0.3, 0.4, 0.1])
    possible_base = np.array([1.5, 0.1, 0.25, 0.3, 0.4, 0.1])
    assert not replace(infeasible.certificate, base=possible_base).verify()
    witness = check(feasible, base=possible_base).certificate
    assert not replace(witness, base=infeasible.base).verify()
    assert not replace(witness, parameters=-witness.parameters).verify()


def test_damaged_dual_point_is_refused(two_links):
    certificate = check(FeasibleSet(two_links), base=[0.5, 0.1, 0.25, 0.3, 0.4, 0.1]).certificate
    index, matrix = next((k, m) for k, m in certificate.exact_dual.items() if len(m) > 1)

    def moved(amount):
        changed = [[value + amount * (i == j) for j, value in enumerate(row)] for i, row in enumerate(matrix)]
        return replace(certificate, exact_dual={**certificate.exact_dual, index: changed})

    assert certificate.verify()
    assert not moved(Fraction(-1, 10)).verify()
    assert not moved(Fraction(1, 1000)).verify()
    assert not replace(certificate, exact_dual={}).verify()


def test_shares_of_the_certificate_add_to_one(two_links):
    certificate = check(FeasibleSet(two_links), base=[0.5, 0.1, 0.25, 0.3, 0.4, 0.1]).certificate
    assert sum(share for _, share in certificate.blocks) == pytest.approx(1.0)


def test_standard_parameters_feasible_virtual_and_infeasible(two_links, point_cloud_parameters):
    rng = np.random.default_rng(8)
    feasible = FeasibleSet(two_links)
    delta = np.full(22, 0.2)
    delta[:10] = point_cloud_parameters(np.ones(8), rng.normal(size=(8, 3)))
    delta[11:21] = point_cloud_parameters(np.ones(8), rng.normal(size=(8, 3)))
    verdict = check(feasible, parameters=delta)
    assert (verdict.status, verdict.feasible, verdict.violations) == ("feasible", True, ())
    virtual = delta.copy()
    virtual[9] = -3.0  # the mass of link 1, which the motion does not show
    verdict = check(feasible, parameters=virtual)
    assert (verdict.status, verdict.feasible) == ("virtually feasible", False)
    assert verdict.violations[0].block == "link 1 (upper arm): inertia"
    assert feasible.contains(verdict.parameters)
    np.testing.assert_allclose(feasible.K @ verdict.parameters, feasible.K @ delta, rtol=1e-9)
    impossible = delta.copy()
    impossible[16] = -1.0  # Lzz2, which it shows
    verdict = check(feasible, parameters=impossible)
    assert (verdict.status, verdict.feasible) == ("infeasible", False)
    assert verdict.certificate.verify()


def test_constraints_and_equations_take_part(two_links):
    base = np.array([1.5, 0.1, 0.25, 0.3, 0.4, 0.1])  # needs m2 > 1
    assert check(FeasibleSet(two_links, constraints=[TotalMass(maximum=1.2)]), base=base).feasible
    for constraint in (TotalMass(maximum=0.9), TotalMass(equal=0.9)):
        verdict = check(FeasibleSet(two_links, constraints=[constraint]), base=base)
        assert verdict.status == "infeasible"
        assert verdict.certificate.verify()
    equal = FeasibleSet(two_links, constraints=[TotalMass(equal=4.0)])
    verdict = check(equal, base=base)
    assert verdict.parameters[[9, 20]].sum() == pytest.approx(4.0, rel=1e-9)
    box = CenterOfMassBox("forearm", (0.0, 0.0, -1.0), (0.19, 1.0, 1.0))  # lx2 = 0.3 <= 0.19 m2 needs m2 > 1.5
    assert check(FeasibleSet(two_links, constraints=[box]), base=base).status == "infeasible"


def test_witness_is_not_absurdly_heavy(two_links):
    verdict = check(FeasibleSet(two_links), base=[1.5, 0.1, 0.25, 0.3, 0.4, 0.1])
    assert verdict.parameters[[9, 20]].sum() < 3.0


def test_exactly_one_vector_is_needed(two_links):
    feasible = FeasibleSet(two_links)
    with pytest.raises(InputError, match="exactly one"):
        check(feasible)
    with pytest.raises(InputError, match="exactly one"):
        check(feasible, base=np.ones(6), parameters=np.ones(22))


def test_certificates_turn_into_plain_numbers(two_links):
    feasible = FeasibleSet(two_links)
    import json

    good = check(feasible, base=[1.5, 0.1, 0.25, 0.3, 0.4, 0.1]).certificate.to_dict()
    bad = check(feasible, base=[0.5, 0.1, 0.25, 0.3, 0.4, 0.1]).certificate.to_dict()
    assert json.loads(json.dumps(good))["verdict"] == "feasible"
    assert json.loads(json.dumps(bad))["verdict"] == "infeasible"


def test_a_link_without_inertia_is_named():
    """A point mass lies on the boundary; the verdict names it rather than only calling itself undecided."""
    robot = Robot.from_dh([("pi/2", 0.0, 0.3, "q"), (0.0, 0.4, 0.0, "q")])
    model = Model(robot)
    parameters = np.zeros(model.parameter_count)
    parameters[:10] = Inertia.from_com(mass=2.0, com=np.zeros(3), about_com=0.1 * np.eye(3)).parameters
    parameters[10:] = Inertia.from_com(mass=1.0, com=np.array([0.1, 0.0, 0.0]), about_com=np.zeros((3, 3))).parameters
    verdict = check(FeasibleSet(model), parameters=parameters)
    assert verdict.feasible is not True
    assert [str(violation) for violation in verdict.violations][:1] == [
        "body of link2 is on the boundary of what is possible"
    ]


def test_violated_terms_have_their_unit():
    model = Model(Robot.from_dh([(0.0, 0.3, 0.0, "q")]).with_terms(Coulomb()))
    parameters = np.zeros(11)
    parameters[:10] = Inertia.from_com(mass=2.0, com=np.zeros(3), about_com=0.1 * np.eye(3)).parameters
    parameters[10] = -0.25
    (violation,) = check(FeasibleSet(model), parameters=parameters).violations
    assert str(violation) == "Fcj >= 0 at joint1 fails by 0.25 N·m"


def test_what_looks_impossible_is_not_called_close_to_the_boundary() -> None:
    """As where no proof is found since another link is a billion times as large."""
    verdict = Verdict(None, "undecided", -0.07, np.zeros(1), None, None, (), "full")
    assert "look impossible (margin -0.07), but it was not proved" in str(verdict)
    assert "closer to the boundary" in str(replace(verdict, margin=-1e-9))
