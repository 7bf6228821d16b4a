"""Thesis (3.9) to (3.13) and (3.32)."""

import numpy as np
import pytest

from steelyard.dynamics import Model, Viscous
from steelyard.errors import InputError
from steelyard.feasibility import FeasibleSet
from steelyard.lmi import (
    LinearMatrixInequality,
    base_variable_names,
    distance_inequality,
    to_base_dependent,
    to_standard,
)
from steelyard.robot import Robot


@pytest.fixture(scope="module")
def arm():
    rows = [("-pi/2", 0.0, 0.3, "q"), ("0", 0.5, 0.1, "q"), ("pi/2", 0.2, 0.0, "q")]
    return Model(Robot.from_dh(rows).with_terms(Viscous()))


def base_dependent_values(model, delta):
    """β = K δ and δ_d by name, by the definitions of chapter 3."""
    base = model.base_parameters()
    values = dict(zip(base_variable_names(model), base.K @ delta, strict=True))
    return values | {model.parameter_names[i]: delta[i] for i in base.dependent}


def test_both_spaces_give_the_same_matrix(arm):
    inequality = FeasibleSet(arm).inequality
    changed = to_base_dependent(inequality, arm)
    base = arm.base_parameters()
    assert changed.names == (
        *base_variable_names(arm),
        *(arm.parameter_names[i] for i in base.dependent),
    )
    rng = np.random.default_rng(1)
    for _ in range(5):
        delta = rng.normal(size=arm.parameter_count)
        np.testing.assert_allclose(
            changed.matrix(base_dependent_values(arm, delta)), inequality.matrix(delta), atol=1e-13
        )


def test_the_way_back_leads_home(arm):
    inequality = FeasibleSet(arm, "inertia").inequality
    again = to_standard(to_base_dependent(inequality, arm.base_parameters()), arm.base_parameters())
    assert again.names == inequality.names
    delta = np.random.default_rng(2).normal(size=arm.parameter_count)
    np.testing.assert_allclose(again.matrix(delta), inequality.matrix(delta), atol=1e-13)


def test_stand_ins_of_published_tables_work_too(two_links):
    inequality = FeasibleSet(two_links).inequality
    changed = to_base_dependent(inequality, two_links)
    # The first base parameter is Lzz1 + m2, so Lzz1 becomes beta1 - m2 in (Lyy1 + Lzz1 - Lxx1)/2.
    assert inequality.expressions[0][0, 0].terms == {"Lxx1": -0.5, "Lyy1": 0.5, "Lzz1": 0.5}
    assert changed.expressions[0][0, 0].terms == {"beta1": 0.5, "Lxx1": -0.5, "Lyy1": 0.5, "m2": -0.5}


def test_other_variables_stay_behind_the_others(arm):
    delta = np.zeros(arm.parameter_count)
    both = distance_inequality(delta, arm.parameter_names) & FeasibleSet(arm).inequality.with_margin(1e-6)
    changed = to_base_dependent(both, arm)
    assert changed.names[-1] == "u"
    assert len(changed.names) == arm.parameter_count + 1


def test_leading_names(arm):
    names = base_variable_names(arm, "leading")
    assert names == tuple(f"beta_{name}" for name in arm.base_parameters().names)
    changed = to_base_dependent(FeasibleSet(arm).inequality, arm, "leading")
    assert changed.names[: len(names)] == names


def test_wrong_spaces_are_refused(arm):
    changed = to_base_dependent(FeasibleSet(arm).inequality, arm)
    with pytest.raises(InputError, match="in base-dependent parameters already: it has the variable 'beta1'"):
        to_base_dependent(changed, arm)
    with pytest.raises(InputError, match="in standard parameters already"):
        to_standard(FeasibleSet(arm).inequality, arm)
    with pytest.raises(InputError, match='"number"'):
        base_variable_names(arm, "short")
    with pytest.raises(InputError, match="a Model or its base_parameters"):
        to_base_dependent(LinearMatrixInequality.from_matrices("x"), 3)
