"""Deciding whether parameters are physically possible, with a proof."""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from steelyard.dynamics.threads import one_thread
from steelyard.errors import InputError
from steelyard.lmi import is_positive_definite

from .certificates import FeasibilityCertificate, InfeasibilityCertificate
from .feasible_set import FeasibleSet
from .margin import MARGIN_CAP, largest_margin, least_violations
from .proof_search import decide
from .tie_break import lightest_parameters

__all__ = ["Verdict", "Violation", "check"]

Vector = npt.NDArray[np.float64]

MODERATE_TRACES = (10.0, 100.0, 1000.0)
"""Bounds on the sum of the traces, in units of the largest |β| (at least 1), that are tried in turn for a witness of
moderate mass where the lightest one cannot be proved: the smallest that leaves room gives the lightest robot."""


@dataclass(frozen=True)
class Violation:
    """A condition that is not satisfied.

    Attributes
    ----------
    block : str
        Name of the block.
    amount : float
        Number that must be added to the diagonal of the block to make it positive semidefinite, or error of an
        equation; 0 if the block is singular, which is on the boundary.
    unit : str
        Unit of `amount`; empty for blocks whose elements have different units.
    """

    block: str
    amount: float
    unit: str = ""

    def __str__(self) -> str:
        if self.amount == 0.0:
            return f"{self.block} is on the boundary of what is possible"
        return f"{self.block} fails by {self.amount:.3g}{' ' + self.unit if self.unit else ''}"


@dataclass(frozen=True, eq=False)
class Verdict:
    """Answer of `check`.

    Attributes
    ----------
    feasible : bool or None
        None if the point is closer to the boundary than floating point can resolve.
    status : str
        ``"feasible"``, ``"virtually feasible"`` (the parameters are not possible, but another robot with the same
        motion is: thesis 3.55), ``"infeasible"`` or ``"undecided"``.
    margin : float
        Largest t, at most 1, with D(δ) - t 1 ⪰ 0 for some δ with these base parameters, or its supremum if that is only
        approached as δ grows. If standard parameters were given, the smallest eigenvalue of their blocks. Negative if
        infeasible.
    base : (n_b,)
    parameters : (n,) or None
        Feasible standard parameters that have these base parameters, if there are any.
    certificate : FeasibilityCertificate, InfeasibilityCertificate or None
    violations : tuple of Violation
        The conditions that are not satisfied, largest first.
    consistency : str
    """

    feasible: bool | None
    status: str
    margin: float
    base: Vector = field(repr=False)
    parameters: Vector | None = field(repr=False)
    certificate: FeasibilityCertificate | InfeasibilityCertificate | None = field(repr=False)
    violations: tuple[Violation, ...]
    consistency: str

    def sentences(self) -> tuple[str, ...]:
        """The verdict in sentences."""
        kind = f'under "{self.consistency}" consistency'
        if self.status == "feasible":
            found = [
                f"Physically feasible {kind}, with a margin of {self.margin:.3g}: a real robot can have these values."
            ]
        elif self.status == "virtually feasible":
            found = [
                f"Virtually feasible {kind}: these values are not physically possible, but another robot that moves in "
                "exactly the same way is, and its parameters are given."
            ]
        elif self.status == "infeasible":
            found = [
                f"Physically infeasible {kind}: no real robot has these values (largest margin {self.margin:.3g})."
            ]
        else:
            found = [f"Undecided {kind}: closer to the boundary than the solver can tell (margin {self.margin:.3g})."]
        found += [f"{violation}." for violation in self.violations]
        if isinstance(self.certificate, InfeasibilityCertificate):
            if self.certificate.equations:
                found.append(f"Part of the contradiction: {', '.join(self.certificate.equations)}.")
            found.append(self.certificate.verify().sentence)
        return tuple(found)

    def __str__(self) -> str:
        return "\n".join(self.sentences())

    def _repr_html_(self) -> str:
        import html

        first, *others = (html.escape(sentence) for sentence in self.sentences())
        return f"<p><strong>{first}</strong></p><ul>{''.join(f'<li>{other}</li>' for other in others)}</ul>"


