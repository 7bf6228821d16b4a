"""Designs: better than chance, within every limit, the same again, and clear about what cannot be."""

from dataclasses import fields

import numpy as np
import pytest

import steelyard as sy
from steelyard.dynamics import LuGre, PolynomialFriction, Spring, Stribeck, ViscousByDirection
from steelyard.excitation import ExcitationObjective, FourierTrajectory, MotionLimits, SearchOptions
from steelyard.excitation.friction_laws import with_friction_laws


def designed(model, limits=None, **options):
    """Design with options by name, whichever object they belong to; quickly where nothing else is asked for."""
    given = {"period": 5.0, "harmonics": 3, "starts": 2, "workers": 1} | options
    objective, search = (
        kind(**{field.name: given.pop(field.name) for field in fields(kind) if field.name in given})
        for kind in (ExcitationObjective, SearchOptions)
    )
    return sy.design_excitation(model, limits, objective=objective, search=search, **given)


def condition_number(model, motion):
    base = model.base_parameters()
    return np.linalg.cond(model.regressor(*motion)[:, :, base.independent].reshape(-1, base.count))


def motions_of(design, rate):
    return design.trajectory.sample(rate)[1:]


@pytest.fixture(scope="module")
def plain(arm, arm_limits):
    """The design that several tests look at."""
    return designed(arm, arm_limits)


@pytest.mark.slow
@pytest.mark.parametrize(
    "family",
    ["fourier", pytest.param("spline", marks=pytest.mark.slow), pytest.param("quintic", marks=pytest.mark.slow)],
)
def test_every_limit_is_kept_between_the_samples_too(arm, arm_limits, arm_parameters, family):
    limits = arm_limits | {"torque": [30.0, 60.0, 14.0], "power": 60.0, "total_power": 70.0}
    design = designed(arm, limits, family=family, parameters=arm_parameters, starts=1)
    q, dq, ddq = motions_of(design, 3700.0)
    assert np.all(q >= arm_limits["lower"])
    assert np.all(q <= arm_limits["upper"])
    assert np.abs(dq).max() <= 2.5
    assert np.all(np.abs(ddq) <= arm_limits["acceleration"])
    q, dq, ddq = motions_of(design, 1000.0)
    torque = arm.inverse_dynamics(q, dq, ddq, arm_parameters)
    assert np.all(np.abs(torque) <= limits["torque"])
    assert np.abs(torque * dq).max() <= 60.0
    assert np.abs((torque * dq).sum(axis=1)).max() <= 70.0
    # The margins are what is left.
    told = {(m.name, m.label.split()[0]): m.clearance for m in design.margins if m.name == "torque"}
    for joint, limit, column in zip(arm.robot.joint_names, limits["torque"], np.abs(torque).T, strict=True):
        assert told["torque", joint] == pytest.approx(limit - column.max(), abs=1e-9)
    assert [m.fraction for m in design.margins] == sorted(m.fraction for m in design.margins)
    assert design.margins[0].clearance >= 0.0
    # Much of the limits is used.
    assert design.margins[0].fraction < 0.01
    assert design.condition_number == pytest.approx(condition_number(arm, design.sample(1000.0)[1:]), rel=1e-6)


@pytest.mark.slow
def test_a_design_is_far_better_than_chance(arm, arm_limits, plain):
    assert plain.condition_number < 0.7 * best_of_chance(arm, arm_limits)


def best_of_chance(model, limits):
    """Return the best condition number of 60 random Fourier series that are scaled into the limits of motion."""
    random = np.random.default_rng(3)
    middle = 0.5 * (np.array(limits["lower"]) + limits["upper"])
    best = np.inf
    for _ in range(60):
        series = FourierTrajectory(random.normal(size=(3, 3)), random.normal(size=(3, 3)), np.zeros(3), 0.2)
        _, q, dq, ddq = series.sample(100.0)
        size = np.max(
            [
                np.abs(q).max(axis=0) / (np.array(limits["upper"]) - middle),
                np.abs(dq).max(axis=0) / limits["velocity"],
                np.abs(ddq).max(axis=0) / limits["acceleration"],
            ],
            axis=0,
        )
        best = min(best, condition_number(model, (middle + q / size, dq / size, ddq / size)))
    return best


