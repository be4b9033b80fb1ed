"""The clocks of force and markers: latency that was put in, and independent signs of it on real walks."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation

from stridelab.body.geometric_com import GeometricCom
from stridelab.body.segment_model import SegmentModel
from stridelab.conventions import Vector3
from stridelab.errors import NotEstimable
from stridelab.estimation.complementary.filter import ComplementaryFilter
from stridelab.estimation.differentiation import low_pass
from stridelab.estimation.evaluation.physics_residuals import bias_m
from stridelab.estimation.latency import REPEATABILITY_SD_S, Latency, estimate_latency
from stridelab.recordings.force_windows import measured_windows
from stridelab.recordings.marker_sets import identify
from stridelab.recordings.plate_contacts import loaded_intervals, wrench_track
from stridelab.recordings.reader import read_recording
from stridelab.recordings.recording import Plate, Recording, WrenchTrack
from stridelab.simulation.human.walker import HumanWalker, Walk
from stridelab.simulation.human_recording import record
from stridelab.simulation.noise import MeasurementNoise

WrenchAt = Callable[[float], WrenchTrack]


def wrench_reader(recording: Recording, landmarks: dict[str, str]) -> WrenchAt:
    return partial(late, recording, measured_windows(recording, landmarks))


def late(recording: Recording, windows, latency_s: float) -> WrenchTrack:  # type: ignore[no-untyped-def]
    return wrench_track(recording, windows, latency_s=latency_s)


# Simulated walks.


@pytest.fixture(scope="module")
def walks() -> list[Walk]:
    return [HumanWalker(speed_m_s=speed, duration_s=3.0, seed=k).walk() for k, speed in enumerate((0.9, 1.2, 1.5))]


def latency_in(walk: Walk, seed: int, lab: str, late_s: float, table_error: float) -> Latency:
    noise = MeasurementNoise(marker_m=0.001, mass_model=table_error, latency_s=late_s)
    recording = record(walk, noise, seed, lab=lab).recording  # type: ignore[arg-type]
    landmarks = dict(identify(list(recording.markers_m)).landmarks)
    geometric = SegmentModel(table="carried").com(recording, landmarks, subject=recording.subject)
    assert recording.subject.mass_kg is not None
    return estimate_latency(geometric, wrench_reader(recording, landmarks), recording.subject.mass_kg)


@pytest.mark.parametrize(("lab", "rms_ms"), [("walkway", 0.5), ("two_plates", 1.1)])
def test_a_latency_put_in_is_estimated_to_two_milliseconds(walks: list[Walk], lab: str, rms_ms: float) -> None:
    """With the person's own segment table, and with one that errs by 20 % in every segment's mass and lever."""
    for table_error in (0.0, 0.2):
        cases = [(walk, 2 * k + j, late_s) for k, walk in enumerate(walks) for j, late_s in enumerate((-0.010, 0.018))]
        result = [latency_in(walk, seed, lab, late_s, table_error) for walk, seed, late_s in cases]
        errors = np.array([one.latency_s - late_s for one, (_, _, late_s) in zip(result, cases, strict=True)])
        assert np.abs(errors).max() < 0.002
        assert 1e3 * np.sqrt(np.mean(errors**2)) < rms_ms
        z = errors / [one.sd_s for one in result]
        assert np.abs(z).max() < 3.0
        assert np.sqrt(np.mean(z**2)) < 1.6  # twelve trials; of 36 walks on two plates it is 0.9


def test_no_latency_is_estimated_where_there_is_none(walks: list[Walk]) -> None:
    result = [latency_in(walk, 10 + seed, "two_plates", 0.0, 0.2) for seed, walk in enumerate(walks)]
    assert all(REPEATABILITY_SD_S < one.sd_s < 0.002 for one in result), "no narrower than repeated trials of people"
    assert not any(one.significant for one in result)


def test_the_axes_of_the_laboratory_do_not_matter(walks: list[Walk]) -> None:
    recording = record(walks[1], MeasurementNoise(marker_m=0.001, mass_model=0.2, latency_s=0.018), 3).recording
    landmarks = dict(identify(list(recording.markers_m)).landmarks)
    geometric = SegmentModel(table="carried").com(recording, landmarks, subject=recording.subject)
    wrench_at = wrench_reader(recording, landmarks)
    R = Rotation.from_euler("z", 130, degrees=True).as_matrix()

    def turned(latency_s: float) -> WrenchTrack:
        track = wrench_at(latency_s)
        return replace(track, force_n=track.force_n @ R.T, moment_nm=track.moment_nm @ R.T)

    here, there = (estimate_latency(g, w, 60.0) for g, w in ((geometric, wrench_at), (geometric.rotated_to(R), turned)))
    assert there.latency_s == pytest.approx(here.latency_s, abs=1e-6)
    assert there.along.lag_s == pytest.approx(here.along.lag_s, abs=1e-6)


# Shared recordings.


@dataclass(frozen=True)
class Trial:
    """A walk in its own axes: forward, left, up."""

    recording: Recording
    landmarks: dict[str, str]
    R: np.ndarray
    geometric: GeometricCom
    wrench_at: WrenchAt
    mass_kg: float
    latency: Latency

    @property
    def speed_m_s(self) -> float:
        window = self.wrench_at(0.0).windows[0]
        t = self.geometric.time_s
        inside = (t > window.start_s) & (t < window.end_s)
        return float(np.polyfit(t[inside], self.geometric.com_m[inside, 0], 1)[0])

    def forward_offset_m(self, latency_s: float) -> float:
        """Fused minus geometric CoM, along the walk."""
        estimate = ComplementaryFilter().estimate(self.geometric, self.wrench_at(latency_s), self.mass_kg)
        return float(bias_m(estimate, self.geometric)[0])

    def heel_stop_s(self) -> float:
        """When the heel of a landing foot stops going forward (15 % of the walking speed), after its plate's onset."""
        result = []
        for plate in self.recording.plates:
            for onset_s, _ in loaded_intervals(plate, self.recording.force_rate_hz):
                heel = self.landed_heel(plate, onset_s)
                if onset_s < 0.1 or heel is None:
                    continue
                t = np.arange(len(heel)) / self.recording.marker_rate_hz
                track = make_interp_spline(t, low_pass(heel, self.recording.marker_rate_hz, 10.0), k=5)
                at = np.arange(onset_s - 0.08, onset_s + 0.08, 0.0005)
                going = np.flatnonzero(track(at, 1)[:, 0] > 0.15 * self.speed_m_s)
                result.append(float(at[going[-1]]) - onset_s)
        return float(np.mean(result)) if result else np.nan

    def landed_heel(self, plate: Plate, onset_s: float) -> np.ndarray | None:
        """The heel that is within 20 cm of the centre of pressure 50 ms after the onset; None where it is hidden."""
        i = int((onset_s + 0.05) * self.recording.force_rate_hz)
        f, nu = plate.force_n[i], plate.moment_nm[i]
        pressure = self.R @ np.array([-nu[1] / f[2], nu[0] / f[2], 0.0])
        frame = round((onset_s + 0.05) * self.recording.marker_rate_hz)
        for side in "lr":
            heel = self.recording.markers_m[self.landmarks[f"{side}_heel"]] @ self.R.T
            if np.isfinite(heel).all() and np.linalg.norm((heel[frame] - pressure)[:2]) < 0.2:
                return heel
        return None


