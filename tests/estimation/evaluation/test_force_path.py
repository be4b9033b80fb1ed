"""The path from the plates alone, and the score that it gives, against drawn people whose truth is known."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest

from experiments.people.movements import Movement
from experiments.people.sensors import DrawnRecording, SensorErrors, draw_recording
from stridelab.body.geometric_com import GeometricCom
from stridelab.conventions import GRAVITY_M_S2
from stridelab.dynamics.wrench import Wrench
from stridelab.estimation.differentiation import window_span
from stridelab.estimation.estimator import ComEstimate
from stridelab.estimation.evaluation.force_path import (
    PlateErrors,
    distance_from_force_m,
    force_path_m,
    momentum_of_segments_nms,
    path_error,
)
from stridelab.estimation.markers_only import GeometryOnly
from stridelab.estimation.smoother import Smoother, SmootherPriors
from stridelab.recordings.recording import WrenchTrack

CLEAN = SensorErrors(
    plate_n=0.0, plate_nm=0.0, drift_n_s=0.0, noise_n=0.0, noise_nm=0.0, late_s=(0.0, 0.0), mass_share=0.0
)

ASIDE, ABOVE = np.array([0.03, -0.02, 0.0]), np.array([0.0, 0.0, 0.05])


def path_of(drawn: DrawnRecording, geometric: GeometricCom, latency_s: float = 0.0) -> np.ndarray:
    wrench = drawn.wrench_at(latency_s)
    span = window_span(geometric, wrench)
    total = Wrench(wrench.force_n[span.inside], wrench.moment_nm[span.inside])
    known = momentum_of_segments_nms(geometric, span.inside, drawn.mass_kg, span.rate_hz)
    return force_path_m(total, geometric.com_m[span.inside, 2], known, drawn.mass_kg, span.rate_hz)


@pytest.mark.parametrize("movement", ["walk", "run", "hop", "stand"])
def test_faultless_plates_give_the_horizontal_path(movement: Movement) -> None:
    rms = []
    for seed in range(4):
        drawn = draw_recording(seed, movement, CLEAN, 4.0)
        if drawn.window.duration_s > 2.0:
            rms.append(np.sqrt(np.mean((path_of(drawn, drawn.geometric) - drawn.com_m[:, :2]) ** 2)))
    assert max(rms) < 0.004


def test_the_path_does_not_depend_on_the_tables_horizontal_error() -> None:
    drawn = draw_recording(2, "walk", CLEAN, 4.0)
    moved = replace(drawn.geometric, com_m=drawn.geometric.com_m + ASIDE)
    shifted = {
        name: replace(segment, com_m=segment.com_m + ASIDE) for name, segment in drawn.geometric.segments.items()
    }
    assert path_of(drawn, replace(moved, segments=shifted)) == pytest.approx(path_of(drawn, drawn.geometric), abs=1e-6)


def test_vertically_the_height_and_the_mass_do_not_count() -> None:
    drawn = draw_recording(3, "run", CLEAN, 4.0)
    wrench = drawn.wrench_at(0.0)
    inside = window_span(drawn.geometric, wrench).inside
    true, force = drawn.com_m[inside], wrench.force_n[inside]
    raised = distance_from_force_m(true + ABOVE, true[:, :2], force, 1.002 * drawn.mass_kg, 100.0)
    assert np.sqrt(np.mean(raised[:, 2] ** 2)) < 0.002
    shaken = true + np.outer(0.01 * np.sin(2 * np.pi * 3.0 * np.arange(len(true)) / 100.0), [0.0, 0.0, 1.0])
    seen = distance_from_force_m(shaken, true[:, :2], force, drawn.mass_kg, 100.0)
    assert seen[:, 2].std() == pytest.approx(0.01 / np.sqrt(2), rel=0.2)


@dataclass(frozen=True)
class FollowsThePlates:
    """The force path itself as an estimator: it agrees with the path by construction."""

    name: ClassVar[str] = "follows"

    def estimate(self, geometric: GeometricCom, wrench: WrenchTrack, mass_kg: float) -> ComEstimate:
        estimate = GeometryOnly().estimate(geometric, wrench, mass_kg)
        span = window_span(geometric, wrench)
        total = Wrench(wrench.force_n[span.inside], wrench.moment_nm[span.inside])
        known = momentum_of_segments_nms(geometric, span.inside, mass_kg, span.rate_hz)
        path = force_path_m(total, geometric.com_m[span.inside, 2], known, mass_kg, span.rate_hz)
        return replace(estimate, com_m=np.column_stack([path, estimate.com_m[:, 2]]))


def test_an_estimator_that_copies_the_path_gains_nothing_by_it() -> None:
    copied, penalised, true = [], [], []
    for seed in range(12):
        drawn = draw_recording(seed, "stand", None, 4.0)
        wrench = drawn.wrench_at(drawn.true_latency_s)
        error = path_error(FollowsThePlates(), drawn.geometric, wrench, drawn.mass_kg, seed=seed)
        estimate = FollowsThePlates().estimate(drawn.geometric, wrench, drawn.mass_kg)
        inside = window_span(drawn.geometric, wrench).inside
        copied.append(error.distance_m2[:2].sum())
        penalised.append(error.square_m2[:2].sum())
        true.append(2 * np.mean((estimate.com_m - drawn.com_m[inside])[:, :2] ** 2, axis=0).sum())
    assert max(copied) < 1e-20
    # Its own error and the path's, which are the same: twice the square.
    assert np.mean(penalised) == pytest.approx(np.mean(true), rel=0.6)


def test_the_geometry_pays_no_penalty_and_its_table_error_shows() -> None:
    drawn = draw_recording(4, "walk", CLEAN, 4.0)
    wrench = drawn.wrench_at(0.0)
    error = path_error(GeometryOnly(), drawn.geometric, wrench, drawn.mass_kg)
    inside = window_span(drawn.geometric, wrench).inside
    true = np.mean((drawn.geometric.com_m - drawn.com_m)[inside] ** 2, axis=0)
    assert np.abs(error.penalty_m2[:2]).max() < 1e-9
    assert np.sqrt(error.distance_m2[0]) == pytest.approx(np.sqrt(true[0]), abs=0.003)


def test_momentum_of_twice_the_frequency_moves_the_path_by_half() -> None:
    """A body at rest over plates whose moment oscillates: L = A sin(w t + phase)."""
    t = np.arange(125) / 100.0
    force_n = np.tile([0.0, 0.0, 70.0 * GRAVITY_M_S2], (len(t), 1))
    rms = []
    for hz in (1.6, 3.2, 6.4):
        w, squares = 2 * np.pi * hz, []
        for phase in np.linspace(0.0, 2 * np.pi, 8, endpoint=False):
            moment_nm = np.outer(2.0 * w * np.cos(w * t + phase), [0.0, 1.0, 0.0])
            path = force_path_m(Wrench(force_n, moment_nm), np.full(len(t), 0.95), 0.0 * force_n, 70.0, 100.0)
            squares.append(np.mean(path[:, 0] ** 2))
        rms.append(np.sqrt(np.mean(squares)))
    assert rms[0] / rms[1] == pytest.approx(2.0, rel=0.1)
    assert rms[1] / rms[2] == pytest.approx(2.0, rel=0.1)


def test_in_runs_the_smoother_pays_for_the_errors_that_it_shares_and_no_more() -> None:
    """The penalty, over drawn runs, beside E (c^ - c) e, which is known here; a slower momentum made it 37 mm^2."""
    smoother = Smoother(learn=False, priors=SmootherPriors(walking_moment_nm=(0.0, 0.0)))
    paid, shared = [], []
    for seed in range(9000, 9012):
        drawn = draw_recording(seed, "run", None, 2.5, 50.0)
        wrench = drawn.wrench_at(drawn.true_latency_s)
        inside = window_span(drawn.geometric, wrench).inside
        error = smoother.estimate(drawn.geometric, wrench, drawn.mass_kg).com_m - drawn.com_m[inside]
        of_path = path_of(drawn, drawn.geometric, drawn.true_latency_s) - drawn.com_m[inside, :2]
        shared.append(1e6 * np.mean(error[:, :2] * of_path, axis=0).sum())
        judged = path_error(smoother, drawn.geometric, wrench, drawn.mass_kg, PlateErrors(clock_s=0.0), seed=seed)
        paid.append(1e6 * judged.penalty_m2[:2].sum())
    assert 2.0 < np.mean(paid) < 12.0
    assert np.mean(paid) == pytest.approx(np.mean(shared), abs=6.0)
