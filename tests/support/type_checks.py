"""Types and shapes are checked while the tests run: in every test anew, but not at each of a hundred thousand calls.

A check takes about 40 us, several times as long as what the functions of a control loop do themselves. So a function is
checked at its first calls within each test, and then at every so many; which ones these are depends on nothing else.
To make a checked function takes 1 ms: it is made at the first call, that of a dataclass' constructor too, and of those
that a function defines anew at every call, not all are made.

jaxtyping as its hook applies it checks the arguments before a call, and again with the result; here beartype checks the
function itself, and jaxtyping remembers sizes from the arguments to the result, if an annotation has a shape.
"""

import dataclasses
import functools
import inspect
from collections import Counter
from collections.abc import Callable
from types import CodeType, FunctionType
from typing import Any, Final, get_args, get_type_hints

import jaxtyping
from beartype import BeartypeConf, beartype
from jaxtyping import jaxtyped

FIRST: Final = 20
"""So many calls of a function are checked in every test,"""
EVERY: Final = 50
"""and every so many of those that follow."""
CHECKED: Final = "_is_checked"
"""Attribute of a constructor with checks, which a subclass may inherit."""
VIOLATIONS: Final = BeartypeConf(violation_type=jaxtyping.TypeCheckError)
"""All functions raise the same error."""


def checked_once(what: Any, *, typechecker: Any) -> Any:
    """As ``jaxtyping.jaxtyped``: arguments are checked once per call, sizes remembered only where there are shapes."""
    if not isinstance(what, FunctionType) or inspect.isgeneratorfunction(what) or inspect.iscoroutinefunction(what):
        return jaxtyped(what, typechecker=typechecker)
    try:
        hints = get_type_hints(what, include_extras=True)
    except Exception:  # a name that only type checkers import: jaxtyping leaves it out, and checks the others
        return jaxtyped(what, typechecker=typechecker)
    alike = FunctionType(what.__code__, what.__globals__, what.__name__, what.__defaults__, what.__closure__)
    functools.update_wrapper(alike, what)
    del alike.__wrapped__  # type: ignore[attr-defined]
    alike.__kwdefaults__, alike.__annotations__ = what.__kwdefaults__, hints
    checked = beartype(conf=VIOLATIONS)(alike)
    return jaxtyped(checked, typechecker=None) if any(map(_has_shape, hints.values())) else checked


def _has_shape(hint: Any) -> bool:
    """Whether an annotation, or a part of it, is one of jaxtyping's."""
    if isinstance(hint, list):  # arguments of a callable
        return any(map(_has_shape, hint))
    own = inspect.isclass(hint) and issubclass(hint, jaxtyping.AbstractArray)
    return own or type(hint).__module__.startswith("jaxtyping") or any(map(_has_shape, get_args(hint)))


class OftenEnough:
    """In place of ``jaxtyping.jaxtyped``, which is ``checks``; ``next_test`` begins to count anew.

    Of a class only the constructor is checked here, if it is a dataclass: its methods are decorated by themselves.
    """

    def __init__(self, checks: Callable[..., Any]) -> None:
        self._checks, self._test = checks, 0
        self._defined: Counter[CodeType] = Counter()

    def next_test(self) -> None:
        """Begin to count calls again for all functions."""
        self._test += 1
        self._defined.clear()

    def __call__(self, what: Any = None, *, typechecker: Any) -> Any:
        """Wrap a function or class by ``checks``, which then runs at some of many calls only."""
        if what is None:
            return functools.partial(self, typechecker=typechecker)
        if not inspect.isclass(what):
            if "<locals>" in what.__qualname__:
                self._defined[what.__code__] += 1
                if not _due(self._defined[what.__code__]):
                    return what
            return self._at_some_calls(what, functools.cache(lambda: self._checks(what, typechecker=typechecker)))
        if dataclasses.is_dataclass(what) and not hasattr(what.__init__, CHECKED):
            self._check_constructor(what, typechecker)
        return what

    def _check_constructor(self, what: Any, typechecker: Any) -> None:
        unchecked = what.__init__
        checked = functools.cache(lambda: self._checks(unchecked, typechecker=typechecker))
        what.__init__ = self._at_some_calls(unchecked, checked)
        setattr(what.__init__, CHECKED, True)

    def _at_some_calls(self, unchecked: Callable[..., Any], checked: Callable[[], Any]) -> Callable[..., Any]:
        """``checked`` makes the other one, once it is called: most functions are not, in most processes."""
        test, calls = -1, 0

        @functools.wraps(unchecked)
        def called(*args: Any, **kwargs: Any) -> Any:
            nonlocal test, calls
            if test != self._test:
                test, calls = self._test, 0
            calls += 1
            if calls <= FIRST or not calls % EVERY:  # ``_due``, without a call more for each of millions
                return (unchecked if jaxtyping.config.jaxtyping_disable else checked())(*args, **kwargs)
            return unchecked(*args, **kwargs)

        return called


def _due(time: int) -> bool:
    return time <= FIRST or time % EVERY == 0
