"""The estimator as C99: it compiles anywhere, agrees with other solvers, and what it hands out is possible."""

import ctypes
import re
import subprocess
import sys
from pathlib import Path
from types import FrameType

import numpy as np
import pytest
from compilers import C_FLAGS, need, run

import steelyard as sy
from steelyard.dynamics import ChannelFriction, Dahl
from steelyard.errors import InputError
from steelyard.identification.wam import true_parameters, wam_model
from steelyard.online import generate_online
from steelyard.online.source_project import _index_type, _Structure

FLAGS = [*C_FLAGS, "-O2", "-Wstack-usage=8192"]
STATUS = ("solved", "unchanged", "stopped", "refused")


def arm(**options: object) -> sy.FeasibleSet:
    robot = sy.Robot.from_dh([("pi/2", 0, 0.3, "q"), (0, 0.5, 0, "q")], name="arm")
    return sy.FeasibleSet(sy.Model(robot.with_terms(sy.Viscous(), sy.Coulomb())), **options)


class Estimator:
    """The compiled source."""

    def __init__(self, feasible_set: sy.FeasibleSet, folder: Path) -> None:
        need("gcc")
        generate_online(feasible_set, folder)
        self.name = feasible_set.model.robot.name
        self.set, (n_b, n) = feasible_set, feasible_set.K.shape
        library = folder / "online.so"
        run(["gcc", *FLAGS, "-shared", "-fPIC", f"{self.name}_online.c", "-o", library, "-lm"], folder)
        self.library = ctypes.CDLL(str(library))
        fields = [("base", ctypes.c_double * n_b), ("parameters", ctypes.c_double * n), ("objective", ctypes.c_double)]
        fields += [("gap", ctypes.c_double), ("iterations", ctypes.c_int32), ("status", ctypes.c_int)]
        self.Answer = type("Answer", (ctypes.Structure,), {"_fields_": fields})
        self.work = ctypes.create_string_buffer(4_000_000)
        self.data = ctypes.create_string_buffer(400_000)
        self.call("begin", self.data)

    def call(self, function: str, *arguments: object) -> int:
        def passed(value: object) -> object:
            return ctypes.c_void_p(value.ctypes.data) if isinstance(value, np.ndarray) else value

        return int(getattr(self.library, f"{self.name}_online_{function}")(*map(passed, arguments)))

    def correct(self, base: np.ndarray) -> tuple[str, np.ndarray, np.ndarray, float]:
        answer = self.Answer()
        base = np.array(base, dtype=float)
        status = self.call("correct", base, self.work, ctypes.byref(answer))
        return STATUS[status], np.array(answer.base), np.array(answer.parameters), answer.objective

    def fit(self, weights: np.ndarray, prior_weight: float) -> tuple[str, np.ndarray, np.ndarray, float]:
        answer = self.Answer()
        arguments = (
            self.data,
            np.array(weights, float),
            ctypes.c_double(prior_weight),
            self.work,
            ctypes.byref(answer),
        )
        status = self.call("fit", *arguments)
        return STATUS[status], np.array(answer.base), np.array(answer.parameters), answer.objective


@pytest.mark.slow
@pytest.mark.parametrize("consistency", ["full", "inertia"])
def test_corrections_of_the_seven_joint_arm_are_those_of_clarabel(consistency: str, tmp_path: Path) -> None:
    model = wam_model()
    feasible_set = sy.FeasibleSet(model, consistency=consistency)
    estimator, random = Estimator(feasible_set, tmp_path), np.random.default_rng(3)
    truth = model.base_parameters().values(true_parameters())
    ends = set()
    for size in (0.0, 1e-3, 1e-1, 1.0, 10.0, 1e4):
        for _ in range(3):
            base = truth + size * random.normal(size=len(truth))
            status, found, parameters, squared = estimator.correct(base)
            expected = sy.correct(feasible_set, base=base)
            assert feasible_set.contains(parameters)
            assert squared == pytest.approx(np.sum((found - base) ** 2), rel=1e-9, abs=1e-20)
            scale = np.linalg.norm(base)
            # Clarabel's own error of the base parameters reaches 1e-5 of their size; see docs/decisions.md.
            assert np.linalg.norm(found - expected.base) <= 5e-5 * scale
            assert squared == pytest.approx(expected.squared_distance, rel=1e-4, abs=1e-9 * scale**2)
            ends.add(status)
    assert ends == {"solved", "unchanged"}


