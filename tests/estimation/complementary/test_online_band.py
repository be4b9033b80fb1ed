"""The band of the online filter, source by source: what one error of a known size does is done here to the filter."""

import numpy as np
import pytest

from stridelab.estimation.complementary.online_filter import OnlineComplementaryFilter
from stridelab.estimation.error_priors import ErrorPriors
from support.recordings.analytic_motions import Motion, uniform

NO_TABLE = (0.0, 0.0, 0.0)
NOTHING = {"marker_m": 1e-9, "acceleration_m_s2": NO_TABLE, "moment_nm": 0.0, "clock_s": 0.0}
STILL = {**NOTHING, "momentum_rate_nm_kg": (0.0, 0.0)}
RATE_HZ = 100.0


def run(motion: Motion, t: np.ndarray, hidden: np.ndarray, push_n: np.ndarray, table_sd_m=NO_TABLE, **priors):
    """CoM and band of a stream whose force is wrong by ``push_n``, its axis right, and whose markers hide."""
    online = OnlineComplementaryFilter(
        low_hz=0.2,
        high_hz=1.0,
        mass_kg=motion.mass_kg,
        table_sd_m=table_sd_m,
        priors=ErrorPriors(**priors),
        velocity_m_s=motion.com.rate,
    )
    f = motion.force(t) + push_n
    nu = np.cross(motion.com.at(t), f)
    steps = zip(t.tolist(), motion.com.at(t), hidden, f, nu, strict=True)
    samples = [online.step(at, None if unseen else g, push, turn) for at, g, unseen, push, turn in steps]
    com, _, sd = (np.array(rows) for rows in zip(*samples, strict=True))
    return com - motion.com.at(t), sd


@pytest.mark.parametrize("axis", range(3))
def test_a_wrong_acceleration_moves_the_com_by_what_the_band_says(axis: int) -> None:
    """0.1 m/s^2 is a lag while markers are seen, and grows with the square of the time while they are not.

    Then the axis pulls back sideways, a little, and half of the first sample saw markers: the band leaves out both.
    """
    t = np.arange(900) / RATE_HZ
    hidden = (t > 8.0) & (t <= 8.6)
    errors = tuple((0.1 * np.eye(3)[axis]).tolist())
    motion = uniform((0.0, 0.0, 0.0))
    error, sd = run(motion, t, hidden, motion.mass_kg * np.array(errors), **STILL | {"acceleration_m_s2": errors})
    settled = (t > 5.0) & (t <= 8.6)
    assert error[settled & ~hidden, axis] == pytest.approx(sd[settled & ~hidden, axis], rel=2e-3)
    assert error[hidden, axis] == pytest.approx(sd[hidden, axis], rel=0.08)
    assert sd[hidden, axis][-1] > 10 * sd[settled, axis][0]
    np.testing.assert_allclose(np.delete(sd, axis, axis=1)[settled], 0.0, atol=1e-6)


@pytest.mark.parametrize(("ahead", "aside"), [(0, 1), (1, 0)])
def test_angular_momentum_is_wrong_ahead_with_the_steps_and_aside_with_the_strides(ahead: int, aside: int) -> None:
    """L' about the lateral axis moves the axis ahead, that about the walk aside; H3 leaves 1 / (1 + (f / f_2)^2)."""
    speed = [0.0, 0.0, 0.0]
    speed[ahead] = 1.2
    t = np.arange(1200) / RATE_HZ
    priors = NOTHING | {"momentum_rate_nm_kg": (0.12, 0.33), "step_hz": 1.8}
    _, sd = run(uniform(tuple(speed)), t, t < 0.0, np.zeros(3), **priors)
    assert sd[-1, ahead] == pytest.approx(0.33 / 9.81 / (1 + (1.8 / 0.2) ** 2), rel=5e-3)
    assert sd[-1, aside] == pytest.approx(0.12 / 9.81 / (1 + (0.9 / 0.2) ** 2), rel=5e-3)


def test_late_clocks_are_wrong_along_the_way_and_moments_both_ways() -> None:
    """5 ms at 1.2 m/s and at 0.5 m/s; 2 Nm at 70 kg; the table's offset is forgotten but upwards."""
    t = np.arange(1200) / RATE_HZ
    motion = uniform((1.2, -0.5, 0.0))
    _, late = run(motion, t, t < 0.0, np.zeros(3), **STILL | {"clock_s": 0.005})
    assert late[-1] == pytest.approx([0.006, 0.0025, 0.0], rel=1e-3, abs=1e-6)
    _, turned = run(motion, t, t < 0.0, np.zeros(3), **STILL | {"moment_nm": 2.0})
    assert turned[-1] == pytest.approx([2.0 / (70 * 9.81)] * 2 + [0.0], rel=1e-3, abs=1e-6)
    _, table = run(motion, t, t < 0.0, np.zeros(3), (0.01, 0.02, 0.03), **STILL)
    assert table[0] == pytest.approx([0.01, 0.02, 0.03], rel=0.05)
    assert table[-1] == pytest.approx([0.0, 0.0, 0.03], abs=1e-5)
