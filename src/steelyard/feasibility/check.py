"""Deciding whether parameters are physically possible, by the search for a proof of either answer."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from steelyard.display import html_sentences
from steelyard.dynamics.threads import in_one_thread
from steelyard.errors import InputError
from steelyard.lmi import is_positive_definite
from steelyard.regression.factor import eigenvectors

from .certificates import FeasibilityCertificate, InfeasibilityCertificate
from .certificates.rational import exact_number
from .exact_dual_point import least_trace_bound, prove_infeasible, prove_infeasible_up_to_a_size
from .facial_reduction import dual_face
from .feasible_set import FeasibleSet
from .margin import MARGIN_CAP, TRACE_BOUND, DualPoint, largest_margin, least_violations
from .tie_break import lightest_parameters

__all__ = ["Decision", "Verdict", "Violation", "check", "decide"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

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


CLEARLY = -1e-5
"""Margin below which an undecided point is not said to be close to the boundary: proofs also fail where sizes of links
differ by more than floating point resolves, as where one of them has its inertia in kg mm²."""

VERDICT_FORMAT = "steelyard-verdict-1"


@dataclass(frozen=True, eq=False)
class Verdict:
    """The answer of `check`.

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
    remarks : tuple of str
        What was judged where that is not the robot of rigid links and joints alone, a sentence each.
    """

    feasible: bool | None
    status: str
    margin: float
    base: Vector = field(repr=False)
    parameters: Vector | None = field(repr=False)
    certificate: FeasibilityCertificate | InfeasibilityCertificate | None = field(repr=False)
    violations: tuple[Violation, ...]
    consistency: str
    remarks: tuple[str, ...] = ()

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
        elif self.margin < CLEARLY:
            found = [
                f"Undecided {kind}: these values look impossible (margin {self.margin:.3g}), but it was not proved "
                "that no robot moves like this."
            ]
        else:
            found = [f"Undecided {kind}: closer to the boundary than the solver can tell (margin {self.margin:.3g})."]
        found += [*self.remarks, *(f"{violation}." for violation in self.violations)]
        if isinstance(self.certificate, InfeasibilityCertificate):
            if self.certificate.equations:
                found.append(f"Part of the contradiction: {', '.join(self.certificate.equations)}.")
            found.append(self.certificate.verify().sentence)
        return tuple(found)

    def __str__(self) -> str:
        return "\n".join(self.sentences())

    def to_dict(self) -> dict[str, Any]:
        """Return the verdict as plain data, without the certificate, which has a file of its own."""
        return {
            "format": VERDICT_FORMAT,
            "feasible": self.feasible,
            "status": self.status,
            "consistency": self.consistency,
            "margin": self.margin,
            "proved": self.certificate is not None,
            "violations": [{"condition": one.block, "amount": one.amount, "unit": one.unit} for one in self.violations],
            "sentences": list(self.sentences()),
        }

    def _repr_html_(self) -> str:
        first, *others = self.sentences()
        return html_sentences(first, others, strong=True)


@in_one_thread
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
    feasible, status = (False, "virtually feasible") if virtual.feasible else (virtual.feasible, virtual.status)
    return replace(virtual, feasible=feasible, status=status, margin=margin, violations=violations)


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
    for bound in MODERATE_TRACES:
        scale = max(1.0, float(np.abs(witness.base).max(initial=0.0)))
        lighter = FeasibilityCertificate(
            feasible_set,
            witness.base,
            largest_margin(feasible_set, witness.base, trace_bound=bound * scale).parameters,
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


FLOORS = (1e-2, 1e-4, 1e-6, 1e-8, 1e-9, 1e-10)
"""Smallest eigenvalues of a block, relative to its largest, that are kept when it is scaled; they are tried in turn,
since the first parameters are wrong in small eigenvalues."""

SCALED_ACCURACY = 1e-11
"""Accuracy of the solver on problems that are scaled around a point near the solution."""

LARGEST_ADDITION = 1e12
"""Largest unidentifiable mass, in kg, that is added to reach the inside; beyond, doubles have no digits left for
links."""

SHORT_DECIMAL, MAP_ACCURACY = 10**10, 1e-13
"""Elements of K with denominators up to the first number count as exact, others as accurate to the second."""

TURNS, FIRST_STEPS, LATER_STEPS = 5, 40, 25
"""Largest number of rounds of Newton's method and a solver before the search ends without a proof, and Newton steps in
the first and in later rounds."""

FARTHEST = 1e6
"""Largest step towards the dual point of the solver; a longer one would lose the digits of the present point."""

CAP_REACHED = 1e-6
"""A margin within this part of `MARGIN_CAP` counts as the cap."""

TRACE_BOUND_FACTOR = 10.0
"""Trace bound of the last attempt, relative to the least one that counts: rounding costs a part of it."""

ADDITIONS = (0.0, 1e2, 1e4, 1e6, 1e8)
"""Masses beside the face, in kg, with which a margin on the face is tried; with 1e10 kg no digit of a margin of 1e-6
would remain."""


@dataclass(frozen=True, eq=False)
class Decision:
    """The proof that was found for base parameters.

    Attributes
    ----------
    certificate : FeasibilityCertificate, InfeasibilityCertificate or None
        None if neither could be proved.
    margin : float
        Largest t with D(δ) - t 1 ⪰ 0, as the solver found it.
    """

    certificate: FeasibilityCertificate | InfeasibilityCertificate | None
    margin: float


def decide(feasible_set: FeasibleSet, base: Vector) -> Decision:
    """Search for feasible parameters and for a dual point until one of them is a proof.

    The first attempts are the largest margin on the face of the dual points, and that of the whole blocks. If neither
    decides, the problem is solved in suitable units: for a dual point in those of the analytic center of the dual
    points, for a witness in those in which the blocks at the best parameters so far are about unit matrices. Links that
    are much smaller than others, and points close to the boundary, then have the full accuracy of the solver.
    """
    face = dual_face(feasible_set).bases
    # On the face no bound on the traces is needed, so that this is the largest margin of all robots, however heavy.
    restricted = largest_margin(feasible_set, base, face, [_orthonormal(U) for U in face])
    refuted = None
    if restricted.value < 0:
        refuted = prove_infeasible(feasible_set, feasible_set.lift @ base, base, restricted.point)
        if refuted is not None and np.isfinite(restricted.value):
            return Decision(refuted, restricted.value)
    bound = TRACE_BOUND * max(1.0, float(np.abs(base).max(initial=0.0)))
    first = largest_margin(feasible_set, base, trace_bound=bound)
    margin = restricted.value if np.isfinite(restricted.value) else first.value
    if refuted is not None:
        return Decision(refuted, margin)
    found = proved_witness(feasible_set, base, first.parameters)
    if found is not None and first.value >= MARGIN_CAP * (1 - CAP_REACHED):
        return Decision(found, first.value)
    if found is not None:
        return Decision(found, max(first.value, min(margin, _attained(feasible_set, restricted.parameters))))
    proof = _centred_proof(feasible_set, base)
    if proof is not None:
        return Decision(proof, margin)
    witness = scaled_witness(feasible_set, base, first.parameters)
    if witness is not None or first.value >= 0:
        return Decision(witness, margin)
    # The shift that covers rounding errors costs about half of the trace bound.
    bounded = largest_margin(feasible_set, base, trace_bound=TRACE_BOUND_FACTOR * least_trace_bound(base))
    return Decision(prove_infeasible_up_to_a_size(feasible_set, bounded.point, base), min(margin, bounded.value))


def _orthonormal(basis: Matrix) -> Matrix:
    """C, such that the columns of U C are orthonormal.

    A margin on the face then equals the margin that the whole blocks approach as unidentifiable mass is added.
    """
    if basis.shape == (1, 1):
        return np.asarray(1.0 / basis)
    return np.asarray(np.linalg.inv(np.linalg.qr(basis)[1])) if basis.shape[1] else np.zeros((0, 0))


def _attained(feasible_set: FeasibleSet, parameters: Vector) -> float:
    """The largest margin of parameters to which unidentifiable mass beside the face is added.

    The face is known in floating point only, so that a margin on it counts only if some robot has it.
    """
    recession = dual_face(feasible_set).recession
    return max(
        float(feasible_set.stack.smallest_eigenvalues(parameters + amount * recession).min(initial=np.inf))
        for amount in ADDITIONS
    )


def _centred_proof(feasible_set: FeasibleSet, base: Vector) -> InfeasibilityCertificate | FeasibilityCertificate | None:
    """A proof of either kind by Newton's method and margins in its metric; None if none is found."""
    from .dual_center import Fibre, center  # few questions are left open until here

    face = dual_face(feasible_set)
    fibre = Fibre(feasible_set, feasible_set.lift @ base, face.bases)
    matrices = fibre.matrices(DualPoint(face.interior, face.multipliers))
    for turn in range(TURNS):
        found = center(fibre, matrices, FIRST_STEPS if turn == 0 else LATER_STEPS)
        if found is None:
            return None
        if found.feasible:
            return raised_witness(feasible_set, base, found.parameters)
        middle = fibre.point(found.matrices)
        if found.value < 0:
            proof = prove_infeasible(feasible_set, found.parameters, base, middle, middle)
            if proof is not None:
                return proof
        try:
            metric = fibre.metric(found.matrices)
        except np.linalg.LinAlgError:
            return None
        blocks = metric.stacked(fibre.blocks(found.parameters))
        margin, along, dual = metric.largest_margin(blocks, MARGIN_CAP, SCALED_ACCURACY)
        if margin > 0:
            return raised_witness(feasible_set, base, found.parameters + fibre.directions @ metric.along(along))
        point = fibre.point(metric.expanded(dual))
        proof = prove_infeasible(feasible_set, found.parameters, base, point, middle)
        if proof is not None:
            return proof
        parameters = found.parameters + fibre.directions @ metric.along(along)
        fibre = Fibre(feasible_set, parameters if np.all(np.isfinite(parameters)) else found.parameters, face.bases)
        # As far towards the solver's point as the cone allows.
        lowest = min(float(np.linalg.eigvalsh(matrix)[0]) for matrix in metric.stack.matrices(dual))
        farthest = min(FARTHEST, 0.5 / max(-lowest, 1e-16))
        matrices = tuple(W + farthest * V for W, V in zip(found.matrices, metric.expanded(dual), strict=True))
    return None


