"""Table of parameters: what each number rests on (data, physics or the prior), its interval, its value in CAD."""

from __future__ import annotations

import csv
import importlib
import io
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import compress
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.display import few_digits, html_table, outward, text_table
from steelyard.dynamics import Model
from steelyard.errors import InputError, MissingExtraError
from steelyard.feasibility import FeasibleSet
from steelyard.feasibility.bounds.profile_intervals import profile_intervals
from steelyard.feasibility.bounds.quantities import Quantity, quantities, standard_errors
from steelyard.files import listed, plain, suggestion
from steelyard.regression import Estimate, Information, ParameterCovariance
from steelyard.regression.repeated_motion import sentence_of_returning
from steelyard.robot import Inertia
from steelyard.robot.inertia import moment_row

from .untold_rotors import MOST_NAMED, UntoldRotors

if TYPE_CHECKING:
    from steelyard.regression.drift import FrictionDrift

__all__ = ["Basis", "LinkRows", "ParameterRow", "ParameterTable", "parameter_table", "weakest"]

Array = NDArray[np.float64]
Basis = Literal["measured", "bounded", "assumed", "unknown"]
CONFIDENCE = 0.95
BASES: tuple[Basis, ...] = ("measured", "bounded", "assumed", "unknown")  # the surest first

MEASURED, BOUNDED = 0.2, 1.0
"""Largest half-width of the interval of a parameter that counts as measured, and as bounded, in units of its scale. A
fifth is about what CAD is wrong by; where the half-width is the scale itself, not even the sign is sure."""

MANY_PARAMETERS = 300
"""Above which intervals are those of the data alone. With physics those of a whole robot took 8 s of the processor for
286 parameters (22 joints with friction) and 17 s for 377 (29 joints), growing with the third power of the number."""

TOO_MANY = (
    "Intervals are those of the data alone, and open where the data show nothing: the bounds of physics take too long "
    f"for more than {MANY_PARAMETERS} parameters; steelyard.feasibility.parameter_intervals finds them for single ones."
)

EXACT = 1e-5
"""Relative error of torques that count as exact, as simulated ones without noise are; they are taken to be off by this
much. No sensor is better, and confidence regions as narrow as rounding cannot be computed in: on a simulated arm the
intervals of what the motion does not show are the same to four digits at 1e-3, 1e-4 and 1e-5, far too narrow at 1e-8,
and at 1e-12 a matrix is singular."""

NEGLIGIBLE = 0.05
"""A term this small beside what would make the whole torque of its joint counts as if it had this size."""

WIDER = 1.5
"""Times as wide as by noise is an interval of which it is said that friction near standstill widens it."""

OTHERWISE = 0.3
"""Part of the change by a delay, or by a tilt, that may be otherwise for each number: it is of first order, and of some
rows. Beside noise that is a tenth of it, intervals along one direction alone would hold nothing else that can exist."""

RETURNS = 1.1
"""Times as wide as by noise is some interval where it is said that what returns with the motion widens them."""

STATED = 1e-6
"""Half-width of an interval relative to the value up to which a constraint of the user states the number: solvers meet
it to rounding. A total mass that was stated lay "outside its interval of 625 to 625 kg", and a stated mass of a link
was "assumed, 0 to 75 kg", since a rotor might hold it."""

DRAWN = 0.01
"""Of the half-width of an interval, by which a value lies beyond its end at least that the prior draws out of it; less
is the rounding of solvers."""


