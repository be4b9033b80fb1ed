"""The numbers between models or recordings and claims: what each function of the reproduction is given and returns.

A change that a claim hides, since it takes the worst of several numbers or rounds them, shows here. For each function
there is the number of calls and, of all numbers in arguments and results, how many there are, their mean, the mean of
their sizes, and the mean of their logarithms with weights that depend on their place, in which small numbers count as
much as large ones and no two change places. ``recorded_claims`` compares them with ``recorded_steps.json``, for every
item and every test of one.
"""

import functools
import inspect
import math
import re
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import fields, is_dataclass
from types import FunctionType, ModuleType
from typing import Any, Final

import numpy as np
import pytest

REPRODUCTION: Final = "stridelab.reproduction."
OTHERS: Final = re.compile(r"(report|registry|runner|result_cache|claims)\b")
"""Modules that lay out pages, or make claims, which are recorded themselves."""
MACHINE: Final = re.compile(r"timed|_ms$|iterations|took|seconds|time_[123]_")
"""Names of functions and fields that hold the times of a machine, and how a solver got there."""
UNSTEADY: Final = re.compile(
    r"(chapter4\.(fig_4_[678]|table_4_1|numbers)|studies\.(recorded_motions|cone_validation\._gauge_change))\b"
)
"""Functions whose numbers depend on the processor, through the order of the rays of a cone or a solver's iterations."""
MACHINE_TIMES: Final = ("time_s", "solve_time_s", "build_time_s", "solve_s", "build_s")
TIMED: Final = ("stridelab.centroidal", REPRODUCTION + "chapter4", REPRODUCTION + "studies.cone_validation")
"""Fields that hold the times of a machine if they are single numbers, and modules of the classes that have them."""
DEEPEST: Final = 5
MOST_NUMBERS: Final = 1000
"""Of larger arrays, so many numbers at equal distances are added up."""
MOST_CALLS: Final = 50
"""Numbers of so many calls of a function are added up; a bootstrap makes thousands."""
WEIGHTS: Final = 1.0 + 0.5 * np.cos(np.arange(100_000))
"""Weights of the first numbers by their places."""
SMALLEST: Final = 1e-4
"""Numbers have a logarithm down to this size (0.1 mm); of smaller ones it is proportional to them."""

Steps = dict[str, dict[str, list[float]]]


