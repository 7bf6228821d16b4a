"""Built-in functions that compute a few samples: what they take, and what they leave alone."""

import ctypes
import gc
import inspect
import pickle
import sys
import weakref
from functools import cache

import numpy as np
import pytest
from small_kernels import NO_CACHE, PARAMETERS, expected, motions, pendulum, unusual

from steelyard.graph import Argument, Kernel, direct_call, machine
from steelyard.graph import kernel as kernel_module
from steelyard.graph.machine import batch_lanes


@pytest.fixture(scope="module")
def kernel():
    return Kernel(pendulum(), cache=NO_CACHE)


@pytest.fixture
def direct(kernel):
    found = kernel.direct((2,), several=True)
    assert found is not None, "arrays are not where they are looked for in this Python or NumPy"
    return found


@pytest.mark.parametrize("lead", [(), (1,), (2,), (3,), (7,), (8,), (9,), (11,), (15,), (3, 5), (2, 1, 4)])
def test_batches_of_any_shape(direct, lead):
    motion = np.random.default_rng(1).normal(size=(*lead, 3))
    memory = np.full(2 * max(1, int(np.prod(lead))) + 2, np.nan)
    out = memory[1:-1].reshape(*lead, 2)
    assert direct(motion, PARAMETERS, out) is out
    np.testing.assert_allclose(out.reshape(-1, 2), expected(motion.reshape(-1, 3)), rtol=1e-12)
    assert np.isnan(memory[[0, -1]]).all()


@pytest.mark.parametrize("lead", [(), (1,), (7,), (9,), (3, 5), (2, 1, 2, 2)])
def test_a_new_array_where_none_is_given(direct, lead):
    motion = np.random.default_rng(2).normal(size=(*lead, 3))
    found = direct(motion, PARAMETERS, None)
    assert type(found) is np.ndarray
    assert found.dtype is np.dtype(np.float64)
    assert found.shape == (*lead, 2)
    assert found.flags.owndata
    assert found.flags.carray
    alone = np.empty(2)
    assert sys.getrefcount(found) == sys.getrefcount(alone) + 1  # the function has it, too
    assert found.tobytes() == direct(motion, PARAMETERS, np.empty((*lead, 2))).tobytes()


def test_no_new_array_that_is_large_or_has_many_dimensions(monkeypatch):
    monkeypatch.setattr(kernel_module, "_MADE", 1 << 10)
    kernel = Kernel(pendulum(), cache=NO_CACHE)
    motion = motions(kernel.most_small + 1)
    assert kernel.most_small == 64
    direct = kernel.direct((2,), several=True)
    assert direct(motion, PARAMETERS, None) is None
    assert direct(motion[1:], PARAMETERS, None).shape == (kernel.most_small, 2)
    out = np.empty((len(motion), 2))
    assert direct(motion, PARAMETERS, out) is out
    assert direct(np.ones((1, 1, 1, 1, 1, 3)), PARAMETERS, None) is None
    assert direct(motions(3), PARAMETERS[:1], None) is None
    assert direct(motions(0), PARAMETERS, None) is None


def test_results_that_somebody_has_are_never_written_again(kernel):
    """Neither arrays nor views, buffers or what was changed in place; what nobody has any more is returned anew."""
    direct = kernel.direct((2,), several=True, otherwise=lambda *_: None)
    motion = motions(40)
    kept = [direct(row, PARAMETERS) for row in motion]
    np.testing.assert_allclose(kept, expected(motion), rtol=1e-12)
    assert len({found.ctypes.data for found in kept}) == len(kept)
    for keep in (lambda a: a[1:], memoryview, lambda a: a.reshape(2, 1), lambda a: [a]):
        thing = keep(direct(motion[0], PARAMETERS))
        before = bytes(np.asarray(thing).tobytes())
        for row in motion[1:5]:
            direct(row, PARAMETERS)
        assert np.asarray(thing).tobytes() == before
    places = [id(direct(row, PARAMETERS)) for row in motion]
    assert len(set(places[2:])) == 1
    named = set()
    for row in motion:
        result = direct(row, PARAMETERS)
        named.add(id(result))
        np.testing.assert_allclose(result, expected(row[None])[0], rtol=1e-12)
    assert len(named) <= 4  # two take turns, beside those that were kept before


