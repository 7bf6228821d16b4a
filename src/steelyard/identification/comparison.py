"""Comparison of saved estimates of one robot: the parameters and the predictions in which they differ."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.display import html_table, shortened, text_table
from steelyard.dynamics import Model
from steelyard.dynamics.threads import in_one_thread
from steelyard.errors import InputError
from steelyard.files import write_json
from steelyard.regression import Estimate
from steelyard.robot import RobotFile

from .default_terms import model_of_estimate
from .log_reader import Progress
from .parameter_table import CONFIDENCE
from .prediction_difference import PredictionDifference, difference_on_logs, difference_on_random_motion, labels
from .saved import matching_estimate
from .saved_result import SavedResult
from .validation import read_as_fitted

__all__ = ["Comparison", "ParameterDifference", "compare_estimates", "holm"]

Array = NDArray[np.float64]
COMPARISON_FORMAT = "steelyard-comparison-1"
MOST_ROWS = 12  # that are printed of those that do not differ: more are not read
MOST_NAMED = 5  # in a sentence
WIDEST = 48  # characters of a base parameter in a table
PRINCIPAL = re.compile(r"J\d+_\d+")  # moments about axes of their own in each estimate, which cannot be compared
FREEDOM = 30
"""Degrees of freedom of Student's t. Standard errors come from batches of samples, tens to hundreds of them, and files
do not tell how many. Of 168 pairs of logs of 40 s of a simulated UR5, 9 % differed by the normal quantiles, 4 % with 60
degrees, 3 % with 30."""

ROUNDING = 1e-9
"""Differences below this part of the values are rounding, whatever the standard errors say."""


@dataclass(frozen=True, eq=False)
class ParameterDifference:
    """One parameter of two estimates.

    Attributes
    ----------
    name : str
        A base parameter in words, or the name of a number of links such as ``"m3"``.
    kind : {"base", "link", "elastic"}
    meaning, unit : str
        Of numbers of links, and of compliances.
    first, second : str
        The estimates.
    first_value, second_value : float
        What the data says: least squares for base parameters, the middle of the interval for numbers of links.
    half_width : float
        Of the interval of the difference: the root of the sum of the squares of those of the two values.
    times : float
        The size of the difference in units of `half_width`.
    differs : bool
        Whether that is beyond the interval, all comparisons taken together.
    """

    name: str
    kind: Literal["base", "link", "elastic"]
    meaning: str
    unit: str
    first: str
    second: str
    first_value: float
    second_value: float
    half_width: float
    times: float
    differs: bool = False


@dataclass(frozen=True, eq=False)
class Comparison:
    """The result of :func:`compare_estimates`.

    Attributes
    ----------
    names : tuple of str
        The estimates; each is compared with the first.
    differences : tuple of ParameterDifference
        The base parameters, those that differ most first.
    link_differences : tuple of ParameterDifference
        Likewise of numbers of single links and joints; asked where base parameters differ.
    elastic_differences : tuple of ParameterDifference
        Of the compliances of elastic joints, of which estimates are normal where those of stiffnesses are not.
    explanations : tuple of (str, str, tuple of str)
        Two estimates, and the links and joints of which one alone, with other parameters, would explain all the
        differences of base parameters of the two, the best first. Only where the robot is known.
    prediction : PredictionDifference or None
        None where the robot is not known.
    remarks : tuple of str
        What the user should know, a sentence each.
    results : tuple of SavedResult
        What was compared.
    model : Model or None
        Of the robot, where it is known.
    """

    names: tuple[str, ...]
    differences: tuple[ParameterDifference, ...] = field(repr=False)
    link_differences: tuple[ParameterDifference, ...] = field(repr=False)
    elastic_differences: tuple[ParameterDifference, ...] = field(default=(), repr=False)
    explanations: tuple[tuple[str, str, tuple[str, ...]], ...] = field(default=(), repr=False)
    prediction: PredictionDifference | None = field(default=None, repr=False)
    remarks: tuple[str, ...] = field(default=(), repr=False)
    results: tuple[SavedResult, ...] = field(default=(), repr=False)
    model: Model | None = field(default=None, repr=False)

    @property
    def differs(self) -> bool:
        """Whether any base parameter or compliance does; what neither shows moves no robot."""
        return any(one.differs for one in (*self.differences, *self.elastic_differences))

    @property
    def sentences(self) -> tuple[str, ...]:
        """The findings as sentences."""
        count = len(self.differences)
        differing = [one for one in self.differences if one.differs]
        level = f"{100 * CONFIDENCE:g} %"
        pairs = len(self.names) - 1
        what = "base parameters" if pairs == 1 else f"base parameters ({pairs} estimates, each against the first)"
        springs = [one for one in self.elastic_differences if one.differs]
        told = [
            f"The {one.name} differs beyond its {level} interval: {one.first_value:.4g} and {one.second_value:.4g} "
            f"{one.unit}, stiffnesses of {1.0 / one.first_value:.4g} and {1.0 / one.second_value:.4g}."
            for one in springs
        ]
        if not differing and told:
            return (f"None of {count} {what} differs beyond its {level} interval.", *told)
        if not differing:
            also = len(self.elastic_differences)
            compliances = ("", ", nor the compliance of a joint", f", nor any of {also} compliances")[min(also, 2)]
            return (
                f"Nothing differs: none of {count} {what} differs beyond its {level} interval{compliances}, all the "
                "comparisons taken together.",
            )
        verb = "differs beyond its" if len(differing) == 1 else "differ beyond their"
        found = [
            f"{len(differing)} of {count} {what} {verb} {level} "
            f"interval{'s' * (len(differing) > 1)}: {_listed([shortened(one.name, WIDEST) for one in differing])}.",
            *told,
        ]
        for first, second, parts in self.explanations:
            if parts:
                others = f" (so would {', or '.join(parts[1:MOST_NAMED])})" if len(parts) > 1 else ""
                found.append(f"Between {first} and {second}, {parts[0]} alone explains all of this{others}.")
            else:
                found.append(f"Between {first} and {second}, no single link or joint explains all of this.")
        links = [one for one in self.link_differences if one.differs]
        if links:
            told = [
                f"{one.meaning} ({one.first_value:.4g} and {one.second_value:.4g} {one.unit}".rstrip() + ")"
                for one in links
            ]
            found.append(f"Of single links and joints: {_listed(told)}.")
        return tuple(found)

    def _rows(self, kind: tuple[ParameterDifference, ...]) -> list[tuple[str, ...]]:
        several = len(self.names) > 2
        shown = [one for one in kind if one.differs]
        shown += [one for one in kind if not one.differs][: max(MOST_ROWS - len(shown), 0)]
        return [
            (
                shortened(one.name, WIDEST),
                *((one.second,) if several else ()),
                f"{one.first_value:.4g}",
                f"{one.second_value:.4g}",
                f"{one.half_width:.2g}",
                f"{one.times:.2f}",
                "yes" if one.differs else "",
            )
            for one in shown
        ]

    def _heads(self) -> tuple[str, ...]:
        others = ("other", "A", "value") if len(self.names) > 2 else ("A", "B")
        return ("parameter", *others, "±", "times", "differs")

    def __str__(self) -> str:
        parts = [*self.sentences]
        numbers = range(len(self._heads()) - 5, len(self._heads()) - 1)
        who = ", ".join(f"{label} is {name}" for label, name in zip(labels(len(self.names)), self.names, strict=True))
        parts.append(
            f"{who}. Base parameters are those of plain least squares, which no prior draws, and numbers of links are "
            "the middles of their intervals, not the answers; ± is the interval of the difference."
        )
        for kind in (self.differences, self.link_differences, self.elastic_differences):
            if kind:
                rows = self._rows(kind)
                parts.append(text_table(self._heads(), rows, numbers=numbers))
                if len(rows) < len(kind):
                    parts.append(f"({len(kind) - len(rows)} more differ less.)")
        if self.prediction is not None:
            parts.append(str(self.prediction))
        parts.extend(f"Note: {remark}" for remark in self.remarks)
        return "\n".join(parts)

    def _repr_html_(self) -> str:
        kinds = (self.differences, self.link_differences, self.elastic_differences)
        tables = [html_table("", self._heads(), self._rows(kind)) for kind in kinds]
        told = () if self.prediction is None else self.prediction.sentences
        return html_table(self.sentences[0], (), (), (*self.sentences[1:], *told, *self.remarks)) + "".join(tables)

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain data: dictionaries, lists, texts and numbers."""
        return {
            "format": COMPARISON_FORMAT,
            "names": self.names,
            "confidence": CONFIDENCE,
            "differs": self.differs,
            "sentences": self.sentences,
            "differences": self.differences,
            "link_differences": self.link_differences,
            "elastic_differences": self.elastic_differences,
            "explanations": [
                {"first": first, "second": second, "alone": parts} for first, second, parts in self.explanations
            ],
            "prediction": None if self.prediction is None else self.prediction.to_dict(),
            "remarks": self.remarks,
        }

    def save(self, path: str | Path) -> None:
        """Write it as JSON, numbers that are not known as null; the file appears whole or not at all."""
        write_json(self.to_dict(), path)