def check(
    feasible_set: FeasibleSet, base: npt.ArrayLike | None = None, parameters: npt.ArrayLike | None = None
) -> Verdict:
    """Decide whether base parameters or standard parameters are physically possible, with a proof (thesis 3.34, 3.55).

    Parameters
    ----------
    feasible_set : FeasibleSet
    base : (n_b,), optional
        Base parameters β; they are feasible if some δ with K δ = β lies in the set.
    parameters : (n,), optional
        Standard parameters δ, given instead of base parameters.

    Returns
    -------
    Verdict

    Raises
    ------
    InputError
        If not exactly one of `base` and `parameters` is given, or it does not fit the model.

    Examples
    --------
    A pendulum with a moment of inertia of 0.6 kg m², and one with a negative one:

    >>> from steelyard.dynamics import Model
    >>> from steelyard.robot import Robot
    >>> model = Model(Robot.from_dh([("0", 0.0, 0.0, "q")], gravity=(0, -9.81, 0)))
    >>> model.base_parameters().names
    ('Lzz1', 'lx1', 'ly1')
    >>> check(FeasibleSet(model), base=[0.6, 1.0, 0.0]).feasible
    True
    >>> verdict = check(FeasibleSet(model), base=[-0.6, 1.0, 0.0])
    >>> verdict.status, bool(verdict.certificate.verify())
    ('infeasible', True)
    """
    if (base is None) == (parameters is None):
        raise InputError("check takes either base= or parameters=; give exactly one of them.")
    with one_thread():
        if parameters is not None:
            return _check_parameters(feasible_set, feasible_set.as_parameters(parameters))
        return _check_base(feasible_set, feasible_set.as_base(base if base is not None else ()))


def _check_parameters(feasible_set: FeasibleSet, parameters: Vector) -> Verdict:
    eigenvalues = feasible_set.stack.smallest_eigenvalues(parameters)
    base = feasible_set.K @ parameters
    violations = _sorted(feasible_set, np.maximum(-eigenvalues, 0.0), least=0.0)
    violations += tuple(
        Violation(equality.name, float(abs(equality.coefficients @ parameters[equality.indices] - equality.value)))
        for equality in feasible_set.equalities
        if not feasible_set.satisfies_equations(parameters)
    )
    violations += tuple(
        Violation(block.name, 0.0, block.unit)
        for block, smallest in zip(feasible_set.blocks, eigenvalues, strict=True)
        if smallest >= 0.0 and block.size > 1 and not is_positive_definite(block.evaluate(parameters))
    )
    margin = float(eigenvalues.min(initial=np.inf))
    if feasible_set.contains(parameters):
        certificate = FeasibilityCertificate.of_parameters(feasible_set, parameters)
        return Verdict(
            True, "feasible", margin, certificate.base, parameters, certificate, (), feasible_set.consistency
        )
    virtual = _check_base(feasible_set, base)
    if virtual.feasible:
        return Verdict(
            False,
            "virtually feasible",
            margin,
            base,
            virtual.parameters,
            virtual.certificate,
            violations,
            feasible_set.consistency,
        )
    if virtual.feasible is None:
        return Verdict(None, "undecided", margin, base, None, None, violations, feasible_set.consistency)
    return Verdict(False, "infeasible", margin, base, None, virtual.certificate, violations, feasible_set.consistency)


def _check_base(feasible_set: FeasibleSet, base: Vector) -> Verdict:
    decision = decide(feasible_set, base)
    proof, margin = decision.certificate, decision.margin
    if isinstance(proof, FeasibilityCertificate):
        smallest = float(feasible_set.stack.smallest_eigenvalues(proof.parameters).min(initial=np.inf))
        proof = _lighter(proof, smallest)
        margin = min(max(margin, smallest), MARGIN_CAP)
        return Verdict(True, "feasible", margin, base, proof.parameters, proof, (), feasible_set.consistency)
    status = "undecided" if proof is None else "infeasible"
    violations = _sorted(feasible_set, least_violations(feasible_set, base), least=1e-7)
    return Verdict(
        None if proof is None else False, status, margin, base, None, proof, violations, feasible_set.consistency
    )


def _lighter(witness: FeasibilityCertificate, margin: float) -> FeasibilityCertificate:
    """A witness of moderate mass, if one is found; the first one lies in the middle of a set that may be unbounded.

    It is the lightest one with half the margin or, if the set is too thin for the solver to find that, the one of
    largest margin among those of moderate size.
    """
    feasible_set = witness.feasible_set
    parameters = lightest_parameters(feasible_set, witness.base, 0.5 * min(margin, feasible_set.margin))
    if parameters is not None:
        lighter = FeasibilityCertificate(feasible_set, witness.base, parameters)
        if lighter.verify():
            return lighter
    whole = [np.eye(block.size) for block in feasible_set.blocks]
    for bound in MODERATE_TRACES:
        scale = max(1.0, float(np.abs(witness.base).max(initial=0.0)))
        lighter = FeasibilityCertificate(
            feasible_set,
            witness.base,
            largest_margin(feasible_set, witness.base, whole, trace_bound=bound * scale).parameters,
        )
        if lighter.verify():
            return lighter
    return witness


def _sorted(feasible_set: FeasibleSet, amounts: Vector, least: float) -> tuple[Violation, ...]:
    found = [
        Violation(block.name, float(amount), block.unit)
        for block, amount in zip(feasible_set.blocks, amounts, strict=True)
        if amount > least
    ]
    return tuple(sorted(found, key=lambda violation: -violation.amount))