def test_results_to_which_there_are_weak_references_are_never_written_again(kernel):
    direct = kernel.direct((2,), otherwise=lambda *_: None)
    motion = motions(6)
    memory = weakref.WeakValueDictionary()
    for turn in range(2):
        memory[turn] = direct(motion[turn], PARAMETERS)
    before = {turn: found.tobytes() for turn, found in memory.items()}
    for row in motion[2:]:
        direct(row, PARAMETERS)
        assert all(found.tobytes() == before[turn] for turn, found in memory.items())


@pytest.mark.usefixtures("other_objects_aside")
@pytest.mark.parametrize("several", [False, True])
@pytest.mark.parametrize("otherwise", [None, lambda *_: None])
def test_the_code_of_a_kernel_lives_as_long_as_its_function(several, otherwise):
    """Of two kernels of one function that two threads made at the same time, a model keeps one."""
    kernel = Kernel(pendulum(), cache=NO_CACHE)
    direct = kernel.direct((2,), several=several, otherwise=otherwise)
    code = [weakref.ref(one) for one in kernel._loaded.values()]
    assert len(code) == 1 + several
    del kernel
    gc.collect()
    assert all(one() is not None for one in code)
    given = (motions(1)[0], PARAMETERS, *[None] * (otherwise is None))
    np.testing.assert_allclose(direct(*given), expected(motions(1))[0], rtol=1e-12)
    del direct
    gc.collect()
    assert all(one() is None for one in code)


@pytest.mark.usefixtures("other_objects_aside")
def test_what_two_threads_make_at_the_same_time_lives_as_long_as_its_function(kernel, monkeypatch):
    """Each of them makes a definition and the code of its own, only one of which is then kept by the caches."""
    monkeypatch.setattr(direct_call, "_loaded", direct_call._loaded.__wrapped__)
    monkeypatch.setattr(direct_call, "_definition", direct_call._definition.__wrapped__)
    made = []
    link = machine._link
    monkeypatch.setattr(machine, "_link", lambda *a: made.append(link(*a)) or made[-1])
    direct = kernel.direct((2,), otherwise=lambda *_: None)
    code = weakref.ref(made.pop())
    gc.collect()
    assert code() is not None
    np.testing.assert_allclose(direct(motions(1)[0], PARAMETERS), expected(motions(1))[0], rtol=1e-12)
    del direct
    gc.collect()
    assert code() is None


@pytest.mark.filterwarnings("ignore:Setting the (shape|dtype):DeprecationWarning")
@pytest.mark.parametrize(
    "change",
    [lambda a: a.setflags(write=False), lambda a: setattr(a, "shape", (2, 1)), lambda a: setattr(a, "dtype", "i8")],
)
def test_results_that_were_changed_in_place_are_not_returned_anew(kernel, change):
    direct = kernel.direct((2,), otherwise=lambda *_: None)
    motion = motions(5)
    for row in motion:
        result = direct(row, PARAMETERS)
        assert (result.shape, result.dtype, result.flags.writeable) == ((2,), np.float64, True)
        np.testing.assert_allclose(result, expected(row[None])[0], rtol=1e-12)
        change(result)


def test_counts_of_references_are_known_whatever_the_interpreter_counts(monkeypatch):
    """Python 3.14 does not count those of names that stand on its stack."""
    count = sys.getrefcount
    monkeypatch.setattr(sys, "getrefcount", lambda thing: count(thing) - 2)
    assert direct_call._references_are_counted()


def test_without_known_counts_of_references(monkeypatch):
    """As in an interpreter without its lock: then every result is new."""
    monkeypatch.setattr(direct_call, "_references_are_counted", lambda: False)
    monkeypatch.setattr(direct_call, "_loaded", cache(direct_call._loaded.__wrapped__))
    monkeypatch.setattr(direct_call, "_definition", cache(direct_call._definition.__wrapped__))
    direct = Kernel(pendulum(), cache=NO_CACHE).direct((2,), several=True)
    motion = motions(3)
    found = direct(motion, PARAMETERS, None)
    alone = np.empty(2)
    assert sys.getrefcount(found) == sys.getrefcount(alone)
    np.testing.assert_allclose(found, expected(motion), rtol=1e-12)


