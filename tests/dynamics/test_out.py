"""Results that are written into arrays of the caller, beside results in arrays of their own."""

import copy
import gc
import inspect
import pickle
import weakref
from types import BuiltinFunctionType

import numpy as np
import pytest
from batches import drawn, one_by_one, small_model

import steelyard as sy
from steelyard.dynamics import model as model_module
from steelyard.graph import direct_call
from steelyard.graph import kernel as kernel_module

MODEL = small_model()


@pytest.fixture(autouse=True)
def _direct_at_once(monkeypatch):
    """Let machine code look at the arrays at the first call already, which makes it ready for the second."""
    monkeypatch.setattr("steelyard.dynamics.functions._CALLS", 2)


def given_arrays(function, lead, seed=0):
    """Return arguments, of which those that are the same for all samples have no leading axes."""
    shapes = tuple(() if argument.uniform else lead for argument in function.arguments)
    return drawn(function.arguments, shapes, np.random.default_rng(seed))


def method(model, name):
    """Return the method of a function, which takes its arguments and `out`."""
    forward = model.forward_dynamics
    return {
        "forward_dynamics": lambda *a, out=None: forward(*a, method="inertia_matrix", out=out),
        "forward_dynamics_articulated": lambda *a, out=None: model.forward_dynamics(
            *a, method="articulated_body", out=out
        ),
        "drive_torque": lambda q, dq, ddq, p, out=None: model.drive_torque(dq, ddq, p, q, out=out),
        "pose": lambda q, out=None: model.pose(q, 1, out=out),
        "jacobian": lambda q, point, out=None: model.jacobian(q, 1, point, out=out),
        "jacobian_rate": lambda q, dq, point, out=None: model.jacobian_rate(q, dq, 1, point, out=out),
    }.get(name, lambda *a, out=None: getattr(model, name)(*a, out=out))


def shape_of(function, lead):
    shapes = [output.shape for output in function.outputs]
    return (*lead, *(shapes[0] if len(shapes) == 1 else (len(shapes), *shapes[0])))


@pytest.mark.parametrize("name", MODEL.functions)
@pytest.mark.parametrize("lead", [(), (1,), (7,), (9,), (2, 5), (67,)])
def test_the_same_bytes_with_and_without(name, lead):
    function = MODEL.function(name)
    given = given_arrays(function, lead)
    out = np.full(shape_of(function, lead), np.nan)
    found, alone = method(MODEL, name)(*given, out=out), method(MODEL, name)(*given)
    if isinstance(found, tuple):
        assert all(np.shares_memory(part, out) for part in found)
        found, alone = np.stack(found), np.stack(alone)
        moved = np.moveaxis(out, len(lead), 0)
    else:
        assert found is out
        moved = out
    assert found.tobytes() == np.asarray(alone).tobytes() == moved.tobytes()
    wanted = one_by_one(function, given)
    expected = np.stack(wanted) if len(wanted) > 1 else wanted[0]
    np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-12 * (1.0 + np.abs(expected).max()))


@pytest.mark.parametrize("name", ["inverse_dynamics", "regressor", "coriolis_matrix"])
@pytest.mark.parametrize("count", [1, 3, 8, 1001])
def test_arrays_of_any_kind_give_the_same(name, count):
    function = MODEL.function(name)
    given = given_arrays(function, (count,))
    call, out = method(MODEL, name), np.empty(shape_of(function, (count,)))
    expected = method(MODEL, name)(*given)
    for kind in (
        lambda a: np.asfortranarray(a),
        lambda a: np.repeat(a, 2, axis=-1)[..., ::2],
        lambda a: a.astype(">f8"),
        lambda a: a.tolist(),
        lambda a: a.view(type("Special", (np.ndarray,), {})),
    ):
        assert call(*map(kind, given), out=out) is out
        assert out.tobytes() == expected.tobytes()
        assert method(MODEL, name)(*map(kind, given)).tobytes() == expected.tobytes()
    first, *rest = given
    assert call(first[:1], *rest, out=out) is out
    assert out.tobytes() == call(np.repeat(first[:1], count, axis=0), *rest).tobytes()


