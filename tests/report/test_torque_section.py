"""The torques in the report: what is drawn, where it comes from, and what is left."""

import base64
import json
import tracemalloc
import zlib
from dataclasses import replace

import lxml.html
import numpy as np
import pytest

import steelyard as sy
from steelyard.identification import Identification
from steelyard.report.residual_patterns import autocorrelation, spectrum
from steelyard.report.torque_section import torques
from steelyard.report.torque_sources import shares, torque_sources

from .conftest import Reference


def parsed(identification: Identification) -> tuple[list[dict], bytes]:
    """The data of the figures and its packed curves."""
    page = lxml.html.fromstring(torques(identification))
    packed = zlib.decompress(base64.b64decode(page.get_element_by_id("torque-curves").text))
    return json.loads(page.get_element_by_id("torque-data").text), packed


def unpacked(packed: bytes, place: dict) -> np.ndarray:
    """A curve, as the script of the page reads it."""
    differences = np.frombuffer(packed, dtype="<i2", count=place["n"], offset=place["at"])
    levels = np.cumsum(differences, dtype=np.int64).astype("<i2").astype(float)
    return np.where(levels == -32768, np.nan, place["low"] + (levels + 32500) * place["step"])


def test_curves_are_the_torques(identification: Identification, reference: Reference) -> None:
    logs, packed = parsed(identification)
    for number, log in enumerate(logs):
        predicted = reference.regressors[number] @ reference.parameters
        for joint, told in enumerate(log["joints"]):
            recorded, residual = reference.torques[number][:, joint], unpacked(packed, told["residual"])
            measured, feasible = unpacked(packed, told["measured"]), unpacked(packed, told["feasible"])
            assert len(measured) == len(recorded)
            size = np.ptp(recorded)
            np.testing.assert_allclose(measured, recorded, atol=2e-5 * size)
            np.testing.assert_allclose(residual, measured - feasible, atol=5e-5 * size)
            np.testing.assert_allclose(unpacked(packed, told["unconstrained"]), predicted[:, joint], atol=1e-3 * size)
            assert told["noise"] == pytest.approx((0.5, 0.1)[joint], rel=0.1)
            np.testing.assert_allclose(np.diff(unpacked(packed, told["t"])), 0.01, atol=4e-4)
    assert [log["rows"].split(",")[0].split(".")[0] for log in logs] == ["Data of the fit", "Validation"]
    assert all(f"All {len(t)} rows are drawn." in log["rows"] for log, t in zip(logs, reference.torques, strict=True))


def test_times_count_from_the_first_row(identification: Identification) -> None:
    whole = identification.predictions[0]
    late = replace(whole, trace=replace(whole.trace, t=whole.trace.t + 1_700_000_000.0))
    logs, packed = parsed(replace(identification, predictions=(late,)))
    t = unpacked(packed, logs[0]["joints"][0]["t"])
    assert t[0] == 0.0
    np.testing.assert_allclose(t, np.arange(len(t)) / 100, atol=4e-4)
    assert len(t) == len(whole.trace.t)


def test_long_logs_keep_their_peaks(identification: Identification) -> None:
    """Of a log of 60 000 rows with two odd ones."""
    whole = identification.predictions[0]
    wave = np.sin(np.arange(60_000) / 500.0)[:, None] * np.ones(2)
    measured = wave.copy()
    measured[12_345, 0], measured[54_321, 1] = 7.0, -0.4  # the second is a peak of the residual alone
    trace = replace(
        whole.trace, t=np.arange(60_000.0), measured=measured, unconstrained=wave, feasible=wave, samples=None
    )
    logs, packed = parsed(replace(identification, predictions=(replace(whole, trace=replace(trace, log_rows=60_000)),)))
    first, second = logs[0]["joints"]
    assert len(unpacked(packed, first["t"])) <= 2400
    assert len(packed) < 80_000  # bytes, whatever the length of the log
    assert unpacked(packed, first["measured"]).max() == pytest.approx(7.0, abs=1e-3)
    left = unpacked(packed, second["residual"])
    assert left[np.abs(left).argmax()] == pytest.approx(-0.4 - wave[54_321, 1], abs=1e-3)
    assert "The log has 60000 rows" in logs[0]["rows"]


