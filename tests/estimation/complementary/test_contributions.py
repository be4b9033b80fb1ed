"""The parts of a fused CoM add up to it, and each filter speaks where it should."""

import numpy as np
import pytest

from stridelab.dynamics.wrench import Wrench
from stridelab.estimation.complementary.contributions import bode_responses, split_contributions
from stridelab.estimation.complementary.filter import ComplementaryFilter
from stridelab.estimation.complementary.forward_backward import filter_inputs, forward_backward
from stridelab.estimation.complementary.transfer_functions import complementary_filters
from stridelab.recordings.recording import Window
from support.recordings.analytic_motions import walk

T = np.arange(2000) / 200.0


def test_the_parts_add_up_to_the_fused_trajectory() -> None:
    motion = walk()
    noise = 0.001 * np.random.default_rng(0).standard_normal((len(T), 3))
    inputs = filter_inputs(motion.com.at(T) + noise, Wrench(motion.force(T), motion.moment(T)), motion.mass_kg)
    filters = complementary_filters(0.4, 4.0, 200.0)
    parts = split_contributions(filters, inputs)
    assert parts.total_m == pytest.approx(forward_backward(filters, inputs), abs=1e-12)


def test_height_comes_from_the_axis_and_the_step_from_the_geometry() -> None:
    """H3 passes what is constant, H1 the band of gait under the thesis' cut-offs."""
    motion = walk()
    inputs = filter_inputs(motion.com.at(T), Wrench(motion.force(T), motion.moment(T)), motion.mass_kg)
    parts = split_contributions(complementary_filters(0.4, 4.0, 200.0), inputs)
    middle = slice(800, 1200)
    assert parts.axis_m[middle, 2].mean() == pytest.approx(0.95, abs=0.005)
    assert parts.geometry_m[middle, 2].mean() == pytest.approx(0.0, abs=0.005)
    sway = {name: np.ptp(getattr(parts, name)[middle, 2]) for name in ("geometry_m", "force_m", "axis_m")}
    assert sway["geometry_m"] > 2 * max(sway["force_m"], sway["axis_m"])


def test_what_is_split_is_what_the_estimator_fuses() -> None:
    motion, t = walk(), np.arange(300) / 100.0
    geometric, wrench = motion.geometric(t, np.array([0.01, -0.01, 0.0])), motion.wrench_track(t, Window(1.0, 2.0))
    estimator = ComplementaryFilter()
    signals = estimator.input_signals(geometric, wrench, motion.mass_kg)
    parts = split_contributions(signals.filters, signals.inputs)
    fused = estimator.estimate(geometric, wrench, motion.mass_kg)
    assert parts.total_m[signals.stretch.within] == pytest.approx(fused.com_m, abs=1e-12)


def test_bode_shows_minus_six_decibels_at_the_cutoffs_and_a_sum_of_one() -> None:
    f = np.array([0.01, 0.4, 4.0, 40.0])
    seen = bode_responses(complementary_filters(0.4, 4.0, 1000.0), f)
    assert seen.gain_db[1, 2] == pytest.approx(-6.02, abs=0.01)
    assert seen.gain_db[2, 1] == pytest.approx(-6.02, abs=0.01)
    assert seen.response.sum(axis=1) == pytest.approx(np.ones(4), abs=1e-12)
    assert seen.phase_rad[2, 1] == pytest.approx(np.pi / 2, abs=0.01)  # two poles, 45 degrees each, below a 180 lead