@pytest.mark.slow
def test_information_of_the_samples_has_the_same_condition_number(arm, arm_limits):
    design = designed(arm, arm_limits, rate=500.0, starts=1)
    _, q, dq, ddq = design.sample(500.0)
    information = sy.Information.from_samples(arm, sy.Samples(q=q, dq=dq, ddq=ddq, torque=np.ones_like(q)))
    assert information.condition_number == pytest.approx(design.condition_number, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("family", ["fourier", pytest.param("spline", marks=pytest.mark.slow)])
def test_motions_that_show_next_to_nothing_are_as_good_as_they_can_be_and_said_to_be_bad(arm, arm_limits, family):
    """At a thousandth of the speed the condition number is some 1e7; the search used to stop at 4e8, where it began."""
    slow = arm_limits | {"velocity": 0.01, "acceleration": 0.05}
    design = designed(arm, slow, family=family)
    own = condition_number(arm, design.sample(1000.0)[1:])
    assert own == pytest.approx(design.condition_number, rel=1e-3)
    assert own < 3e7
    assert not design.identifies
    assert len(design.unidentifiable) > 3
    assert "cannot identify what was asked" in design.remarks[0]
    assert "limits of velocity, which the motion uses up" in design.remarks[0]
    quick = designed(arm, arm_limits, family=family)
    assert quick.identifies
    assert quick.unidentifiable == ()
    # Where all else is known, the friction of one joint is shown even so.
    easy = designed(arm, slow, family=family, subset=["Fcj1"], nuisance="known")
    assert easy.identifies


@pytest.mark.slow
def test_the_same_arguments_give_the_same_motion_with_any_number_of_workers(arm, arm_limits, tmp_path):
    for name, workers in (("one", 1), ("two", 2)):
        design = designed(arm, arm_limits, workers=workers, starts=3)
        design.save_all(tmp_path / name)
    for file in sorted((tmp_path / "one").iterdir()):
        assert file.read_bytes() == (tmp_path / "two" / file.name).read_bytes(), file.name
    other = designed(arm, arm_limits, seed=1)
    assert other.condition_number != design.condition_number


@pytest.mark.slow
def test_a_criterion_is_best_where_it_was_asked_for(arm, arm_limits):
    designs = {kind: designed(arm, arm_limits, criterion=kind) for kind in ("condition", "d", "a")}
    covariances = {}
    for kind, design in designs.items():
        base = arm.base_parameters()
        matrix = arm.regressor(*design.sample(1000.0)[1:])[:, :, base.independent].reshape(-1, base.count)
        covariances[kind] = np.linalg.inv(matrix.T @ matrix)
    assert min(designs, key=lambda k: designs[k].condition_number) == "condition"
    assert min(designs, key=lambda k: np.linalg.slogdet(covariances[k])[1]) == "d"
    assert min(designs, key=lambda k: np.trace(covariances[k])) == "a"
    assert designs["a"].figure == pytest.approx(np.trace(covariances["a"]), rel=1e-6)


@pytest.mark.slow
def test_a_subset_is_shown_better_where_it_was_asked_for(arm, arm_limits):
    def variance(design):
        base = arm.base_parameters()
        matrix = arm.regressor(*design.sample(1000.0)[1:])[:, :, base.independent].reshape(-1, base.count)
        rows = np.abs(base.K[:, arm.link_columns[2]]).max(axis=1) > 0
        return np.trace(np.linalg.inv(matrix.T @ matrix)[np.ix_(rows, rows)])

    whole = designed(arm, arm_limits, criterion="a")
    payload = designed(arm, arm_limits, criterion="a", subset="payload")
    assert variance(payload) < variance(whole)
    assert payload.figure == pytest.approx(variance(payload), rel=1e-6)


@pytest.mark.slow
def test_noise_weights_the_rows(arm, arm_limits):
    noise = np.array([0.1, 1.0, 4.0])
    design = designed(arm, arm_limits, noise=noise)
    base = arm.base_parameters()
    matrix = arm.regressor(*design.sample(1000.0)[1:])[:, :, base.independent] / noise[:, None]
    assert design.figure == pytest.approx(np.linalg.cond(matrix.reshape(-1, base.count)), rel=1e-6)
    plain = designed(arm, arm_limits)
    assert design.condition_number > plain.condition_number


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["trajectory", "design", "information"])
def test_a_second_motion_counts_the_first_as_prior_information(arm, arm_limits, kind):
    narrow = arm_limits | {"velocity": [2.5, 0.3, 0.3]}  # joints 2 and 3 hardly move
    first = designed(arm, narrow)
    _, q, dq, ddq = first.sample(1000.0)
    information = sy.Information.from_samples(arm, sy.Samples(q=q, dq=dq, ddq=ddq, torque=np.zeros_like(q)))
    known = {"trajectory": first.excitation, "design": first, "information": information}[kind]
    second = designed(arm, arm_limits, prior_information=known)
    both = [np.vstack(pair) for pair in zip((q, dq, ddq), second.sample(1000.0)[1:], strict=True)]
    assert second.combined_condition_number == pytest.approx(condition_number(arm, both), rel=1e-6)
    assert second.figure == pytest.approx(second.combined_condition_number, rel=1e-6)
    assert second.combined_condition_number < first.condition_number