@pytest.mark.parametrize("total", [0, 30_000])
def test_a_stream_keeps_the_extremes_of_torque_and_residual(total: int) -> None:
    """Of 30 000 rows in chunks, every extreme of every joint in each eighth is there, and the rows are untouched."""
    from steelyard.identification.log_reader import DrawnRows

    model = sy.Model(sy.Robot.from_dh([("-pi/2", 0.0, 0.3, "q"), (0, 0.4, 0, "q")]).with_terms(sy.Viscous()))
    random = np.random.default_rng(5)
    count = 30_000
    angle = np.arange(count)[:, None] * np.array([0.011, 0.017])
    q, dq, ddq = np.sin(angle), np.cos(angle), -np.sin(angle)
    truth = random.uniform(0.1, 1.0, model.parameter_count)
    ideal = model.inverse_dynamics(q, dq, ddq, truth)
    torque = ideal + random.normal(0.0, 0.05, ideal.shape)
    odd = 2500 * np.arange(12) + random.integers(0, 2372, 12)  # no two of them in one piece of 128
    torque[odd, odd % 2] = ideal[odd, odd % 2] + 0.6  # hidden in the swing of the torque
    drawn, start = DrawnRows(model, 2000, total), 0
    for end in (500, 9000, 9001, 20_000, count):
        rows = slice(start, end)
        samples = sy.Samples(q=q[rows], dq=dq[rows], ddq=ddq[rows], torque=torque[rows], t=np.arange(start, end) * 1.0)
        drawn.add(samples)
        start = end
    drawn.finish()
    kept = drawn.kept.samples.t.astype(int)
    assert (drawn.kept.seen, drawn.kept.piece) == (count, 128)  # 235 pieces, of which 250 may be
    assert len(kept) <= 4000
    np.testing.assert_array_equal(drawn.kept.samples.torque, torque[kept])
    np.testing.assert_array_equal(drawn.kept.samples.ddq, ddq[kept])
    assert set(odd.tolist()) <= set(kept.tolist())
    for part in np.array_split(np.arange(count), 8):
        assert np.isin(part[torque[part].argmax(axis=0)], kept).all()
    assert all(np.array_equal(window.torque, torque[window.t.astype(int)]) for window in drawn.kept.windows)


@pytest.mark.slow
def test_of_a_long_piece_that_is_not_whole_few_rows_wait() -> None:
    """All rows since the last of 25 pieces would take 6 MB, and twice that while they are put together."""
    from steelyard.identification.log_reader import DrawnRows

    model = sy.Model(sy.Robot.from_dh([("-pi/2", 0.0, 0.3, "q"), (0, 0.4, 0, "q")]))
    drawn = DrawnRows(model, 200)
    samples = sy.Samples(*np.random.default_rng(2).standard_normal((4, 4000, 2)))
    for _ in range(3):
        drawn.add(samples)
    tracemalloc.start()
    try:
        for _ in range(397):
            drawn.add(samples)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    drawn.finish()
    assert peak < 2e6
    assert drawn.kept.piece >= 65_536
    assert drawn.kept.seen == 1_600_000


