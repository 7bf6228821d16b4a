"""What is known of a robot while it is excited: parameters, their covariance, and the torque errors to be expected."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics import Model
from steelyard.estimators import EntropicPrior
from steelyard.estimators.fitting_problems import CAREFUL, WarmFit
from steelyard.estimators.prior import PreparedPrior
from steelyard.excitation import MotionLimits
from steelyard.feasibility import FeasibleSet
from steelyard.once import cached_property
from steelyard.recording import Recording, Samples
from steelyard.regression import Information
from steelyard.robot.inertia import parameters_of_pseudo_inertia

from .credible_robots import CredibleRobots, random_motions

__all__ = ["Learner", "RobotKnowledge"]

Array = NDArray[np.float64]

SHORTEST = 1.5  # s of a motion, below which the filters leave nothing of it
SLOW = 0.02
"""Rows of joints that are slower than this share of the limit of velocity are left out, since joints that stick have
any friction. With them the torque error of a simulated WAM after 37 s was 2.5 times as large, with torques that are not
filtered as the motion is 1.7 times."""
TRIM = 0.5  # s at both ends of what was recorded, in which the filters ring
FIRST_NOISE = 0.2  # of the torque sizes, the noise that is assumed before residuals show it
FIRST_COUNT = 1.0
"""Independent rows for which this assumption counts, beside those that the parameters do not use up. With 30, and all
rows counted, the noise of the second joint of a simulated WAM was still taken for four times what it is after 35 s, so
that the search cared little for it."""
FIT_STEPS = 300  # of a search for the estimate; 60 are the usual number
NOISE_ROUNDS = 3  # in which the noise and the rows that the parameters use up are made to agree
FIT_ROUNDS = 6
"""In which the noise and the fit are made to agree at most. With one, what is assumed took as much from the fit as the
noise that was believed before allows: after 9.8 s a simulated arm of 30 kg was known to 12 % where 4 % were expected,
with six to 1.1 and 1.6 %."""
CONTRADICTS, ROWS_TO_ASK = 25.0, 20.0
"""Times that the squared residuals of what is measured anew are those that are expected, from which on the robot is
another one, and independent rows that a joint must have anew and before. *Measured*: at most 11 on 24 simulated WAM,
UR5, Panda, xArm 7, Z1 and UR3, at most 16 on 14 arms whose friction near standstill, ripple or warming up the model
lacks, and 39 and 160 for an arm that takes up 0.3 and 2 kg. The first estimate, of 2 s, is too sure by up to 57 and is
not asked; of joints with 8 rows it is up to 15."""
PRIOR_WEIGHTS = tuple(0.2 * 0.1**k for k in range(8))
"""Of the distance from the assumed distribution of mass, which grows with the ratio of inertias: with 2, one that is
three times what is assumed was found 30 % too small, by five standard deviations; a Panda was known to 2 % in 23.9 s,
with 0.2 in 19.9 s. The others are for robots that the description tells nothing of: a link with a thousand times the
assumed inertia was found with a fourteenth of its own, and what it left unexplained was taken for noise."""


@dataclass(frozen=True, eq=False)
class RobotKnowledge:
    """The knowledge of a robot at one time.

    Attributes
    ----------
    parameters, base : ndarray
        (n,), and (n_b,) its base parameters.
    root : ndarray
        (n_b, n_b), the factor R of the information, with the prior.
    noise : ndarray
        (N,) standard deviation of that of the torques, N·m or N.
    covariance : ndarray
        (n_b, n_b).
    deviations : ndarray
        (N,) root mean square, over motions within the limits, of the torque that this covariance leaves open, N·m or N.
    expected_error : float
        Expected error of predicted torques over motions within the limits, relative to these torques.
    joint_errors : ndarray
        (N,) the same of each joint.
    information : Information
        Of what was measured.
    stretches : int
        In which it was measured.
    contradicted : tuple of str
        The joints of which the last stretch contradicts those before: these are forgotten.
    """

    parameters: Array
    base: Array
    root: Array
    noise: Array
    covariance: Array
    deviations: Array
    expected_error: float
    joint_errors: Array
    information: Information
    stretches: int = 0
    contradicted: tuple[str, ...] = ()

    @property
    def is_measured(self) -> bool:
        """Whether anything was measured yet."""
        return self.information.count > 0


class Learner:
    """Learns a robot from what is recorded of it, beginning with what its kinematics make credible.

    Parameters
    ----------
    model : Model
    limits : MotionLimits
        Within which torques are to be predicted.
    cutoff, sample_time : float
        Hz of the filter, and s.
    """

    def __init__(self, model: Model, limits: MotionLimits, cutoff: float, sample_time: float) -> None:
        self.model, self.limits, self.cutoff, self.sample_time = model, limits, cutoff, sample_time
        self.credible = CredibleRobots.of(model, limits)
        self._base = model.base_parameters()

    @property
    def correlation(self) -> float:
        """Rows that tell as much as one independent one: noise that passes the filter of positions is that slow."""
        return max(1.0, 0.5 / (self.cutoff * self.sample_time))

    @cached_property
    def mean_squares(self) -> list[Array]:
        """For each joint the mean of y'y of its rows over motions within the limits, (n_b, n_b)."""
        rows = self._rows(*random_motions(self.limits, 600))
        return [rows[:, k].T @ rows[:, k] / len(rows) for k in range(self.model.dof)]

    @cached_property
    def feasible_set(self) -> FeasibleSet:
        """The set in which estimates lie."""
        return FeasibleSet(self.model)

    def assumed(self) -> RobotKnowledge:
        """Return what is known before any measurement."""
        noise = FIRST_NOISE * self.credible.torque_sizes
        return self.known(self.credible.parameters, noise, Information.empty(self.model), 1.0)

    def learnt(self, log: Array, begin: float, before: RobotKnowledge) -> tuple[RobotKnowledge, float]:
        """Return what is known with what was recorded since a time, and the time up to which that was used.

        Parameters
        ----------
        log : ndarray
            (S, 1 + 2 N), times, positions and torques.
        begin : float
            s.
        before : RobotKnowledge
            Of what was recorded before that time.
        """
        samples, used = self._samples(log, begin)
        if samples is None:
            return before, begin
        fresh = Information.from_samples(self.model, samples, batch_means=False)
        contradicted = self._contradicted(fresh, before)
        # The stretch in which the robot changed may be of both robots: it is left out when there is another one.
        anew = bool(contradicted or before.contradicted)
        info = fresh if anew else before.information + fresh
        counts = np.array([factor.count for factor in info.measured]) / self.correlation
        first = FIRST_COUNT * (FIRST_NOISE * self.credible.torque_sizes) ** 2
        noise, most = before.noise, np.full(self.model.dof, np.inf)
        for _ in range(FIT_ROUNDS):
            weighted_by = noise
            parameters, trust = self.fitted(info, noise), 1.0
            residual = np.asarray(info.joint_rms_error(np.asarray(self._base.K) @ parameters))
            squares = np.where(counts > 0, counts * residual**2, 0.0)
            for _ in range(NOISE_ROUNDS):
                covariance = self._covariance(noise, info, trust)[1]
                free = np.maximum(counts - self._spent(noise, info, covariance), 0.0)
                noise = np.sqrt((first + squares) / (FIRST_COUNT + free))
                trust = self.trust(parameters, covariance, trust)
            noise = most = np.minimum(noise, most)  # with few rows one joint's grows for ever, at which the others fit
            if np.all(noise > 0.95 * weighted_by):
                break
        known = self.known(parameters, noise, info, trust)
        stretches = 1 if anew else before.stretches + 1
        return replace(known, stretches=stretches, contradicted=contradicted), used

    def _contradicted(self, fresh: Information, before: RobotKnowledge) -> tuple[str, ...]:
        """Return the joints whose torques are not those that were expected by what was measured before."""
        if before.stretches < 2:
            return ()
        residual, found = np.asarray(fresh.joint_rms_error(before.base)), []
        for k, factor in enumerate(fresh.measured):
            if min(factor.count, before.information.measured[k].count) < ROWS_TO_ASK * self.correlation:
                continue
            rows = factor.triangle[:, :-1]
            unknown = np.sum((rows @ before.covariance[np.ix_(factor.columns, factor.columns)]) * rows) / factor.count
            if residual[k] ** 2 > CONTRADICTS * (before.noise[k] ** 2 + unknown):
                found.append(self.model.robot.joint_names[k])
        return tuple(found)

    def _samples(self, log: Array, begin: float) -> tuple[Samples | None, float]:
        """Process what was recorded since a time; return the samples and until when they reach."""
        size = self.model.dof
        first = int(np.searchsorted(log[:, 0], begin - 1e-9))
        part = log[first:]
        if len(part) < SHORTEST / self.sample_time:
            return None, begin
        recording = Recording(
            t=part[:, 0] - part[0, 0], q=part[:, 1 : 1 + size], torque=part[:, 1 + size :], source="on the fly"
        )
        if not np.any(np.ptp(recording.q, axis=0) > SLOW * self.limits.velocity):  # held still: no motion to learn from
            return None, begin
        samples = recording.process(
            model=self.model,
            cutoff=self.cutoff,
            order=3,
            trim=TRIM,
            torque_cutoff=self.cutoff,
            velocity_threshold=None,
        )
        fast = np.abs(samples.dq) >= SLOW * self.limits.velocity
        if samples.mask is not None:
            fast &= samples.mask
        if not fast.any():  # a robot of one joint that has only sunk while it was caught
            return None, begin
        return replace(samples, mask=fast), float(part[-1, 0]) - 2.0 * TRIM

    def fitted(self, info: Information, noise: Array) -> Array:
        """Return the parameters (n,) by what was measured, with noise of standard deviations (N,), and what is assumed.

        What is assumed has the largest weight with which it takes no more from the fit than noise does from as many
        parameters (the discrepancy principle of Morozov, 1966).
        """
        problem, K = info.reduced(1.0 / noise), np.asarray(self._base.K)
        search, prior = self._search
        # Of robots whose masses are in the assumed ratios, one that is as heavy as what was measured. A search crawls
        # from a robot of a hundredth of the masses, or from an answer with another weight, next to the boundary.
        size = float(np.linalg.norm(problem.rho) / np.linalg.norm(problem.R @ (K @ self._inside)))

        def fit(weight: float) -> tuple[Array, float]:
            search.begin(max(size, 1.0) * self._inside)
            # So many rows tell as much as one independent one; the noise is in the weights.
            found = search.solve(problem.R, problem.rho, self.correlation, prior, weight, most_steps=FIT_STEPS)
            left = problem.R @ (K @ found.parameters) - problem.rho
            return found.parameters, float(left @ left) / self.correlation

        _, least = fit(PRIOR_WEIGHTS[-1])
        for weight in PRIOR_WEIGHTS:
            parameters, left = fit(weight)
            if left - least <= self._base.count:
                break
        return parameters

    @cached_property
    def _search(self) -> tuple[WarmFit, PreparedPrior]:
        """The search for the estimate, and what it stays near to."""
        feasible, known = self.feasible_set, self.credible
        prior = EntropicPrior(known.prior.parameters, term_deviations=known.term_deviations)
        search = WarmFit(feasible, to_boundary=CAREFUL)
        return search, prior.prepare(feasible, PRIOR_WEIGHTS[0])

    @cached_property
    def _inside(self) -> Array:
        """(n,) parameters inside the feasible set, where the search begins."""
        known = self.credible
        terms = np.isfinite(known.term_deviations)
        inside = known.parameters.copy()
        inside[terms] = 0.1 * known.term_deviations[terms]
        # A link whose shape is a mark of a centimetre has moments of inertia below the margin of the set.
        room = parameters_of_pseudo_inertia(10.0 * self.feasible_set.margin * np.eye(4))
        for columns in self.model.link_columns:
            inside[np.asarray(columns)] += room
        return inside

    def known(self, parameters: Array, noise: Array, info: Information, trust: float) -> RobotKnowledge:
        """Return the knowledge that parameters (n,), noise (N,) and what was measured are.

        A robot that is not as what is assumed in what was measured need not be in what was not: `trust` is the part of
        the precision of the prior that is left.
        """
        base = np.asarray(self._base.K) @ parameters
        root, covariance = self._covariance(noise, info, trust)
        errors = np.array([np.sum(matrix * covariance) for matrix in self.mean_squares])
        sizes = np.array([base @ matrix @ base for matrix in self.mean_squares])
        if not info.count:
            sizes = np.maximum(sizes, self.credible.torque_sizes**2)
        weights = 1.0 / noise**2
        whole = float(np.sqrt(np.sum(weights * errors) / np.sum(weights * sizes)))
        joint_errors = np.sqrt(errors / sizes)
        return RobotKnowledge(parameters, base, root, noise, covariance, np.sqrt(errors), whole, joint_errors, info)

    def _covariance(self, noise: Array, info: Information, trust: float) -> tuple[Array, Array]:
        """Return the factor R of the information with the prior, and the covariance, (n_b, n_b) each."""
        precision = trust * self._prior_precision
        if info.count:
            R = info.reduced(1.0 / noise).R
            precision += R.T @ R / self.correlation
        scale = 1.0 / np.sqrt(np.diag(precision))
        root = np.linalg.cholesky(precision * np.outer(scale, scale)).T / scale
        inverse = np.linalg.inv(root)
        return root, inverse @ inverse.T

    @cached_property
    def _prior_precision(self) -> Array:
        return np.asarray(np.linalg.inv(self.credible.covariance))

    def _spent(self, noise: Array, info: Information, covariance: Array) -> Array:
        """Return how many independent rows of each joint (N,) the fit uses up: its part of the trace of the hat matrix.

        A fit leaves that many rows less of the noise (MacKay, "Bayesian interpolation", Neural Computation 4, 1992).
        """
        found = np.zeros(self.model.dof)
        for k, factor in enumerate(info.measured):
            rows = factor.triangle[:, :-1]
            own = covariance[np.ix_(factor.columns, factor.columns)]
            found[k] = np.sum((rows @ own) * rows) / (noise[k] ** 2 * self.correlation)
        return found

    def trust(self, parameters: Array, covariance: Array, trust: float) -> float:
        """Return the part of the precision of the prior that is left where measurements contradict it.

        As many parameters as are measured are as far from what was assumed as it says, in its standard deviations
        (MacKay, eq. 4.8 there); what was not measured may be as far.
        """
        off = np.asarray(self._base.K) @ (parameters - self.credible.parameters)
        measured = self._base.count - trust * float(np.sum(self._prior_precision * covariance))
        return min(1.0, max(measured, 1.0) / float(off @ self._prior_precision @ off))

    def torque_deviations(self, q: Array, dq: Array, ddq: Array, knowledge: RobotKnowledge) -> Array:
        """Return the standard deviation of the torques that are predicted of a motion, (S, N)."""
        return _deviations(self._rows(q, dq, ddq), knowledge)

    def inertias(self, q: Array, knowledge: RobotKnowledge) -> tuple[Array, Array]:
        """Return the inertia of each joint by the estimate at every q, and its standard deviation, (S, N) each."""
        still = np.zeros_like(q)
        at_rest = self._rows(q, still, still)
        values, spreads = np.zeros_like(q), np.zeros_like(q)
        for k in range(self.model.dof):
            one = still.copy()
            one[:, k] = 1.0
            rows = self._rows(q, still, one)[:, k : k + 1] - at_rest[:, k : k + 1]
            values[:, k] = np.maximum(rows[:, 0] @ knowledge.base, 1e-12)
            spreads[:, k] = _deviations(rows, knowledge)[:, 0]
        return values, spreads

    def _rows(self, q: Array, dq: Array, ddq: Array) -> Array:
        """The base regressor, (S, N, n_b)."""
        return np.asarray(self.model.kernel("regressor", base=True)(q, dq, ddq)).reshape(len(q), self.model.dof, -1)


def _deviations(rows: Array, knowledge: RobotKnowledge) -> Array:
    """Standard deviations (S, N) of what rows (S, N, n_b) tell of the base parameters."""
    return np.asarray(np.sqrt(np.einsum("skb,bc,skc->sk", rows, knowledge.covariance, rows)))
