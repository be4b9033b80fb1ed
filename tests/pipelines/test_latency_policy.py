"""What is done about the latency of the force is chosen by rule, and always said."""

import math
from dataclasses import replace

import numpy as np
import pytest

from stridelab.errors import InvalidInput
from stridelab.pipelines.mass_and_latency import LatencyChoice, choose_latency
from stridelab.recordings.recording import Window, WrenchTrack
from support.recordings.analytic_motions import uniform, walk

WINDOW = Window(0.5, 1.5)
T = np.arange(200) / 100.0


def chosen(wanted: str | float, late_s: float, noise_n: float = 5.0) -> LatencyChoice:
    """Of a walk whose force is ``late_s`` late."""
    motion, rng = walk(), np.random.default_rng(3)
    geometric = motion.geometric(T, noise_m=rng.normal(0, 0.0005, (200, 3)))
    noise = rng.normal(0, noise_n, (200, 3))

    def wrench_at(latency_s: float) -> WrenchTrack:
        track = motion.wrench_track(T, WINDOW, late_s, latency_s)
        return replace(track, force_n=track.force_n + noise)

    return choose_latency(wanted, geometric, wrench_at, motion.mass_kg)  # type: ignore[arg-type]


def codes(choice: LatencyChoice) -> list[str]:
    return [remark.code for remark in choice.remarks]


@pytest.mark.parametrize("late_s", [0.018, -0.012])
def test_a_significant_latency_is_taken_out_and_said(late_s: float) -> None:
    choice = chosen("apply", late_s)
    assert choice.trial_estimate is not None
    assert choice.trial_estimate.significant
    assert choice.applied_s == choice.trial_estimate.latency_s == pytest.approx(late_s, abs=0.002)
    assert choice.remaining_sd_s == choice.trial_estimate.sd_s
    (remark,) = choice.remarks
    assert remark.code == "latency-applied"
    assert ("later" if late_s > 0 else "earlier") in remark.message
    assert f"{1e3 * abs(choice.applied_s):.1f} ms" in remark.message
    assert "±" in remark.message


@pytest.mark.parametrize("late_s", [0.0, 0.0015])
def test_a_latency_like_zero_is_left_alone_with_a_remark(late_s: float) -> None:
    choice = chosen("apply", late_s)
    assert choice.trial_estimate is not None
    assert choice.applied_s == 0.0
    assert choice.remaining_sd_s == math.hypot(choice.trial_estimate.sd_s, choice.trial_estimate.latency_s)
    assert codes(choice) == ["latency-not-significant"]


def test_report_takes_nothing_out_and_says_what_there_is() -> None:
    late, on_time = chosen("report", 0.018), chosen("report", 0.0)
    assert late.applied_s == on_time.applied_s == 0.0
    assert codes(late) == ["latency-not-applied"]
    assert codes(on_time) == []


def test_a_number_is_taken_out_as_it_is_with_the_finding_beside_it() -> None:
    choice = chosen(0.005, 0.018)
    assert choice.applied_s == 0.005
    assert codes(choice) == ["latency-applied"]
    assert "5.0 ms later, as requested; the estimate is 1" in choice.remarks[0].message


@pytest.mark.parametrize(("wanted", "applied_s"), [("apply", 0.0), ("report", 0.0), (0.007, 0.007)])
def test_clocks_that_cannot_be_compared_are_a_remark_never_a_refusal(wanted: str | float, applied_s: float) -> None:
    motion, rng = uniform((0.0, 0.0, 0.0)), np.random.default_rng(0)
    geometric = motion.geometric(T, noise_m=rng.normal(0, 0.0005, (200, 3)))
    noise = rng.normal(0, 2, (200, 3))

    def wrench_at(latency_s: float) -> WrenchTrack:
        track = motion.wrench_track(T, WINDOW, 0.0, latency_s)
        return replace(track, force_n=track.force_n + noise)

    choice = choose_latency(wanted, geometric, wrench_at, motion.mass_kg)  # type: ignore[arg-type]
    assert choice.trial_estimate is None
    assert choice.applied_s == applied_s
    assert codes(choice)[0] == "latency-unclear"
    assert ("latency-applied" in codes(choice)) == (applied_s != 0.0)


@pytest.mark.parametrize("absurd", [5.0, -0.2, float("nan"), float("inf")])
def test_a_stated_latency_that_no_clocks_have_is_refused_by_name(absurd: float) -> None:
    with pytest.raises(InvalidInput) as refusal:
        chosen(absurd, 0.0)
    assert refusal.value.code == "latency-out-of-range"
    assert refusal.value.faults[0].where == "latency"