def proved_witness(feasible_set: FeasibleSet, base: Vector, parameters: Vector) -> FeasibilityCertificate | None:
    """The certificate of feasible parameters, or None if they are not proved feasible."""
    if not np.all(np.isfinite(parameters)):
        return None
    # Exact arithmetic is not needed for blocks that are far from positive definite.
    for block, smallest in zip(feasible_set.blocks, feasible_set.stack.smallest_eigenvalues(parameters), strict=True):
        if smallest < -1e-9 * max(1.0, float(np.abs(block.evaluate(parameters)).max(initial=0.0))):
            return None
    if not _beyond_rounding(feasible_set, parameters):
        return None
    certificate = FeasibilityCertificate(feasible_set, base, parameters)
    return certificate if certificate.verify() else None


def _beyond_rounding(feasible_set: FeasibleSet, parameters: Vector) -> bool:
    """Return whether the blocks remain definite for all maps K that round to the given one.

    Elements of K that are not short decimals are rounded. With parameters of tonnes, rounding errors of terms that
    cancel could make an impossible robot of grams look possible.
    """
    change = feasible_set.kept(_rounding_of_map) @ np.abs(parameters)
    if not np.any(change):
        return True
    affected = np.zeros(feasible_set.parameter_count)
    affected[np.asarray(feasible_set.model.base_parameters().independent, dtype=np.intp)] = change
    for block in feasible_set.blocks:
        norms = np.abs(block.coefficients).sum(axis=2).max(axis=1)
        loss = float(affected[block.indices] @ norms)
        if loss > 0 and block.size > 1 and block.smallest_eigenvalue(parameters) <= loss:
            return False
    return True


