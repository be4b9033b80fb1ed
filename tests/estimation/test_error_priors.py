"""Stated errors that no standard deviation can have are refused, and the field is named."""

import pytest

from stridelab.errors import InvalidInput
from stridelab.estimation.error_priors import ErrorPriors

NAN = float("nan")


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("marker_m", 0.0),
        ("marker_m", -0.001),
        ("marker_m", NAN),
        ("force_n", 0.0),
        ("step_hz", 0.0),
        ("acceleration_m_s2", (0.05, -0.05, 0.15)),
        ("moment_nm", -1.0),
        ("momentum_rate_nm_kg", (0.1, float("inf"))),
        ("clock_s", -0.001),
    ],
)
def test_a_prior_that_is_no_size_of_an_error_is_refused_by_name(field: str, value: object) -> None:
    with pytest.raises(InvalidInput) as refusal:
        ErrorPriors(**{field: value})  # type: ignore[arg-type]
    assert refusal.value.code == "prior-out-of-range"
    assert [fault.where for fault in refusal.value.faults] == [f"priors.{field}"]
    assert field in refusal.value.message


def test_an_error_that_is_absent_is_zero() -> None:
    priors = ErrorPriors(acceleration_m_s2=(0.0, 0.0, 0.0), moment_nm=0.0, momentum_rate_nm_kg=(0.0, 0.0), clock_s=0.0)
    assert priors.clock_s == 0.0
