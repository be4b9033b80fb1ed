"""Up, forward, and units of length."""

import numpy as np
import pytest

from stridelab.recordings import orientation
from stridelab.recordings.files.metadata import length_scale

NAMES = ("+x", "-x", "+y", "-y", "+z", "-z")


@pytest.mark.parametrize("name", NAMES)
def test_rotation_takes_up_to_z_and_is_proper(name: str) -> None:
    R = orientation.rotation_to_z_up(name)
    np.testing.assert_allclose(R @ orientation.axis_vector(name), [0, 0, 1])
    np.testing.assert_allclose(R @ R.T, np.eye(3))
    assert np.linalg.det(R) == pytest.approx(1.0)


def test_up_is_the_line_of_the_force_with_the_markers_above_the_plates() -> None:
    body = np.full((5, 3, 3), [0.0, 1.0, 0.0])
    plates = [np.zeros(3)]
    assert orientation.find_up_axis(np.array([30.0, 700.0, -20.0]), plates, body, "+z") == "+y"
    assert orientation.find_up_axis(np.array([30.0, -700.0, -20.0]), plates, body, "+z") == "+y"


def test_an_oblique_force_decides_nothing_and_the_hint_is_used() -> None:
    assert orientation.find_up_axis(np.array([500.0, 500.0, 0.0]), [], np.ones((2, 2, 3)), "+z") == "+z"


def test_without_force_and_hint_people_are_taller_than_wide() -> None:
    body = np.zeros((1, 4, 3))
    body[0, :, 1] = [0.05, 0.5, 1.0, 1.6]
    body[0, :, 0] = [0.2, 0.3, 0.1, 0.2]
    assert orientation.find_up_axis(None, [], body, None) == "+y"


def test_walking_direction_survives_gaps() -> None:
    """A marker that is seen only at the end would pull a plain centroid forward."""
    t = np.arange(200) / 100.0
    cloud = np.zeros((200, 5, 3)) + np.arange(5)[None, :, None] * 0.1
    cloud[:, :, 1] -= 1.1 * t[:, None]
    cloud[:150, 4] = np.nan
    direction = orientation.walking_direction(cloud, 100.0)
    assert direction is not None
    np.testing.assert_allclose(direction, [0, -1, 0], atol=1e-9)


def test_standing_has_no_direction() -> None:
    rng = np.random.default_rng(0)
    assert orientation.walking_direction(rng.normal(0, 0.01, (200, 5, 3)), 100.0) is None
    assert orientation.walking_direction(np.ones((1, 5, 3)), 100.0) is None


def test_belt_direction_is_that_of_the_faster_swing() -> None:
    """0.6 s back at 1 m/s, 0.4 s forward at 1.5 m/s."""
    phase = (np.arange(300) / 100.0) % 1.0
    y = np.where(phase < 0.6, -phase, -0.6 + 1.5 * (phase - 0.6))
    foot = np.column_stack([0.01 * y, y, np.zeros(300)])
    direction = orientation.belt_direction([foot], 100.0)
    assert direction is not None
    np.testing.assert_allclose(direction, [0, 1, 0], atol=0.02)


def body_in(scale: float) -> np.ndarray:
    rng = np.random.default_rng(1)
    return (np.array([0.0, 0.0, 1.0]) + rng.uniform(-0.5, 0.5, (3, 12, 3)) * [0.5, 0.5, 1.6]) * scale


@pytest.mark.parametrize(
    ("stated", "true_scale", "expected"),
    [("mm", 1000.0, 1e-3), ("m", 1.0, 1.0), ("cm", 100.0, 1e-2), ("mm", 1.0, 1.0), ("m", 1000.0, 1e-3), ("", 1.0, 1.0)],
)
def test_unit_of_length_is_checked_against_a_body(stated: str, true_scale: float, expected: float) -> None:
    scale, remarks = length_scale(stated, body_in(true_scale))
    assert scale == expected
    wrong = expected * true_scale == 1.0 and {"mm": 1e-3, "m": 1.0, "cm": 1e-2, "": 1e-3}[stated] != expected
    assert [remark.code for remark in remarks] == (["unit-corrected"] if wrong else [])


def test_a_body_that_no_unit_fits_is_remarked() -> None:
    assert [remark.code for remark in length_scale("mm", body_in(1e6))[1]] == ["unit-implausible"]
