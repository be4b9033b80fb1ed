"""Figure 2.5 in numbers: the discrete filters add up to one, and what they let pass."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import signal

from stridelab.errors import InvalidInput
from stridelab.estimation.complementary.transfer_functions import complementary_filters

RATES_HZ = (100.0, 200.0, 1000.0)
THESIS = (0.4, 4.0)


@pytest.mark.parametrize("rate_hz", RATES_HZ)
@pytest.mark.parametrize("cutoffs", [THESIS, (0.2, 1.0), (0.1, 20.0)])
@pytest.mark.parametrize("order", [2, 3])
def test_the_three_filters_add_up_to_one_at_every_frequency(
    rate_hz: float, cutoffs: tuple[float, float], order: int
) -> None:
    """(2.27)."""
    f = np.geomspace(1e-3, 0.4999 * rate_hz, 1000)
    filters = complementary_filters(*cutoffs, rate_hz, order)
    total = filters.h1.response(f) + filters.s2_h2.response(f) + filters.h3.response(f)
    assert np.abs(total - 1).max() < 1e-12


@pytest.mark.parametrize("rate_hz", RATES_HZ)
@pytest.mark.parametrize("order", [2, 3])
def test_s2_h2_is_h2_of_the_bilinear_second_derivative(rate_hz, order):
    """(2.24) and (2.25)."""
    f = np.geomspace(0.01, 0.45 * rate_hz, 100)
    filters = complementary_filters(*THESIS, rate_hz, order)
    z = np.exp(2j * np.pi * f / rate_hz)
    s = 2 * rate_hz * (z - 1) / (z + 1)
    assert_allclose(filters.s2_h2.response(f), s**2 * filters.h2.response(f), rtol=1e-9)


def test_the_discrete_filters_are_the_analogue_ones_up_to_the_warping_of_the_bilinear_rule():
    """(2.24), (2.26)."""
    f, rate_hz = np.geomspace(0.05, 20, 50), 1000.0
    s = 2j * rate_hz * np.tan(np.pi * f / rate_hz)
    tau_1, tau_2 = 1 / (2 * np.pi * 4.0), 1 / (2 * np.pi * 0.4)
    filters = complementary_filters(*THESIS, rate_hz)
    assert_allclose(filters.h3.response(f), 1 / (1 + s * tau_2) ** 2, rtol=1e-9)
    assert_allclose(filters.h2.response(f), tau_1**2 / (1 + s * tau_1) ** 2, rtol=1e-9)


def test_the_cutoffs_are_at_minus_6_db_and_h1_is_no_clean_band_pass():
    filters = complementary_filters(*THESIS, 1000.0)
    assert abs(filters.h3.response(np.array([0.4]))[0]) == pytest.approx(0.5, abs=1e-3)
    assert abs(filters.s2_h2.response(np.array([4.0]))[0]) == pytest.approx(0.5, abs=1e-3)
    h1 = np.abs(filters.h1.response(np.geomspace(0.01, 100, 4000)))
    assert h1.max() == pytest.approx(1.173, abs=1e-3)
    gains = np.abs(filters.h1.response(np.array([0.1, 10.0, 20.0])))
    assert gains == pytest.approx([0.474, 0.704, 0.386], abs=2e-3)


def test_the_third_order_has_steeper_skirts_on_both_sides():
    """H1 falls by 100 per decade where the thesis' falls by 10, and is one half at the cut-offs' real part alike."""
    f = np.array([0.001, 0.01, 0.4, 4.0, 100.0, 1000.0])
    second, third = (np.abs(complementary_filters(*THESIS, 1e5, order).h1.response(f)) for order in (2, 3))
    assert second[1] / second[0] == pytest.approx(10, rel=0.01)
    assert third[1] / third[0] == pytest.approx(100, rel=0.01)
    assert second[4] / second[5] == pytest.approx(10, rel=0.02)
    assert third[4] / third[5] == pytest.approx(100, rel=0.02)
    split = complementary_filters(*THESIS, 1e5, 3)
    assert split.h3.response(np.array([0.4]))[0].real == pytest.approx(0.5, abs=1e-3)
    assert split.s2_h2.response(np.array([4.0]))[0].real == pytest.approx(0.5, abs=1e-3)


def test_another_order_is_refused():
    with pytest.raises(InvalidInput) as error:
        complementary_filters(*THESIS, 100.0, 4)
    assert error.value.code == "order-out-of-range"


@pytest.mark.parametrize("name", ["h1", "h2", "s2_h2", "h3"])
def test_taps_and_roots_describe_the_same_filter(name):
    h = getattr(complementary_filters(*THESIS, 100.0), name)
    f = np.array([0.5, 2.0, 10.0, 30.0])
    expected = signal.freqz(h.b, h.a, worN=2 * np.pi * f / 100.0)[1]
    assert_allclose(h.response(f), expected, rtol=1e-6)
    assert np.abs(h.poles).max() < 1


@pytest.mark.parametrize(
    "cutoffs", [(0.0, 4.0), (4.0, 0.4), (1.0, 1.0), (0.4, 50.0), (0.4, 60.0), (-1.0, 4.0), (float("nan"), 4.0)]
)
def test_cutoffs_that_make_no_filter_are_refused(cutoffs: tuple[float, float]) -> None:
    with pytest.raises(InvalidInput) as error:
        complementary_filters(*cutoffs, 100.0)
    assert error.value.code == "cutoffs-out-of-range"
    assert error.value.faults[0].where == "cutoffs"