def _listed(names: Sequence[str]) -> str:
    more = len(names) - MOST_NAMED
    return "; ".join(names[:MOST_NAMED]) + (f"; and {more} more" if more > 0 else "")


@in_one_thread
def compare_estimates(
    results: Sequence[str | Path],
    *,
    robot: str | Path | RobotFile | None = None,
    logs: Sequence[str | Path] = (),
    seed: int = 0,
    progress: Progress | None = None,
) -> Comparison:
    """Tell in which parameters saved estimates of one robot differ beyond their intervals, and how predictions differ.

    Compared are the base parameters that plain least squares made of the data of each estimate: their standard errors
    tell how far they are from the truth, which a prior would hide. Each difference is held against the root of the sum
    of both squared standard errors, and all of them together by Holm's method: in 95 of 100 cases, estimates of one
    robot from independent noise differ in nothing. Where base parameters differ, the numbers of single links are
    compared by the intervals of their tables in the same way.

    Parameters
    ----------
    results : sequence of path
        Two or more folders that ``steelyard identify`` wrote, or ``estimate.json`` files; each is compared with the
        first. A description among them, such as a URDF, stands for its inertials (CAD), which are taken as exact.
    robot : str, Path or RobotFile, optional
        URDF or robot.toml; the one with which the first estimate was made, where it is still there.
    logs : sequence of path
        On which predictions are compared, processed as those of the first were; a random motion where there are none.
    seed : int
        Of the random motion.
    progress : callable, optional
        Called with a few words before each step.

    Raises
    ------
    InputError
        If a file cannot be used, the estimates belong to different robots, or nothing is known of their errors.

    Examples
    --------
    >>> import tempfile
    >>> from dataclasses import replace
    >>> import numpy as np, steelyard as sy
    >>> one = sy.Estimate(
    ...     method="ordinary least squares", base_names=("m1", "lx1"), base_expressions=("m1", "lx1"),
    ...     base=np.array([2.0, 0.5]), standard_error=np.array([0.1, 0.01]), joint_names=("joint1",),
    ...     relative_error=0.05, row_count=100, condition_number=1.0,
    ... )
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     first, second = Path(folder) / "a.json", Path(folder) / "b.json"
    ...     one.save(first)
    ...     replace(one, base=np.array([2.1, 0.6])).save(second)
    ...     found = compare_estimates([first, second])
    >>> found.sentences[0]
    '1 of 2 base parameters differs beyond its 95 % interval: lx1.'
    """
    if len(results) < 2:
        raise InputError(f"Two or more results are compared, got {len(results)}; give their folders or estimates.")
    loaded, model, file = _loaded(results, robot, bool(logs))
    for other in loaded[1:]:
        _require_same(loaded[0], other)
    pairs = [(loaded[0], other) for other in loaded[1:]]
    found = [one for first, second in pairs for one in _base_differences(first, second)]
    if not found:
        raise InputError(
            f"{loaded[0].name}: no standard errors are known that hold, since torques were filtered or the data shows "
            "nothing, so that nothing can be compared; identify anew without torque_cutoff, or with a richer motion."
        )
    differences = _judged(found)
    links: list[ParameterDifference] = []
    if any(one.differs for one in differences):
        links = _judged([one for first, second in pairs for one in _link_differences(first, second)])
    springs = [one for first, second in pairs for one in _elastic_differences(first, second)]
    remarks = [
        f"{one.name} does not hold the base parameters of plain least squares, so those of its answer were compared. "
        "Physics and priors draw them away from the data; differences may come from that."
        for one in loaded
        if one.estimate.unconstrained_base is None and one.estimate.consistency is not None
    ]
    remarks += [
        f"{one.name} is a description: its inertials are taken as exact, and are all that is compared; friction and "
        "rotors are those of the estimate in what it predicts, whatever it states."
        for one in loaded
        if one.is_description
    ]
    remarks += _not_shown(loaded)
    remarks += _filtered_differently(loaded)
    explanations, prediction = [], None
    if file is None or model is None:
        remarks.append(
            "The robot file of these results is not known, or was changed, so that predictions were not compared; give "
            "it with --robot."
        )
    else:
        for one in loaded:
            if not one.is_description:
                matching_estimate(model, one.path)
        names, bases = [one.name for one in loaded], [one.estimate.base for one in loaded]
        if logs:
            first = next(one for one in loaded if not one.is_description)
            read = read_as_fitted(file, model, first, logs, progress=progress)
            remarks += read.remarks
            source = str(logs[0]) if len(logs) == 1 else f"{len(logs)} logs"
            prediction = difference_on_logs(model, read.information, names, bases, source)
        else:
            prediction = difference_on_random_motion(model, names, bases, seed=seed)
        explanations = [
            (first.name, second.name, _explanations(model, first.estimate, second.estimate))
            for first, second in pairs
            if any(one.differs and one.second == second.name for one in differences)
        ]
    return Comparison(
        tuple(one.name for one in loaded),
        tuple(differences),
        tuple(links),
        tuple(_judged(springs)) if springs else (),
        tuple(explanations),
        prediction,
        tuple(dict.fromkeys(remarks)),
        tuple(loaded),
        model,
    )