def test_the_sources_are_those_of_pinocchio(identification: Identification) -> None:
    """Gravity, inertia and Coriolis forces of the same bodies by other algorithms; friction in closed form."""
    pin = pytest.importorskip("pinocchio")
    model, delta = identification.model, np.asarray(identification.estimate.parameters)
    samples = identification.predictions[0].samples
    assert samples is not None
    own, robot = pin.Model(), model.robot
    own.gravity.linear = np.array([0.0, -9.81, 0.0])
    parent = 0
    for index, columns in enumerate(model.link_columns):
        place = pin.SE3(np.eye(3), np.array([0.5 * index, 0.0, 0.0]))
        parent = own.addJoint(parent, pin.JointModelRZ(), place, f"joint{index}")
        L, first, m = delta[columns[:6]], delta[columns[6:9]], delta[columns[9]]
        center = first / m
        about = np.array([[L[0], L[1], L[2]], [L[1], L[3], L[4]], [L[2], L[4], L[5]]])
        skew = pin.skew(center)
        own.appendBodyToJoint(parent, pin.Inertia(m, center, about + m * skew @ skew), pin.SE3.Identity())
    data, found = own.createData(), torque_sources(model, delta, samples)
    assert list(found) == ["gravity", "inertia", "Coriolis and centrifugal", "friction"]
    names = list(model.parameter_names)
    for row in range(0, samples.count, 97):
        q, dq, ddq = samples.q[row], samples.dq[row], samples.ddq[row]
        gravity = pin.computeGeneralizedGravity(own, data, q)
        mass = pin.crba(own, data, q)
        mass = np.triu(mass) + np.triu(mass, 1).T
        coriolis = pin.computeCoriolisMatrix(own, data, q, dq) @ dq
        np.testing.assert_allclose(found["gravity"][row], gravity, atol=1e-9)
        np.testing.assert_allclose(found["inertia"][row], mass @ ddq, atol=1e-9)
        np.testing.assert_allclose(found["Coriolis and centrifugal"][row], coriolis, atol=1e-9)
        viscous, coulomb = ([delta[names.index(f"{s}{k + 1}")] for k in range(robot.dof)] for s in ("Fvj", "Fcj"))
        np.testing.assert_allclose(found["friction"][row], viscous * dq + coulomb * np.sign(dq), atol=1e-9)
    total = np.sum(list(found.values()), axis=0)
    np.testing.assert_allclose(total, model.inverse_dynamics(samples.q, samples.dq, samples.ddq, delta), atol=1e-9)
    sizes, parts = shares(found)
    np.testing.assert_allclose(np.sum(list(parts.values()), axis=0), 1.0, atol=1e-12)
    np.testing.assert_allclose(sizes["gravity"], np.sqrt(np.mean(found["gravity"] ** 2, axis=0)))


@pytest.mark.parametrize(("rows", "compared"), [(4000, 15), (1024, 15), (51, 24), (50, 24)])
def test_the_spectrum_is_that_of_scipy(rows: int, compared: int) -> None:
    """Up to so many frequencies, each of which has a band of its own."""
    from scipy.signal import welch

    window = np.random.default_rng(4).standard_normal((rows, 2)) + np.arange(rows)[:, None] / rows
    frequency, density = spectrum([window], 0.01)
    expected = welch(window, 100.0, nperseg=min(rows, 1024), axis=0, detrend=False)
    np.testing.assert_allclose(frequency[:compared], expected[0][1:-1][:compared], rtol=1e-12)
    np.testing.assert_allclose(density[:compared] ** 2, expected[1][1:-1][:compared], rtol=1e-9)


def test_a_line_stands_at_its_frequency_and_a_memory_in_its_lags() -> None:
    """A sine of 12.5 Hz in noise; and x_k = 0.8 x_{k-1} + noise, whose autocorrelation is 0.8^k."""
    random = np.random.default_rng(3)
    t = np.arange(16_384) / 200.0
    memory = np.zeros(len(t))
    noise = random.normal(size=len(t))
    for k in range(1, len(t)):
        memory[k] = 0.8 * memory[k - 1] + noise[k]
    both = np.column_stack([np.sin(2 * np.pi * 12.5 * t) + 0.1 * noise, memory])
    both[5000:5200, 1] = np.nan
    windows = [both[:8192], both[8192:]]
    frequency, density = spectrum(windows, 1 / 200)
    assert frequency[density[:, 0].argmax()] == pytest.approx(12.5, rel=0.03)
    # 1 / |1 - 0.8 exp(-iω)|² of white noise, whose one-sided density is 2/200.
    expected = np.sqrt(2 / 200) / np.abs(1 - 0.8 * np.exp(-2j * np.pi * frequency / 200))
    np.testing.assert_allclose(density[60:, 1], expected[60:], rtol=0.25)
    lag, found, bound = autocorrelation(windows, 1 / 200)
    np.testing.assert_allclose(found[:8, 1], 0.8 ** np.arange(8), atol=0.05)
    assert lag[1] == 1 / 200
    assert bound[0] == pytest.approx(1.96 / 128)