def test_ctrl_c_keeps_the_best_so_far(arm, arm_limits):
    said = []

    def impatient(text):
        said.append(text)
        if len(said) == 2:
            raise KeyboardInterrupt

    design = designed(arm, arm_limits, progress=impatient, starts=50)
    assert design.status == "interrupted"
    assert 2 <= design.finished_starts < 50
    assert any("interrupted after" in remark for remark in design.remarks)
    assert design.margins[0].clearance >= 0.0


def test_a_time_limit_ends_with_the_best_so_far(arm, arm_limits):
    design = designed(arm, arm_limits, time_limit=0.3, starts=500)
    assert design.status == "time limit"
    assert design.finished_starts < 500
    assert design.margins[0].clearance >= 0.0


@pytest.mark.parametrize("workers", [1, 2])
def test_a_minimiser_of_ones_own_is_called_for_each_start(arm, arm_limits, plain, workers):
    def standing_still(problem, start, stop):
        """Return a small motion, whatever there was to be gained: what is told must be its own condition number."""
        assert start.shape == (problem.unknowns,)
        assert not stop()
        return 0.1 * start

    design = designed(arm, arm_limits, minimiser=standing_still, workers=workers)
    assert design.method == "standing_still"
    assert plain.method == "gradient"
    assert design.finished_starts == 2
    assert design.condition_number == pytest.approx(condition_number(arm, design.sample(1000.0)[1:]), rel=1e-6)
    assert design.condition_number > 2.0 * plain.condition_number


@pytest.mark.slow
def test_a_constraint_of_ones_own_is_kept(arm, arm_limits, plain):
    class Coupled:
        """Joints 2 and 3 must bend together by at least 0.5 rad."""

        name = "cable"
        labels = ("both",)
        scale = 0.5

        def clearance(self, q, dq, ddq):
            return -0.5 - (q[:, 1:2] + q[:, 2:3])

        def vjp(self, q, dq, ddq, weights):
            slope = np.zeros_like(q)
            slope[:, 1:] = -weights
            return slope, np.zeros_like(q), np.zeros_like(q)

    assert (motions_of(plain, 1000.0)[0][:, 1:].sum(axis=1)).max() > -0.4
    kept = designed(arm, arm_limits, constraints=[Coupled()], starts=1)
    assert (motions_of(kept, 1000.0)[0][:, 1:].sum(axis=1)).max() <= -0.5
    assert any(m.name == "cable" for m in kept.margins)


@pytest.mark.slow
def test_margin_periods_and_lead(arm, arm_limits):
    design = designed(arm, arm_limits, margin=0.2, periods=3, ramp_time=1.5)
    assert design.trajectory.duration == pytest.approx(3 * 5.0 + 2 * 1.5)
    assert np.abs(motions_of(design, 1000.0)[1]).max() <= 0.8 * 2.5
    assert design.excitation.duration == pytest.approx(5.0)
    plain = designed(arm, arm_limits, ramp_time=0.0)
    assert isinstance(plain.trajectory, FourierTrajectory)


def friction_uncertainty(model, motion):
    """Mean logarithm of the standard errors of a square and a cube, another viscous friction backward, Stribeck's."""
    q, dq, ddq = motion
    base = model.base_parameters()
    rigid = model.regressor(q, dq, ddq)[:, :, base.independent]
    found = []
    for k in range(model.dof):
        v = dq[:, k]
        laws = np.column_stack([v * np.abs(v), v**3, np.abs(v), np.sign(v) * np.exp(-((v / 0.2) ** 2))])
        covariance = np.linalg.pinv(np.column_stack([laws, rigid[:, k]]))[:4]
        found.append(np.log(np.linalg.norm(covariance, axis=1)))
    return float(np.mean(found))