def load(path: Path) -> Trial:
    recording = read_recording(path)
    ahead: Vector3 | None = recording.walking_direction
    mass_kg = recording.subject.mass_kg
    assert ahead is not None
    assert mass_kg is not None
    R = np.array([ahead, np.cross([0.0, 0.0, 1.0], ahead), [0.0, 0.0, 1.0]])
    landmarks = dict(identify(list(recording.markers_m)).landmarks)
    statics = sorted(path.parent.glob("*_ST.c3d"))
    static = read_recording(statics[0]) if statics else None
    geometric = SegmentModel().com(recording, landmarks, subject=recording.subject, static=static)
    geometric = geometric.rotated_to(R)
    read = wrench_reader(recording, landmarks)

    def turned(latency_s: float) -> WrenchTrack:
        track = read(latency_s)
        return replace(track, force_n=track.force_n @ R.T, moment_nm=track.moment_nm @ R.T)

    latency = estimate_latency(geometric, turned, mass_kg)
    return Trial(recording, landmarks, R, geometric, turned, mass_kg, latency)


@pytest.fixture(scope="module")
def adults(gait: Path) -> dict[str, tuple[Trial, Trial]]:
    """Each person at their own speed (C4) and faster (C5)."""
    result = {}
    for folder in sorted((gait / "rehazenter-adult-walking").iterdir()):
        own, fast = (sorted(folder.glob(f"*_{speed}_*.c3d")) for speed in ("C4", "C5"))
        if own and fast:
            result[folder.name] = (load(own[0]), load(fast[0]))
    return result


@pytest.fixture(scope="module")
def children(gait: Path) -> list[Trial]:
    return [load(path) for path in sorted((gait / "biomechzoo-sample-study").glob("*/Straight*.c3d"))]


def lags_ms(trials: list[Trial]) -> np.ndarray:
    return 1e3 * np.array([[t.latency.along.lag_s, t.latency.vertical.lag_s, t.latency.latency_s] for t in trials])


