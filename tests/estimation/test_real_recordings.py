"""The estimators on real walks: against the clocks, the force, repetition, and standing still as physical truth."""

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from stridelab.body.geometric_com import GeometricCom
from stridelab.body.segment_model import SegmentModel
from stridelab.conventions import Vector3
from stridelab.estimation.complementary.filter import ComplementaryFilter
from stridelab.estimation.estimator import ComEstimate, ComEstimator
from stridelab.estimation.evaluation.physics_residuals import bias_m, force_residual_n
from stridelab.estimation.latency import Latency, estimate_latency
from stridelab.estimation.markers_only import GeometryOnly
from stridelab.recordings.force_windows import measured_windows
from stridelab.recordings.marker_sets import identify
from stridelab.recordings.plate_contacts import wrench_track
from stridelab.recordings.reader import read_recording
from stridelab.recordings.recording import Recording, WrenchTrack

AUTO, THESIS, GEOMETRY = ComplementaryFilter(), ComplementaryFilter.thesis(), GeometryOnly()


@dataclass(frozen=True)
class Trial:
    """A walk turned so that it goes along +x, with its force as recorded and with the latency taken out."""

    mass_kg: float
    geometric: GeometricCom
    raw: WrenchTrack
    aligned: WrenchTrack
    latency: Latency

    def estimate(self, estimator: ComEstimator, aligned: bool = True) -> ComEstimate:
        return estimator.estimate(self.geometric, self.aligned if aligned else self.raw, self.mass_kg)

    def residual(self, estimator: ComEstimator, aligned: bool = True) -> np.ndarray:
        wrench = self.aligned if aligned else self.raw
        return force_residual_n(self.estimate(estimator, aligned), wrench, self.mass_kg)

    def bias(self, estimator: ComEstimator, aligned: bool = True) -> np.ndarray:
        return bias_m(self.estimate(estimator, aligned), self.geometric)


def geometry(recording: Recording, folder: Path) -> GeometricCom:
    landmarks = identify(list(recording.markers_m)).landmarks
    statics = sorted(folder.glob("*_ST.c3d"))
    static = read_recording(statics[0]) if statics else None
    return SegmentModel().com(recording, landmarks, subject=recording.subject, static=static)


def load(path: Path) -> Trial:
    recording = read_recording(path)
    mass_kg, ahead = recording.subject.mass_kg, recording.walking_direction
    assert mass_kg is not None
    assert ahead is not None
    windows = measured_windows(recording, identify(list(recording.markers_m)).landmarks)
    wrench_at = partial(turned, recording, windows, heading(ahead))
    com = geometry(recording, path.parent)
    com = com.rotated_to(heading(ahead))
    latency = estimate_latency(com, wrench_at, mass_kg)
    return Trial(mass_kg, com, wrench_at(0.0), wrench_at(latency.latency_s), latency)


def heading(ahead: Vector3) -> np.ndarray:
    return np.array([ahead, np.cross([0.0, 0.0, 1.0], ahead), [0.0, 0.0, 1.0]])


def turned(recording, windows, rotation, latency_s) -> WrenchTrack:
    track = wrench_track(recording, windows, latency_s=latency_s)
    return replace(track, force_n=track.force_n @ rotation.T, moment_nm=track.moment_nm @ rotation.T)


@pytest.fixture(scope="module")
def adults(gait: Path) -> dict[str, Trial]:
    return {p.parent.name: load(p) for p in sorted(gait.glob("rehazenter-adult-walking/*/*_C4_*.c3d"))}


@pytest.fixture(scope="module")
def faster(gait: Path) -> dict[str, Trial]:
    return {p.parent.name: load(p) for p in sorted(gait.glob("rehazenter-adult-walking/*/*_C5_*.c3d"))}


@pytest.fixture(scope="module")
def children(gait: Path) -> dict[str, Trial]:
    return {p.parent.name: load(p) for p in sorted(gait.glob("biomechzoo-sample-study/*/Straight*.c3d"))}


