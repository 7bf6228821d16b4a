"""The generated step of friction with presliding, sample after sample, against the states along the whole motion."""

import ctypes
from pathlib import Path

import numpy as np
import pytest
from python_file import module_of_file

import steelyard as sy
from steelyard.dynamics import ByJoint, ChannelFriction, Dahl, LuGre

from .conftest import build_self_test, need, run
from .scripts import PYTHON, mutated, needs, self_test_of

ROWS = [("pi/2", 0.1, 0.3, "q"), (0, 0.4, 0, "q"), (0, 0, "q", 0)]


@pytest.fixture(scope="module")
def arm() -> sy.Model:
    """LuGre's friction at the first joint, none with a state at the second, and Dahl's at one that slides."""
    laws = ByJoint([LuGre(0.01, 0.5, 0.1, joints=[1]), Dahl(0.02, joints=[3]), sy.Viscous()])
    return sy.Model(sy.Robot.from_dh(ROWS, name="arm").with_terms(laws))


def motion() -> tuple[np.ndarray, np.ndarray]:
    """Reversals fast and slow, and a rest."""
    t = np.clip(np.linspace(0.0, 5.0, 301), 0.0, 4.0)[:, None]
    still = np.linspace(0.0, 5.0, 301)[:, None] > 4.0
    sizes, rates = np.array([0.05, 0.3, 0.04]), np.array([3.0, 2.0, 5.0])
    return sizes * np.sin(rates * t), np.where(still, 0.0, sizes * rates * np.cos(rates * t))


def stepped_in_c(folder: Path, q: np.ndarray, dq: np.ndarray) -> np.ndarray:
    need("gcc")
    run(["gcc", "-std=c99", "-O2", "-shared", "-fPIC", "arm.c", "-lm", "-o", "shared.so"], folder)
    step = ctypes.CDLL(str(folder / "shared.so")).arm_presliding_step
    states = np.zeros_like(q)
    for k in range(1, len(q)):
        rows = q[k - 1], q[k], dq[k - 1], dq[k], states[k - 1], states[k]
        step(*(ctypes.c_void_p(row.ctypes.data) for row in rows))
    return states


def stepped_in_python(folder: Path, q: np.ndarray, dq: np.ndarray) -> np.ndarray:
    step, states = module_of_file(folder / "arm.py").presliding_step, np.zeros_like(q)
    for k in range(1, len(q)):
        states[k] = step(q[k - 1], q[k], dq[k - 1], dq[k], states[k - 1])
    return states


def stepped_in_octave(folder: Path, q: np.ndarray, dq: np.ndarray) -> np.ndarray:
    need("octave-cli")
    np.savetxt(folder / "q.txt", q, fmt="%.17g")
    np.savetxt(folder / "dq.txt", dq, fmt="%.17g")
    (folder / "driver.m").write_text(
        "q = load('q.txt'); dq = load('dq.txt'); u = zeros(3, 1);\n"
        "for k = 2:rows(q)\n"
        "  u = arm_presliding_step(q(k - 1, :), q(k, :), dq(k - 1, :), dq(k, :), u); printf('%.17g ', u); disp('');\n"
        "end\n"
    )
    printed = run(["octave-cli", "--norc", "--no-history", "driver.m"], folder)
    return np.vstack([np.zeros(3), np.array([[float(x) for x in line.split()] for line in printed.splitlines()])])


STEPPED = {"c": stepped_in_c, "python": stepped_in_python, "octave": stepped_in_octave}


@pytest.mark.parametrize("language", STEPPED)
def test_steps_lead_to_the_states_along_the_motion(language: str, arm: sy.Model, tmp_path: Path) -> None:
    q, dq = motion()
    expected = arm.presliding(q, dq)
    assert np.ptp(expected[:, 0]) > 2.0  # LuGre's goes beyond Coulomb friction, to both sides
    assert np.ptp(expected[:, 2]) > 1.8
    assert not expected[:, 1].any()
    arm.generate(language, ["presliding_step"], directory=tmp_path)
    found = STEPPED[language](tmp_path, q, dq)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-12)


def test_where_no_functions_are_named_the_step_is_among_them(arm: sy.Model, tmp_path: Path) -> None:
    arm.generate("python", directory=tmp_path / "with")
    module = module_of_file(tmp_path / "with" / "arm.py")
    assert {"inverse_dynamics", "presliding_step"} <= set(module.__all__)
    arm.without_channels.generate("python", directory=tmp_path / "without")
    assert "presliding_step" not in module_of_file(tmp_path / "without" / "arm.py").__all__
    assert "presliding_step" in arm.functions
    assert "presliding_step" not in arm.without_channels.functions


def test_models_without_a_state_refuse_the_step(arm: sy.Model, tmp_path: Path) -> None:
    with pytest.raises(sy.InputError, match=r"arm has no friction with a state, which 'presliding_step' would step"):
        arm.without_channels.generate("c", ["presliding_step"], directory=tmp_path / "code")
    assert not (tmp_path / "code").exists()


def test_torques_take_the_state_of_the_step(arm: sy.Model) -> None:
    """Beside another channel the state has its own place among the channels."""
    terms = [ChannelFriction("heat", range=[0, 60], joints=[2]), Dahl(0.02, joints=[1, 3])]
    model = sy.Model(arm.robot.with_terms(ByJoint(terms)))
    assert model.function("presliding_step").arguments[-1].width == 3
    torque = model.function("inverse_dynamics").arguments[3]
    place = torque.elements.index("presliding at joint 'joint1'")
    assert torque.width == 6
    assert place == 3 * model.robot.channels.index("presliding")


CHANGES = (
    (r"\+ presliding_before\[2\]", "- presliding_before[2]"),
    (r"presliding_before\[0\]", "presliding_before[1]"),
    (r"q_before\[0\]", "q_before[1]"),
    (r"dq\[0\]", "dq[1]"),
    (r"0\.02\)", "0.0200000001)"),
)


@pytest.mark.slow
def test_the_self_test_notices_a_wrong_step(arm: sy.Model, tmp_path: Path) -> None:
    for k, change in enumerate(((r"$", ""), *CHANGES)):
        folder = tmp_path / str(k)
        arm.generate("python", ["presliding_step"], directory=folder)
        mutated(folder / "arm.py", *change)
        assert self_test_of(folder) == (k > 0), change


@pytest.mark.slow
@pytest.mark.parametrize("language", ["c", "cpp", "rust", "jax", "casadi"])
def test_the_self_test_passes(language: str, arm: sy.Model, tmp_path: Path) -> None:
    if language in PYTHON:
        needs(language)
    arm.generate(language, directory=tmp_path)
    if language in PYTHON:
        assert self_test_of(tmp_path) == 0
    else:
        assert run([build_self_test(language, tmp_path)], tmp_path)
