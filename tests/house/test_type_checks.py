"""Types and shapes are checked in every test: at first calls, at some later ones, and not at all others."""

from collections.abc import Callable

import jaxtyping
import numpy as np
import pytest
from beartype import beartype
from jaxtyping import Float

from stridelab.dynamics.spatial import Placement
from stridelab.dynamics.wrench import zmp_linearised
from support.type_checks import EVERY, FIRST, OftenEnough, checked_once


def noting(checked: list[int]) -> Callable[..., Callable[[int], int]]:
    """Checks that only note what the function is called with."""

    def jaxtyped(what: Callable[[int], int], *, typechecker: None) -> Callable[[int], int]:
        def called(number: int) -> int:
            checked.append(number)
            return what(number)

        return called

    return jaxtyped


def test_first_calls_and_some_later_ones_are_checked_in_every_test_anew() -> None:
    checked: list[int] = []
    often = OftenEnough(noting(checked))
    doubled = often(typechecker=None)(lambda number: 2 * number)
    expected = [*range(1, FIRST + 1), *range(EVERY, 4 * EVERY + 1, EVERY)]
    for _ in range(2):
        assert [doubled(number) for number in range(1, 4 * EVERY + 1)] == list(range(2, 8 * EVERY + 1, 2))
        assert checked == expected
        checked.clear()
        often.next_test()


def test_of_a_function_that_is_defined_anew_the_first_and_some_later_ones_are_checked() -> None:
    checked: list[int] = []
    often = OftenEnough(noting(checked))
    for _ in range(2):
        for number in range(1, 2 * EVERY + 1):

            def doubled(number: int) -> int:
                return 2 * number

            assert often(doubled, typechecker=None)(number) == 2 * number
        assert checked == [*range(1, FIRST + 1), EVERY, 2 * EVERY]
        checked.clear()
        often.next_test()


@pytest.mark.parametrize("time", range(2))
def test_a_wrong_shape_is_refused_in_every_test_that_is_the_first_to_give_it(time: int) -> None:
    """By a function, a dataclass and a method of the package; the second test is like the first."""
    for _ in range(FIRST - 5):
        Placement.identity()
        zmp_linearised(np.zeros((time + 1, 3)), np.zeros((time + 1, 3)))
    with pytest.raises(jaxtyping.TypeCheckError):
        Placement(np.zeros(2), np.eye(3))
    with pytest.raises(jaxtyping.TypeCheckError):
        zmp_linearised(np.zeros((4, 3)), np.zeros((5, 3)))
    with pytest.raises(jaxtyping.TypeCheckError):
        Placement.identity().act(np.zeros((4, 2)))


def test_arguments_and_results_are_refused_with_and_without_shapes() -> None:
    """Also a size that differs between an argument and the result."""

    def lengths(rows: Float[np.ndarray, "n 3"], more: int) -> Float[np.ndarray, " n"]:
        return np.zeros(len(rows) + more)

    def text_of(number: int) -> str:
        return str(number) if number > 0 else number  # type: ignore[return-value]

    shaped, plain = (checked_once(function, typechecker=beartype) for function in (lengths, text_of))
    assert shaped(np.zeros((2, 3)), 0).shape == (2,)
    assert plain(1) == "1"
    for refused, arguments in (
        (shaped, (np.zeros((2, 3)), 1)),
        (shaped, (np.zeros((2, 2)), 0)),
        (plain, (0,)),
        (plain, ("1",)),
    ):
        with pytest.raises(jaxtyping.TypeCheckError):
            refused(*arguments)