def test_the_force_is_late_by_what_other_signs_say(adults, faster, children):
    """Rehazenter 18 ms at both speeds (one subject 1 to 3 ms: another set-up), biomechZoo 8 to 14 ms."""
    for trials in (adults, faster):
        assert 0.014 < np.median([t.latency.latency_s for t in trials.values()]) < 0.022
    assert 0.008 < np.median([t.latency.latency_s for t in children.values()]) < 0.014
    change = [adults[s].latency.latency_s - faster[s].latency.latency_s for s in adults]
    assert np.std(change) < 0.004  # the same person's delay, estimated twice


def test_aligning_the_clocks_brings_geometry_and_force_together(adults):
    raw = np.mean([t.residual(GEOMETRY, aligned=False) for t in adults.values()], axis=0)
    aligned = np.mean([t.residual(GEOMETRY) for t in adults.values()], axis=0)
    assert raw == pytest.approx([23.1, 21.5, 30.1], rel=0.1)
    assert aligned == pytest.approx([14.1, 20.5, 16.8], rel=0.1)


def test_the_filter_agrees_with_the_force_within_one_percent_of_body_weight(adults, faster, children):
    stated_mass = 0.03  # vertically in children: the plates disagree with the stated mass by up to 9 %
    for trials, limit in ((adults, 0.011), (faster, 0.012), (children, (0.01, 0.01, stated_mass))):
        share = np.mean([t.residual(AUTO) / (t.mass_kg * 9.81) for t in trials.values()], axis=0)
        assert (share < limit).all()
        thesis = np.mean([t.residual(THESIS) / (t.mass_kg * 9.81) for t in trials.values()], axis=0)
        assert (thesis > share).all()  # 4 Hz trusts the force only where no walk is


def test_the_correction_does_not_follow_the_speed_once_the_clocks_agree(adults, faster):
    def change(aligned: bool) -> float:
        return float(np.mean([adults[s].bias(AUTO, aligned)[0] - faster[s].bias(AUTO, aligned)[0] for s in adults]))

    assert abs(change(aligned=True)) < 0.004
    assert change(aligned=False) > 0.005  # late force x speed: mistaken for an error of the table


def test_standing_still_is_the_truth_for_the_bias_estimated_while_walking(gait, children):
    """Quiet standing on a plate: the mean centre of pressure is the horizontal CoM. Seven children."""
    misses, bands = [], []
    for name, trial in children.items():
        folder = gait / "biomechzoo-sample-study" / name
        (path,) = folder.glob("Static*.c3d")
        standing = read_recording(path)
        marked = identify(list(standing.markers_m)).landmarks
        at = {k: np.nanmean(standing.markers_m[marked[k]], axis=0) for k in ("l_asis", "r_asis", "sacrum")}
        ahead = ((at["l_asis"] + at["r_asis"]) / 2 - at["sacrum"]) * [1.0, 1.0, 0.0]
        ahead /= np.linalg.norm(ahead)
        f = np.sum([p.force_n.mean(axis=0) for p in standing.plates], axis=0)
        nu = np.sum([p.moment_nm.mean(axis=0) for p in standing.plates], axis=0)
        pressure = np.array([-nu[1], nu[0], 0.0]) / f[2]
        table_error = heading(ahead) @ (np.nanmean(geometry(standing, folder).com_m, axis=0) - pressure)
        misses.append((-trial.bias(AUTO) - table_error)[:2])
        bands.append(trial.estimate(AUTO).sd_m[:, :2].mean(axis=0))
        assert np.abs(trial.bias(THESIS, aligned=False)[0] + table_error[0]) > np.abs(misses[-1][0])
    missed, band = np.array(misses), np.array(bands)
    assert (np.sqrt(np.mean(missed**2, axis=0)) < [0.0075, 0.005]).all()  # 6.0 and 3.7 mm
    assert (np.abs(missed) < 1.96 * band).mean() >= 0.85
