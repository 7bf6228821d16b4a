"""The same argument has one name, one place and one default in all public functions."""

import importlib
import inspect
from collections.abc import Callable, Iterator
from itertools import combinations
from typing import Any

import pytest

import steelyard as sy

ROOMS = sorted(
    name for name in dir(sy) if inspect.ismodule(getattr(sy, name)) and hasattr(getattr(sy, name), "__all__")
)

ORDER = (
    ("info", "feasible_set"),
    ("feasible_set", "base"),
    ("feasible_set", "parameters"),
    ("base", "info"),
    ("info", "covariance"),
    ("covariance", "weights"),
    ("weights", "solver"),
    ("covariance", "solver"),
    ("accuracy", "iterations"),
    ("model", "q"),
    ("q", "dq"),
    ("dq", "ddq"),
    ("source", "columns"),
    ("columns", "processing"),
    ("columns", "joints"),
    ("processing", "rows"),
    ("rows", "joints"),
    ("lower", "upper"),
    ("kp", "kd"),
    ("base", "compensate_drives"),
    ("compensate_drives", "sign_width"),
    ("sensors", "actuators"),
    ("actuators", "environment"),
    ("environment", "stopping_conditions"),
    ("language", "functions"),
    ("base", "gravity"),
    ("gravity", "sign"),
)

DEFAULTS = {
    "solver": "clarabel",
    "weights": "joint",
    "residual_slack": 5e-4,
    "confidence": 0.95,
    "consistency": "full",
    "convention": "standard",
    "locked": (),
    "prior": None,
    "prior_weight": 1.0,
    "covariance": None,
    "info": None,
    "columns": None,
    "processing": None,
    "joints": None,
    "compensate_drives": False,
    "tool": None,
    "environment": None,
    "actuators": None,
    "stopping_conditions": None,
    "sign": "exact",
    "substitute": None,
    "threshold": 1.345,
    "batch_means": True,
}

OLD = {"information", "feasible", "posture", "others", "complement", "safety", "believed", "noise_factor", "preference"}
NOT_OPTIONS = {
    "weights": {"estimators.proved_estimate"},
    "prior": {".identify"},
    "prior_weight": {".identify", ".OnlineEstimator.__init__", "estimators.bayesian"},
}
"""Functions in which the argument is no option but a result that is handed on, and those that choose it themselves: the
main job gathers its prior from the robot, and finds its weight from the data, as the estimator that runs with it does;
that of the mean of the posterior takes descriptions to be right to three tenths.
"""


def functions() -> Iterator[tuple[str, Callable[..., Any]]]:
    """All public functions, and public methods of public classes; values that classes hold are no arguments."""
    seen = set()
    for room in ("", *ROOMS):
        place = importlib.import_module(f"steelyard.{room}".rstrip("."))
        for name in place.__all__:
            found = getattr(place, name)
            if id(found) in seen or not callable(found) or not str(found.__module__).startswith("steelyard"):
                continue
            seen.add(id(found))
            if not inspect.isclass(found):
                yield f"{room}.{name}", found
                continue
            for own, value in vars(found).items():
                method = value.__func__ if isinstance(value, classmethod | staticmethod) else value
                written = own == "__init__" and not hasattr(found, "__dataclass_fields__")
                if inspect.isfunction(method) and (written or not own.startswith("_")):
                    yield f"{room}.{name}.{own}", method


FUNCTIONS = dict(functions())


def arguments(function: Callable[..., Any]) -> dict[str, inspect.Parameter]:
    return dict(inspect.signature(function).parameters)


def test_the_functions_are_found() -> None:
    assert len(FUNCTIONS) > 250
    assert {".fit", ".check", "estimators.l_curve", "feasibility.parameter_intervals"} <= set(FUNCTIONS)


def test_no_argument_has_an_old_name() -> None:
    found = {(name, key) for name, function in FUNCTIONS.items() for key in OLD.intersection(arguments(function))}
    assert found == set()


def test_arguments_come_in_one_order() -> None:
    """Those that a call must give, and those that it may give."""
    wrong = []
    for name, function in FUNCTIONS.items():
        needed = {key: one.default is inspect.Parameter.empty for key, one in arguments(function).items()}
        places = {key: place for place, key in enumerate(needed)}
        wrong += [
            f"{name}: {second} before {first}"
            for first, second in ORDER
            if first in places and second in places and needed[first] == needed[second]
            if places[first] > places[second]
        ]
    assert wrong == []


@pytest.mark.parametrize("key", sorted(DEFAULTS))
def test_an_option_has_one_default(key: str) -> None:
    found = {
        name: parameter.default
        for name, function in FUNCTIONS.items()
        for parameter in [arguments(function).get(key)]
        if parameter is not None and parameter.default is not inspect.Parameter.empty
        if name not in NOT_OPTIONS.get(key, ())
    }
    assert found
    assert {name: value for name, value in found.items() if value != DEFAULTS[key]} == {}


def test_the_order_contradicts_itself_nowhere() -> None:
    assert not [pair for pair, other in combinations(ORDER, 2) if pair == other[::-1]]