def _loaded(
    results: Sequence[str | Path], robot: str | Path | RobotFile | None, needs_robot: bool
) -> tuple[list[SavedResult], Model | None, RobotFile | None]:
    """Read estimates and descriptions, and the robot that they are of, where it is known."""
    described = {k for k, one in enumerate(results) if Path(one).is_file() and Path(one).suffix.lower() != ".json"}
    if len(described) == len(results):
        raise InputError(
            f"{results[0]} and {results[1]} are descriptions, of which no errors are known; compare a description with "
            "a folder of results."
        )
    read = {k: SavedResult.load(one) for k, one in enumerate(results) if k not in described}
    first = next(iter(read.values()))
    given = first.robot_file if robot is None else robot
    if given is None and described:
        given = results[min(described)]
    if given is None and needs_robot:
        raise InputError(
            f"--log needs the robot, and {first.name} does not tell its file, or that was changed; give --robot."
        )
    file = None if given is None else RobotFile.load(given)
    model = None if file is None else model_of_estimate(first.estimate, file)
    for k in described:
        assert model is not None  # of the description itself, where of no other
        read[k] = SavedResult.of_description(results[k], first, model)
    return [read[k] for k in range(len(results))], model, file


def _require_same(first: SavedResult, other: SavedResult) -> None:
    """Refuse estimates of different robots: their parameters have different names, or mean different things."""
    one, two = first.estimate, other.estimate
    lists = [
        ("joint", one.joint_names, two.joint_names),
        ("base parameter", one.base_expressions, two.base_expressions),
    ]
    if one.parameter_names and two.parameter_names:
        lists.insert(1, ("parameter", one.parameter_names, two.parameter_names))
    for what, own, given in lists:
        if own == given:
            continue
        alone = [*((first, n) for n in own if n not in given), *((other, n) for n in given if n not in own)]
        told = f"only {alone[0][0].name} has the {what} {alone[0][1]}" if alone else f"the order of the {what}s differs"
        raise InputError(
            f"{other.name}: is of another robot, or of other terms, than {first.name}: {told}; compare estimates that "
            "were made with the same robot file, which states its [[terms]]."
        )


