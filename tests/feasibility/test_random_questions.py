"""Verdicts on robots with coupled motors, mimic and sliding joints, nearly parallel axes, branches and constraints."""

import json

import numpy as np
import pytest
from random_questions import Question, margin_by_cvxpy, random_question

import steelyard as sy
from steelyard.feasibility import verify_document

CLEAR = 1e-6


def decided(question: Question) -> sy.Verdict:
    """The verdict, which is proved unless the margin is within a millionth of the scale."""
    verdict = sy.check(question.feasible, base=question.base)
    if verdict.feasible is None:
        assert abs(verdict.margin) <= CLEAR * question.scale
    else:
        assert verify_document(json.loads(json.dumps(verdict.certificate.to_dict())))
    return verdict


@pytest.mark.parametrize(
    "seed", [8, 29, *(pytest.param(s, marks=pytest.mark.slow) for s in (0, 7, 9, 10, 12, 13, 15, 22, 25, 32))]
)
def test_verdict_and_margin_are_those_of_cvxpy(seed):
    """The conditions are written out anew, and β enters through torques: see `margin_by_cvxpy`."""
    pytest.importorskip("cvxpy")
    question = random_question(seed)
    verdict = decided(question)
    margin, status = margin_by_cvxpy(question)
    if status == "infeasible":  # equations of constraints contradict β
        assert verdict.feasible is False
        return
    assert verdict.feasible == (margin > 0)
    assert verdict.margin == pytest.approx(margin, rel=1e-5, abs=CLEAR)


@pytest.mark.parametrize("seed", [152, 182, 512, 696, pytest.param(1754, marks=pytest.mark.slow), 1898])
def test_nearly_singular_robots_are_decided(seed):
    """Axes a thousandth of a degree from parallel; in the last, least squares that LAPACK's gelsd cannot solve."""
    assert decided(random_question(seed)).feasible is not None


@pytest.mark.slow
@pytest.mark.parametrize("part", range(5))
def test_no_clear_verdict_is_left_open(part):
    for seed in range(3000 + 30 * part, 3030 + 30 * part):
        decided(random_question(seed))


@pytest.mark.parametrize("consistency", ["full", "inertia"])
def test_rotors_with_coupled_motors(consistency):
    """Offsets of the motors are in several base parameters, beside masses that slide against gravity."""
    robot = sy.Robot.from_dh([(0.11, 0.37, "q", -0.27), (1.01, 0.02, 0.32, "q")])
    model = sy.Model(robot.with_terms(sy.RotorInertia(), sy.MotorSide([[1, 0.5], [0, 1]])))
    feasible = sy.FeasibleSet(model, consistency)
    # Friction of -1 alone says that it is infeasible, by 1 or more.
    verdict = sy.check(feasible, base=-np.ones(feasible.K.shape[0]))
    assert (verdict.status, bool(verdict.certificate.verify())) == ("infeasible", True)
    assert verdict.margin <= -1.0