@pytest.mark.slow
def test_a_set_with_equations_bounds_and_a_box(tmp_path: Path) -> None:
    constraints = [
        sy.TotalMass(maximum=9.0),
        sy.CenterOfMassBox("link2", lower=(-0.3, -0.1, -0.1), upper=(0.1, 0.1, 0.1)),
        sy.feasibility.LinearBound("m1", minimum=2.0),
        sy.feasibility.SymmetricLink("link2", plane="xz"),
    ]
    feasible_set = arm(constraints=constraints)
    estimator, random = Estimator(feasible_set, tmp_path), np.random.default_rng(4)
    for size in (0.1, 1.0, 10.0):
        base = size * random.normal(size=feasible_set.K.shape[0])
        status, found, parameters, squared = estimator.correct(base)
        expected = sy.correct(feasible_set, base=base)
        assert status == "solved"
        assert feasible_set.contains(parameters)
        np.testing.assert_allclose(found, expected.base, atol=1e-5 * np.linalg.norm(base))
        assert squared == pytest.approx(expected.squared_distance, rel=1e-5)


@pytest.mark.slow
def test_updates_are_those_of_numpy_and_fits_those_of_clarabel(tmp_path: Path) -> None:
    feasible_set = arm()
    model, random = feasible_set.model, np.random.default_rng(5)
    estimator = Estimator(feasible_set, tmp_path)
    motion = random.normal(size=(3, 200, 2))
    regressor = np.asarray(model.regressor(*motion)) @ np.linalg.pinv(feasible_set.K)
    truth = feasible_set.K @ np.abs(random.normal(size=feasible_set.parameter_count))
    torque = regressor @ truth + random.normal(size=(200, 2))
    forget = 0.99
    for rows, values in zip(regressor, torque, strict=True):
        ended = estimator.call("update", estimator.data, np.ascontiguousarray(rows), values.copy(),
                               ctypes.c_double(forget), estimator.work)  # fmt: skip
        assert STATUS[ended] == "solved"
    shares = np.sqrt(forget ** np.arange(199, -1, -1.0))
    base, squares = random.normal(size=len(truth)), np.zeros(2)
    estimator.call("squared_residuals", estimator.data, base, squares)
    weighted = shares[:, None] * (regressor @ base - torque)
    np.testing.assert_allclose(squares, np.sum(weighted**2, axis=0), rtol=1e-12)

    weights = np.array([2.0, 0.5])
    status, found, parameters, objective = estimator.fit(weights, 1e-9)
    assert status == "solved"
    assert feasible_set.contains(parameters)
    rows = (weights[:, None] * shares[:, None, None] * regressor).reshape(-1, len(truth))
    right = (weights * shares[:, None] * torque).ravel()
    best = np.linalg.lstsq(rows, right)[0]
    expected = sy.correct(feasible_set, base=best, metric=rows.T @ rows).base
    np.testing.assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())
    assert objective == pytest.approx(0.5 * np.sum((rows @ found - right) ** 2), rel=1e-6)


@pytest.mark.slow
def test_what_is_no_number_is_refused_with_possible_parameters(tmp_path: Path) -> None:
    feasible_set = arm()
    estimator = Estimator(feasible_set, tmp_path)
    for bad in (np.nan, np.inf, -np.inf, 1e300):
        base = np.zeros(feasible_set.K.shape[0])
        base[1] = bad
        status, _, parameters, _ = estimator.correct(base)
        assert status == "refused"
        assert feasible_set.contains(parameters)
        rows, torque = np.zeros((2, len(base))), np.array([0.0, bad])
        ended = estimator.call("update", estimator.data, rows, torque, ctypes.c_double(1.0), estimator.work)
        assert STATUS[ended] == "refused"
        assert estimator.fit(np.array([1.0, bad]), 1.0)[0] == "refused"
    assert estimator.fit(np.ones(2), 1e-320)[0] == "refused"  # by which the objective would be divided
    status, _, parameters, _ = estimator.correct(np.zeros(feasible_set.K.shape[0]))
    assert status in ("solved", "unchanged")
    assert feasible_set.contains(parameters)
    status, _, parameters, _ = estimator.fit(np.ones(2), 1.0)  # of no data
    assert feasible_set.contains(parameters)