def test_the_place_of_a_method(kernel):
    """What cannot be done at once is left to the method, with the same arguments, and so are its errors."""
    calls = []

    def both(motion, parameters, *, scale=1.0, out=None):
        """Say something."""
        calls.append((motion, parameters, scale, out))
        if scale == 0.0:
            raise ZeroDivisionError("scale")
        return "left"

    direct = kernel.direct((2,), several=True, otherwise=both)
    assert (direct.__name__, direct.__doc__) == ("both", "Say something.")
    assert str(inspect.signature(direct)) == "(motion, parameters, *, scale=1.0, out=None)"
    motion, out = motions(3), np.empty((3, 2))
    assert direct(motion, PARAMETERS, out=out) is out
    np.testing.assert_allclose(out, expected(motion), rtol=1e-12)
    assert direct(motion, PARAMETERS).tobytes() == direct(motion, PARAMETERS, out=None).tobytes() == out.tobytes()
    assert calls == []
    assert direct(motion.tolist(), PARAMETERS) == direct(motion, parameters=PARAMETERS) == "left"
    assert direct(motion, PARAMETERS, scale=2.0) == direct(motion, PARAMETERS, scale=2.0, out=out) == "left"
    assert direct(motion, PARAMETERS, out=out[:1]) == direct(motion[:, :2].copy(), PARAMETERS) == "left"
    assert [(scale, given is None) for _, _, scale, given in calls[2:4]] == [(2.0, True), (2.0, False)]
    assert calls[1][1] is PARAMETERS
    with pytest.raises(TypeError, match=r"both\(\) takes 2 positional arguments"):
        direct(motion, PARAMETERS, out)
    with pytest.raises(TypeError, match="missing"):
        direct()
    with pytest.raises(TypeError, match="unexpected"):
        direct(motion, PARAMETERS, other=out)
    with pytest.raises(ZeroDivisionError):
        direct(motion, PARAMETERS, scale=0.0)


@pytest.mark.parametrize("name", ["_KNOWN_VERSIONS", "_NEW_ARRAY"])
def test_an_interface_of_numpy_that_is_not_known(monkeypatch, name):
    """Another version, or none at all: then nothing is called directly."""
    if name == "_KNOWN_VERSIONS":
        monkeypatch.setattr(direct_call, name, ())
    else:
        monkeypatch.delattr("numpy._core._multiarray_umath._ARRAY_API")
        monkeypatch.setattr(direct_call, "_interface_of_numpy", direct_call._interface_of_numpy.__wrapped__)
    assert not direct_call._arrays_are_known.__wrapped__()


def test_others_may_have_types_of_their_own_for_functions_of_python(monkeypatch):
    types = [ctypes.c_void_p]
    for name in ("PyCapsule_GetPointer", "PyCFunction_NewEx"):
        monkeypatch.setattr(getattr(ctypes.pythonapi, name), "argtypes", types)
    assert len(direct_call._interface_of_numpy.__wrapped__()) > direct_call._NEW_ARRAY
    assert Kernel(pendulum(), cache=NO_CACHE).direct((2,)) is not None
    for name in ("PyCapsule_GetPointer", "PyCFunction_NewEx"):
        assert getattr(ctypes.pythonapi, name).argtypes == types


def test_machine_code_of_this_process_is_not_pickled(direct, kernel):
    for function in (direct, kernel.direct((2,), otherwise=lambda *_: None)):
        with pytest.raises(TypeError, match="cannot be pickled"):
            pickle.dumps(function)


def test_outputs_of_any_shape(kernel):
    motion = motions(5)
    out = np.empty((5, 1, 2, 1))
    assert kernel.direct((1, 2, 1), several=True)(motion, PARAMETERS, out) is out
    np.testing.assert_allclose(out.reshape(5, 2), expected(motion), rtol=1e-12)
    assert kernel.direct((1,) * 9) is None


def test_one_sample_alone(kernel):
    one = kernel.direct((2,))
    motion, out = motions(1), np.empty(2)
    assert one(motion[0], PARAMETERS, out) is out
    assert one(motion, PARAMETERS, out[None]) is not None
    assert one(motions(2), PARAMETERS, np.empty((2, 2))) is None


