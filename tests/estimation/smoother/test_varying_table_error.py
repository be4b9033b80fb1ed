"""The table's error that follows the posture: as stated in a walk, twice that in runs and jumps, small in standing."""

import numpy as np
import pytest

from experiments.people.movements import Movement
from experiments.people.sensors import draw_recording
from stridelab.estimation.evaluation.truth_errors import truth_error
from stridelab.estimation.smoother import Smoother


@pytest.mark.parametrize(("movement", "size_mm"), [("walk", 3.0), ("run", 6.0), ("hop", 6.0), ("stand", 1 / 3)])
def test_a_body_that_stands_has_little_of_it_and_learning_leaves_it_alone(movement: Movement, size_mm: float) -> None:
    drawn = draw_recording(4, movement, duration_s=2.5, frame_hz=50.0)
    for learn in (False, True):
        estimate = Smoother(learn=learn).estimate(drawn.geometric, drawn.wrench_at(0.0), drawn.mass_kg)
        assert estimate.diagnostics["table_varying_mm"] == pytest.approx(size_mm)


def test_the_smoother_is_nearer_the_truth_than_the_geometry_in_jumps() -> None:
    ratios, covered = [], []
    for seed in range(8):
        drawn = draw_recording(seed, "hop", duration_s=2.5, frame_hz=50.0)
        wrench = drawn.wrench_at(drawn.true_latency_s)
        estimate = Smoother(learn=False).estimate(drawn.geometric, wrench, drawn.mass_kg)
        error = truth_error(estimate, drawn.geometric.time_s, drawn.com_m)
        geometry = np.sqrt(np.mean(np.sum((drawn.geometric.com_m - drawn.com_m)[:, :2] ** 2, axis=1)))
        ratios.append(error.horizontal_m / geometry)
        covered.append(error.coverage[:2].mean())
    assert np.median(ratios) < 0.6
    assert np.mean(covered) > 0.85
