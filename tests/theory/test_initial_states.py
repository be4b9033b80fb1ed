"""How the filter may be begun on a short window: the table of docs/theory/complementary-filter.md, and 2.6.3."""

import numpy as np
import pytest

from stridelab.dynamics.wrench import Wrench
from stridelab.estimation.complementary.filter import ComplementaryFilter
from stridelab.estimation.complementary.forward_backward import (
    FilterState,
    filter_inputs,
    forward_backward,
    forward_pass,
    initial_state,
    joined_passes,
)
from stridelab.estimation.complementary.transfer_functions import complementary_filters
from stridelab.estimation.error_priors import ErrorPriors
from stridelab.recordings.recording import Window
from support.recordings.analytic_motions import draw

DRAWS = 100
ZERO = FilterState(*(np.zeros((2, 3)),) * 3)


def rms_mm(low_hz: float, high_hz: float, window: Window, draws: int = DRAWS) -> dict[str, np.ndarray]:
    """Error of every way to begin, over the window, of walks whose errors are drawn from the default priors."""
    filters = complementary_filters(low_hz, high_hz, 100.0)
    errors: dict[str, list[np.ndarray]] = {}
    for seed in range(draws):
        motion, geometric, wrench = draw(seed, ErrorPriors(), window, duration_s=window.end_s + 0.5)
        k = wrench.complete
        inputs = filter_inputs(geometric.com_m[k], Wrench(wrench.force_n[k], wrench.moment_nm[k]), motion.mass_kg)
        whole = ComplementaryFilter(low_hz=low_hz, high_hz=high_hz).estimate(geometric, wrench, motion.mass_kg)
        tracks = {
            "geometry": inputs.geometry_m,
            "forward, zero states": forward_pass(filters, inputs, ZERO),
            "forward, solved": forward_pass(filters, inputs, initial_state(filters, inputs)),
            "forward-backward, solved": forward_backward(filters, inputs),
            "forward-backward, 2.6.3": joined_passes(filters, inputs),
            "geometry beyond the window, solved": whole.com_m,
        }
        truth = motion.com.at(geometric.time_s)[k]
        for name, c in tracks.items():
            errors.setdefault(name, []).append(c - truth)
    return {name: 1e3 * np.sqrt(np.mean(np.concatenate(e) ** 2, axis=0)) for name, e in errors.items()}


@pytest.fixture(scope="module")
def one_second() -> dict[str, np.ndarray]:
    return rms_mm(0.4, 4.0, Window(0.5, 1.5))


def test_zero_states_are_ten_times_worse_than_the_geometry(one_second):
    assert (one_second["forward, zero states"][[0, 2]] > 5 * one_second["geometry"][[0, 2]]).all()


def test_2_6_3_states_that_bring_both_passes_together_spoil_a_short_window(one_second):
    solved, meeting = one_second["forward-backward, solved"], one_second["forward-backward, 2.6.3"]
    assert meeting[1] > 4 * solved[1]
    assert (meeting[:2] > one_second["geometry"][:2]).all()  # worse than no force at all
    longer = rms_mm(0.4, 4.0, Window(0.5, 3.0), draws=20)
    assert longer["forward-backward, 2.6.3"][1] < 1.2 * longer["forward-backward, solved"][1]


def test_the_table_of_the_page(one_second):
    stated = {
        "geometry": [9.2, 9.0, 19.3],
        "forward, zero states": [98.8, 12.1, 98.2],
        "forward, solved": [9.3, 3.9, 19.1],
        "forward-backward, solved": [8.1, 3.1, 19.1],
        "forward-backward, 2.6.3": [13.0, 15.3, 19.1],
        "geometry beyond the window, solved": [7.1, 4.4, 19.1],
    }
    for name, values in stated.items():
        assert one_second[name] == pytest.approx(values, abs=0.15), name
