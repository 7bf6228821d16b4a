"""Verdicts on random robots whose answer is known, each with a proof that is verified from its document."""

import json
from fractions import Fraction

import numpy as np
import pytest
from random_instances import KINDS, random_instance

import steelyard as sy
from steelyard.feasibility import verify_document
from steelyard.feasibility.facial_reduction import dual_face

BAND = 1e-9


def assert_right(seed: int) -> bool:
    """The verdict is right and proved; whether it was reached."""
    instance = random_instance(seed)
    verdict = sy.check(instance.feasible, base=instance.base)
    if verdict.feasible is None:
        return abs(instance.inside) <= BAND
    assert verdict.feasible == instance.possible, f"seed {seed}"
    assert verify_document(json.loads(json.dumps(verdict.certificate.to_dict()))), f"seed {seed}"
    return True


@pytest.mark.parametrize("k", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in (1, 2))])
@pytest.mark.parametrize("kind", range(4), ids=KINDS)
def test_random_robots(kind, k):
    assert assert_right(10_000 + 4 * k + kind)


@pytest.mark.slow
@pytest.mark.parametrize("part", range(2))
def test_many_random_robots(part):
    """Together a hundred; at most one in fifty may be too close to call outside the band."""
    decided = [assert_right(seed) for seed in range(50 * part, 50 * part + 50)]
    assert sum(decided) >= 49


def bracket(feasible: sy.FeasibleSet, inside: np.ndarray, outside: np.ndarray) -> tuple[float, float]:
    """Where on the line the last proof of feasibility and the first proof of the contrary are."""

    def verdict(place: float) -> bool | None:
        found = sy.check(feasible, base=inside + place * (outside - inside))
        if found.feasible is not None:
            assert found.certificate.verify()
        return found.feasible

    low, high = 0.0, 1.0
    while high - low > 1e-10:
        middle = (low + high) / 2
        found = verdict(middle)
        if found is None:
            break
        low, high = (middle, high) if found else (low, middle)
    return low, high


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_the_undecided_band_is_thin(seed):
    """From both sides, the boundary between proofs is met within a billionth of the way or two."""
    instance = random_instance(4 * seed, most_links=10)
    rng = np.random.default_rng(seed)
    outside = instance.base + 0.3 * np.abs(instance.base).max() * rng.normal(size=len(instance.base))
    if sy.check(instance.feasible, base=outside).feasible:
        pytest.skip("this direction leads to another feasible robot")
    low, high = bracket(instance.feasible, instance.base, outside)
    for place, expected in ((low - 2e-9, True), (high + 2e-9, False)):
        found = sy.check(instance.feasible, base=instance.base + place * (outside - instance.base))
        assert found.feasible in (expected, None)
    assert high - low <= 4e-9


@pytest.mark.parametrize("moment", [0.0, -1e-9, -1e-300])
def test_a_body_without_inertia_is_never_called_feasible(moment):
    """A pendulum that nothing resists, on the boundary or beside it; a thousandth of a gram m² above it, it exists."""
    model = sy.Model(sy.Robot.from_dh([("0", 0.0, 0.0, "q")], gravity=(0, -9.81, 0)))
    feasible = sy.FeasibleSet(model)
    assert sy.check(feasible, base=[moment, 0.1, 0.0]).feasible is not True
    assert sy.check(feasible, base=[1e-6, 0.1, 0.0]).feasible is True


def test_faces_of_the_wam_are_where_its_axes_meet():
    """Three axes meet in the shoulder: mass there on link 1, 2 and 3, and on the axis of link 1, never shows."""
    rows = [("-pi/2", 0, 0, "q"), ("pi/2", 0, 0, "q"), ("-pi/2", 0.045, 0.55, "q"), ("pi/2", -0.045, 0, "q")]
    feasible = sy.FeasibleSet(sy.Model(sy.Robot.from_dh(rows)))
    bases = dual_face(feasible).exact_bases
    assert [len(basis[0]) for basis in bases] == [2, 3, 3, 4]
    # In the frame of link 3 the shoulder is at -0.045 along x and 0.55 along y, as the rows say.
    shoulder = [Fraction("-0.045"), Fraction("0.55"), Fraction(0), Fraction(1)]
    for column in range(3):
        assert sum(v * row[column] for v, row in zip(shoulder, bases[2], strict=True)) == 0
    # The axis of joint 1 is the y axis of frame 1; masses on it do not show.
    for vector in ([0, 1, 0, 0], [0, 0, 0, 1]):
        assert all(sum(v * row[column] for v, row in zip(vector, bases[0], strict=True)) == 0 for column in range(2))