class _Sums:
    """Count, sum and sum of sizes of finite numbers."""

    def __init__(self) -> None:
        self.calls, self.count, self.finite = 0, 0, 0
        self.total, self.size, self.logarithms = 0.0, 0.0, 0.0

    def add(self, value: Any, depth: int = 0) -> None:
        """Add all numbers in a value."""
        if isinstance(value, (bool, int, float, np.number, np.bool_)):
            self._add_number(float(value))
        elif isinstance(value, np.ndarray):
            if value.dtype.kind in "fiub":
                self._add_array(value.ravel())
        elif depth < DEEPEST:
            for part in _parts_of(value):
                self.add(part, depth + 1)

    def _add_number(self, number: float) -> None:
        """As an array of one, which takes ten times as long."""
        self.count += 1
        if math.isfinite(number):
            self.total += number
            self.size += abs(number)
            logarithm = math.copysign(math.log1p(abs(number) / SMALLEST), number)
            self.logarithms += (1.0 + 0.5 * math.cos(self.finite)) * logarithm
            self.finite += 1

    def _add_array(self, numbers: np.ndarray) -> None:
        self.count += len(numbers)
        some = numbers[:: 1 + len(numbers) // MOST_NUMBERS].astype(float)
        size = float(np.abs(some).sum())
        if math.isfinite(size):
            weights = self._weights_of(len(some))
        else:
            places = np.flatnonzero(np.isfinite(some))
            weights = 1.0 + 0.5 * np.cos(self.finite + places)
            some = some[places]
            size = float(np.abs(some).sum())
        self.finite += len(some)
        self.total += float(some.sum())
        self.size += size
        self.logarithms += float(weights @ np.copysign(np.log1p(np.abs(some) / SMALLEST), some))

    def _weights_of(self, n: int) -> np.ndarray:
        """Weights of the next ``n`` numbers, all finite: cosines are as slow as all the rest."""
        first = self.finite
        return WEIGHTS[first : first + n] if first + n <= len(WEIGHTS) else 1.0 + 0.5 * np.cos(first + np.arange(n))

    def summary(self) -> list[float]:
        """Calls, numbers, mean, mean size and mean weighted logarithm."""
        n = max(self.finite, 1)
        means = (value / n for value in (self.total, self.size, self.logarithms))
        return [self.calls, self.count, *(float(f"{value:.6g}") for value in means)]


def _parts_of(value: Any) -> Iterator[Any]:
    if isinstance(value, (tuple, list, range)):
        if value and all(isinstance(part, (bool, int, float)) for part in value):
            yield np.array(value, dtype=float)
        else:
            yield from value
        return
    named: Mapping[Any, Any] = {}
    timed = type(value).__module__.startswith(TIMED)
    if isinstance(value, Mapping):
        named = value
    elif is_dataclass(value) and not type(value).__module__.startswith(("stridelab.robots", REPRODUCTION + "claims")):
        named = {} if isinstance(value, type) else {field.name: getattr(value, field.name) for field in fields(value)}
    for name, part in named.items():
        if not MACHINE.search(str(name)) and not (timed and name in MACHINE_TIMES and isinstance(part, float)):
            yield part


@contextmanager
def recorded_steps() -> Iterator[Steps]:
    """Record calls of the reproduction's functions, with empty caches."""
    sums: dict[str, tuple[_Sums, _Sums]] = {}
    steps: Steps = {}
    with pytest.MonkeyPatch.context() as patch:
        _wrap_functions(patch, sums)
        yield steps
    for name, (given, returned) in sorted(sums.items()):
        steps[name] = {"given": given.summary(), "returned": returned.summary()}


def _wrap_functions(patch: pytest.MonkeyPatch, sums: dict[str, tuple[_Sums, _Sums]]) -> None:
    wrappers: dict[int, Callable[..., Any]] = {}
    for module in _modules():
        for name, thing in list(vars(module).items()):
            if inspect.isclass(thing) and thing.__module__ == module.__name__:
                _wrap_methods(patch, thing, sums)
            elif not inspect.isclass(thing) and _is_of_reproduction(thing):
                with suppress(AttributeError):
                    thing.cache_clear()
                if id(thing) not in wrappers:
                    wrappers[id(thing)] = _recording(thing, sums)
                patch.setattr(module, name, wrappers[id(thing)])


def _wrap_methods(patch: pytest.MonkeyPatch, of: type, sums: dict[str, tuple[_Sums, _Sums]]) -> None:
    for name, thing in list(vars(of).items()):
        if isinstance(thing, FunctionType) and not name.startswith("__"):
            patch.setattr(of, name, _recording(thing, sums))
        elif isinstance(thing, staticmethod):
            patch.setattr(of, name, staticmethod(_recording(thing.__func__, sums)))


def _modules() -> list[ModuleType]:
    return [
        module
        for name, module in list(sys.modules.items())
        if name.startswith(REPRODUCTION) and not OTHERS.match(name.removeprefix(REPRODUCTION))
    ]


def _is_of_reproduction(thing: Any) -> bool:
    module = getattr(thing, "__module__", None) or ""
    return (
        callable(thing)
        and hasattr(thing, "__qualname__")
        and module.startswith(REPRODUCTION)
        and not OTHERS.match(module.removeprefix(REPRODUCTION))
    )


def _recording(function: Callable[..., Any], sums: dict[str, tuple[_Sums, _Sums]]) -> Callable[..., Any]:
    name = f"{function.__module__.removeprefix(REPRODUCTION)}.{function.__qualname__}"
    if MACHINE.search(name) or UNSTEADY.match(name):
        return function

    @functools.wraps(function)
    def recorded(*arguments: Any, **named: Any) -> Any:
        given, returned = sums.setdefault(name, (_Sums(), _Sums()))
        given.calls += 1
        if given.calls > MOST_CALLS:
            return function(*arguments, **named)
        given.add(arguments)
        given.add(named)
        result = function(*arguments, **named)
        returned.calls += 1
        returned.add(result)
        return result

    return recorded


def step_differences(now: Steps, recorded: Mapping[str, Mapping[str, list[float]]], relative: float) -> list[str]:
    """Functions whose calls differ from the record.

    Room is ``relative`` of the mean size, and as much as the logarithm changes if all numbers change by that share.
    """
    differences = [f"{name} is called, and is not recorded" for name in now.keys() - recorded.keys()]
    differences += [f"{name} is recorded, and is not called" for name in recorded.keys() - now.keys()]
    for name in now.keys() & recorded.keys():
        for side, one in now[name].items():
            other = recorded[name][side]
            room = relative * max(abs(one[3]), abs(other[3])) + 1e-7
            rooms = (room, room, relative)
            if len(one) != len(other) or one[:2] != other[:2] or any(not math.isclose(a, b, rel_tol=0.0, abs_tol=of)
                                           for a, b, of in zip(one[2:], other[2:], rooms, strict=True)):  # fmt: skip
                differences.append(f"{name}, {side}: {one}, recorded {other}")
    return sorted(differences)