@dataclass(frozen=True, eq=False)
class ParameterRow:
    """One number of the answer.

    Attributes
    ----------
    name : str
        ``"m3"``, ``"Fvj2"``; ``"cx3"`` for a centre of mass, ``"J1_3"`` for a principal moment of inertia.
    meaning : str
        In words.
    lower, upper : float
        Of the interval that holds the true value with a probability of 95 %, by data and physics; infinite where
        nothing bounds it, NaN where no interval is told. A value outside is one that the prior draws there.
    cad : float
        What the description says; NaN where it says nothing.
    basis : {"measured", "bounded", "assumed", "unknown"}
        ``"measured"``: the data alone tells it, to a fifth of its scale. ``"bounded"``: data and physics confine it to
        its scale; so is what the data tells, where the prior draws the value out of its interval. ``"assumed"``:
        neither does; the prior chose it, or the data tells it only together with the inertia of a rotor of which
        nobody says anything, and the interval holds what is left if there is one. ``"unknown"``: torques were filtered
        where the regressor was not, so that no interval holds.
    """

    name: str
    meaning: str
    unit: str
    value: float
    lower: float
    upper: float
    cad: float
    basis: Basis

    @property
    def resolved(self) -> float:
        """The value as tables show it: what is less than a hundred-thousandth of its interval is rounded away."""
        width = self.upper - self.lower
        if not 0.0 < width < np.inf:
            return self.value
        return round(self.value, 5 - math.floor(math.log10(width))) + 0.0

    @property
    def is_outside(self) -> bool:
        """Whether the prior draws the value out of its interval."""
        return self.value < self.lower or self.value > self.upper

    @property
    def interval(self) -> str:
        """The interval in words, to follow what the value rests on."""
        ends = f"{few_digits(self.lower)} to {few_digits(self.upper)} {self.unit}"
        return f"outside its interval of {ends}" if self.is_outside else ends

    @property
    def rests_on(self) -> str:
        """The basis as tables show it, where a value outside its interval is marked."""
        return f"{self.basis}, outside" if self.is_outside else self.basis

    def __repr__(self) -> str:
        lower, upper = outward(self.lower, self.upper) if np.isfinite(self.lower) else ("?", "?")
        return f"ParameterRow({self.name} = {few_digits(self.resolved)} {self.unit}, {lower} to {upper}, {self.basis})"


@dataclass(frozen=True, eq=False)
class LinkRows:
    """The numbers of one link.

    Attributes
    ----------
    center : tuple of ParameterRow
        x, y and z of the centre of mass in the frame of the link.
    moments : tuple of ParameterRow
        Principal moments of inertia about it, ascending.
    """

    name: str
    mass: ParameterRow
    center: tuple[ParameterRow, ...]
    moments: tuple[ParameterRow, ...]

    def __repr__(self) -> str:
        center = ", ".join(few_digits(row.value, 3) for row in self.center)
        return f"LinkRows({self.name!r}: {few_digits(self.mass.value)} kg at ({center}) m)"


def weakest(rows: Iterable[ParameterRow]) -> Basis:
    """Return the basis of the least sure of some numbers."""
    return max((row.basis for row in rows), key=BASES.index)


def _rest_on(rows: Sequence[ParameterRow]) -> str:
    return f"{weakest(rows)}, outside" if any(row.is_outside for row in rows) else weakest(rows)