@pytest.mark.parametrize("name", ["inverse_dynamics", "regressor", "inverse_dynamics_derivatives"])
def test_threads_and_large_batches_give_the_same(name, monkeypatch):
    monkeypatch.setattr(kernel_module, "_WORTHWHILE", 1.0)
    monkeypatch.setattr(kernel_module, "_LARGE", 1 << 12)
    monkeypatch.setattr(kernel_module, "_RECYCLED", 1 << 12)
    function = MODEL.function(name)
    given = given_arrays(function, (1003,))
    expected = np.stack(one_by_one(function, given), axis=1).reshape(shape_of(function, (1003,)))
    for threads in (1, 2, 3):
        model = sy.Model(MODEL.robot, threads=threads)
        out = np.full(expected.shape, np.nan)
        method(model, name)(*given, out=out)
        alone = getattr(model, name)(*given)
        alone = np.stack(alone, axis=1) if isinstance(alone, tuple) else alone
        assert alone.tobytes() == out.tobytes()
        np.testing.assert_allclose(out, expected, rtol=1e-11, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("count", [1, 3, 2000])
def test_what_cannot_be_written_is_refused(count):
    q, dq, ddq = np.random.default_rng(0).normal(size=(3, count, 2))
    shape, width = (count, 2, len(MODEL.parameter_names)), len(MODEL.parameter_names)
    still = np.empty(shape)
    still.flags.writeable = False
    for out, text in (
        (np.empty((count + 1, 2, width)), rf"got float64 of shape \({count + 1}, 2, {width}\)"),
        (np.empty((count, 2 * width)), "got float64 of shape"),
        (np.empty(shape, dtype=np.float32), "got float32 of shape"),
        (np.empty(shape, dtype=">f8"), "got >f8 of shape .*, in another byte order"),
        (np.empty((count, 2, 2 * width))[..., ::2], "not C-contiguous"),
        (still, "read-only"),
        ([0.0], r"got \[0.0\]"),
    ):
        with pytest.raises(sy.InputError, match=rf"out must be .* of shape \({count}, 2, {width}\).*{text}.*make one"):
            MODEL.regressor(q, dq, ddq, out=out)
    for shared in (q, dq, ddq):
        with pytest.raises(sy.InputError, match="out shares memory with an array that is read"):
            MODEL.inverse_dynamics(q, dq, ddq, np.zeros(width), out=shared)


def test_a_regressor_whose_zeros_are_added(monkeypatch):
    monkeypatch.setattr("steelyard.dynamics.functions._LARGEST_DENSE", 0)
    compact = sy.Model(MODEL.robot)
    assert compact.kernel("regressor").compact
    q, dq, ddq = np.random.default_rng(0).normal(size=(3, 5, 2))
    expected = MODEL.regressor(q, dq, ddq)
    out = np.full_like(expected, np.nan)
    assert compact.regressor(q, dq, ddq, out=out) is out
    np.testing.assert_allclose(out, expected, rtol=1e-14)
    np.testing.assert_allclose(compact.regressor(q[0], dq[0], ddq[0]), expected[0], rtol=1e-14)


def test_gravity_as_an_argument_and_estimates_of_any_kind():
    function = MODEL.function("inverse_dynamics", gravity="argument")
    *motion, parameters, gravity = given_arrays(function, (6,))
    expected = one_by_one(function, [*motion, parameters, gravity])[0]
    for kind in (parameters, parameters.tolist()):
        for weight in (gravity, tuple(gravity)):
            out = np.empty((6, 2))
            assert MODEL.inverse_dynamics(*motion, kind, gravity=weight, out=out) is out
            np.testing.assert_allclose(out, expected, rtol=1e-12, atol=1e-12)


def test_without_the_machine_code_that_looks_at_arrays(monkeypatch):
    monkeypatch.setattr(direct_call, "_arrays_are_known", lambda: False)
    model = small_model()
    for name in ("inverse_dynamics", "inertia_matrix", "kinetic_energy"):
        for lead in ((), (3,), (2, 2)):
            given = given_arrays(MODEL.function(name), lead)
            assert (
                np.asarray(getattr(model, name)(*given)).tobytes() == np.asarray(method(MODEL, name)(*given)).tobytes()
            )


def test_what_is_called_often_is_called_directly(monkeypatch):
    """And gives the same bytes before and after, and for arrays of which the direct call knows nothing."""
    monkeypatch.setattr("steelyard.dynamics.functions._CALLS", 3)
    calls = []
    found = sy.graph.Kernel.direct
    monkeypatch.setattr(sy.graph.Kernel, "direct", lambda *a, **k: calls.append(k["several"]) or found(*a, **k))
    model = small_model()
    q, p = np.array([0.3, 0.2]), np.ones(model.parameter_count)
    for batch, several in ((q, False), (np.repeat(q[None], 3, axis=0), True)):
        expected = model.kernel("gravity")(batch.reshape(-1, 2), p).reshape(batch.shape)
        for turn in range(6):
            assert (several in calls) == (turn >= 2)
            assert model.gravity(batch, p).tobytes() == expected.tobytes()
            assert model.gravity(batch.tolist(), p).tobytes() == expected.tobytes()


def test_methods_that_are_called_often_keep_their_signature():
    """Machine code stands in their place; what it cannot do it leaves to the method."""
    model = small_model()
    plain = [name for name in sorted(model_module._PLAIN) if name in model.functions]
    assert plain == sorted(model_module._PLAIN)
    for name in plain:
        given = given_arrays(MODEL.function(name), (3,))
        before = getattr(model, name)(*given)
        assert name in vars(model)
        after = getattr(model, name)
        assert inspect.signature(after).parameters.keys() == inspect.signature(getattr(MODEL, name)).parameters.keys()
        assert after.__doc__ == inspect.getdoc(getattr(sy.Model, name))
        assert after(*given).tobytes() == after(*(a.tolist() for a in given)).tobytes() == before.tobytes()
    q, p = np.zeros(2), np.ones(model.parameter_count)
    down = np.array([0.0, 0.0, -9.81])
    assert model.gravity(q, p, gravity=2.0 * down).tobytes() == MODEL.gravity(q, p, gravity=2.0 * down).tobytes()
    with pytest.raises(TypeError, match="positional"):
        model.gravity(q, p, down)
    with pytest.raises(sy.InputError, match="2 joints"):
        model.gravity(np.zeros(3), p)


def test_a_class_with_methods_of_its_own_keeps_them():
    class Doubled(sy.Model):
        def gravity(self, q, parameters, **options):
            return 2.0 * super().gravity(q, parameters, **options)

    model = Doubled(MODEL.robot)
    q, p = np.array([0.3, 0.2]), np.ones(model.parameter_count)
    for _ in range(3):
        np.testing.assert_allclose(model.gravity(q, p), 2.0 * MODEL.gravity(q, p), rtol=1e-14)


def test_what_took_the_place_of_a_method_of_the_class_is_called_every_time(monkeypatch):
    plain, calls = sy.Model.gravity, []
    monkeypatch.setattr(sy.Model, "gravity", lambda *a: calls.append(len(a)) or plain(*a))
    model = small_model()
    for _ in range(5):
        model.gravity(np.array([0.3, 0.2]), np.ones(model.parameter_count))
    assert calls == [3] * 5


def test_a_model_whose_method_was_replaced_keeps_what_took_its_place():
    model = small_model()
    q, p, calls = np.array([0.3, 0.2]), np.ones(model.parameter_count), []
    for batch in (q, np.repeat(q[None], 3, axis=0)):  # before machine code is ready for one sample, and for several
        plain = model.gravity
        model.gravity = lambda *a, plain=plain: calls.append(len(a)) or plain(*a)
        for turn in range(1, 5):
            calls.clear()
            np.testing.assert_array_equal(model.gravity(batch, p), MODEL.gravity(batch, p), err_msg=f"{turn}")
            assert calls == [2]
        model.gravity = plain


@pytest.mark.usefixtures("other_objects_aside")
@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, lambda thing: pickle.loads(pickle.dumps(thing))])
def test_copies_compute_the_same_whatever_was_called_before(copied):
    """Compiled code stays where it was compiled, and a copy is not the model that it was made of."""
    model, q, p = small_model(), np.array([0.3, 0.2]), np.ones(26)
    expected = MODEL.gravity(q, p).tobytes()
    assert model.base_columns.uneven.size  # which has kernels
    for _ in range(3):
        twin = copied(model)
        for turn in range(3):
            assert twin.gravity(q, p).tobytes() == expected, turn
            assert model.gravity(q, p).tobytes() == expected
    assert type(vars(model)["gravity"]) is BuiltinFunctionType
    again = weakref.ref(model)
    del model
    gc.collect()
    assert (again() is None) == (copied is not copy.copy)  # a shallow copy shares its code
    assert twin.gravity(q, p).tobytes() == expected


