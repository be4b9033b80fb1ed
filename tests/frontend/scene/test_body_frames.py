"""The body of a recorded person: limbs between joint centres, and lines where none are stored."""

import numpy as np
import pytest

from stridelab_web.scene.body_frames import BODY, LIMBS, body_sticks, median_length_m, profile_of
from stridelab_web.scene.frames import Sheet, Stick
from stridelab_web.viewer import meshes

HIP_M, KNEE_M, ANKLE_M = np.array([0.1, 0.2, 0.9]), np.array([0.2, 0.2, 0.5]), np.array([0.1, 0.2, 0.1])
AHEAD_M = np.array([1.0, 0.0, 0.0])


def columns_of(**joints: np.ndarray) -> dict[str, np.ndarray]:
    """A table of two frames with these joint centres, the second 1 m farther ahead."""
    return {
        f"joint_{name}_{axis}_m": np.array([place[k], place[k] + (k == 0)])
        for name, place in joints.items()
        for k, axis in enumerate("xyz")
    }


def test_a_limb_joins_its_joint_centres() -> None:
    sheet = Sheet()
    tracks = columns_of(l_hip=HIP_M, l_knee=KNEE_M, l_ankle=ANKLE_M)
    sticks = {stick.name: stick for stick in body_sticks(tracks, sheet)}
    assert sticks.keys() == {f"{BODY}thigh/l", f"{BODY}shank/l"}
    values = sheet.to_array(2)
    thigh = sticks[f"{BODY}thigh/l"]
    np.testing.assert_allclose(values[:, thigh.start : thigh.start + 3], [HIP_M, HIP_M + AHEAD_M], atol=1e-6)
    np.testing.assert_allclose(values[:, thigh.end : thigh.end + 3], [KNEE_M, KNEE_M + AHEAD_M], atol=1e-6)
    assert sticks[f"{BODY}shank/l"].start == thigh.end
    assert median_length_m(values, thigh) == pytest.approx(np.hypot(0.1, 0.4), abs=1e-6)


def test_the_whole_body_has_every_limb_of_both_sides() -> None:
    joints = {end.replace("*", side) for limb in LIMBS.values() for end in limb[:2] for side in "lr"}
    sticks = body_sticks(columns_of(**dict.fromkeys(joints, HIP_M)), Sheet())
    assert len(sticks) == sum(1 + ("*" in limb.start) for limb in LIMBS.values())
    assert all(profile_of(stick) for stick in sticks)


def test_other_sticks_are_no_limbs() -> None:
    assert body_sticks({"LASI_x_m": np.zeros(2)}, Sheet()) == ()
    assert profile_of(Stick("/body/line3", 0, 3)) is None
    assert profile_of(Stick("/skeleton/3", 0, 3)) is None


def test_a_limb_that_is_never_seen_has_no_length() -> None:
    assert np.isnan(median_length_m(np.full((3, 6), np.nan), Stick("/body/thigh/l", 0, 3)))


def test_a_solid_of_revolution_is_closed_and_as_thick_as_its_profile() -> None:
    vertices, faces = meshes.solid_of_revolution(((0.0, 0.0), (0.0, 0.1), (1.0, 0.1), (1.0, 0.0)))
    corners = vertices[faces].astype(float)
    volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    sides = len(vertices) // 4
    assert volume == pytest.approx(0.5 * sides * 0.1**2 * np.sin(2 * np.pi / sides), rel=1e-5)