@dataclass(frozen=True, eq=False)
class ParameterTable:
    """All numbers of an answer; ``table["m3"]`` is one of them.

    Attributes
    ----------
    sentences : tuple of str
        Which numbers are known only together.
    covariance : ParameterCovariance or None
        Of the base parameters, with all the errors on which the intervals rest; None where not known.
    conflict : str
        Which values lie outside their intervals, why, and what would settle it; empty where none does.
    """

    rows: tuple[ParameterRow, ...]
    sentences: tuple[str, ...] = field(default=(), repr=False)
    covariance: ParameterCovariance | None = field(default=None, repr=False, compare=False)
    conflict: str = field(default="", repr=False)

    @property
    def confidence(self) -> float | None:
        """Of the intervals, 0.95; None where there are none."""
        return None if all(row.basis == "unknown" for row in self.rows) else CONFIDENCE

    @property
    def has_physics(self) -> bool:
        """Whether intervals are those of data and physics, and not of the data alone, as for many parameters."""
        return TOO_MANY not in self.sentences

    def __getitem__(self, name: str) -> ParameterRow:
        for row in self.rows:
            if row.name == name:
                return row
        raise InputError(f"there is no parameter {name!r}; {suggestion(name, [row.name for row in self.rows])}")

    def __iter__(self) -> Iterator[ParameterRow]:
        return iter(self.rows)

    def __len__(self) -> int:
        return len(self.rows)

    def count(self, basis: Basis) -> int:
        """Return how many numbers rest on one basis."""
        return sum(row.basis == basis for row in self.rows)

    @property
    def counts(self) -> str:
        """How many numbers rest on what, in words."""
        if self.confidence is None:
            return (
                f"None of the {len(self)} numbers has an interval: torques were filtered or decimated where the "
                "regressor was not, so that errors are larger than noise explains."
            )
        told = ", ".join(f"{self.count(basis)} are {basis}" for basis in ("measured", "bounded", "assumed"))
        return f"Of {len(self)} numbers {told}."

    @property
    def links(self) -> tuple[LinkRows, ...]:
        """The rows of each link: mass, centre of mass and principal moments of inertia."""
        by_name = {row.name: row for row in self.rows}
        found = []
        for link in range(1, len(by_name) + 1):
            if f"cx{link}" not in by_name:
                break
            mass, *others = (by_name[f"{part}{link}"] for part in ("m", "cx", "cy", "cz", "J1_", "J2_", "J3_"))
            found.append(LinkRows(mass.meaning.removeprefix("mass of "), mass, tuple(others[:3]), tuple(others[3:])))
        return tuple(found)

    def link_table(self) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
        """The table of masses and centres of mass, short enough for a terminal: its heads and its rows.

        Columns of intervals and of CAD are left out where there are none.
        """
        links = self.links
        told, described = self.confidence is not None, any(not np.isnan(link.mass.cad) for link in links)
        heads = ("link", "mass kg", "from", "to", "CAD", "rests on", "centre of mass m", "rests on")
        shown = (True, True, told, told, described, told, True, told)
        rows = []
        for link in links:
            _, value, lower, upper, cad, _, rests_on, _ = _written(link.mass)
            center = ", ".join(
                "-" if np.isnan(row.value) else f"{round(row.value, 3) + 0.0:.3f}" for row in link.center
            )
            rows.append((link.name, value, lower, upper, cad, rests_on, center, _rest_on(link.center)))

        return tuple(compress(heads, shown)), [tuple(compress(row, shown)) for row in rows]

    def __str__(self) -> str:
        return text_table(HEADS, [_written(row) for row in self.rows], numbers=(1, 2, 3, 4))

    def _repr_html_(self) -> str:
        return html_table(self.counts, HEADS, [_written(row) for row in self.rows])

    def to_csv(self) -> str:
        """The table as comma-separated values, numbers in full, with a line of names."""
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(COLUMNS)
        for row in self.rows:
            numbers = ("" if np.isnan(v) else repr(float(v)) for v in (row.value, row.lower, row.upper, row.cad))
            writer.writerow((row.name, row.meaning, row.unit, *numbers, row.basis))
        return out.getvalue()

    @classmethod
    def from_list(cls, rows: Sequence[Mapping[str, Any]], where: str) -> ParameterTable:
        """Return the table that `to_list` made plain, as ``estimate.json`` holds it.

        Parameters
        ----------
        rows : sequence of mapping
        where : str
            For messages.

        Raises
        ------
        InputError
            If a row is none of such a table.
        """
        found = []
        for number, row in enumerate(rows, start=1):
            try:
                texts = [str(row[key]) for key in ("name", "meaning", "unit")]
                value, cad = (np.nan if row[key] is None else float(row[key]) for key in ("value", "cad"))
                known = row["basis"] != "unknown"
                ends = [
                    float(end) if end is not None else side if known else np.nan
                    for end, side in ((row["lower"], -np.inf), (row["upper"], np.inf))
                ]
                basis = BASES[BASES.index(row["basis"])]
            except (KeyError, TypeError, ValueError):
                raise InputError(f"{where}: row {number} is none of a table of parameters; identify anew.") from None
            found.append(ParameterRow(texts[0], texts[1], texts[2], value, ends[0], ends[1], cad, basis))
        return cls(tuple(found))

    def to_frame(self, library: Literal["polars", "pandas"] = "polars") -> Any:
        """The table as a data frame, a row for each number, with NaN where there is none.

        Parameters
        ----------
        library : {"polars", "pandas"}

        Returns
        -------
        polars.DataFrame or pandas.DataFrame
            With the columns name, meaning, unit, value, lower, upper, cad and basis.

        Raises
        ------
        MissingExtraError
            If pandas is asked for and not installed.
        """
        if library not in ("polars", "pandas"):
            raise InputError(f'library must be "polars" or "pandas", got {library!r}.')
        columns = {name: [getattr(row, name) for row in self.rows] for name in COLUMNS}
        try:
            return importlib.import_module(library).DataFrame(columns)
        except ModuleNotFoundError:
            raise MissingExtraError(
                f"{library} is not installed; install it, or use to_frame(), whose table Polars holds."
            ) from None

    def to_list(self) -> list[dict[str, Any]]:
        """As plain data for JSON; numbers that are not finite are None."""
        return [plain(row) for row in self.rows]


COLUMNS = ("name", "meaning", "unit", "value", "lower", "upper", "cad", "basis")
HEADS = ("name", "value", "from", "to", "CAD", "unit", "rests on", "meaning")


