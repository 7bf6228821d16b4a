"""Equations of several constraints together."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from steelyard.errors import InputError
from steelyard.feasibility import (
    CenterOfMassBox,
    Equality,
    EqualLinks,
    FeasibleSet,
    LinearBound,
    MeasuredMass,
    SymmetricLink,
    TotalMass,
)
from steelyard.feasibility.constraints.constraint import independent_equalities


def test_contradiction_names_both(two_links):
    with pytest.raises(
        InputError, match="'mass of forearm = 4 kg' contradicts 'mass of forearm = 3 kg'; remove or correct one"
    ):
        FeasibleSet(two_links, constraints=[TotalMass(equal=3, links="forearm"), TotalMass(equal=4, links="forearm")])


def test_contradiction_of_several_names_all(two_links):
    with pytest.raises(InputError) as caught:
        FeasibleSet(
            two_links,
            constraints=[
                TotalMass(equal=3.0, links="forearm"),
                SymmetricLink("forearm", plane="xz"),
                MeasuredMass(2.0, "upper arm"),
                TotalMass(equal=5.1),
            ],
        )
    assert str(caught.value) == (
        "the constraint 'total mass = 5.1 kg' contradicts these together: 'mass of forearm = 3 kg', "
        "'weighed mass of upper arm = 2 kg'; remove or correct one."
    )


def test_contradiction_through_links_that_are_alike(two_links):
    constraints = [
        EqualLinks("upper arm", "forearm"),
        MeasuredMass(2.0, "upper arm"),
        MeasuredMass(2.5, "forearm"),
    ]
    with pytest.raises(InputError, match=r"contradicts these together: 'link 2 \(forearm\) equals link 1 .*-m1 \+ m2"):
        FeasibleSet(two_links, constraints=constraints)


def test_what_follows_is_left_out(two_links):
    feasible = FeasibleSet(
        two_links,
        constraints=[
            TotalMass(equal=3.0, links="forearm"),
            MeasuredMass(2.0, "upper arm"),
            TotalMass(equal=5.0),
            SymmetricLink("forearm", plane=["xz", "yz"]),
            SymmetricLink("forearm", axis="z"),
            CenterOfMassBox("forearm", (0, -1, -1), (0, 1, 1)),
        ],
    )
    assert len(feasible.equalities) == 2 + 5 + 1
    assert np.linalg.matrix_rank(feasible.equation_matrix) == 8


@given(seed=st.integers(0, 2**32 - 1), rank=st.integers(1, 5), extra=st.integers(0, 5))
@example(seed=344, rank=3, extra=2)
def test_rank_is_that_of_numpy(seed, rank, extra):
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(rank, 8)) * 10.0 ** rng.uniform(-3, 3, (rank, 1))
    point = rng.normal(size=8)
    matrix = np.vstack([rows, rng.normal(size=(extra, rank)) @ rows])
    rng.shuffle(matrix)
    equalities = [Equality(f"row {i}", np.arange(8), row, float(row @ point)) for i, row in enumerate(matrix)]
    kept = independent_equalities(equalities, 8)
    assert len(kept) == np.linalg.matrix_rank(rows / np.linalg.norm(rows, axis=1, keepdims=True))
    if extra:
        last = matrix[-1]
        wrong = Equality("wrong", np.arange(8), last, float(last @ point) + 1e-3 * float(np.linalg.norm(last)))
        with pytest.raises(InputError, match="the constraint 'wrong' contradicts"):
            independent_equalities([*equalities, wrong], 8)


def test_empty_equation(two_links):
    assert independent_equalities([Equality("nothing", np.array([0]), np.zeros(1), 0.0)], 3) == ()
    with pytest.raises(InputError, match="'nothing' cannot hold for any parameters"):
        independent_equalities([Equality("nothing", np.array([0, 0]), np.array([1.0, -1.0]), 1.0)], 3)


def test_equal_blocks_count_once_and_names_differ(two_links):
    bounds = [
        TotalMass(maximum=9.0),
        TotalMass(maximum=9),
        LinearBound("m1 + m2", maximum=9.0),
        LinearBound("m1", maximum=2),
    ]
    names = [block.name for block in FeasibleSet(two_links, constraints=bounds).blocks if block.kind == "constraint"]
    assert names == ["total mass <= 9 kg", "m1 <= 2 kg"]
    close = [LinearBound("m1", maximum=2.00000001), LinearBound("m1", maximum=2.0)]
    names = [block.name for block in FeasibleSet(two_links, constraints=close).blocks if block.kind == "constraint"]
    assert names == ["m1 <= 2 kg", "m1 <= 2 kg (2)"]
