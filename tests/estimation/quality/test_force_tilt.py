"""The vertical of a file against gravity: a walk in the axes of an inclined surface."""

from dataclasses import replace

import numpy as np
import pytest

from stridelab.body.segment_model import SegmentModel
from stridelab.estimation.quality import Recorded, assess_quality
from stridelab.estimation.smoother import Smoother
from stridelab.recordings.marker_sets import identify
from stridelab.recordings.plate_contacts import wrench_track
from stridelab.recordings.recording import Recording, Window
from stridelab.simulation.human.walker import HumanWalker
from stridelab.simulation.human_recording import record
from stridelab.simulation.noise import MeasurementNoise

MASS_KG = 70.0


def inclined_walk(angle_rad: float) -> Recording:
    """A walk in the axes of a surface that is inclined along the walk: markers and plates turned together."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    R = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    walk = HumanWalker(height_m=1.75, mass_kg=MASS_KG, sex="male", speed_m_s=1.2, duration_s=3.0, seed=1).walk()
    level = record(walk, MeasurementNoise(force_n=3.0, moment_nm=2.0, marker_m=0.001), 1, lab="walkway").recording
    plates = tuple(
        replace(p, corners_m=p.corners_m @ R.T, force_n=p.force_n @ R.T, moment_nm=p.moment_nm @ R.T)
        for p in level.plates
    )
    return replace(level, plates=plates, markers_m={name: track @ R.T for name, track in level.markers_m.items()})


@pytest.mark.parametrize("angle_deg", [0.0, 12.0])
def test_the_axes_of_an_inclined_surface_contradict_gravity_and_are_named_first(angle_deg: float) -> None:
    recording = inclined_walk(np.radians(angle_deg))
    landmarks = identify(list(recording.markers_m)).landmarks
    geometric = SegmentModel().com(recording, landmarks, subject=recording.subject)
    wrench = wrench_track(recording, (Window(0.9, 2.1),))
    recorded = Recorded(recording, landmarks, geometric, wrench, MASS_KG)
    quality = assess_quality(recorded, Smoother().estimate(geometric, wrench, MASS_KG))
    (check,) = [check for check in quality.checks if check.name == "force_tilt"]
    assert check.value == pytest.approx(np.sin(np.radians(angle_deg)), abs=0.01)
    assert check.contradicts is (angle_deg > 0.0)
    if angle_deg > 0.0:
        first = "The sensors contradict each other; do not use these numbers. The mean force leans by 1"
        assert quality.remarks[0].message.startswith(first)