def _written(row: ParameterRow) -> tuple[str, ...]:
    def number(value: float) -> str:
        return "" if np.isnan(value) else "open" if np.isinf(value) else f"{value:.4g}"

    return (
        row.name,
        number(row.resolved),
        number(row.lower),
        number(row.upper),
        number(row.cad),
        row.unit,
        row.rests_on,
        row.meaning,
    )


def parameter_table(
    info: Information,
    feasible_set: FeasibleSet,
    estimate: Estimate,
    unconstrained: Estimate,
    *,
    cad: ArrayLike | None = None,
    term_scales: ArrayLike | None = None,
    drifts: Sequence[FrictionDrift] = (),
    error: Array | None = None,
    error_of: str = "the delay of the torques",
    standstill: Array | None = None,
) -> ParameterTable:
    """Tell what every parameter, mass, centre of mass, principal moment and friction of an answer rests on.

    Intervals are those of `profile_intervals`: noise, with its correlation in time, and directions that the motion does
    not show, within what is physically possible. They speak of data and physics alone, also where the prior of the
    answer draws a value out of its interval. That of friction which drifts is widened to hold it from the begin to the
    end of the log, all are wider where torques are late, and those that friction near standstill moves are wider by as
    much.

    Parameters
    ----------
    info : Information
    feasible_set : FeasibleSet
    estimate : Estimate
        The answer, with standard parameters.
    unconstrained : Estimate
        Plain least squares of the same data and weights.
    cad : (n,), optional
        Standard parameters of the description; those of the model's robot where absent.
    term_scales : (n,), optional
        Parameters of terms that would make the whole torque of their joints, such as `term_deviations` tells.
    drifts : sequence of FrictionDrift, optional
        What `friction_drifts` found in the logs.
    error : (n_b,), optional
        Change of the base parameters that counts as a standard deviation beside noise: that of delays, or of a base
        that is tilted.
    error_of : str
        What makes it, for the sentence that says so.
    standstill : (n_b,), optional
        Further standard deviations of the base parameters, each by itself: those of friction near standstill, see
        `standstill_errors`.

    Returns
    -------
    ParameterTable
        Without intervals, and every number "unknown", where torques were filtered and the regressor was not.
    """
    parameters = estimate.parameters
    if parameters is None:
        raise InputError("parameter_table needs an estimate with standard parameters, such as that of fit.")
    asked, about = _quantities(feasible_set, parameters)
    covariance, wider, returns = _covariance(info, unconstrained, error, standstill)
    values = np.array([quantity.value(parameters) for quantity in asked])
    source = feasible_set.model.robot.parameters if cad is None else cad
    described = _described(feasible_set, np.asarray(source, dtype=float), asked, about)
    told: tuple[Array, Array] | None = None
    rotors = UntoldRotors.of(feasible_set)
    own_shares = np.array([rotors.share(quantity, parameters) for quantity in asked])
    centers, alone = _intervals_of_data(feasible_set, covariance, asked, parameters, unconstrained.base)
    if not covariance.filtered_torque and feasible_set.parameter_count > MANY_PARAMETERS:
        positive = np.array([quantity.never_negative for quantity in asked])
        told = np.where(positive, np.maximum(centers - alone, 0.0), centers - alone), centers + alone
    elif not covariance.filtered_torque:
        holds_rotors = np.isfinite(alone) & own_shares.any(axis=1)
        told = _profiles(rotors, unconstrained.base, covariance, asked, parameters, holds_rotors)
    scales = _scales(feasible_set, parameters, values, asked, about, term_scales)
    at_rest = _offsets_at_rest(info, feasible_set) if told is not None else []
    changes: dict[str, list[float]] = {}
    for drift in drifts:
        for name, times in drift.changes.items():
            changes.setdefault(name, []).extend(1.0 + times * (end - 1.0) for end in (drift.first, drift.last))
    rows, of_rotors = [], []
    for index, quantity in enumerate(asked):
        low, high, basis = np.nan, np.nan, "unknown"
        if told is not None:
            basis = "assumed"
            ranges = [values[index], *values[index] * np.array(changes.get(quantity.name, ()))]
            low, high = min(told[0][index], *ranges), max(told[1][index], *ranges)
            half = 0.5 * (high - low)
            stated = half <= STATED * abs(values[index])
            away = max(told[0][index] - values[index], values[index] - told[1][index])
            is_drawn = away > max(DRAWN * half, STATED * abs(values[index]))
            if is_drawn and quantity.name not in changes:  # data and physics tell another value
                low, high = told[0][index], told[1][index]
            widest = (1.0 if quantity.name in changes else 2.0) * MEASURED * scales[index]
            if stated:
                basis = "bounded"
            elif not is_drawn and alone[index] <= MEASURED * scales[index] and half <= widest:
                basis = "measured"
            elif half <= BOUNDED * scales[index]:
                basis = "bounded"
            if rotors.names and np.isfinite(alone[index]) and not stated:
                share = own_shares[index]
                # What the data tell is the number and its shares of rotors, and no rotor has a negative inertia.
                if np.any(share > 0.0):
                    low = min(low, 0.0) if quantity.never_negative else -np.inf
                if np.any(share < 0.0):
                    high = np.inf
                if np.any(share):
                    basis = "assumed"
                    of_rotors.append((quantity.name, np.flatnonzero(share)))
            if quantity.name in at_rest:
                low, high, basis = -np.inf, np.inf, "assumed"
        rows.append(
            ParameterRow(
                quantity.name,
                quantity.meaning,
                quantity.unit,
                float(values[index]),
                float(low),
                float(high),
                float(described[index]),
                basis,  # type: ignore[arg-type]
            )
        )
    rows = _within_total_mass(rows, about)
    assumed = {row.name for row in rows if row.basis == "assumed"}
    sentences = _known_together(info, feasible_set, unconstrained, covariance.standard_error, assumed, rotors)
    if changes and told is not None:
        hold = "changes in the course of a log; its interval holds it from its begin to its end"
        if len(changes) > 1:
            hold = "change in the course of a log; intervals hold them from its begin to its end"
        sentences.append(f"{listed(changes, MOST_NAMED)} {hold}.")
    if error is not None and told is not None:
        sentences.append(f"Intervals are as wide as {error_of} asks for.")
    if returns and told is not None:
        sentences.append(sentence_of_returning(info.returning, info.joint_names))
    if wider and told is not None:
        sentences.append(
            f"Intervals are wider than noise asks for where {listed(wider, MOST_NAMED)} would come out otherwise "
            "without the rows in which joints hardly move, or with friction that falls off with speed: that of slow "
            "joints is not that of the model."
        )
    if at_rest:
        sentences.append(
            f"{listed(at_rest, MOST_NAMED)} would hold the friction of joints that stand still in all of these "
            "logs, which may be any up to that of sliding, either way: motions of these joints tell it from an offset."
        )
    if of_rotors:
        sentences.append(rotors.sentence(of_rotors))
    if isinstance(model := feasible_set.model, Model) and "rotor_inertia" not in model.described_as:
        kinds = zip(rows, about, strict=True)
        sentences += _without_rotors([row for row, of in kinds if of.kind == "principal" or row.name[:3] in DIAGONAL])
    if told is not None and feasible_set.parameter_count > MANY_PARAMETERS:
        sentences.insert(0, TOO_MANY)
    conflict = _conflict(rows, about, feasible_set.model.robot.link_names)
    return ParameterTable(tuple(rows), tuple(sentences), covariance, conflict)


