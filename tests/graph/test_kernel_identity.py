"""Kernels with an identity: what a warm cache knows, and what it must not be believed."""

import json
from pathlib import Path

import numpy as np
import pytest

from steelyard.errors import InputError
from steelyard.graph import Argument, Function, Graph, Kernel, ObjectCache, Output, kernel, sin
from steelyard.graph.cache import pack, unpack
from steelyard.graph.kernel import Signature, source_digest
from steelyard.simulation import compiled

X = np.random.default_rng(4).normal(size=(20, 2))
SCALE = np.array([3.0])


@pytest.fixture
def cache(tmp_path):
    folder = tmp_path / "cache"
    folder.mkdir(mode=0o700)
    return ObjectCache(folder)


def example():
    """Return a matrix with two zeros, and a number."""
    g = Graph()
    x, scale = g.inputs("x", 2), g.input("scale[0]")
    matrix = (sin(x[0]), g.zero, g.zero, x[1] * scale)
    arguments = (Argument("x", 2, elements=("a", "b")), Argument("scale", 1, uniform=True))
    return Function("f", arguments, (Output("M", (2, 2), matrix), Output("y", (), (x[0] - x[1],))))


def expected():
    nothing = np.zeros(len(X))
    return np.stack([np.sin(X[:, 0]), nothing, nothing, 3.0 * X[:, 1], X[:, 0] - X[:, 1]], axis=1)


def never():
    raise AssertionError("the function was built")


def test_the_function_is_built_when_it_is_needed_and_once(cache):
    calls = []

    def build():
        calls.append(1)
        return example()

    made = Kernel(build, cache=cache)
    assert calls == []
    np.testing.assert_allclose(made(X, SCALE), expected(), rtol=1e-14)
    made(X[:1], SCALE)
    assert made.function.outputs[0].name == "M"
    assert calls == [1]


@pytest.mark.parametrize("compact", [False, True])
def test_a_warm_cache_needs_no_function(cache, compact):
    cold = Kernel(example, identity="example", compact=compact, cache=cache)
    batch, single = cold(X, SCALE), cold(X[:1], SCALE)
    warm = Kernel(never, identity="example", compact=compact, cache=cache)
    assert warm(X, SCALE).tolist() == batch.tolist()
    assert warm(X[:1], SCALE).tolist() == single.tolist()
    assert repr(warm) == repr(cold)
    assert warm.places.tolist() == cold.places.tolist()
    assert warm.signature.outputs == (("M", (2, 2)), ("y", ()))
    with pytest.raises(InputError, match=r"scale must have shape \(1,\)"):
        warm(X, np.ones(2))


def test_compact_kernels_leave_zeros_out(cache):
    compact = Kernel(example, compact=True, cache=cache)
    assert compact.places.tolist() == [0, 3, 4]
    assert compact.width == 3
    np.testing.assert_allclose(compact(X, SCALE), expected()[:, compact.places], rtol=1e-14)


def test_nothing_but_zeros_is_nothing_to_compute(cache):
    g = Graph()
    function = Function("f", (Argument("x", 2),), (Output("y", (2,), (g.zero, g.zero)),))
    compact = Kernel(function, compact=True, cache=cache)
    assert compact(X).shape == (20, 0)
    assert compact.sample(X[0]).shape == (0,)
    assert Kernel(function, cache=cache)(X).tolist() == [[0.0, 0.0]] * 20


def test_different_identities_and_forms_are_kept_apart(cache):
    Kernel(example, identity="one", cache=cache)(X, SCALE)

    def other():
        x = Graph().inputs("x", 2)
        return Function("g", example().arguments, (Output("y", (5,), (x[0],) * 5),))

    assert Kernel(other, identity="two", cache=cache)(X, SCALE).tolist() == X[:, [0] * 5].tolist()
    assert Kernel(example, identity="one", compact=True, cache=cache)(X, SCALE).shape == (20, 3)


def test_other_code_of_the_package_makes_it_again(cache, monkeypatch):
    Kernel(example, identity="example", cache=cache)(X, SCALE)
    monkeypatch.setattr(kernel, "source_digest", lambda *_: "another version")
    with pytest.raises(AssertionError, match="was built"):
        Kernel(never, identity="example", cache=cache)(X, SCALE)