@pytest.mark.slow
def test_the_source_has_no_allocation_and_no_undefined_behaviour(tmp_path: Path) -> None:
    need("gcc")
    generate_online(arm(), tmp_path)
    source, test = tmp_path / "arm_online.c", tmp_path / "arm_online_test.c"
    run(["gcc", *FLAGS, "-c", source, "-o", "online.o"], tmp_path)
    wanted = set(re.findall(r" U (\w+)", run(["nm", "online.o"], tmp_path)))
    assert wanted <= {"sqrt", "pow", "hypot", "fmax", "fmin", "memcpy", "memmove", "memset"}
    sanitized = ["-g", "-fsanitize=address,undefined,float-divide-by-zero", "-fno-sanitize-recover=all"]
    run(["gcc", *FLAGS[:-1], *sanitized, source, test, "-o", "sanitized", "-lm"], tmp_path)
    assert "agree" in run([tmp_path / "sanitized"], tmp_path)
    need("g++")
    run(["g++", "-x", "c++", "-Wall", "-Wextra", "-Werror", source, test, "-o", "cpp", "-lm"], tmp_path)
    assert "agree" in run([tmp_path / "cpp"], tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("compiler", "emulator"),
    [("aarch64-linux-gnu-gcc", "qemu-aarch64"), ("arm-linux-gnueabihf-gcc", "qemu-arm")],
)
def test_the_self_test_passes_on_other_processors(compiler: str, emulator: str, tmp_path: Path) -> None:
    """Those of controllers: fused operations, other registers, and addresses of 32 bits."""
    need(compiler)
    need(emulator)
    sy.OnlineEstimator(wam_model()).generate("c", tmp_path)
    for flags in (["-O0"], ["-O3", "-ffp-contract=fast"]):
        for sources in ("wam.c wam_test.c", "wam_online.c wam_online_test.c"):
            run([compiler, *C_FLAGS, *flags, "-static", *sources.split(), "-o", "test", "-lm"], tmp_path)
            assert "agree" in run([emulator, tmp_path / "test"], tmp_path)


@pytest.mark.slow
def test_the_self_test_notices_a_wrong_sign(tmp_path: Path) -> None:
    need("gcc")
    generate_online(arm(), tmp_path)
    source = tmp_path / "arm_online.c"
    text = source.read_text()
    for right, wrong in (
        ("-= 2.0 * base_value[e] * difference", "+= 2.0 * base_value[e] * difference"),
        ("(cosine * above) + (sine * row[i + k])", "(cosine * above) - (sine * row[i + k])"),
    ):
        assert text.count(right) == 1
        source.write_text(text.replace(right, wrong))
        run(["gcc", "-std=c99", "-O1", source, "arm_online_test.c", "-o", "test", "-lm"], tmp_path)
        assert subprocess.run([tmp_path / "test"], capture_output=True, check=False).returncode == 1


def test_what_cannot_be_written_is_refused_in_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="as C99 alone, not as 'rust'"):
        generate_online(arm(), tmp_path, language="rust")
    body = sy.Inertia.from_com(1.0, [0, 0, 0], np.eye(3)).parameters
    body = np.concatenate([body, [np.nan, np.nan], body, [np.nan, np.nan]])
    with pytest.raises(InputError, match="not quadratic"):
        generate_online(arm(), tmp_path, prior=sy.estimators.EntropicPrior(body))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("term", "said"),
    [
        (Dahl(0.01), "remembers the motion before.*not identified while they move.*sliding = true"),
        (ChannelFriction("warmth", range=[0, 60]), "needs the channel 'warmth'.*not identified while they move.*held"),
    ],
)
def test_terms_that_need_more_than_the_motion_are_refused(term, said, tmp_path):
    model = sy.Model(sy.Robot.from_dh([(0, 0.5, 0, "q")]).with_terms(term))
    with pytest.raises(InputError, match=said):
        generate_online(sy.FeasibleSet(model), tmp_path / "code")
    assert not (tmp_path / "code").exists()
    with pytest.raises(InputError, match=said):
        sy.OnlineEstimator(model)


