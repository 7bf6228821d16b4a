"""Source projects of models: what stands in them, and that they compute what the model does."""

import subprocess
import sys

import numpy as np
import pytest

import steelyard as sy
from steelyard.dynamics.layout import ParameterLayout
from steelyard.dynamics.model_source import possible_parameters


@pytest.fixture
def arm():
    robot = sy.Robot.from_dh([("pi/2", 0, 0.3, "q"), (0, 0.5, 0, "q"), (0, 0.1, "q", 0)], name="arm */ 'x'\n#")
    return sy.Model(robot.with_terms(sy.Viscous(), sy.Coulomb(), sy.RotorInertia()))


def run(folder, code):
    command = [sys.executable, "-c", code]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


def module_of(written):
    (module,) = (path for path in written if path.suffix == ".py" and "test" not in path.name)
    return module


def test_generated_python_computes_what_the_model_does(arm, tmp_path):
    names = [name for name in arm.functions if name != "forward_dynamics_articulated"]
    module = module_of(arm.generate("python", names, directory=tmp_path, gravity="argument"))
    random = np.random.default_rng(0)
    q, dq, ddq = random.normal(size=(3, 3))
    delta, down = possible_parameters(ParameterLayout(arm.robot), 3), np.array([1.0, -2.0, 3.0])
    code = (
        f"import numpy as np, sys; sys.path.insert(0, {str(module.parent)!r}); import {module.stem} as m\n"
        f"q, dq, ddq = np.array({q.tolist()}), np.array({dq.tolist()}), np.array({ddq.tolist()})\n"
        f"print(*m.inverse_dynamics(q, dq, ddq, np.array({delta.tolist()}), np.array({down.tolist()})), sep='\\n')"
    )
    done = run(tmp_path, code)
    assert done.returncode == 0, done.stderr
    torque = [float(line) for line in done.stdout.split()]
    np.testing.assert_allclose(torque, arm.inverse_dynamics(q, dq, ddq, delta, gravity=down), rtol=1e-12)


def test_gravity_is_an_argument_of_the_functions_that_depend_on_it_and_of_no_other(arm):
    delta, random = possible_parameters(ParameterLayout(arm.robot), 3), np.random.default_rng(0)
    given = {name: random.normal(size=3) for name in ("q", "dq", "ddq", "tau", "point")} | {"parameters": delta}
    for name in arm.functions:
        function = arm.function(name, gravity="argument")
        values = [
            function.evaluate({a.name: (given | {"gravity": down})[a.name] for a in function.arguments})
            for down in np.array([[1.0, -2.0, 3.0], [4.0, 5.0, 6.0]])
        ]
        depends = any(not np.allclose(values[0][output], values[1][output]) for output in values[0])
        assert ("gravity" in [a.name for a in function.arguments]) is depends, name


def test_an_estimate_in_the_code_leaves_no_argument_and_fewer_operations(arm):
    delta = possible_parameters(ParameterLayout(arm.robot))
    free, fixed = arm.function("inverse_dynamics"), arm.function("inverse_dynamics", parameters=delta)
    assert [a.name for a in fixed.arguments] == ["q", "dq", "ddq"]
    assert fixed.operation_count["mul"] < free.operation_count["mul"]
    q, dq, ddq = np.random.default_rng(0).normal(size=(3, 3))
    given = {"q": q, "dq": dq, "ddq": ddq}
    np.testing.assert_allclose(
        fixed.evaluate(given)["torque"], arm.inverse_dynamics(q, dq, ddq, delta), rtol=1e-12, atol=1e-12
    )
    base = arm.base_parameters().values(delta)
    in_base = arm.function("inverse_dynamics", base=True, parameters=base)
    np.testing.assert_allclose(
        in_base.evaluate(given)["torque"], arm.inverse_dynamics(q, dq, ddq, delta), rtol=1e-10, atol=1e-10
    )
    with pytest.raises(sy.InputError, match="expected so many finite numbers, got shape"):
        arm.function("gravity", parameters=[1.0])


@pytest.mark.slow
def test_every_function_stands_in_every_language(arm, tmp_path):
    from steelyard.codegen import languages

    names = [*arm.functions, "pose(link1)"]
    for language in languages():
        first = arm.generate(language, names, directory=tmp_path / language)
        content = [path.read_bytes() for path in first]
        again = arm.generate(language, names, directory=tmp_path / language)
        assert again == first
        assert [path.read_bytes() for path in again] == content
        assert any(b"Fvj1" in text for text in content), "parameters are documented"


@pytest.mark.slow
def test_links_whose_names_are_alike_are_told_apart(tmp_path):
    joint = '<joint name="j{k}" type="revolute"><parent link="{parent}"/><child link="{child}"/></joint>'
    links = ["base", "a b", "a_b", "\u6a5f", "a-b"]
    text = "".join(f'<link name="{name}"/>' for name in links)
    text += "".join(joint.format(k=k, parent=links[k], child=links[k + 1]) for k in range(4))
    (tmp_path / "alike.urdf").write_text(f'<robot name="alike">{text}</robot>', encoding="utf-8")
    model = sy.Model(sy.Robot.from_urdf(tmp_path / "alike.urdf"))
    names = ["pose", *(f"pose({name})" for name in links[1:])]
    module = module_of(model.generate("python", names, directory=tmp_path / "code"))
    done = run(tmp_path, f"import sys; sys.path.insert(0, {str(module.parent)!r}); import alike; print(*dir(alike))")
    assert done.returncode == 0, done.stderr
    assert {n for n in done.stdout.split() if n.startswith("pose")} == {
        "pose",
        "pose_a_b",
        "pose_a_b_2",
        "pose_a_b_3",
        "pose_link3",
    }


def test_bad_requests_are_refused_before_anything_is_written(arm, tmp_path):
    target = tmp_path / "out"
    for call, phrase in (
        (lambda: arm.generate("cobol", directory=target), "'cobol' is no language"),
        (lambda: arm.generate("c", ["inverse_dynamic"], directory=target), 'did you mean "inverse_dynamics"'),
        (lambda: arm.generate("c", "gravity", directory=target), "must be a sequence of names"),
        (lambda: arm.generate("c", ["gravity", "gravity"], directory=target), "names 'gravity' twice"),
        (lambda: arm.generate("c", ["pose(hand)"], directory=target), 'has no link "hand"'),
    ):
        with pytest.raises(sy.InputError, match=phrase):
            call()
    assert not target.exists()


def test_joints_that_have_no_number_are_told_where_they_stand(tmp_path):
    def link(name):
        inertia = '<inertia ixx=".1" ixy="0" ixz="0" iyy=".1" iyz="0" izz=".1"/>'
        return f'<link name="{name}"><inertial><mass value="1"/>{inertia}</inertial></link>'

    def joint(name, parent, child, more=""):
        return f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>{more}</joint>'

    (tmp_path / "arm.urdf").write_text(
        '<robot name="arm">' + "".join(link(name) for name in "abcd") + joint("one", "a", "b")
        + joint("held */", "b", "c") + joint("two", "c", "d", '<mimic joint="one" multiplier="-2" offset="0.1"/>')
        + "</robot>"
    )  # fmt: skip
    robot = sy.Robot.from_urdf(tmp_path / "arm.urdf", locked={"held */": 0.3})
    written = sy.Model(robot).generate("python", ["gravity"], directory=tmp_path / "code")
    text = " ".join(module_of(written).read_text("utf-8").split())
    assert "the functions hold there alone: 'held" in text
    assert "at 0.3 (rad or m)." in text
    assert "to which their torques are added: 'two' at -2 times 'one' plus 0.1 (rad or m)." in text
