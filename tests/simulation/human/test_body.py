"""The body against the numbers it is built from, and against another implementation of the same table."""

import numpy as np
import pinocchio as pin
import pytest

from stridelab.body import segment_tables
from stridelab.recordings.recording import Sex
from stridelab.simulation.human.body_model import build_body, landmark_tracks, segment_frames


@pytest.mark.parametrize(
    ("height_m", "mass_kg", "sex"), [(1.71, 60.0, "female"), (1.85, 92.0, "male"), (1.3, 28.0, "female")]
)
def test_the_upright_body_has_the_requested_stature_and_mass(height_m: float, mass_kg: float, sex: Sex) -> None:
    body = build_body(height_m, mass_kg, sex)
    landmarks = landmark_tracks(body, body.neutral_pose()[None])
    assert landmarks["head_top"][0, 2] == pytest.approx(height_m, abs=1e-12)
    assert landmarks["l_heel"][0, 2] == pytest.approx(0.015 * height_m, abs=1e-12)
    assert body.mass_kg == pytest.approx(mass_kg, rel=1e-12)


def test_inertia_of_the_upright_body_is_human() -> None:
    """Whole-body moments about the centre of mass, standing: 8 to 14 kg m2, about 1 about the vertical."""
    body = build_body(1.75, 70.0, "male")
    data = body.model.createData()
    pin.ccrba(body.model, data, body.neutral_pose(), np.zeros(34))
    about_x, about_y, about_z = np.diag(data.Ig.inertia)
    assert 8.0 < about_x < 14.0
    assert 8.0 < about_y < 14.0
    assert 0.7 < about_z < 1.6


def test_height_of_the_centre_of_mass_is_human() -> None:
    for sex in ("female", "male"):
        body = build_body(1.7, 65.0, sex)
        height = pin.centerOfMass(body.model, body.model.createData(), body.neutral_pose())[2]
        assert 0.54 < height / 1.7 < 0.58


def test_segments_carry_the_mass_of_the_table() -> None:
    table = segment_tables.load_table("dumas2007", "female")
    body = build_body(1.71, 60.0, "female")
    for name in segment_frames(body.proportions):
        carried = body.model.inertias[body.joint[name]].mass
        assert carried == pytest.approx(60.0 * table.segments[name].mass_fraction, rel=1e-12)


def test_left_and_right_mirror_each_other() -> None:
    body = build_body(1.71, 60.0, "female")
    landmarks = landmark_tracks(body, body.neutral_pose()[None])
    for name, place in landmarks.items():
        if name.startswith("l_"):
            np.testing.assert_allclose(place * [1, -1, 1], landmarks["r_" + name[2:]], atol=1e-14)
    for side in ("upper_arm", "forearm", "hand", "thigh", "shank", "foot"):
        left, right = (body.model.inertias[body.joint[s + side]] for s in ("l_", "r_"))
        np.testing.assert_allclose(left.lever * [1, -1, 1], right.lever, atol=1e-14)
