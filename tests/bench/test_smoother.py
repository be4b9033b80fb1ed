"""Speed of the smoother; run by ``make bench`` (skipped otherwise). A minute, a trial of nine seconds, two seconds."""

from dataclasses import replace

import numpy as np
import pytest

from stridelab.estimation.smoother import Smoother
from stridelab.recordings.recording import Window
from support.recordings.analytic_motions import walk

RATE_HZ = 200.0
MOTION = walk()
TABLE_SD_M = (0.009, 0.009, 0.02)


@pytest.mark.parametrize("learn", [True, False])
@pytest.mark.parametrize("duration_s", [2.0, 9.0, 60.0])
def test_smoother(benchmark, duration_s, learn):
    """``estimate``, band included; learning looks at three seconds whatever the length."""
    t = np.arange(round(duration_s * RATE_HZ) + 1) / RATE_HZ
    exact = MOTION.geometric(t)
    noise = 1e-3 * np.random.default_rng(0).standard_normal(exact.com_m.shape)
    geometric = replace(exact, com_m=exact.com_m + noise)
    wrench = MOTION.wrench_track(t, Window(0.0, duration_s))
    benchmark(lambda: Smoother(learn=learn).estimate(geometric, wrench, MOTION.mass_kg))
    benchmark.extra_info["samples_per_s"] = round(len(t) / benchmark.stats.stats.median)


def test_causal_smoother_step(benchmark):
    """Position, velocity and band, one sample at a time; five seconds of them."""
    t = np.arange(1000) / RATE_HZ
    geometric, force, moment = MOTION.com.at(t), MOTION.force(t), MOTION.moment(t)
    samples = list(zip(t.tolist(), geometric, force, moment, strict=True))

    def stream():
        online = Smoother().causal(mass_kg=MOTION.mass_kg, table_sd_m=TABLE_SD_M)
        for sample in samples:
            online.step(*sample)

    benchmark(stream)
    benchmark.extra_info["us_per_step"] = round(1e6 * benchmark.stats.stats.median / len(samples), 1)
