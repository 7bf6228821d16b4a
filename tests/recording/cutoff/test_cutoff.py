"""The choice of the cutoff against the best one, which is known where the motion is; its evidence against SciPy."""

import numpy as np
import plotly.graph_objects
import pytest
from lxml import etree
from scipy import signal

import steelyard as sy
from steelyard.errors import InputError
from steelyard.identification.wam import TRAJECTORIES, simulated_log
from steelyard.recording import Processing, Recording, Samples, choose_cutoff, process_chunks
from steelyard.recording.cutoff import motion_spectra, residual_analysis
from steelyard.recording.cutoff.by_spectra import _density
from steelyard.recording.cutoff.by_torques import TorqueFit

RATE = 500.0


def noisy_motion(seed: int, top: float, noise: float, seconds: float = 30.0, joints: int = 2):
    """Sums of five sines up to a frequency, at phases and frequencies of a generator; their exact accelerations."""
    random = np.random.default_rng(seed)
    t = np.arange(round(seconds * RATE)) / RATE
    frequencies = np.sort(random.uniform(0.1 * top, top, (5, joints)), axis=0)
    angles = 2 * np.pi * frequencies[None] * t[:, None, None] + random.uniform(0, 6, (5, joints))
    sizes = random.uniform(0.2, 1.0, (5, joints)) / (1.0 + frequencies)
    q = (sizes * np.sin(angles)).sum(axis=1)
    ddq = -(sizes * (2 * np.pi * frequencies) ** 2 * np.sin(angles)).sum(axis=1)
    q = q + noise * random.normal(size=q.shape)
    return Recording(t=t, q=q, torque=np.cos(t)[:, None] + q), ddq


@pytest.mark.parametrize("rows", [999, 1000])
def test_the_density_is_that_of_scipy(rows: int) -> None:
    values = np.cumsum(np.random.default_rng(rows).normal(size=(rows, 3)), axis=0)
    trend = np.polynomial.polynomial.polyfit(np.arange(rows), values, 1)
    straight = values - np.polynomial.polynomial.polyval(np.arange(rows), trend).T
    expected = signal.welch(straight, RATE, window="blackman", nperseg=rows, axis=0)
    for found, known in zip(_density(values, RATE), expected, strict=True):
        np.testing.assert_allclose(found, known[1:], rtol=1e-9)


def true_error(recording: Recording, ddq: np.ndarray, cutoff: float) -> float:
    found = recording.process(cutoff=cutoff, trim=0.0, velocity_threshold=None).ddq
    inside = slice(1500, -1500)
    share = np.mean((found - ddq)[inside] ** 2, axis=0) / np.mean(ddq[inside] ** 2, axis=0)
    return float(np.sqrt(share.mean()))


@pytest.mark.parametrize(
    ("top", "noise"),
    [
        (0.5, 1e-5),
        (3.0, 1e-2),
        *(pytest.param(*case, marks=pytest.mark.slow) for case in ((1.0, 1e-3), (2.0, 1e-4), (5.0, 1e-4))),
    ],
)
@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_choice_is_close_to_the_best(top, noise, seed):
    recording, ddq = noisy_motion(seed, top, noise)
    choice = choose_cutoff(recording)
    best = min(true_error(recording, ddq, f) for f in np.geomspace(0.7 * top, 20 * top, 30) if f < 0.45 * RATE)
    # Within a quarter of the least error that any cutoff has; a log of 30 s resolves no errors below 1e-4.
    assert true_error(recording, ddq, choice.cutoff) <= 1.25 * best + 5e-5


def test_expected_error_is_the_true_one():
    recording, ddq = noisy_motion(3, 2.0, 1e-3)
    choice = recording.choose_cutoff()
    for factor in (0.6, 1.0, 2.0, 3.0):
        expected = np.interp(factor * choice.cutoff, choice.candidates, choice.error)
        assert expected == pytest.approx(true_error(recording, ddq, factor * choice.cutoff), rel=0.35)


@pytest.mark.slow
def test_arm_of_the_thesis(wam):
    """Brute force over cutoffs puts the best at 2.17 Hz; the thesis chose 4.8 Hz by the rule of ten."""
    recording = simulated_log(wam, "A", 1)
    *_, ddq = TRAJECTORIES["A"].sample(1000.0, 3.0)
    choice = recording.choose_cutoff()
    assert choice.cutoff == pytest.approx(2.17, rel=0.1)
    assert choice.rule == pytest.approx(4.8, rel=0.1)
    found = [recording.process(cutoff=c, trim=0.0, velocity_threshold=None).ddq for c in (choice.cutoff, 4.8)]
    errors = [np.abs((f - ddq)[2000:-2000]).std() for f in found]
    assert errors[0] < 0.5 * errors[1]


