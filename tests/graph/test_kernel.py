"""Compiled kernels against NumPy and the C library."""

import math

import numpy as np
import pytest
from small_kernels import kernel_of, outputs_of

from steelyard.errors import InputError
from steelyard.graph import Argument, Graph, cos, evaluate, sin


@pytest.mark.parametrize("width", [1, 7, 8, 12, 16, 25])
@pytest.mark.parametrize("count", [0, 1, 2, 7, 8, 9, 100])
def test_every_size_agrees_with_numpy(width, count):
    graph = Graph()
    outputs = outputs_of(graph, width)
    kernel = kernel_of([Argument("x", 3), Argument("p", 2, uniform=True)], outputs)
    random = np.random.default_rng(count)
    x, p = random.normal(size=(count, 3)), random.normal(size=2)
    names = {f"x[{k}]": x[:, k] for k in range(3)} | {f"p[{k}]": p[k] for k in range(2)}
    expected = np.array([np.broadcast_to(v, (count,)) for v in evaluate(outputs, names)])
    np.testing.assert_allclose(kernel(x, p).T, expected, rtol=1e-14, atol=1e-15)


def sine_kernel():
    graph = Graph()
    x = graph.input("x[0]")
    return kernel_of([Argument("x", 1)], [sin(x), cos(x)])


@pytest.mark.parametrize("size", [1e-300, 1e-8, 0.1, 1.0, 10.0, 1e3, 1e6, 1e9])
def test_sine_and_cosine_are_within_an_ulp_of_the_c_library(size):
    x = np.random.default_rng(7).uniform(-size, size, 4001)
    x[:3] = [0.0, size, -size]
    result = sine_kernel()(x[:, None])
    for column, function in enumerate((math.sin, math.cos)):
        expected = np.array([function(v) for v in x])
        assert np.all(np.abs(result[:, column] - expected) <= 1.5 * np.spacing(np.abs(expected)))


def test_exact_at_multiples_of_a_quarter_turn():
    x = np.arange(-8, 9)[:, None] * (math.pi / 2)
    result = sine_kernel()(x)
    np.testing.assert_allclose(result[:, 0], np.sin(x[:, 0]), rtol=0, atol=1e-16)
    np.testing.assert_allclose(result[:, 1], np.cos(x[:, 0]), rtol=0, atol=1e-16)


def test_what_is_not_a_number_stays_so():
    result = sine_kernel()(np.array([[np.nan], [np.inf], [0.0]]))
    assert np.isnan(result[:2]).all()
    assert result[2].tolist() == [0.0, 1.0]


def test_single_and_batch_agree_to_the_last_bit():
    x = np.random.default_rng(3).normal(size=(16, 1))
    kernel = sine_kernel()
    together = kernel(x)
    one_by_one = np.array([kernel(row[None])[0] for row in x])
    assert together.tolist() == one_by_one.tolist()


def test_wrong_shapes_are_refused():
    kernel = sine_kernel()
    with pytest.raises(InputError, match=r"x must have shape \(S, 1\), got \(4, 2\)"):
        kernel(np.zeros((4, 2)))
    with pytest.raises(InputError, match="out must be"):
        kernel(np.zeros((4, 1)), out=np.zeros((3, 2)))