def _not_shown(loaded: Sequence[SavedResult]) -> list[str]:
    """Say which base parameters cannot be compared, so that nobody takes them for the same."""
    found = []
    for one in loaded:
        estimate = one.estimate
        both = zip(estimate.base_expressions, estimate.standard_error, strict=True)
        names = [shortened(name, WIDEST) for name, error in both if error == np.inf]
        if estimate.filtered_torque:
            found.append(f"The torques of {one.name} were filtered, so that its base parameters could not be compared.")
        elif names and not one.is_description:
            found.append(
                f"The data of {one.name} does not show {len(names)} base parameter{'s' * (len(names) > 1)}, which "
                f"could not be compared: {_listed(names)}."
            )
    return found


def _filtered_differently(loaded: Sequence[SavedResult]) -> list[str]:
    """Say whether other filters may be why estimates differ; which slow rows were masked moves nothing."""
    first = loaded[0].processing
    for other in loaded[1:]:
        second = other.processing
        if first is None or second is None:
            continue
        if replace(first, velocity_threshold=None) != replace(second, velocity_threshold=None):
            return [
                f"The logs of {loaded[0].name} and {other.name} were processed differently, which moves parameters by "
                "more than noise; where it matters, identify both with the same [processing]."
            ]
    return []


def _data(estimate: Estimate) -> Array:
    """Return what the data says of the base parameters."""
    return estimate.base if estimate.unconstrained_base is None else estimate.unconstrained_base