@pytest.mark.slow
def test_the_criterion_of_friction_shows_laws_that_the_model_does_not_have(arm, arm_limits):
    design = designed(arm, arm_limits, criterion="friction", harmonics=None, periods=2, starts=1, rate=250.0)
    assert (design.slow_time, design.excitation.harmonics) == (5.0, 10)
    assert {"Fv3j1", "Fsj2", "Ksj3"} <= {name.split()[-1] for name in design.subset}
    assert design.base_count == arm.base_parameters().count
    q, dq, ddq = motions_of(design, 3700.0)
    assert np.all((q >= arm_limits["lower"]) & (q <= arm_limits["upper"]))
    assert np.abs(dq).max() <= 2.5
    assert np.all(np.abs(ddq) <= arm_limits["acceleration"])
    same = {"harmonics": 10, "periods": 2, "starts": 1, "slow_time": 5.0, "rate": 250.0}
    plain = designed(arm, arm_limits, **same)
    better, other = (friction_uncertainty(arm, motions_of(one, 100.0)) for one in (design, plain))
    assert better < other - 0.1
    assert motions_of(plain, 10.0)[0].shape == motions_of(design, 10.0)[0].shape


@pytest.mark.parametrize(
    ("terms", "counted"),
    [
        ((sy.Viscous(), Stribeck([0.1, 0.1, 0.1])), {"Fcj2", "Fsj2", "Fvpj2", "Fv3j2", "Ksj2"}),
        ((ViscousByDirection(), PolynomialFriction([3]), Spring()), {"Fcj2", "Fsj2", "Fvpj2", "Fv3j2", "Ksj2"}),
    ],
    ids=["stribeck", "others"],
)
def test_laws_that_the_model_has_count_as_those_that_it_lacks(arm, arm_limits, terms, counted):
    model = sy.Model(arm.robot.with_terms(*terms))
    names = with_friction_laws(model, MotionLimits.of(arm.robot.joint_names, **arm_limits))[1]
    assert counted <= set(names)


@pytest.mark.slow
def test_what_the_state_of_friction_shows_is_said_not_to_be_judged(arm, arm_limits, plain):
    """The numbers are those of `inspect`, and a remark tells why the motion is judged by fewer."""
    model = sy.Model(arm.robot.with_terms(LuGre(displacement=0.01, ratio=0.5, velocity=0.1)))
    design = designed(model, arm_limits, starts=1)
    count = model.base_parameters().count
    assert (design.parameter_count, design.base_count) == (model.parameter_count, count)
    [remark] = [one for one in design.remarks if "judged" in one]
    assert f"by {count - model.dof} of {count} base parameters, without Fbj1, Fbj2, Fbj3:" in remark
    assert not any("judged" in one for one in plain.remarks)


@pytest.mark.slow
def test_fast_repetitions_keep_limits_between_the_samples_of_the_first_period():
    """A cycle of 20 Hz has fifty samples; those of later periods lie between those of the first one."""
    model = sy.Model(sy.Robot.from_dh([(np.pi / 2, 0, 0, "q")], gravity=(0, 9.81, 0)).with_terms(sy.Coulomb()))
    limits = {"lower": -1.5, "upper": 1.5, "velocity": 6.0, "torque": 8.0}
    parameters = np.zeros(model.parameter_count)
    parameters[[*map(str, model.parameter_names)].index("Lyy1")] = 0.1
    parameters[[*map(str, model.parameter_names)].index("Fcj1")] = 0.2
    design = designed(
        model, limits, period=0.5, harmonics=10, criterion="friction", starts=1, parameters=parameters, ramp_time=0.05
    )
    q, dq, ddq = motions_of(design, 1000.0)
    assert np.abs(dq).max() <= 6.0
    assert np.abs(model.inverse_dynamics(q, dq, ddq, parameters)).max() <= 8.0


def test_designs_show_themselves(plain):
    assert repr(plain).startswith("ExcitationDesign(arm: fourier, ")
    assert "nearest limit: " in repr(plain)
    assert "<table>" in plain._repr_html_()


