"""The capture point of a periodic walk, against an integration of the pendulum."""

import numpy as np
import pytest

from stridelab.wholebody.recovery.walking import WalkCommand, periodic_offsets_m


@pytest.mark.parametrize(
    ("first_m", "second_m"),
    [((0.3, 0.17), (0.3, -0.17)), ((0.0, 0.47), (0.0, -0.17)), ((-0.1, 0.17), (-0.12, -0.19))],
)
def test_the_capture_point_of_a_walk_is_periodic(first_m: tuple[float, float], second_m: tuple[float, float]) -> None:
    """Integrated over two steps, with the pressure in the standing sole and then moving to the next one."""
    w, swing_s, both_s, dt_s = 3.4, 0.6, 0.16, 1e-5
    steps = [np.array(first_m), np.array(second_m)]
    start_m, landing_m = periodic_offsets_m(steps[0], steps[1], w, swing_s, both_s)
    stance_m, xi = np.zeros(2), start_m.copy()
    for k, step_m in enumerate(steps):
        for _ in range(round(swing_s / dt_s)):
            xi = xi + dt_s * w * (xi - stance_m)
        landed_m = stance_m + step_m
        if k == 0:
            assert xi - landed_m == pytest.approx(landing_m, abs=1e-4)
        n = round(both_s / dt_s)
        for i in range(n):
            pressure_m = stance_m + (i + 0.5) / n * step_m
            xi = xi + dt_s * w * (xi - pressure_m)
        stance_m = landed_m
    assert xi - stance_m == pytest.approx(start_m, abs=2e-3)


def test_small_commands_are_rest() -> None:
    assert WalkCommand().is_rest
    assert WalkCommand(0.01, -0.01, 0.01).is_rest
    assert not WalkCommand(turn_rad_s=-0.1).is_rest