def test_without_readable_sources_the_assembly_is_the_key(cache, monkeypatch):
    monkeypatch.setattr(kernel, "source_digest", lambda *_: None)
    Kernel(example, identity="example", cache=cache)(X, SCALE)
    (file,) = cache.folder.iterdir()
    stamp = file.stat().st_mtime_ns
    np.testing.assert_allclose(Kernel(example, identity="other", cache=cache)(X, SCALE), expected(), rtol=1e-14)
    assert [f.stat().st_mtime_ns for f in cache.folder.iterdir()] == [stamp]


def changed(description, **changes):
    return json.dumps(json.loads(description) | changes)


@pytest.mark.parametrize(
    "changes",
    [
        {"arguments": [["x", -2, False], ["scale", 1, True]]},
        {"arguments": [["x", "2", False], ["scale", 1, True]]},
        {"arguments": [["x", 2]]},
        {"arguments": [["not a name", 2, False]]},
        {"outputs": [["M", [2, -2]]]},
        {"outputs": 5},
        {"computed": [3, 0]},
        {"computed": [0, 5]},
        {"computed": [0, 1.5]},
        {"computed": [True]},
    ],
)
def test_sizes_that_cannot_be_are_not_believed(cache, changes):
    Kernel(example, identity="example", cache=cache)(X, SCALE)
    (file,) = cache.folder.iterdir()
    description, code = unpack(cache.read(file.stem))
    cache.write(file.stem, pack(changed(description, **changes), code))
    np.testing.assert_allclose(Kernel(example, identity="example", cache=cache)(X, SCALE), expected(), rtol=1e-14)
    assert unpack(cache.read(file.stem))[0] == description
    assert Kernel(never, identity="example", cache=cache)(X, SCALE).shape == (20, 5)


@pytest.mark.parametrize("content", [b"", b"short", b"\xff" * 20, pack("{}", b""), pack("\0", b"code")])
def test_entries_that_are_none_are_made_again(cache, content):
    Kernel(example, identity="example", cache=cache)(X, SCALE)
    (file,) = cache.folder.iterdir()
    cache.write(file.stem, content)
    np.testing.assert_allclose(Kernel(example, identity="example", cache=cache)(X, SCALE), expected(), rtol=1e-14)


def test_code_that_is_none_is_made_again(cache):
    Kernel(example, identity="example", cache=cache)(X, SCALE)
    (file,) = cache.folder.iterdir()
    description, code = unpack(cache.read(file.stem))
    cache.write(file.stem, pack(description, b"not machine code"))
    np.testing.assert_allclose(Kernel(example, identity="example", cache=cache)(X, SCALE), expected(), rtol=1e-14)
    assert unpack(cache.read(file.stem))[1] == code


def test_an_entry_under_another_name_is_not_used(cache):
    cache.write("key", b"machine code")
    (cache.folder / "other.o").write_bytes((cache.folder / "key.o").read_bytes())
    assert cache.read("key") == b"machine code"
    assert cache.read("other") is None


def test_an_identity_that_does_not_determine_the_function_is_an_error(cache):
    Kernel(example, identity="example", cache=cache)(X, SCALE)

    def other():
        return Function("g", (Argument("x", 2),), (Output("y", (), (Graph().input("x[0]"),)),))

    with pytest.raises(RuntimeError, match="kernel of g does not determine it"):
        Kernel(other, identity="example", cache=cache)(X[:1], SCALE)


def test_a_signature_is_the_same_after_json():
    signature = Signature.of(example(), compact=True)
    assert Signature.from_json(signature.to_json()) == signature
    assert Signature.from_json("[") is None


def test_digests_tell_the_files_of_other_rooms_and_whether_they_can_be_read():
    digests = {source_digest(), source_digest(kernel.__file__), source_digest(compiled.__file__)}
    assert len(digests) == 3
    assert None not in digests
    assert source_digest(str(Path(compiled.__file__).with_name("nowhere.py"))) is None