def test_each_axis_alone_has_the_median_of_before(adults, children) -> None:  # type: ignore[no-untyped-def]
    """Rehazenter 21 / 16 ms (C4) and 22 / 17 (C5), biomechZoo 14 / 8, along the walk and vertically."""
    own, fast = ([pair[k] for pair in adults.values()] for k in (0, 1))
    for trials, before in ((own, (21.0, 16.0)), (fast, (22.0, 17.0)), (children, (14.0, 8.0))):
        assert np.median(lags_ms(trials), axis=0)[:2] == pytest.approx(before, abs=2.0)


def test_a_person_has_the_same_latency_twice(adults) -> None:  # type: ignore[no-untyped-def]
    own, fast = (lags_ms([pair[k] for pair in adults.values()])[:, 2] for k in (0, 1))
    assert len(own) == 11
    assert abs(np.mean(own - fast)) < 1.2
    scatter_ms = np.std(own - fast, ddof=1) / np.sqrt(2)
    assert scatter_ms < 1.2  # 1.0 ms per recording
    stated_ms = 1e3 * np.mean([trial.latency.sd_s for pair in adults.values() for trial in pair])
    assert scatter_ms < 1.3 * stated_ms  # 1.2 ms
    assert np.std(own, ddof=1) > 4.5  # one person differs by 17 ms, both times


def test_the_medians_lie_between_those_of_the_axes(adults, children) -> None:  # type: ignore[no-untyped-def]
    own, fast = ([pair[k] for pair in adults.values()] for k in (0, 1))
    for trials, expected_ms in ((own, 17.3), (fast, 17.4), (children, 10.1)):
        along, vertical, both = np.median(lags_ms(trials), axis=0)
        assert vertical < both < along
        assert both == pytest.approx(expected_ms, abs=0.7)


def test_a_child_who_stands_has_no_latency(gait: Path) -> None:
    """One of the seven resembled a latency of 85 ms by chance: 0.1 % of the weight is no motion."""
    statics = sorted((gait / "biomechzoo-sample-study").glob("*/Static*.c3d"))
    assert len(statics) == 7
    for path in statics:
        recording = read_recording(path)
        landmarks = dict(identify(list(recording.markers_m)).landmarks)
        geometric = SegmentModel().com(recording, landmarks, subject=recording.subject)
        with pytest.raises(NotEstimable, match="quiet stance") as refusal:
            estimate_latency(geometric, wrench_reader(recording, landmarks), 30.0)
        assert refusal.value.code == "latency-unclear"


def test_which_latencies_are_taken_out(adults, children) -> None:  # type: ignore[no-untyped-def]
    """All but those of the one person whose clocks agree."""
    stored = {name for name, pair in adults.items() if not any(trial.latency.significant for trial in pair)}
    assert stored == {"2015026"}
    assert all(pair[k].latency.significant for name, pair in adults.items() if name not in stored for k in (0, 1))
    assert all(trial.latency.significant for trial in children)


def test_what_the_force_changes_grows_with_the_speed_until_the_clocks_agree(adults) -> None:  # type: ignore[no-untyped-def]
    """An independent sign: an offset proportional to speed is a time, an error of the table is not."""
    change: dict[str, list[float]] = {"raw": [], "aligned": []}
    faster = []
    for own, fast in adults.values():
        change["raw"].append(own.forward_offset_m(0.0) - fast.forward_offset_m(0.0))
        change["aligned"].append(
            own.forward_offset_m(own.latency.latency_s) - fast.forward_offset_m(fast.latency.latency_s)
        )
        faster.append(fast.speed_m_s - own.speed_m_s)
    raw, aligned = (1e3 * float(np.mean(change[name])) for name in ("raw", "aligned"))
    assert raw > 5.0
    assert aligned < 0.5 * raw  # 2.9 of 6.3 mm
    assert 0.010 < 1e-3 * raw / np.mean(faster) < 0.030  # metres per metre per second


def test_a_heel_that_stops_cannot_replace_the_accelerations_but_knows_the_odd_one_out(adults) -> None:  # type: ignore[no-untyped-def]
    """The direct sign scatters by 8 to 12 ms among people; the one whose force is early has the latest heel, twice."""
    for k in (0, 1):
        stop = {name: pair[k].heel_stop_s() for name, pair in adults.items()}
        values = np.array(list(stop.values()))
        assert np.isfinite(values).all()
        assert 0.0 < np.median(values) < 0.02
        assert 0.006 < np.std(values) < 0.014
        assert max(stop, key=lambda name: stop[name]) == "2015026"