def _rounding_of_map(feasible_set: FeasibleSet) -> Matrix:
    """Bound on the rounding errors of the elements of K."""
    found = np.zeros_like(feasible_set.K)
    for i, j in zip(*np.nonzero(feasible_set.K), strict=True):
        value = float(feasible_set.K[i, j])
        if exact_number(value).denominator > SHORT_DECIMAL:
            found[i, j] = MAP_ACCURACY * abs(value)
    return found


def raised_witness(feasible_set: FeasibleSet, base: Vector, parameters: Vector) -> FeasibilityCertificate | None:
    """Add unidentifiable mass until blocks that are definite on the face of the dual points are definite.

    With bases U of the face and V of its complement, D = [[D_UU, D_UV], [D_VU, D_VV + s G]] is positive definite for
    large s, because D_UU is.
    """
    face = dual_face(feasible_set)
    amount = 0.0
    for block, U in zip(feasible_set.blocks, face.bases, strict=True):
        size, rank = U.shape
        if rank == size:
            continue
        D = block.evaluate(parameters)
        added = np.tensordot(face.recession[block.indices], block.coefficients, axes=1)
        left = np.linalg.svd(U)[0] if rank else np.eye(size)
        Q, V = left[:, :rank], left[:, rank:]
        lacking = -(V.T @ D @ V)
        if rank:
            try:
                lacking += V.T @ D @ Q @ np.linalg.solve(Q.T @ D @ Q, Q.T @ D @ V)
            except np.linalg.LinAlgError:
                return None
        sizes, vectors = eigenvectors(V.T @ added @ V)
        if sizes[0] <= 0 or not np.all(np.isfinite(lacking)):
            return None
        half = vectors / np.sqrt(sizes)
        amount = max(amount, float(np.linalg.eigvalsh(half.T @ lacking @ half)[-1]))
    for factor in (1.1, 3.0, 30.0, 1e3):
        if factor * amount > LARGEST_ADDITION:
            break
        found = proved_witness(feasible_set, base, parameters + factor * amount * face.recession)
        if found is not None:
            return found
    return None


def scaled_witness(feasible_set: FeasibleSet, base: Vector, parameters: Vector) -> FeasibilityCertificate | None:
    """Parameters inside the set, from the margin of blocks that are scaled around the best parameters so far."""
    trace_bound = 1e6 * len(feasible_set.blocks)
    for floor in FLOORS:
        scalings = _scalings(feasible_set, parameters, floor)
        found = largest_margin(feasible_set, base, None, scalings, trace_bound, SCALED_ACCURACY)
        certificate = proved_witness(feasible_set, base, found.parameters)
        if certificate is not None:
            return certificate
        parameters = found.parameters
    return None


def _scalings(feasible_set: FeasibleSet, parameters: Vector, floor: float) -> list[Matrix]:
    """C_b with C_bᵀ |D_b(δ)| C_b = 1, after eigenvalues are raised to `floor` times the largest."""
    found = []
    for block in feasible_set.blocks:
        values, vectors = eigenvectors(block.evaluate(parameters))
        size = np.abs(values)
        largest = float(size.max(initial=0.0)) or 1.0
        found.append(vectors / np.sqrt(np.maximum(size, floor * largest)))
    return found
