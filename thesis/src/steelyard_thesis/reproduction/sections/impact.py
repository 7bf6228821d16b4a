"""Section 8.1, left open by the thesis: what impossible parameters do beyond the inertia matrix."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from steelyard.report import Chart, Curve
from steelyard.simulation import SimulationResult, Status

from ..effects import Effects, States, effects, guided, hangs_unstably, held, identities, reach, released
from ..noisy_estimates import Case, Subject, cases, random_subject, wam_subject
from ..section import Context, Section, SectionResult, Table

__all__ = ["SECTION", "Finding", "findings", "subjects"]

Array = NDArray[np.float64]
_NOISES = (0.03, 0.1, 0.3, 1.0)
_RANDOM_ARMS, _WAM_DRAWS, _ARM_DRAWS = 12, 6, 2
_STATES, _FEW_STATES, _STARTS = 1000, 100, 4
_DURATION, _HELD = 2.0, 1.0  # s
_ROUNDING = 1e-6  # % or degrees: what is less comes from rounding, and differs from machine to machine
_REMARKS = (
    "An arm with known parameters moves, its torques get random noise, weighted least squares identifies it, and "
    "check proves the estimate possible or impossible. Each impossible estimate stands beside the nearest possible one "
    "(correct, full consistency, in the metric of the same data). In the tables “a → b” is a for the impossible "
    "estimate and b for its correction: medians over estimates, or numbers of estimates or runs.",
    "Gravity is not touched. Whatever gravity torques an estimate has, some possible arm with turning joints has just "
    "the same: heavier links with their centres of mass moved make up for anything. They are always the gradient of "
    "a potential, too. Errors of gravity, and the drift of an arm that is carried by them, come from noise and not "
    "from impossibility; correction changes them little.",
    "Coriolis and centripetal torques are touched as inertia is, for both are made of the inertia matrix. They remain "
    "bounded by a multiple of the squared speed, and the skew symmetry of dM/dt - 2 C holds for any parameters, so "
    "that neither tells anything of passivity.",
    "Passivity is lost. With a negative kinetic energy somewhere, the total energy of an arm is conserved and yet "
    "bounds nothing: speeds grow without limit. In every configuration without a positive definite inertia matrix, "
    "computed torque is positive feedback in some direction. Friction coefficients of the wrong sign drive instead of "
    "braking.",
    "An estimate can be impossible and have a positive definite inertia matrix in every configuration tried; with "
    "little noise all of these have. They fall and track as their corrections do. What is wrong shows in their "
    "accelerations, and in a proof.",
)


@dataclass(frozen=True, eq=False)
class Finding:
    """The effects of an impossible estimate and of its correction.

    Attributes
    ----------
    case : Case
    group : str
    before, after : Effects
    identity : tuple of float
        See `identities`, of the estimate.
    reach : dict
        See `reach`, of the estimate.
    unstable : tuple of bool
        Whether each hangs unstably.
    fell, moved, ran_away : tuple of two arrays
        Of the runs of the estimate and of the correction: the time at which a release diverged, infinite where it did
        not; the largest angle by which the carried arm drifted; whether the held arm had to be stopped.
    start_definite : ndarray of bool
        Whether the estimate's inertia matrix is positive definite where each run starts.
    """

    case: Case
    group: str
    before: Effects
    after: Effects
    identity: tuple[float, float]
    reach: dict[str, float]
    unstable: tuple[bool, bool]
    fell: tuple[Array, Array]
    moved: tuple[Array, Array]
    ran_away: tuple[NDArray[np.bool_], NDArray[np.bool_]]
    start_definite: NDArray[np.bool_]


def subjects() -> Iterator[tuple[str, Subject, int]]:
    """Return group, arm and number of draws for each noise."""
    yield "WAM", wam_subject(), _WAM_DRAWS
    for seed in range(_RANDOM_ARMS):
        yield "random arms", random_subject(seed), _ARM_DRAWS


def findings(group: str, subject: Subject, found: Sequence[Case]) -> list[Finding]:
    """Study the impossible estimates among these cases of one arm."""
    chosen = [case for case in found if case.infeasible]
    if not chosen:
        return []
    states, few = States.random(subject, _STATES), States.random(subject, _FEW_STATES)
    n = subject.model.dof
    starts = np.random.default_rng(8).uniform(-np.pi, np.pi, (_STARTS, n))
    bases = [base for case in chosen for base in (case.estimate, case.corrected)]
    fell = _times(released(subject, bases, starts, _DURATION))
    moved = _drifts(guided(subject, bases, starts, _DURATION))
    stopped = np.isfinite(_times(held(subject, bases, starts, _HELD)))
    matrix = subject.model.kernel("total_inertia_matrix", base=True)
    result = []
    for k, case in enumerate(chosen):
        one, two = 2 * k, 2 * k + 1
        definite = np.linalg.eigvalsh(matrix(starts, case.estimate).reshape(-1, n, n))[:, 0] > 0.0
        result.append(
            Finding(
                case,
                group,
                effects(subject, case.estimate, states),
                effects(subject, case.corrected, states),
                identities(subject, case.estimate, few),
                reach(subject, case.estimate, few),
                (hangs_unstably(subject, case.estimate), hangs_unstably(subject, case.corrected)),
                (fell[one], fell[two]),
                (moved[one], moved[two]),
                (stopped[one], stopped[two]),
                definite,
            )
        )
    return result


def _times(result: SimulationResult) -> Array:
    """Return when each run ended early, infinite where it did not, (bases, starts)."""
    early = np.array([status is not Status.FINISHED for status in result.status])
    return np.where(early, np.asarray(result.end_time), np.inf).reshape(-1, _STARTS)


def _drifts(result: SimulationResult) -> Array:
    return np.asarray(np.abs(result.final_q - result.q[:, 0]).max(axis=1)).reshape(-1, _STARTS)


def _compute(context: Context) -> SectionResult:
    studied: list[Finding] = []
    counts: dict[tuple[str, float], int] = {}
    for group, subject, draws in subjects():
        context.say(subject.name)
        found = list(cases(subject, _NOISES, draws))
        for case in found:
            counts[group, case.noise] = counts.get((group, case.noise), 0) + 1
        studied += findings(group, subject, found)
    tables = (
        _reached(studied),
        _impossible(studied, counts),
        _errors(studied),
        _uses(studied),
        _feedback(studied),
        _identities(studied),
    )
    return SectionResult(tables=tables, charts=_charts(studied), remarks=_REMARKS)


def _groups(studied: Sequence[Finding]) -> Iterator[tuple[str, float, list[Finding]]]:
    def key(finding: Finding) -> tuple[bool, float]:
        return finding.group != "WAM", finding.case.noise

    for (_, noise), members in groupby(sorted(studied, key=key), key=key):
        rows = list(members)
        yield rows[0].group, noise, rows


def _percent(value: float) -> str:
    return f"{_short(100.0 * value)} %"


def _short(value: float) -> str:
    if value < _ROUNDING:
        return "0"
    return f"{value:.0f}" if value >= 1000.0 else f"{value:.3g}"


def _median(values: Iterator[float]) -> float:
    return float(np.median(list(values)))


def _pair(rows: Sequence[Finding], name: str) -> str:
    """Return the medians of an effect, of the estimates and of their corrections."""
    before, after = (_median(getattr(effect(f), name) for f in rows) for effect in (_before, _after))
    return f"{_percent(before)} → {_percent(after)}"


def _before(finding: Finding) -> Effects:
    return finding.before


def _after(finding: Finding) -> Effects:
    return finding.after


def _reached(studied: Sequence[Finding]) -> Table:
    names = list(studied[0].reach)
    rows = []
    for group in dict.fromkeys(f.group for f in studied):
        members = [f for f in studied if f.group == group]
        cells = []
        for name in names:
            values = [f.reach[name] for f in members]
            cells.append(f"{_percent(float(np.median(values)))}, at most {_percent(max(values))}")
        rows.append((group, f"{len(members)}", *cells))
    title = (
        "How much of each term is impossible by itself: least rms change that makes its torques those of a possible arm"
    )
    return Table(title, ("arm", "impossible estimates", *names), tuple(rows))


def _impossible(studied: Sequence[Finding], counts: dict[tuple[str, float], int]) -> Table:
    rows = []
    for group, noise, members in _groups(studied):
        definite = sum(f.before.indefinite == 0.0 for f in members)
        rows.append(
            (
                group,
                _percent(noise),
                f"{len(members)} of {counts[group, noise]}",
                _percent(_median(f.reach["inertia"] for f in members)),
                f"{definite} of {len(members)}",
                _pair(members, "indefinite"),
                _pair(members, "negative_energy"),
                f"{sum(f.before.driving_friction > 0 for f in members)} → "
                f"{sum(f.after.driving_friction > 0 for f in members)}",
                f"{sum(f.unstable[0] for f in members)} → {sum(f.unstable[1] for f in members)}",
            )
        )
    heads = (
        "arm",
        "noise of the torques",
        "impossible estimates",
        "impossible part of the inertia torques",
        "of them with M > 0 in all configurations tried",
        "configurations without M > 0",
        "states with negative kinetic energy",
        "estimates whose friction drives somewhere",
        "estimates that hang unstably",
    )
    return Table(f"What is impossible about them, in {_STATES} random states", heads, tuple(rows))


def _errors(studied: Sequence[Finding]) -> Table:
    names = [f.name for f in fields(Effects)][:5]
    rows = [
        (group, _percent(noise), *(_pair(members, name) for name in names))
        for group, noise, members in _groups(studied)
    ]
    heads = (
        "arm",
        "noise of the torques",
        "gravity torques",
        "Coriolis and centripetal torques",
        "inverse dynamics",
        "forward dynamics",
        "forward dynamics, worst in twenty",
    )
    return Table("Errors against the true arm, relative to the rms of what is in error", heads, tuple(rows))


def _uses(studied: Sequence[Finding]) -> Table:
    rows = []
    for group, noise, members in _groups(studied):
        fell = [np.concatenate([f.fell[side] for f in members]) for side in (0, 1)]
        moved = [np.degrees(np.concatenate([f.moved[side] for f in members])) for side in (0, 1)]
        stopped = [np.concatenate([f.ran_away[side] for f in members]) for side in (0, 1)]
        ended = fell[0][np.isfinite(fell[0])]
        rows.append(
            (
                group,
                _percent(noise),
                " → ".join(_percent(float(np.mean(np.isfinite(times)))) for times in fell),
                f"{np.median(ended):.2g} s" if len(ended) else "none",
                " → ".join(f"{_short(float(np.median(angles)))}°" for angles in moved),
                " → ".join(_percent(float(np.mean(runs))) for runs in stopped),
            )
        )
    heads = (
        "arm",
        "noise of the torques",
        "free fall: runs that diverge",
        "at (median)",
        "gravity compensation: drift of the true arm",
        "computed torque: runs that are stopped",
    )
    title = (
        f"What happens in use, {_STARTS} starts an estimate: {_DURATION:g} s of free fall without friction; "
        f"{_DURATION:g} s of the true arm carried with damping; {_HELD:g} s of the true arm moved by 0.05 rad"
    )
    return Table(title, heads, tuple(rows))


def _feedback(studied: Sequence[Finding]) -> Table:
    definite = np.concatenate([f.start_definite for f in studied])
    everywhere = np.repeat([f.before.indefinite == 0.0 for f in studied], _STARTS)
    stopped = np.concatenate([f.ran_away[0] for f in studied])
    fell = np.isfinite(np.concatenate([f.fell[0] for f in studied]))
    rows = []
    for text, chosen in (
        ("positive definite there and in all configurations tried", everywhere & definite),
        ("positive definite there, not everywhere", definite & ~everywhere),
        ("not positive definite there", ~definite),
    ):
        if np.any(chosen):
            shares = (_percent(float(np.mean(runs[chosen]))) for runs in (stopped, fell))
            rows.append((text, f"{np.sum(chosen)}", *shares))
    heads = ("inertia matrix of the estimate at the start", "runs", "computed torque is stopped", "free fall diverges")
    return Table("Which of the impossible estimates fail, by the configuration of the start", heads, tuple(rows))


def _identities(studied: Sequence[Finding]) -> Table:
    names = ("dq' (dM/dt - 2 C) dq = 0", "gravity torques are the gradient of the potential energy")
    # The power of ten alone: rounding differs from machine to machine.
    bounds = (np.ceil(np.log10(max(f.identity[k] for f in studied))) for k in range(2))
    return Table(
        "What holds for any parameters, possible or not: largest relative deviation, by central differences",
        ("identity", "deviation"),
        tuple((name, f"below {10.0**bound:.0e}") for name, bound in zip(names, bounds, strict=True)),
    )


def _charts(studied: Sequence[Finding]) -> tuple[Chart, ...]:
    label = "impossible part of the inertia torques, % (where only friction is impossible: left out)"
    studied = [f for f in studied if 100.0 * f.reach["inertia"] > _ROUNDING]
    degree = np.array([100.0 * f.reach["inertia"] for f in studied])

    def curves(value: Callable[[Finding, int], float]) -> tuple[Curve, ...]:
        names = ("impossible estimates", "their corrections")
        return tuple(
            Curve(name, degree, [value(f, side) for f in studied], "points") for side, name in enumerate(names)
        )

    def of(finding: Finding, side: int) -> Effects:
        return (finding.before, finding.after)[side]

    return (
        Chart(
            "Forward dynamics against the degree of impossibility",
            label,
            "error of accelerations, worst in twenty, %",
            curves(lambda f, side: 100.0 * of(f, side).worst_acceleration),
            x_log=True,
            y_log=True,
        ),
        Chart(
            "Gravity torques against the degree of impossibility",
            label,
            "error, %",
            curves(lambda f, side: 100.0 * of(f, side).gravity),
            x_log=True,
            y_log=True,
        ),
        Chart(
            "Configurations without a positive definite inertia matrix",
            label,
            "%",
            curves(lambda f, side: 100.0 * of(f, side).indefinite),
            x_log=True,
        ),
        Chart(
            "Free fall: runs that diverge",
            label,
            "%",
            curves(lambda f, side: 100.0 * float(np.mean(np.isfinite(f.fell[side])))),
            x_log=True,
        ),
    )


SECTION = Section("8.1", "What impossible parameters do beyond the inertia matrix", _compute)
