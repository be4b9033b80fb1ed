"""The delay between force and markers is found again when it was put there on purpose."""

import numpy as np
import pytest

from stridelab.errors import NotEstimable
from stridelab.estimation.latency import estimate_latency
from stridelab.recordings.recording import Window
from support.motions import uniform, walk

WINDOW = Window(0.5, 1.5)


@pytest.mark.parametrize("late_s", [-0.010, 0.0, 0.008, 0.018, 0.030])
@pytest.mark.parametrize("heading", ["x", "-y"])
def test_an_injected_delay_is_recovered_to_two_milliseconds(late_s, heading):
    t = np.arange(200) / 100.0
    motion = walk()
    rotation = np.eye(3) if heading == "x" else np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    rng = np.random.default_rng(3)
    geometric = motion.geometric(t, noise_m=rng.normal(0, 0.0005, (200, 3)))
    turned = type(geometric)(t, geometric.com_m @ rotation.T, "truth", {}, {}, geometric.sd_m)

    def wrench_at(latency_s):
        w = motion.wrench_track(t, WINDOW, late_s, latency_s)
        noisy = w.force_n + rng.normal(0, 5, (200, 3))
        return type(w)(t, noisy @ rotation.T, w.moment_nm @ rotation.T, w.complete, w.windows, latency_s)

    found = estimate_latency(turned, wrench_at, motion.mass_kg)
    assert found.latency_s == pytest.approx(late_s, abs=0.002)
    assert 0.0002 < found.sd_s < 0.01
    assert found.correlation > 0.8


def test_the_standard_deviation_is_honest():
    t = np.arange(200) / 100.0
    motion = walk()
    z = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        geometric = motion.geometric(t, noise_m=rng.normal(0, 0.001, (200, 3)))
        noise = rng.normal(0, 5, (200, 3))

        def wrench_at(latency_s, noise=noise):
            w = motion.wrench_track(t, WINDOW, 0.018, latency_s)
            return type(w)(t, w.force_n + noise, w.moment_nm, w.complete, w.windows, latency_s)

        found = estimate_latency(geometric, wrench_at, motion.mass_kg)
        z.append((found.latency_s - 0.018) / found.sd_s)
    assert 0.1 < np.std(z) < 1.2  # white noise is kinder than the residuals that the 12 per second come from
    assert np.mean(np.abs(z) < 1.96) > 0.85


def test_a_body_at_rest_has_no_latency_to_tell():
    t = np.arange(200) / 100.0
    rng = np.random.default_rng(0)
    motion = uniform((0.0, 0.0, 0.0))
    geometric = motion.geometric(t, noise_m=rng.normal(0, 0.0005, (200, 3)))
    noise = rng.normal(0, 2, (200, 3))

    def wrench_at(latency_s):
        w = motion.wrench_track(t, WINDOW, 0.0, latency_s)
        return type(w)(t, w.force_n + noise, w.moment_nm, w.complete, w.windows, latency_s)

    with pytest.raises(NotEstimable, match="delay") as error:
        estimate_latency(geometric, wrench_at, motion.mass_kg)
    assert error.value.code == "latency-unclear"