def _profiles(
    rotors: UntoldRotors,
    base: Array,
    covariance: ParameterCovariance,
    asked: list[Quantity],
    parameters: Array,
    holds_rotors: NDArray[np.bool_],
) -> tuple[Array, Array]:
    """Ends of the intervals by data and physics.

    Numbers that the data alone tell with a share of a rotor of which nobody says anything (`holds_rotors`) are told as
    if there were none, and one of their ends is open; physics confines the others by links that may hold rotors, see
    `UntoldRotors.with_rotors`.
    """
    found = np.zeros((2, len(asked)))
    feasible_set, wider_set = rotors.feasible_set, rotors.with_rotors()
    plainly = holds_rotors if wider_set is not feasible_set else np.ones(len(asked), dtype=bool)
    for chosen, among in ((plainly, feasible_set), (~plainly, wider_set)):
        if chosen.any():
            own = list(compress(asked, chosen))
            inside, own = rotors.within(among, parameters, own)
            profiles = profile_intervals(among, base, covariance, own, inside, CONFIDENCE)
            found[:, chosen] = profiles.lower, profiles.upper
    return found[0], found[1]


def _offsets_at_rest(info: Information, feasible_set: FeasibleSet) -> list[str]:
    """Return the offsets of joints that have Coulomb friction, of which the data show nothing.

    Friction is zero where the model has a velocity of zero; that of a real joint at rest takes up any torque to that of
    sliding, which is constant as an offset is.
    """
    model = feasible_set.model
    if not isinstance(model, Model):
        return []
    hidden, K = info.unidentifiable_mask, np.asarray(model.base_parameters().K, dtype=float)
    offsets, shown = dict[str, str](), dict[str, bool]()
    for column, (name, kind) in enumerate(zip(model.parameter_names, model.described_as, strict=True)):
        symbol = name.rstrip("0123456789")
        of_joint = name[len(symbol) - 1 :]  # "j3" of a joint, "m3" of a motor
        if kind == "offset":
            offsets[of_joint] = name
        elif kind == "friction":
            shown[of_joint] = shown.get(of_joint, False) or not K[hidden, column].any()
    return [name for of_joint, name in offsets.items() if not shown.get(of_joint, True)]


