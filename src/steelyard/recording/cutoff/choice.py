"""The choice of the cutoff: least expected error of the accelerations, beside two other opinions."""

from __future__ import annotations

import html
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError

from ..filtering import edge_rows, motion_frequency
from .drawing import Curve, picture
from .residuals import ResidualAnalysis, residual_analysis
from .spectra import HIGHEST, Spectra, motion_spectra

if TYPE_CHECKING:
    from ..recording import Recording

__all__ = ["CutoffChoice", "choose_cutoff"]

Array = NDArray[np.float64]
CANDIDATES = 96
TRIED = 24
MOST_ROWS = 100_000


@dataclass(frozen=True, eq=False)
class CutoffChoice:
    """A cutoff chosen from the data, and its evidence.

    Attributes
    ----------
    cutoff : float
        Hz, of a Butterworth filter of `order` forwards and backwards.
    order : int
    rate : float
        Hz.
    source : str
    joint_names : tuple of str
    spectra : Spectra
        Where the motion of each joint ends and noise begins.
    candidates : ndarray
        (C,) Hz.
    distortion, noise : ndarray
        (C, N) expected mean squares of what each candidate takes from the acceleration of a joint and of the noise
        that it leaves, over the mean square of the acceleration; 0 for joints at rest.
    residuals : ResidualAnalysis
        The second opinion, of the positions.
    rule : float
        Hz, the third: ten times the frequency of the motion (Gautier 1997).
    """

    titles: ClassVar[tuple[str, ...]] = (
        "Joint",
        "Noise dominates from, Hz",
        "Best cutoff of this joint, Hz",
        "Residual analysis, Hz",
    )
    explanation: ClassVar[str] = (
        "The cutoff of the position filter was chosen from the data. Left, the spectrum of each joint's acceleration: "
        "it falls beyond the motion and rises again where noise dominates. Right, what each cutoff is expected to "
        "cost: what it takes from the motion, and the noise that it leaves. The dotted line is the choice."
    )

    cutoff: float
    order: int
    rate: float
    source: str
    joint_names: tuple[str, ...]
    spectra: Spectra
    candidates: Array
    distortion: Array
    noise: Array
    residuals: ResidualAnalysis
    rule: float

    @property
    def error(self) -> Array:
        """(C,) expected error of the accelerations: root mean square over the moving joints, relative."""
        moving = self.spectra.moving
        return np.asarray(np.sqrt((self.distortion + self.noise)[:, moving].mean(axis=1)))

    @property
    def joint_cutoffs(self) -> Array:
        """(N,) Hz, what each joint would choose for itself; NaN for joints at rest."""
        own = self.candidates[np.argmin(self.distortion + self.noise, axis=0)]
        return np.where(self.spectra.moving, own, np.nan)

    def remark(self) -> str:
        """One sentence that says what was chosen and why."""
        moving = self.spectra.moving
        crossover = self.spectra.crossover[moving]
        least = float(np.interp(self.cutoff, self.candidates, self.error))
        return (
            f"Positions were filtered at {self.cutoff:.4g} Hz, chosen from the data: noise exceeds the motion above "
            f"{crossover.min():.3g} to {crossover.max():.3g} Hz, and the expected error of the accelerations is least, "
            f"{100.0 * least:.2g} %; residual analysis says {np.median(self.residuals.chosen[moving]):.3g} Hz, ten "
            "times the "
            f"motion's frequency is {self.rule:.3g} Hz."
        )

    def __repr__(self) -> str:
        return f"CutoffChoice({self.source!r}: {self.cutoff:.4g} Hz, order {self.order})"

    def figure(self) -> dict[str, Any]:
        """The evidence as a plotly figure, as plain data: spectra of the accelerations, and the expected error."""
        f, shown = self.spectra.frequencies, self.spectra.acceleration
        traces: list[dict[str, Any]] = [
            {"type": "scatter", "x": f.tolist(), "y": shown[:, j].tolist(), "name": name, "xaxis": "x", "yaxis": "y"}
            for j, name in enumerate(self.joint_names)
        ]
        moving = self.spectra.moving
        parts = (
            ("distortion", np.sqrt(self.distortion[:, moving].mean(axis=1))),
            ("noise", np.sqrt(self.noise[:, moving].mean(axis=1))),
            ("both", self.error),
        )
        traces += [
            {"type": "scatter", "x": self.candidates.tolist(), "y": y.tolist(), "name": n, "xaxis": "x2", "yaxis": "y2"}
            for n, y in parts
        ]
        line = {"type": "line", "x0": self.cutoff, "x1": self.cutoff, "y0": 0, "y1": 1, "line": {"dash": "dot"}}
        layout = {
            "xaxis": {"type": "log", "domain": [0, 0.46], "title": {"text": "frequency, Hz"}},
            "xaxis2": {"type": "log", "domain": [0.54, 1], "title": {"text": "cutoff, Hz"}, "anchor": "y2"},
            "yaxis": {"type": "log", "title": {"text": "density of the acceleration, (rad/s²)²/Hz"}},
            "yaxis2": {"type": "log", "anchor": "x2", "title": {"text": "expected relative error"}},
            "shapes": [{**line, "xref": "x", "yref": "y domain"}, {**line, "xref": "x2", "yref": "y2 domain"}],
        }
        return {"data": traces, "layout": layout}

    def svg(self) -> str:
        """The same as two pictures in SVG, without scripts."""
        f, shown = self.spectra.frequencies, self.spectra.acceleration
        moving = [j for j in range(len(self.joint_names)) if self.spectra.moving[j]]
        first = picture(
            [Curve(self.joint_names[j], f, shown[:, j]) for j in moving],
            "frequency, Hz",
            "spectrum of the acceleration, (rad/s²)²/Hz",
            self.cutoff,
        )
        distortion, noise = (
            np.sqrt(part[:, self.spectra.moving].mean(axis=1)) for part in (self.distortion, self.noise)
        )
        second = picture(
            [
                Curve("distortion", self.candidates, distortion),
                Curve("noise", self.candidates, noise),
                Curve("both", self.candidates, self.error),
            ],
            "cutoff, Hz",
            "expected error of the acceleration, relative",
            self.cutoff,
            decades=7,
        )
        return first + second

    def table(self) -> list[tuple[str, str, str, str]]:
        """For each joint its name, crossover, own cutoff and that of residual analysis, in Hz."""
        return [
            (name, *(f"{value:.3g}" if np.isfinite(value) else "–" for value in values))  # type: ignore[misc]
            for name, values in zip(
                self.joint_names,
                zip(self.spectra.crossover, self.joint_cutoffs, self.residuals.chosen, strict=True),
                strict=True,
            )
        ]

    def _repr_html_(self) -> str:
        head = "".join(f"<th>{title}</th>" for title in self.titles)
        rows = "".join(
            "<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in self.table()
        )
        return (
            f"<p>{html.escape(self.remark())}</p>{self.svg()}"
            f"<table><caption>{html.escape(repr(self))}</caption><tr>{head}</tr>{rows}</table>"
        )