def test_limits_that_cannot_be_kept_are_named(arm, arm_limits, arm_parameters):
    with pytest.raises(sy.SolverError, match=r"cannot even rest .* torque, joint2 within 0\.5") as caught:
        designed(arm, arm_limits | {"torque": {"joint2": 0.5}}, parameters=arm_parameters)
    assert "\n" not in str(caught.value)
    frictional = arm_parameters.copy()
    frictional[-2] = 14.5  # Coulomb's at the third joint, as of descriptions that have the same at each
    with pytest.raises(sy.SolverError, match=r"cannot even move slowly .* torque, joint3 within 14, .* lower friction"):
        designed(arm, arm_limits | {"torque": {"joint3": 14.0}}, parameters=frictional)

    class Stillness:
        """Where the robot moves at all, it is too fast."""

        name = "stillness"
        labels = ("a",)
        scale = 1.0

        def clearance(self, q, dq, ddq):
            return -1.0 * np.any(np.abs(dq) > self.speed, axis=1, keepdims=True)

        def vjp(self, q, dq, ddq, weights):
            return np.zeros_like(q), np.zeros_like(q), np.zeros_like(q)

    Stillness.speed = 0.0
    with pytest.raises(
        sy.SolverError, match=r"cannot even move slowly .* stillness, a, is passed as soon as it moves;"
    ):
        designed(arm, arm_limits, constraints=[Stillness()], starts=1)
    Stillness.speed = 1e-6
    with pytest.raises(sy.SolverError, match=r"No motion was found .* stillness, a, is passed by 1"):
        designed(arm, arm_limits, constraints=[Stillness()], starts=1)


@pytest.mark.slow
@pytest.mark.parametrize("time_limit", [None, 1e-3])
def test_a_smaller_motion_is_made_where_none_of_full_size_keeps_a_limit(arm, arm_limits, time_limit):
    """A limit without slopes tells a search nothing of where it holds; rest does."""

    class Fence:
        """The first joint must stay within 0.6 rad of zero."""

        name = "fence"
        labels = ("joint1",)
        scale = 1.0

        def clearance(self, q, dq, ddq):
            return np.where(np.abs(q[:, :1]) <= 0.6, 1.0, -1.0)

        def vjp(self, q, dq, ddq, weights):
            return np.zeros_like(q), np.zeros_like(q), np.zeros_like(q)

    design = designed(arm, arm_limits, constraints=[Fence()], starts=1, time_limit=time_limit)
    assert design.margins[0].clearance >= 0.0
    travel = np.ptp(motions_of(design, 1000.0)[0], axis=0)
    # The first one of a search is as large as it may be.
    told = [one for one in design.remarks if "made smaller, since those of full size passed fence, joint1;" in one]
    assert len(told) == (time_limit is None)
    assert 0.1 < travel[0] <= 1.2
    assert np.all(travel > 0.1)


@pytest.mark.slow
def test_joints_without_limits_of_position(arm):
    limits = MotionLimits.of(arm.robot.joint_names, lower={"joint2": 0.5}, velocity=2.0, acceleration=6.0)
    design = designed(arm, limits)
    q, dq, ddq = motions_of(design, 1000.0)
    assert q[:, 1].min() >= 0.5
    assert np.abs(dq).max() <= 2.0
    assert np.abs(ddq).max() <= 6.0
    assert design.condition_number < 40.0


@pytest.mark.slow
@pytest.mark.parametrize("options", [{"ramp_time": 0.001}, {"period": 0.1}])
def test_accelerations_of_short_ramps_and_fast_motions_are_seen(arm, arm_limits, options):
    """Accelerations are second differences of the positions at 20 kHz, which 1 kHz passes over."""
    design = designed(arm, arm_limits, starts=1, **options)
    t = np.arange(int(design.trajectory.duration * 20e3)) / 20e3
    ddq = np.diff(design.trajectory.motion(t)[0], n=2, axis=0) * 20e3**2
    assert np.all(np.abs(ddq) <= np.array(arm_limits["acceleration"]) * (1.0 + 1e-4))


def test_what_is_not_limited_is_told_with_what_the_motion_reaches(arm, arm_limits, plain):
    assert not any(remark.startswith("No limit") for remark in plain.remarks)
    limits = {key: arm_limits[key] for key in ("lower", "upper")} | {"velocity": {"joint1": 1.0}}
    design = designed(arm, limits, starts=1)
    (remark,) = (one for one in design.remarks if one.startswith("No limit"))
    q = motions_of(design, 20e3)[0]
    speed = np.abs(np.diff(q[:, 1:], axis=0)).max() * 20e3
    acceleration = np.abs(np.diff(q, n=2, axis=0)).max() * 20e3**2
    assert f"the velocity of joint2, joint3, which reaches {speed:.3g} rad/s" in remark
    assert f"the acceleration of all joints, which reaches {acceleration:.3g} rad/s²" in remark