def _without_rotors(moments: list[ParameterRow]) -> tuple[str, ...]:
    """Say which moments of inertia are known as long as no rotor turns with a joint, as far as the model can tell.

    Simulated logs of nine arms whose rotors take some 3 % of the torques: of the diagonal moments that are measured or
    bounded 8 of 43 were wrong where the model lacks rotors, and none of 19 where it has them; of all other numbers as
    many were wrong with rotors as without. Since physics confines links by what they may hold of rotors that no motion
    tells, those of the SO-101 are right.
    """
    told = [row.name for row in moments if row.basis in ("measured", "bounded")]
    if not told:
        return ()
    holds = "holds" if len(told) == 1 else "hold"
    return (
        f"{listed(told, MOST_NAMED)} {holds} where no rotor turns with a joint, as where torques are sensed behind "
        'the gears: the model has none. Otherwise add [[terms]] with kind = "rotor_inertia".',
    )


def _covariance(
    info: Information,
    unconstrained: Estimate,
    error: Array | None,
    standstill: Array | None,
) -> tuple[ParameterCovariance, list[str], bool]:
    """Return the covariance with all further errors, and what makes numbers less sure than noise.

    That is which of them friction near standstill does so, and whether what returns with the motion does.

    Data have the error of the best sensor at least: exact data would leave no room at all.
    """
    covariance = ParameterCovariance.of(info, unconstrained.base, unconstrained.weights)
    returns = False
    if info.returning:
        without = replace(info, returning=())
        by_noise = ParameterCovariance.of(without, unconstrained.base, unconstrained.weights).standard_error
        returns = bool(np.any(np.isfinite(by_noise) & (covariance.standard_error > RETURNS * by_noise)))
    if 0.0 < unconstrained.relative_error < EXACT:
        covariance = replace(covariance, root=covariance.root * (EXACT / unconstrained.relative_error))
    if error is not None:
        covariance = covariance.with_error(error).with_independent_errors(OTHERWISE * np.abs(error))
    wider = np.zeros(info.base_count, dtype=bool)
    if standstill is not None:
        by_noise = covariance.standard_error
        covariance = covariance.with_independent_errors(standstill)
        wider = np.isfinite(by_noise) & (covariance.standard_error > WIDER * by_noise)
    return covariance, list(compress(unconstrained.base_names, wider)), returns


def _conflict(rows: Sequence[ParameterRow], about: Sequence[_About], links: Sequence[str]) -> str:
    """Say which numbers the prior draws out of their intervals, of which links, and what would settle it; or nothing.

    In 51 simulated experiments of four arms, of which the truth is known, there are 30 such numbers among 5187, and the
    intervals of 8 hold it.
    """
    drawn = {row.name: of.link for row, of in zip(rows, about, strict=True) if row.is_outside}
    if not drawn:
        return ""
    lie = "lies outside its interval" if len(drawn) == 1 else "lie outside their intervals"
    own = [links[link] for link in sorted({*drawn.values()} - {-1})]
    of = f" ({listed(own, MOST_NAMED)})" if own else ""
    by_chance = int((1.0 - CONFIDENCE) * len(rows))
    if len(drawn) <= by_chance:
        few = f"of {len(rows)} intervals some {by_chance} miss the truth by chance"
        return f"{listed(drawn, MOST_NAMED)}{of} {lie}, to which the prior draws the answer; {few}."
    check = f"check the description of {listed(own, MOST_NAMED)}, " if own else ""
    return (
        f"{listed(drawn, MOST_NAMED)}{of} {lie}: the prior draws the answer that far away from the data, and one "
        f"of the two misleads there; {check}record a longer log, or give the data more weight by a smaller "
        "--prior-weight."
    )