def test_spectra_are_scipys_and_noise_is_found():
    recording, _ = noisy_motion(1, 1.0, 1e-3)
    spectra = motion_spectra(recording.q, RATE)
    detrended = signal.detrend(recording.q, axis=0)
    f, density = signal.periodogram(detrended, RATE, window="blackman", axis=0, detrend="constant")
    np.testing.assert_allclose(spectra.frequencies, f[1:])
    np.testing.assert_allclose(spectra.density, density[1:], rtol=1e-4, atol=1e-12)
    # White noise of variance s² has the one-sided density 2 s² / rate.
    np.testing.assert_allclose(spectra.noise, 2e-6 / RATE, rtol=0.35)
    assert np.all((spectra.crossover > 1.0) & (spectra.crossover < 10.0))
    assert spectra.moving.all()


def test_residual_analysis_tells_white_noise():
    recording, _ = noisy_motion(2, 1.0, 1e-2)
    found = residual_analysis(recording.q, RATE, np.geomspace(1.0, 220.0, 20))
    b, a = signal.butter(3, found.cutoffs[7], fs=RATE)
    rest = recording.q - signal.filtfilt(b, a, recording.q, axis=0)
    np.testing.assert_allclose(found.residuals[7], np.sqrt(np.mean(rest**2, axis=0)), rtol=1e-6)
    # The square root of the band that is left lies above its chord: the line ends up to a third above the noise.
    assert np.all((found.noise > 0.9e-2) & (found.noise < 1.4e-2))
    assert np.all(found.chosen >= 1.0)


def test_joints_at_rest_do_not_vote():
    recording, _ = noisy_motion(4, 1.0, 1e-4)
    held = np.column_stack([recording.q, np.full(recording.count, 0.3)])
    both = Recording(t=recording.t, q=held, torque=np.column_stack([recording.torque, recording.torque[:, :1]]))
    assert both.choose_cutoff().cutoff == pytest.approx(recording.choose_cutoff().cutoff)
    assert np.isnan(both.choose_cutoff().joint_cutoffs[2])
    assert both.choose_cutoff().table[2][1] == "–"


def test_evidence_can_be_looked_at():
    recording, _ = noisy_motion(1, 1.0, 1e-3)
    choice = recording.choose_cutoff(order=4)
    figure = plotly.graph_objects.Figure(choice.figure())
    assert len(figure.data) == 5
    assert f"{choice.cutoff:.4g} Hz" in choice.remark
    page = etree.fromstring(f"<div>{choice._repr_html_()}</div>")
    assert len(page.findall(".//svg")) == 2
    assert len(page.findall(".//tr")) == 3
    names = Recording(t=recording.t, q=recording.q, torque=recording.torque, joint_names=("a<b", "c&d"))
    etree.fromstring(f"<div>{names.choose_cutoff()._repr_html_()}</div>")


def test_processing_chooses_and_says_so(tmp_path):
    recording, _ = noisy_motion(1, 1.0, 1e-4)
    choice = recording.choose_cutoff(order=3)
    samples = recording.process(cutoff="auto", trim=0.0, velocity_threshold=None)
    np.testing.assert_array_equal(
        samples.ddq, recording.process(cutoff=choice.cutoff, trim=0.0, velocity_threshold=None).ddq
    )
    assert samples.remarks == (choice.remark,)
    assert samples.cutoff_choice is not None
    assert samples.cutoff_choice.cutoff == choice.cutoff
    assert recording.process(cutoff=3.0, trim=0.0, velocity_threshold=None).cutoff_choice is None
    # Chunk by chunk, the same rows decide.
    path = recording.save(tmp_path / "log.npz")
    parts = list(
        process_chunks(path, processing=Processing(cutoff="auto", trim=0.0, velocity_threshold=None), rows=6000)
    )
    assert parts[0].cutoff_choice.cutoff == pytest.approx(choice.cutoff, rel=1e-6)
    assert [part.cutoff_choice is None for part in parts] == [False, True, True]
    assert Samples.joined(parts).cutoff_choice is parts[0].cutoff_choice
    # A filter with a width of its own asks for no choice.
    assert (
        recording.process(
            cutoff="auto", filter={"kind": "savitzky_golay", "window": 0.2}, trim=0.0, velocity_threshold=None
        ).remarks
        == ()
    )


@pytest.mark.parametrize(
    ("q", "phrase"),
    [(np.ones((2000, 1)), "too little motion"), (np.arange(40.0)[:, None], "too few to choose a cutoff")],
)
def test_what_shows_no_cutoff_is_refused(q, phrase):
    t = np.arange(len(q)) / RATE
    with pytest.raises(InputError, match=phrase):
        Recording(t=t, q=q, torque=np.sin(t)[:, None]).process(cutoff="auto", trim=0.0, velocity_threshold=None)


def test_a_joint_without_torques_has_no_relative_residual():
    model = sy.Model(sy.Robot.from_dh([("pi/2", 0, 0, "q"), (0, 0.4, 0, "q")]))
    q, dq, ddq, torque = np.random.default_rng(1).normal(size=(4, 100, 2))
    torque[:, 1] = 0.0
    found = TorqueFit(model)
    found.add(sy.Samples(q=q, dq=dq, ddq=ddq, torque=1e9 * torque), np.arange(100), np.ones((100, 2), dtype=bool))
    relative = found.fitted()[1]
    assert np.isfinite(relative[0])
    assert np.isnan(relative[1])