def test_methods_that_are_called_often_can_be_sent_to_another_process():
    model, q, p = small_model(), np.array([0.3, 0.2]), np.ones(26)
    for _ in range(3):
        sent = pickle.loads(pickle.dumps(model.gravity))
        assert sent(q, p).tobytes() == model.gravity(q, p).tobytes()
    assert type(vars(model)["gravity"]) is BuiltinFunctionType


@pytest.mark.usefixtures("other_objects_aside")
def test_a_model_that_nobody_has_is_freed():
    model = small_model()
    q, p = np.zeros(2), np.ones(model.parameter_count)
    model.gravity(q, p)
    direct, there = model.gravity, weakref.ref(model)
    del model
    gc.collect()
    assert there() is not None  # the function may still be called
    assert np.isfinite(direct(q, p)).all()
    del direct
    gc.collect()
    assert there() is None


def test_a_number_stays_a_number():
    q, dq = np.zeros((2, 2))
    parameters = np.ones(MODEL.parameter_count)
    assert isinstance(MODEL.kinetic_energy(q, dq, parameters), float)
    out = np.empty(())
    assert MODEL.kinetic_energy(q, dq, parameters, out=out) is out


def test_forward_dynamics_still_refuses_a_singular_inertia_matrix():
    q, dq, tau = np.random.default_rng(0).normal(size=(3, 4, 2))
    nothing = np.zeros(MODEL.parameter_count)
    for batch in (q, dq, tau), (q[0], dq[0], tau[0]):
        with pytest.raises(sy.InputError, match="inertia matrix of small is singular"):
            MODEL.forward_dynamics(*batch, nothing)
    unknown = np.full(MODEL.parameter_count, np.nan)
    assert np.isnan(MODEL.forward_dynamics(q[0], dq[0], tau[0], unknown)).all()