def _within_total_mass(rows: Sequence[ParameterRow], about: Sequence[_About]) -> list[ParameterRow]:
    """No link is heavier than all of them, and together they weigh what each does, whatever rotors there are."""
    heaviest = next((row.upper for row in rows if row.name == "total mass"), np.inf)
    lightest = sum(row.lower for row, of in zip(rows, about, strict=True) if of.kind == "mass")
    found = []
    for row, of in zip(rows, about, strict=True):
        if of.kind == "mass":
            row = replace(row, upper=min(row.upper, heaviest))
        elif row.name == "total mass":
            row = replace(row, lower=max(row.lower, lightest))
        found.append(row)
    return found


@dataclass(frozen=True)
class _About:
    """The subject of a quantity: the number of its link, if any, and its kind."""

    link: int
    kind: Literal["mass", "center", "first", "second", "principal", "total", "term"]


def _quantities(feasible_set: FeasibleSet, parameters: Array) -> tuple[list[Quantity], list[_About]]:
    """Standard parameters, total mass, centres of mass, and principal moments of the answer."""
    asked = list(quantities(feasible_set))
    places = {int(c): divmod(k, 10) for k, c in enumerate(feasible_set.link_columns.ravel())}
    about = []
    for quantity in asked:
        used = np.flatnonzero(quantity.row)
        link, place = places.get(int(used[0]), (-1, 0))
        if quantity.mass is not None:
            about.append(_About(link, "center"))
        elif len(used) > 1:
            about.append(_About(-1, "total"))
        elif link < 0:
            about.append(_About(-1, "term"))
        else:
            about.append(_About(link, "mass" if place == 9 else "first" if place >= 6 else "second"))
    names = feasible_set.model.robot.link_names
    for link, columns in enumerate(feasible_set.link_columns):
        center, _, axes = _principal(parameters[columns])
        for number, axis in enumerate(axes.T):
            across = np.eye(3) - np.outer(axis, axis)
            quadratic = np.block(
                [[across, -(across @ center)[:, None]], [-(center @ across)[None], center @ across @ center]]
            )
            row = np.zeros(len(parameters))
            row[columns] = moment_row(quadratic)
            meaning = f"principal moment of inertia {number + 1} of {names[link]}"
            asked.append(Quantity(f"J{number + 1}_{link + 1}", meaning, "kg m²", row, never_negative=True))
            about.append(_About(link, "principal"))
    return asked, about


def _principal(body: Array) -> tuple[Array, Array, Array]:
    """Centre of mass, principal moments of inertia about it, ascending, and their axes, the columns (3, 3)."""
    inertia = Inertia.from_parameters(body)
    return inertia.com, *np.linalg.eigh(inertia.about_com)


def _described(feasible_set: FeasibleSet, cad: Array, asked: list[Quantity], about: list[_About]) -> Array:
    """The same quantities of the description, NaN where it says nothing; principal moments in ascending order."""
    found, finite = [], np.nan_to_num(cad)
    for quantity, what in zip(asked, about, strict=True):
        used = np.flatnonzero(quantity.row if quantity.mass is None else quantity.row + quantity.mass)
        known = np.isfinite(cad[used]).all()
        if what.kind == "principal":
            body = cad[feasible_set.link_columns[what.link]]
            known = np.isfinite(body).all() and body[9] > 0.0
            if known:
                found.append(float(_principal(body)[1][int(quantity.name[1]) - 1]))
                continue
        found.append(quantity.value(finite) if known else np.nan)
    return np.array(found)


def parameter_sizes(link_columns: NDArray[np.intp], parameters: Array, term_scales: ArrayLike | None = None) -> Array:
    """Return the size (n,) that parameters have in links of such masses and extents, whatever their own values.

    Parameters
    ----------
    link_columns : (L, 10) of int
        As a model or a feasible set has them.
    parameters : (n,)
        Of which the masses and extents are taken, and the sizes of terms.
    term_scales : (n,), optional
        What would make the whole torque of a joint; a term counts as at least `NEGLIGIBLE` of it.

    Returns
    -------
    ndarray
        (n,) in the units of the parameters.
    """
    sizes = np.abs(parameters)
    if term_scales is not None:
        scales = np.asarray(term_scales, dtype=float)
        sizes = np.maximum(sizes, NEGLIGIBLE * np.where(np.isfinite(scales), scales, 0.0))
    bodies = parameters[link_columns]
    mass, second = bodies[:, 9], 0.5 * bodies[:, [0, 3, 5]].sum(axis=1)
    sizes[link_columns[:, :6]] = second[:, None]
    sizes[link_columns[:, 6:9]] = np.sqrt(mass * second)[:, None]
    sizes[link_columns[:, 9]] = mass
    return sizes


