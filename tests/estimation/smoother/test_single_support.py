"""A window without a full single support is refused; a contact between two flights is one."""

import numpy as np
import pytest

from stridelab.errors import NotEstimable
from stridelab.estimation.smoother.measurements import Walk, require_single_support

RATE_HZ = 100.0
STEP_HZ = 3.3


def contact(first: int, stop: int, *, changes_side: bool = False) -> Walk:
    """A run of 0.4 s at 5 m/s whose only contact lasts from sample ``first`` to ``stop``, 5 cm beside the body."""
    n = 40
    t = np.arange(n) / RATE_HZ
    f = np.zeros((n, 3))
    f[first:stop, 2] = 1500.0
    y = np.full(n, 0.05)
    if changes_side:
        y[(first + stop) // 2 :] = -0.05
    nu = np.column_stack([y * f[:, 2], np.zeros(n), np.zeros(n)])
    geometry = np.column_stack([5.0 * t, 0.0 * t, 1.0 + 0.0 * t])
    velocity = np.array([5.0, 0.0, 0.0])
    return Walk(np.eye(3), geometry, f, nu, np.ones(n, dtype=bool), RATE_HZ, velocity, np.zeros(3))


def test_a_short_contact_between_two_flights_is_a_full_single_support() -> None:
    require_single_support(contact(14, 27), slice(0, 40), STEP_HZ)


@pytest.mark.parametrize(
    "walk",
    [
        pytest.param(contact(0, 13), id="began-before-the-window"),
        pytest.param(contact(27, 40), id="ends-behind-the-window"),
        pytest.param(contact(14, 27, changes_side=True), id="two-feet"),
    ],
)
def test_part_of_a_contact_or_two_feet_are_not(walk: Walk) -> None:
    with pytest.raises(NotEstimable) as refused:
        require_single_support(walk, slice(0, 40), STEP_HZ)
    assert refused.value.code == "no-single-support"