def choose_cutoff(recording: Recording, order: int = 3) -> CutoffChoice:
    """Choose the cutoff of the position filter from the data.

    The spectrum of each joint's acceleration falls beyond the motion and rises again where noise dominates. Motion
    below that crossover counts as signal, everything above it as noise, whose density is taken to go on below it
    unchanged. For each candidate the mean squared error of the acceleration is then expected to be ``∫ (1 - G)²
    signal + ∫ G² noise``, with the response G of the filter. It is taken relative to the acceleration's own mean
    square, averaged over the moving joints (all joints share one filter, so that their signals stay alike), and made
    least.

    Parameters
    ----------
    recording : Recording
        Evenly sampled. Of more than 100 000 rows the middle ones are taken.
    order : int
        Of the Butterworth filter that is applied twice.

    Returns
    -------
    CutoffChoice

    Raises
    ------
    InputError
        Where no joint moves, or there are too few rows.

    Examples
    --------
    >>> from steelyard.recording import Recording
    >>> t = np.arange(20000) / 1000
    >>> q = np.sin(2 * np.pi * 0.5 * t) + 1e-4 * np.random.default_rng(1).normal(size=t.size)
    >>> choice = choose_cutoff(Recording(t=t, q=q[:, None], torque=np.cos(t)[:, None], source="sine"))
    >>> bool(1.0 < choice.cutoff < 4.0)
    True
    """
    rate, source = recording.rate, recording.source
    q = recording.q
    if len(q) > MOST_ROWS:
        begin = (len(q) - MOST_ROWS) // 2
        q = q[begin : begin + MOST_ROWS]
    if len(q) <= edge_rows(order):
        raise InputError(
            f"{source} has {len(q)} rows, too few to choose a cutoff by; state `cutoff` in [processing], in Hz."
        )
    spectra = motion_spectra(q, rate, source)
    candidates = np.geomspace(max(2.0 * rate / len(q), 1e-4 * rate), HIGHEST * rate, CANDIDATES)
    distortion, noise = _expected(spectra, candidates, rate, order)
    total = (distortion + noise)[:, spectra.moving].mean(axis=1)
    best = int(np.argmin(total))
    cutoff = float(candidates[best])
    if 0 < best < CANDIDATES - 1:
        # The vertex of the parabola through the least value and its neighbours, in the logarithms.
        y = np.log(total[best - 1 : best + 2])
        bend = y[0] - 2.0 * y[1] + y[2]
        if bend > 0.0:
            cutoff *= (candidates[best + 1] / candidates[best]) ** float(0.5 * (y[0] - y[2]) / bend)
    names = recording.joint_names or tuple(f"joint {j + 1}" for j in range(recording.joint_count))
    tried = np.geomspace(candidates[0], 0.45 * rate, TRIED)
    opinion = residual_analysis(q, rate, tried, order, source)
    rule = min(10.0 * motion_frequency(q, rate), 0.2 * rate)
    return CutoffChoice(cutoff, order, rate, source, names, spectra, candidates, distortion, noise, opinion, rule)


def _expected(spectra: Spectra, candidates: Array, rate: float, order: int) -> tuple[Array, Array]:
    """Relative mean squares of distortion and of noise, (C, N) each."""
    f = spectra.frequencies
    ratio = np.tan(np.pi * np.minimum(f / rate, 0.4999)) / np.tan(np.pi * candidates / rate)[:, None]
    gain = 1.0 / (1.0 + ratio ** (2 * order))  # (C, F)
    distortion, left = np.zeros((2, len(candidates), spectra.density.shape[1]))
    for j in np.flatnonzero(spectra.moving):
        density, level = spectra.density[:, j], spectra.noise[j]
        below = f < spectra.crossover[j]
        fourth = (2.0 * np.pi * f) ** 4
        signal = np.where(below, np.maximum(density - level, 0.0), 0.0) * fourth
        disturbance = np.where(below, np.minimum(level, density), density) * fourth
        power = max(float(signal.sum()), 1e-300)
        distortion[:, j] = (1.0 - gain) ** 2 @ signal / power
        left[:, j] = gain**2 @ disturbance / power
    return distortion, left