def _scales(
    feasible_set: FeasibleSet,
    parameters: Array,
    values: Array,
    asked: list[Quantity],
    about: list[_About],
    term_scales: ArrayLike | None,
) -> Array:
    """Return what half-widths are compared with: the size of such a parameter in a link of this mass and extent."""
    sizes = parameter_sizes(feasible_set.link_columns, parameters, term_scales)
    second, first, mass = sizes[feasible_set.link_columns[:, [0, 6, 9]]].T
    of_link = {"mass": mass, "center": first / mass, "first": first, "second": second}
    found, principal = np.empty(len(asked)), dict[int, float]()
    for value, what in zip(values, about, strict=True):
        if what.kind == "principal":
            principal[what.link] = max(principal.get(what.link, -np.inf), value)
    for index, (quantity, what) in enumerate(zip(asked, about, strict=True)):
        if what.kind == "term":
            found[index] = sizes[int(np.flatnonzero(quantity.row)[0])]
        elif what.kind == "total":
            found[index] = abs(values[index])
        elif what.kind == "principal":
            found[index] = principal[what.link]
        else:
            found[index] = of_link[what.kind][what.link]
    return found


def _intervals_of_data(
    feasible_set: FeasibleSet,
    covariance: ParameterCovariance,
    asked: list[Quantity],
    parameters: Array,
    base: Array,
) -> tuple[Array, Array]:
    """Centers and half-widths of the intervals of plain least squares; infinite for what the base does not tell."""
    from scipy.special import ndtri

    rows = np.array([quantity.slope(parameters) for quantity in asked])
    halves = float(ndtri(0.5 + 0.5 * CONFIDENCE)) * standard_errors(feasible_set, covariance, rows)
    # Ratios are as their slopes say; where nothing is told, the center is not read.
    at_answer = [0.0 if one.mass is None else one.value(parameters) for one in asked]
    return at_answer + rows @ feasible_set.lift @ base, halves


DIAGONAL = ("Lxx", "Lyy", "Lzz")
"""Moments of inertia, which a rotor looks like; products of inertia it does not."""


def _known_together(
    info: Information,
    feasible_set: FeasibleSet,
    unconstrained: Estimate,
    standard_error: Array,
    assumed: set[str],
    rotors: UntoldRotors,
) -> list[str]:
    """Say of which assumed numbers a combination is measured, those with the most of them first.

    Rotors that the model does not have, and whose torques links can make, are a part of these sums.
    """
    names = [str(name) for name in feasible_set.model.parameter_names]
    found = []
    for base, expression in enumerate(unconstrained.base_expressions):
        parts = [names[index] for index in np.flatnonzero(feasible_set.K[base])]
        error, value = standard_error[base], unconstrained.base[base]
        if len(parts) > 1 and assumed.intersection(parts) and 2.0 * error <= MEASURED * abs(value):
            count = len(assumed.intersection(parts))
            row = np.asarray(feasible_set.K[base], dtype=float)
            sum_of_all = expression + rotors.summands(row)
            found.append((count, f"{sum_of_all} ({value:.4g} ± {2.0 * error:.2g})", rotors.in_sums(row)))
    found.sort(key=lambda item: -item[0])
    sentences = []
    if found:
        shown = "; ".join(text for _, text, _ in found[:MOST_NAMED])
        held = np.unique(np.concatenate([joints for *_, joints in found[:MOST_NAMED]]))
        told = ""
        if len(held):
            which = "the inertia of a rotor" if len(held) == 1 else "inertias of rotors"
            told = f", where {', '.join(rotors.names[joint] for joint in held)} would be {which} that the model lacks"
        sentences.append(
            f"Of these only the sum is measured; no motion of this robot shows the parts by themselves: {shown}{told}."
        )
    model = feasible_set.model
    unlogged: dict[str, str] = {}
    if info.unidentifiable and isinstance(model, Model):
        from .unlogged_torques import told_by_unlogged_torques  # of few logs

        unlogged = told_by_unlogged_torques(model, info)
    hidden = [name for name in info.unidentifiable if name not in unlogged]
    if hidden:
        sentences.append(
            f"These logs do not show {listed(hidden, MOST_NAMED)}: joints that stood still, or moved alone, hide them."
        )
    if unlogged:
        joints = ", ".join(dict.fromkeys(unlogged.values()))
        sentences.append(
            f"No motion shows {listed(unlogged, MOST_NAMED)}: "
            f"the logs have no torque of {joints}, which alone tells them."
        )
    return sentences