def _errors(first: Estimate, second: Estimate) -> Array:
    """Standard errors of the differences of base parameters, (n_b,), infinite where the data says nothing."""
    if first.filtered_torque or second.filtered_torque:
        return np.full_like(first.base, np.inf)
    least = ROUNDING * np.maximum(np.abs(_data(first)), np.abs(_data(second)))
    return np.asarray(np.maximum(np.hypot(first.standard_error, second.standard_error), least))


def _reach() -> float:
    """Half-width of an interval, in standard errors."""
    from scipy.special import stdtrit

    return float(stdtrit(FREEDOM, 0.5 + 0.5 * CONFIDENCE))


def _difference(
    name: str,
    kind: Literal["base", "link", "elastic"],
    results: tuple[SavedResult, SavedResult],
    values: Sequence[float],
    half_width: float,
    meaning: str = "",
    unit: str = "",
) -> ParameterDifference:
    first, second = results
    one, two = map(float, values)
    with np.errstate(divide="ignore"):
        times = 0.0 if one == two else float(np.abs(two - one) / np.float64(half_width))
    return ParameterDifference(name, kind, meaning, unit, first.name, second.name, one, two, float(half_width), times)


def _base_differences(first: SavedResult, second: SavedResult) -> list[ParameterDifference]:
    one, two = _data(first.estimate), _data(second.estimate)
    halves = _reach() * _errors(first.estimate, second.estimate)
    names = first.estimate.base_expressions
    return [
        _difference(name, "base", (first, second), values, half)
        for name, *values, half in zip(names, one, two, halves, strict=True)
        if np.isfinite(half)
    ]


def _link_differences(first: SavedResult, second: SavedResult) -> list[ParameterDifference]:
    """Return the differences of the numbers for which both tables have intervals."""
    from scipy.special import ndtri

    wider = _reach() / float(ndtri(0.5 + 0.5 * CONFIDENCE))  # those of the tables are of a normal distribution
    theirs = {row["name"]: row for row in second.estimate.parameter_table if _has_interval(row, second)}
    found = []
    for row in first.estimate.parameter_table:
        if not _has_interval(row, first) or row["name"] not in theirs:
            continue
        other = theirs[row["name"]]
        values = [0.5 * (r["lower"] + r["upper"]) for r in (row, other)]
        least = ROUNDING * max(map(abs, values))
        own = (0.5 * wider * (r["upper"] - r["lower"]) for r in (row, other))
        half = max(float(np.hypot(*own)), least)
        meaning, unit = str(row.get("meaning", row["name"])), str(row.get("unit", ""))
        found.append(_difference(row["name"], "link", (first, second), values, half, meaning, unit))
    return found


def _elastic_differences(first: SavedResult, second: SavedResult) -> list[ParameterDifference]:
    """Return those of the compliances of joints that are elastic in both, and measured in one at least."""
    from steelyard.estimators.joint_stiffness import JointStiffness  # loaded for elastic joints alone

    own, theirs = (
        {str(row.get("joint")): JointStiffness.from_dict(row, str(one.path)) for row in one.estimate.elastic_joints}
        for one in (first, second)
    )
    found = []
    for name, joint in own.items():
        other = theirs.get(name)
        if other is None or not joint.compliance > 0.0 < other.compliance:
            continue
        half = _reach() * float(np.hypot(joint.compliance_standard_error, other.compliance_standard_error))
        if "measured" not in (joint.verdict, other.verdict) or not np.isfinite(half):
            continue
        told, unit = f"compliance of {name}", "/".join(reversed(joint.unit.split("/"))).replace("N·m", "(N·m)")
        values = joint.compliance, other.compliance
        found.append(_difference(told, "elastic", (first, second), values, half, told, unit))
    return found


