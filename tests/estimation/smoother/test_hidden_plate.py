"""Walks of drawn people, half of whose force is withheld as if one of two plates were missing."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.people.sensors import DrawnRecording, draw_recording
from stridelab.conventions import Mask, Points
from stridelab.estimation.differentiation import walk_frame, window_span
from stridelab.estimation.estimator import ComEstimator
from stridelab.estimation.evaluation.holdout_force import withhold_samples
from stridelab.estimation.evaluation.physics_residuals import FLIGHT_N
from stridelab.estimation.markers_only import GeometryOnly
from stridelab.estimation.smoother import Smoother

SEEDS = (0, 1, 6, 7)


@pytest.fixture(scope="module")
def walks() -> list[DrawnRecording]:
    return [draw_recording(seed, "walk", None, 2.5, 50.0) for seed in SEEDS]


def hidden_error_m(estimator: ComEstimator, walk: DrawnRecording, *, left: bool) -> tuple[Points, Points]:
    """Error and stated sd, along and lateral, while the force on one side of the body is withheld."""
    wrench = walk.wrench_at(walk.true_latency_s)
    span = window_span(walk.geometric, wrench)
    truth = walk.com_m[span.inside]
    force_n, moment_nm = wrench.force_n[span.inside], wrench.moment_nm[span.inside]
    hidden: Mask = (moment_nm[:, 0] / np.maximum(force_n[:, 2], 50.0) > truth[:, 1]) == left
    hidden &= force_n[:, 2] > FLIGHT_N
    withheld = withhold_samples(walk.geometric, wrench, walk.mass_kg, hidden)
    estimate = estimator.estimate(walk.geometric, withheld, walk.mass_kg)
    turn = walk_frame(np.diff(truth, axis=0))
    error = (estimate.com_m - truth) @ turn.T
    sd = np.sqrt(estimate.sd_m**2 @ (turn**2).T)
    return error[hidden][:, :2], sd[hidden][:, :2]


def test_where_a_plate_is_hidden_it_is_hardly_worse_than_the_geometry_and_better_along(
    walks: list[DrawnRecording],
) -> None:
    """Half a stride of moments does not separate angular momentum from an error of the segment table."""
    square_m2: dict[str, list[Points]] = {"geometry": [], "smoother": []}
    inside = []
    for walk in walks:
        for left in (True, False):
            error, sd = hidden_error_m(Smoother(), walk, left=left)
            square_m2["smoother"].append(np.mean(error**2, axis=0))
            inside.append(np.mean(np.abs(error) < 1.96 * sd, axis=0))
            square_m2["geometry"].append(np.mean(hidden_error_m(GeometryOnly(), walk, left=left)[0] ** 2, axis=0))
    rms_m = {name: np.sqrt(np.mean(squares, axis=0)) for name, squares in square_m2.items()}
    ratio = rms_m["smoother"] / rms_m["geometry"]
    assert ratio[0] < 0.8
    assert ratio[1] < 1.5
    assert (np.mean(inside, axis=0) > 0.9).all()


def test_in_a_run_without_the_force_of_one_foot_the_segments_carry_it() -> None:
    """With a resonator alone, half a stride becomes an error of the table."""
    square_m2 = {True: 0.0, False: 0.0}
    for run in (draw_recording(seed, "run", None, 2.5, 50.0) for seed in (0, 2)):
        for segments in (True, False):
            drawn = run if segments else replace(run, geometric=replace(run.geometric, segments={}))
            for left in (True, False):
                error, _ = hidden_error_m(Smoother(), drawn, left=left)
                square_m2[segments] += float(np.mean(error[:, 1] ** 2))
    assert square_m2[True] < 0.5 * square_m2[False]