@pytest.mark.slow
def test_rows_of_joints_that_are_left_out_are_neither_counted_nor_forgotten(tmp_path: Path) -> None:
    feasible_set = arm()
    n_b, random = feasible_set.K.shape[0], np.random.default_rng(6)
    estimator = Estimator(feasible_set, tmp_path)
    motion = random.normal(size=(3, 60, 2))
    regressor = np.asarray(feasible_set.model.regressor(*motion)) @ np.linalg.pinv(feasible_set.K)
    torque, counted = random.normal(size=(60, 2)), random.random((60, 2)) < 0.6
    torque[~counted] = np.nan
    forget, base, squares = 0.9, random.normal(size=n_b), np.zeros(2)
    for rows, values, which in zip(regressor, torque, counted, strict=True):
        ended = estimator.call("update_joints", estimator.data, np.where(which[:, None], rows, np.inf), values.copy(),
                               np.ascontiguousarray(which), ctypes.c_double(forget), estimator.work)  # fmt: skip
        assert STATUS[ended] == "solved"
    estimator.call("squared_residuals", estimator.data, base, squares)
    for joint in range(2):
        own = counted[:, joint]
        residuals = regressor[own, joint] @ base - torque[own, joint]
        shares = forget ** np.arange(own.sum() - 1, -1, -1.0)
        assert squares[joint] == pytest.approx(np.sum(shares * residuals**2), rel=1e-12)
    ended = estimator.call("update_joints", estimator.data, regressor[0].copy(), np.array([np.nan, 0.0]),
                           np.array([True, False]), ctypes.c_double(forget), estimator.work)  # fmt: skip
    assert STATUS[ended] == "refused"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("flags", "macro", "said"),
    [
        (["-ffast-math"], "__FAST_MATH__", "Compile without -ffast-math"),
        (["-Ofast"], "__FAST_MATH__", "Compile without -ffast-math"),
        (["-ffinite-math-only"], "__FINITE_MATH_ONLY__ 1", "Compile without -ffast-math"),
        (["-funsafe-math-optimizations"], "__ASSOCIATIVE_MATH__", "Compile without -ffast-math and its parts"),
        (["-freciprocal-math"], "__RECIPROCAL_MATH__", "Compile without -ffast-math and its parts"),
        (["-mfpmath=387"], "__FLT_EVAL_METHOD__ 2", "Compile for SSE2"),
    ],
)
def test_what_loses_digits_of_pairs_is_refused_when_the_source_is_compiled(
    flags: list[str], macro: str, said: str, tmp_path: Path
) -> None:
    """Answers are off by up to 1e-4 with `-funsafe-math-optimizations`, and by 3e-4 with registers of 80 bits."""
    need("gcc")
    empty = tmp_path / "empty.c"
    empty.write_text("")
    known = subprocess.run(["gcc", *flags, "-dM", "-E", empty], capture_output=True, text=True, check=False)
    if macro not in known.stdout:
        pytest.skip(f"this gcc does not tell of {flags[0]}")
    generate_online(arm(), tmp_path)
    command = ["gcc", "-std=c99", *flags, "-c", "arm_online.c", "-o", "fast.o"]
    made = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert made.returncode != 0
    assert said in made.stderr


@pytest.mark.slow
def test_the_lines_of_the_guide_compile_beside_another_robot(tmp_path: Path) -> None:
    need("gcc")
    text = (Path(__file__).parents[2] / "docs/how-to/online.md").read_text(encoding="utf-8")
    (lines,) = re.findall(r"```c\n(.*?)```", text, re.DOTALL)
    generate_online(arm(), tmp_path)
    other = sy.Robot.from_dh([(0, 0.5, 0, "q")], name="tail").with_terms(sy.Viscous())
    generate_online(sy.FeasibleSet(sy.Model(other)), tmp_path / "tail")
    main = '#include "tail/tail_online.h"\nint main(void)\n{\n    double x[6] = {0};\n    sample(x, x, x, x);\n'
    main += "    static tail_online_data other;\n    tail_online_begin(&other);\n    (void)answer;\n    return 0;\n}\n"
    (tmp_path / "guide.c").write_text(lines + main)
    sources = ["guide.c", "arm.c", "arm_online.c", "tail/tail.c", "tail/tail_online.c"]
    run(["gcc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-O1", *sources, "-o", "guide", "-lm"], tmp_path)
    run([tmp_path / "guide"], tmp_path)


def test_unknowns_that_all_belong_together_are_ordered_at_once() -> None:
    """As in the fit of a robot of twenty joints: in about as many steps as the factor has elements, of which there are
    45 150. Comparing all pairs to choose each next one takes millions.
    """
    steps = 0

    def count(frame: FrameType, event: str, argument: object) -> None:
        nonlocal steps
        steps += event == "call"  # of a function, or of a generator for its next value

    before = sys.getprofile()
    sys.setprofile(count)
    try:
        found = _Structure.of(300, [np.arange(300)])
    finally:
        sys.setprofile(before)
    assert 300 < steps < 300**2
    assert found.order == list(range(300))
    assert len(found.row) == 300 * 301 // 2


@pytest.mark.slow
def test_tables_of_large_robots_compile_without_a_warning(tmp_path: Path) -> None:
    """From some 26 joints on, places of a factor exceed 16 bits."""
    need("gcc")
    generate_online(arm(), tmp_path)
    source = tmp_path / "arm_online.c"
    small, large = (f"typedef {_index_type(greatest)} arm_online_index;" for greatest in (2**16 - 1, 2**16))
    assert source.read_text().count(small) == 1
    assert large != small
    source.write_text(source.read_text().replace(small, large))
    run(["gcc", *FLAGS, source, "arm_online_test.c", "-o", "large", "-lm"], tmp_path)
    assert "agree" in run([tmp_path / "large"], tmp_path)