def _has_interval(row: Any, result: SavedResult) -> bool:
    name, ends = row.get("name"), (row.get("lower"), row.get("upper"))
    told = [end for end in ends if isinstance(end, (int, float)) and not isinstance(end, bool)]
    if not isinstance(name, str) or any(end is not None and end not in told for end in ends):
        raise InputError(
            f"{result.path}: 'parameter_table' has a row without name or interval; save the estimate anew."
        )
    if len(told) == 2 and told[1] < told[0]:
        raise InputError(f"{result.path}: the interval of {name} ends before it begins; save the estimate anew.")
    return len(told) == 2 and row.get("basis") != "unknown" and PRINCIPAL.fullmatch(name) is None


def _judged(found: list[ParameterDifference]) -> list[ParameterDifference]:
    """Mark what differs, all comparisons taken together, and sort by how far."""
    from scipy.special import stdtr

    times = np.array([one.times for one in found])
    rejected = holm(2.0 * stdtr(FREEDOM, -_reach() * times), 1.0 - CONFIDENCE)
    marked = [replace(one, differs=bool(yes)) for one, yes in zip(found, rejected, strict=True)]
    return sorted(marked, key=lambda one: -one.times)


def holm(probabilities: ArrayLike, level: float) -> NDArray[np.bool_]:
    """Tell which of many hypotheses are rejected, with a probability of at most `level` of rejecting any true one.

    The least probability is held against the level over their number, the next against the level over one less, until
    one is not rejected (S. Holm, A simple sequentially rejective multiple test procedure, 1979). Nothing need be known
    of how they hang together. The probabilities (m,) are of what was seen, or more, where a hypothesis is true.

    Examples
    --------
    >>> holm([0.01, 0.04, 0.03, 0.005], 0.05).tolist()
    [True, False, False, True]
    """
    given = np.asarray(probabilities, dtype=float)
    order = np.argsort(given, kind="stable")
    kept = given[order] <= level / (len(given) - np.arange(len(given)))
    rejected = np.zeros(len(given), dtype=bool)
    rejected[order[: len(kept) if kept.all() else int(np.argmin(kept))]] = True
    return rejected


def _explanations(model: Model, first: Estimate, second: Estimate) -> tuple[str, ...]:
    """Links and joints of which one alone, with other parameters, leaves no base parameter beyond its interval.

    For each, the change of its parameters is sought that makes the largest remaining difference, in standard errors,
    least (a linear program); where that is within what noise alone reaches, the link explains the differences.
    """
    from scipy.optimize import linprog
    from scipy.special import stdtrit

    errors = _errors(first, second)
    known = np.isfinite(errors) & (errors > 0.0)
    difference = (_data(second) - _data(first))[known] / errors[known]
    matrix = model.base_parameters().K[known] / errors[known, None]
    reach = float(-stdtrit(FREEDOM, (1.0 - CONFIDENCE) / (2.0 * max(known.sum(), 1))))
    found = []
    for name, columns in _parts(model):
        own = matrix[:, columns]
        own = own[:, np.any(own != 0.0, axis=0)]
        if own.shape[1] == 0:
            continue
        own = own / np.abs(own).max(axis=0)
        ones = np.ones((len(own), 1))
        solved = linprog(
            [*np.zeros(own.shape[1]), 1.0],
            A_ub=np.block([[own, -ones], [-own, -ones]]),
            b_ub=np.concatenate([difference, -difference]),
            bounds=[(None, None)] * own.shape[1] + [(0.0, None)],
        )
        left = np.inf if solved.fun is None else float(solved.fun)  # in standard errors
        if left <= reach:
            found.append((left, name))
    return tuple(name for _, name in sorted(found))


def _parts(model: Model) -> list[tuple[str, list[int]]]:
    """Links and the terms of joints, with their columns of the standard parameters."""
    robot = model.robot
    links = {int(c) for columns in model.link_columns for c in columns}
    parts = [
        (f"the link {link.name}", [int(c) for c in columns])
        for link, columns in zip(robot.links, model.link_columns, strict=True)
    ]
    starts = [int(columns[0]) for columns in model.link_columns]
    ends = [*starts[1:], model.parameter_count]
    for joint, start, end in zip(robot.joints, starts, ends, strict=True):
        parts.append(
            (f"friction, rotor and offset of the joint {joint.name}", [c for c in range(start, end) if c not in links])
        )
    return parts
