"""Functions of a model without a compiler, which takes longer than all else where many robots are tried once each."""

import numpy as np

import steelyard as sy


def interpreted(model: sy.Model, name: str, **values: np.ndarray) -> np.ndarray:
    """Interpret what a kernel is compiled from; every argument of any function may be given, (..., width)."""
    function = model.function(name)
    (output,) = function.evaluate({argument.name: values[argument.name] for argument in function.arguments}).values()
    return output