def refused(motion):
    """Yield what has a wrong number, kind or shape, beside arrays that fit."""
    out, count = np.full((len(motion), 2), np.nan), len(motion)
    yield from (
        (),
        (motion, PARAMETERS),
        (motion, PARAMETERS, out, out),
        (None, PARAMETERS, out),
        (motion, 3.0, out),
        (motion, PARAMETERS, [0.0] * 2),
        (motion[:-1], PARAMETERS, out),
        (motion[:, :2].copy(), PARAMETERS, out),
        (motion[None], PARAMETERS, out),
        (motion[0], PARAMETERS, out),
        (np.array(1.0), PARAMETERS, out),
        (motion, PARAMETERS[:1], out),
        (motion, PARAMETERS[None], out),
        (motion, PARAMETERS, out[:-1]),
        (motion, PARAMETERS, out.T.copy()),
        (motion, PARAMETERS, np.empty((count, 2), dtype=np.float32)),
        (motion, PARAMETERS, np.empty((count, 4))[:, ::2]),
        (motion, PARAMETERS, np.empty((count, 1, 2))),
        (np.empty((0, 3)), PARAMETERS, np.empty((0, 2))),
        (np.ones((1 << 20, 3)), PARAMETERS, np.empty((1 << 20, 2))),
    )
    still = out.copy()
    still.flags.writeable = False
    yield motion, PARAMETERS, still
    assert np.isnan(out).all()


def test_what_does_not_fit_is_left_alone(direct):
    motion = motions(5)
    for given in refused(motion):
        assert direct(*given) is None
    for kind in unusual(motion):
        out = np.full((5, 2), np.nan)
        plain = type(kind) is np.ndarray and kind.dtype.isnative and kind.flags.c_contiguous and kind.flags.aligned
        found = direct(kind, PARAMETERS, out)
        assert found is (out if plain else None)
        assert np.isnan(out).all() == (not plain)


def test_outputs_in_the_memory_of_an_argument_are_left_alone(direct):
    memory = np.arange(40.0)
    before = memory.copy()
    motion = memory[10:25].reshape(5, 3)
    for start, free in ((0, True), (1, False), (10, False), (24, False), (25, True)):
        out = memory[start : start + 10].reshape(5, 2)
        assert (direct(motion, PARAMETERS, out) is out) == free
        if free:
            np.testing.assert_allclose(out, expected(motion), rtol=1e-12)
        memory[:] = before
    parameters = memory[30:32]
    assert direct(motion, parameters, memory[21:31].reshape(5, 2)) is None
    assert direct(motion, parameters, memory[31:41].reshape(-1)) is None
    assert memory.tolist() == before.tolist()


def test_references_are_neither_lost_nor_kept(direct):
    motion, out = motions(3), np.empty((3, 2))
    before = [sys.getrefcount(x) for x in (motion, PARAMETERS, out, direct)]
    for _ in range(1000):
        direct(motion, PARAMETERS, out)
        direct(motion, PARAMETERS, None)
    assert [sys.getrefcount(x) for x in (motion, PARAMETERS, out, direct)] == before


def test_kernels_that_have_no_such_function(monkeypatch):
    many = [Argument(f"a{k}", 1) for k in range(9)]
    assert direct_call.direct_call(many, (1,), single=None, batch=None, few=1, most=1, made=1) is None
    monkeypatch.setattr(direct_call, "_arrays_are_known", lambda: False)
    without = Kernel(pendulum(), cache=NO_CACHE)
    assert without.direct((2,)) is None
    motion = motions(3)
    np.testing.assert_allclose(without.sample(motion[1], PARAMETERS), expected(motion)[1], rtol=1e-12)


def test_few_samples_and_full_registers_give_the_same_bytes(direct, kernel):
    motion = motions(2 * batch_lanes() + 3)
    whole = kernel(motion, PARAMETERS)
    for count in range(1, len(motion) + 1):
        out = np.empty((count, 2))
        direct(motion[:count], PARAMETERS, out)
        assert out.tobytes() == whole[:count].tobytes()
