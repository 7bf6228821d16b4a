"""Every recording of a real robot: classical weighted least squares, ours, and every earlier method."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal, cast

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics import Model
from steelyard.dynamics.threads import one_thread
from steelyard.errors import SteelyardError
from steelyard.estimators.fit import fit
from steelyard.feasibility import FeasibleSet, check
from steelyard.regression import Estimate, Information, least_squares
from steelyard_thesis.methods import METHODS, Method

from ..recordings import RealRobot, kinova_gen3, parted, staubli_tx40, ur10
from ..section import Context, Section, SectionResult, Table
from .published_robots import tx40_comparisons, wam_2014_comparisons
from .real_wam import real_wam

__all__ = ["SECTION", "certified", "estimates", "positive_definite_share", "robots"]

_Consistency = Literal["inertia", "full"]
_CONSISTENCIES: tuple[_Consistency, ...] = ("inertia", "full")
_CONFIGURATIONS = 2000
# The conditions of the paper where it has any: the triangle inequality is not among them before 2018.
_ASKS_FOR_FULL = {"Rucker2022", "NakanishiCorrected", "Ayusawa2010"}
_HEADS = (
    "robot",
    "method",
    "conditions",
    "training error, %",
    "held-out error, %",
    "criterion above WLS, %",
    "possible",
    "configurations with M > 0, %",
    "time, s",
    "how it ended",
)
_REMARKS = (
    "All methods have the same reduced regression, with the joint weights of classical weighted least squares. The "
    "WAM's published data is reduced already and has no weights; nothing of it is held out. Kinova Gen3 has CAD as a "
    "prior. Conditions: “inertia”, positive masses and inertias about the centre of mass, or “full”, the triangle "
    "inequality as well; none other, so that all methods can take part.",
    "Errors are relative to the torques, all joints together. The criterion is what the methods minimise, the weighted "
    "squared residual. Possible: what was proved of the base parameters, with the proof verified in rational "
    "arithmetic: “yes” under “full”, “inertia only”, “no”, or “undecided” where neither is proved.",
    "Where a fit has no optimum, the residual falls a little more as masses grow without end, so that a method may get "
    "below ours. Ours with least residual stops at a mass bound and says so; ours by default gives away at most 0.05 % "
    "of the criterion, or 0.8 % of what feasibility costs, for the lightest robot or the one closest to CAD.",
    "What is held out of Kinova Gen3 is another motion than the short one that is learnt from, which shows few "
    "parameters well: all methods predict it badly, plain least squares worst of all that fit the training data.",
)


@dataclass(frozen=True, eq=False)
class Outcome:
    """The estimate of a method from a recording.

    Attributes
    ----------
    method, conditions : str
    estimate : Estimate or None
        None where the method refused.
    ended : str
    seconds : float
    """

    method: str
    conditions: str
    estimate: Estimate | None
    ended: str
    seconds: float


def robots(context: Context) -> Iterator[RealRobot]:
    """Read the recordings of the data folder, one after the other."""
    data = cast("Path", context.data)
    for name, reader in (("TX40", staubli_tx40), ("UR10", ur10)):
        model, samples = reader(data)
        one, two = (Information.from_samples(model, part, batch_means=False) for part in parted(samples))
        yield RealRobot(name, model, one, two, "the last third of the log")
    model, first, second = kinova_gen3(data)
    one, two = (Information.from_samples(model, part, batch_means=False) for part in (first, second))
    prior = np.asarray(model.robot.parameters, dtype=np.float64)
    yield RealRobot("Gen3", model, one, two, "a second log", prior=prior)
    model, reduced = real_wam(context)
    yield RealRobot("WAM", model, reduced, None, "nothing", weights=None)


def estimates(robot: RealRobot) -> Iterator[Outcome]:
    """Run all the methods on the training data of a robot."""
    data, weights = robot.training, robot.weights
    sets = {kind: FeasibleSet(robot.model, kind) for kind in _CONSISTENCIES}
    yield _run("WLS" if weights else "OLS", "none", lambda: least_squares(data, weights=weights))
    for kind in _CONSISTENCIES:
        best = partial(fit, data, sets[kind], weights=weights, prefer=None, residual_slack=0.0)
        yield _run("ours, least residual", kind, best)
    prefer: Literal["cad", "lightest"] = "lightest" if robot.prior is None else "cad"
    yield _run("ours, default", "full", partial(fit, data, sets["full"], weights=weights, prefer=prefer))
    for method in METHODS:
        kind = "full" if method.__name__ in _ASKS_FOR_FULL else "inertia"
        yield _run(_spaced(method.__name__), kind, partial(_fitted, method, robot, sets[kind]))


def _spaced(name: str) -> str:
    """Return the name of a class in words: ``Mata2005`` as ``Mata 2005``."""
    return re.sub(r"(?<=[a-z])(?=[A-Z0-9])", " ", name)


def _fitted(method: type[Method], robot: RealRobot, feasible_set: FeasibleSet) -> Estimate:
    return method().fit(robot.training, feasible_set, weights=robot.weights, prior=robot.prior)


def _run(name: str, conditions: str, method: Callable[[], Estimate]) -> Outcome:
    begin = time.perf_counter()
    try:
        # Descents pass through infinity now and then; what comes out is judged below.
        with one_thread(), np.errstate(all="ignore"):
            estimate = method()
    except SteelyardError as error:
        return Outcome(name, conditions, None, f"refused: {error}", time.perf_counter() - begin)
    return Outcome(name, conditions, estimate, _ended(estimate), time.perf_counter() - begin)


def _ended(estimate: Estimate) -> str:
    """Return in a few words what the remarks of an estimate say."""
    said = " ".join(estimate.remarks)
    parts = []
    for text, words in (
        ("not converged", "not converged"),
        ("No reduced model", "no reduced model is possible"),
        ("No optimum below", "no optimum: stopped at a mass bound"),
        ("No box is known", "boxes of a default size"),
        ("Masses grew", "masses grew without end"),
        ("No prior is known", "no prior"),
    ):
        if text in said:
            parts.append(words)
    return "; ".join(parts) or "regularly"


def certified(robot: RealRobot, base: NDArray[np.float64]) -> str:
    """Return what is proved of base parameters: "yes" under full consistency, "inertia only", "no" or "undecided"."""
    proved: dict[str, bool | None] = {}
    for kind in _CONSISTENCIES:
        verdict = check(FeasibleSet(robot.model, kind), base=base)
        if verdict.certificate is None or not verdict.certificate.verify():
            proved[kind] = None
        else:
            proved[kind] = verdict.feasible
    if proved["full"]:
        return "yes"
    if proved["inertia"]:
        return "inertia only"
    return "no" if proved["inertia"] is False else "undecided"


def positive_definite_share(model: Model, base: NDArray[np.float64], q: NDArray[np.float64]) -> float:
    """Return the share of configurations (S, N) with a positive definite inertia matrix of links and rotors."""
    n = model.dof
    matrices = model.kernel("total_inertia_matrix", base=True)(q, base).reshape(len(q), n, n)
    return float(np.mean(np.linalg.eigvalsh(matrices)[:, 0] > 0.0))


def _criterion(robot: RealRobot, base: NDArray[np.float64]) -> float:
    weights = None if robot.weights is None else robot.training.joint_weights(robot.weights)
    problem = robot.training.reduced(weights)
    return float(np.sum((problem.R @ base - problem.rho) ** 2) + problem.residual2)


def _rows(robot: RealRobot, outcomes: list[Outcome]) -> Iterator[tuple[str | float, ...]]:
    first = outcomes[0].estimate
    assert first is not None
    least = _criterion(robot, first.base)
    q = np.random.default_rng(2014).uniform(-np.pi, np.pi, (_CONFIGURATIONS, robot.model.dof))
    for outcome in outcomes:
        found = outcome.estimate
        if found is None:
            empty = ("",) * 5
            yield (robot.name, outcome.method, outcome.conditions, *empty, outcome.seconds, outcome.ended)
            continue
        held = "" if robot.held_out is None else round(100.0 * robot.held_out.relative_error(found.base), 3)
        yield (
            robot.name,
            outcome.method,
            outcome.conditions,
            round(100.0 * robot.training.relative_error(found.base), 3),
            held,
            100.0 * (_criterion(robot, found.base) / least - 1.0),
            certified(robot, found.base),
            100.0 * positive_definite_share(robot.model, found.base, q),
            round(outcome.seconds, 4),
            outcome.ended,
        )


def _best(rows: list[tuple[str | float, ...]]) -> Table:
    """Return ours with least residual beside the best earlier method that is proved possible under its conditions."""
    found: list[tuple[str | float, ...]] = []
    for ours in (row for row in rows if row[1] == "ours, least residual"):
        proved = ("yes",) if ours[2] == "full" else ("yes", "inertia only")
        rivals = [
            (float(row[5]), str(row[1]))
            for row in rows
            if row[0] == ours[0] and not str(row[1]).startswith("ours") and row[6] in proved
        ]
        least, method = min(rivals)
        own = float(ours[5])
        found.append((ours[0], ours[2], own, method, least, (own - least) / (100.0 + least)))
    return Table(
        "Ours with least residual beside the best earlier method that is proved possible under the same conditions",
        (
            "robot",
            "conditions",
            "ours: above WLS, %",
            "best method",
            "its criterion above WLS, %",
            "ours above it, part",
        ),
        tuple(found),
    )


def _per_joint(robot: RealRobot, outcomes: list[Outcome]) -> Table | None:
    if not robot.training.has_joint_errors or robot.held_out is None:
        return None
    rows = []
    for outcome in outcomes:
        if outcome.estimate is None:
            continue
        base = outcome.estimate.base
        training = 100.0 * robot.training.joint_relative_error(base)
        held_out = 100.0 * robot.held_out.joint_relative_error(base)
        cells = (f"{a:.1f} / {b:.1f}" for a, b in zip(training, held_out, strict=True))
        rows.append((f"{outcome.method}, {outcome.conditions}", *cells))
    title = f"{robot.name}: relative error of each joint, training / held out ({robot.split}), %"
    return Table(title, ("method", *robot.model.robot.joint_names), tuple(rows))


def _compute(context: Context) -> SectionResult:
    rows: list[tuple[str | float, ...]] = []
    joints = []
    for robot in robots(context):
        context.say(robot.name)
        outcomes = []
        for outcome in estimates(robot):
            context.say(f"{robot.name}, {outcome.method}")
            outcomes.append(outcome)
        rows += _rows(robot, outcomes)
        table = _per_joint(robot, outcomes)
        if table is not None:
            joints.append(table)
    title = "All methods on all recordings (times differ from run to run; one thread)"
    comparisons = (*tx40_comparisons(context), *wam_2014_comparisons(context))
    return SectionResult(comparisons, (Table(title, _HEADS, tuple(rows)), _best(rows), *joints), remarks=_REMARKS)


SECTION = Section("real robots", "Every method on the recordings of four real robots", _compute, needs_data=True)