def test_limits_belong_to_the_joints_that_they_name(arm, arm_limits):
    names = arm.robot.joint_names
    backwards = MotionLimits.of(
        names[::-1],
        lower=arm_limits["lower"][::-1],
        upper=arm_limits["upper"][::-1],
        velocity=arm_limits["velocity"],
        acceleration=arm_limits["acceleration"][::-1],
    )
    q, _, ddq = motions_of(designed(arm, backwards, starts=1), 3700.0)
    assert np.all((q >= arm_limits["lower"]) & (q <= arm_limits["upper"]))
    assert np.all(np.abs(ddq) <= arm_limits["acceleration"])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"limits": None}, "Nothing limits the position, the velocity or the acceleration of joint1, joint2, joint3"),
        ({"limits": {"velocity": 1, "torque": 5}}, "no inertia for link1: give parameters"),
        ({"limits": MotionLimits.of(["a"], velocity=1)}, "of the joints a, but arm has joint1, joint2, joint3"),
        ({"rate": 0.1}, "2 to 1e.06 samples of the 5 s .* got 0.1 Hz"),
        ({"rate": 1e9}, "2 to 1e.06 samples of the 5 s"),
        ({"periods": 10**6}, "A motion of .* too long for its limits to be checked"),
        ({"harmonics": 10**5}, "200001 coefficients of each joint is too long"),
        ({"parameters": np.ones(4)}, "parameters must be 39 finite numbers"),
        ({"starts": 0}, "starts must be a whole number of at least 1"),
        ({"starts": "many"}, "starts must be a whole number of at least 1, got 'many'"),
        ({"seed": -1}, "seed must be"),
        ({"time_limit": 0.0}, "time_limit must be positive"),
        ({"rate": float("nan")}, "rate must be positive"),
        ({"margin": 1.0}, "margin must be a fraction"),
        ({"noise": [1.0, 2.0]}, "noise must be 3 positive numbers"),
        ({"criterion": "e"}, "criterion must be one of"),
        ({"criterion": "friction", "subset": "payload"}, "friction of all joints; leave out subset"),
        ({"slow_time": -1.0}, "slow_time must be a time in s"),
        ({"family": "spline", "slow_time": 2.0}, "slow_time belong to the family fourier"),
        (
            {"prior_information": FourierTrajectory([[1.0]], [[1.0]], [0.0], 1.0)},
            "a motion of 1 joints, but arm has 3",
        ),
    ],
)
def test_bad_arguments_are_refused_in_one_sentence(arm, arm_limits, options, message):
    if "parameters" in options:
        options = options | {"limits": arm_limits | {"torque": 50.0}}
    with pytest.raises(sy.InputError, match=message) as caught:
        designed(arm, **({"limits": arm_limits} | options))
    assert "\n" not in str(caught.value)


@pytest.mark.slow
def test_a_limits_file_may_hold_a_workspace(arm, tmp_path):
    """The tables about space count in Python as they do on the command line; the pose says that they are kept."""
    path = tmp_path / "limits.toml"
    path.write_text(
        "lower = -1.5\nupper = 1.5\nvelocity = 2.0\nacceleration = 6.0\n"
        f'[workspace]\nlink = "{arm.robot.link_names[-1]}"\nlower = [-inf, -inf, 0.2]\nupper = [inf, inf, inf]\n'
    )
    design = designed(arm, path, starts=1)
    q = motions_of(design, 1000.0)[0]
    assert arm.pose(q, arm.robot.link_names[-1])[:, 2, 3].min() >= 0.2 - 1e-9
    assert any("workspace" in margin.name for margin in design.margins)


@pytest.mark.slow
def test_what_a_constraint_has_to_say_is_passed_on(arm, arm_limits):
    class Talkative:
        name, labels, scale, remarks = "talk", ("nothing",), 1.0, ("Something was left out.",)

        def clearance(self, q, dq, ddq):
            return np.ones((len(q), 1))

        def vjp(self, q, dq, ddq, weights):
            return np.zeros_like(q), np.zeros_like(q), np.zeros_like(q)

    design = designed(arm, arm_limits, constraints=[Talkative()], ramp_time=0.0, starts=1)
    assert "Something was left out." in design.remarks
    assert any("starts and ends in motion" in remark for remark in design.remarks)
    with pytest.raises(sy.InputError, match="several periods need a ramp-up and a ramp-down"):
        designed(arm, arm_limits, ramp_time=0.0, periods=2)


@pytest.mark.slow
def test_processes_are_not_branched_off_beside_jax(arm, arm_limits, plain):
    """JAX warns of it, and with reason; the answer is the same with threads."""
    pytest.importorskip("jax", reason="JAX is not installed")
    options = {"workers": 2}
    design = designed(arm, arm_limits, **options)
    assert design.condition_number == plain.condition_number
