"""Walks of real people with a known truth: their segments' tracks, taken as point masses, move exactly.

The low-passed tracks have a centre of mass, a force and an angular momentum without error. Table, markers, plates, mass
and clock then err by the sizes that the smoother assumes by default; the clocks have not been compared. What is real is
the movement; the errors are drawn from the priors, which is kind to the smoother, and so are the independent samples of
the noise.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Literal

import numpy as np
from numpy.random import Generator
from scipy.interpolate import CubicSpline, make_interp_spline

from stridelab.body.geometric_com import GeometricCom, SegmentTrack
from stridelab.conventions import GRAVITY_M_S2, Points, Series
from stridelab.estimation.complementary.filter import ComplementaryFilter
from stridelab.estimation.differentiation import low_pass, walk_frame
from stridelab.estimation.estimator import ComEstimator
from stridelab.estimation.kalman.filter import RtsSmoother
from stridelab.estimation.latency import estimate_latency
from stridelab.estimation.markers_only import GeometryOnly
from stridelab.estimation.smoother import Smoother, SmootherPriors
from stridelab.recordings.gap_filling import true_runs
from stridelab.recordings.recording import Window, WrenchTrack
from stridelab.reproduction.common.recorded_walks import RecordedWalk

TRACKS_HZ, MARKERS_HZ = 10.0, 6.0
"""Band of the tracks, and of markers that a laboratory has filtered."""
MARGIN_S: Final = 0.1
TURNS: Final = ((1.15, 0.25), (1.4, 0.15))
"""L' of people over that of their segments as point masses, about the walking and the lateral axis (smoother.md)."""
ESTIMATORS: Final[Mapping[str, ComEstimator]] = {
    "geometry": GeometryOnly(),
    "thesis": ComplementaryFilter.thesis(),
    "complementary": ComplementaryFilter(),
    "rts": RtsSmoother.tuned(),
    "smoother": Smoother(),
}

Markers = Literal["white", "filtered"]


@dataclass(frozen=True, eq=False)
class ExactWalk:
    """A walk of point masses: positions, force, and the rate of the angular momentum about the centre of mass."""

    time_s: Series
    mass_kg: float
    fraction: Mapping[str, float]
    segment_m: Mapping[str, Points]
    com_m: Points
    force_n: Points
    momentum_rate_nm: Points
    windows: tuple[Window, ...]
    sd_m: tuple[float, float, float]

    @property
    def rate_hz(self) -> float:
        """Sampling rate."""
        return float(1.0 / np.median(np.diff(self.time_s)))


@dataclass(frozen=True, kw_only=True)
class TrackErrors:
    """Which errors are drawn.

    Markers with white noise, or filtered ones; the force over the ``whole`` walk, or over the plates of the recording.
    With ``rolls`` the moments have the further error of feet that roll over plates, and the segments turn.
    """

    markers: Markers
    whole: bool
    rolls: bool


def exact_walk(path: Path) -> ExactWalk:
    """The longest stretch of a recording in which all segments are known. Raises as ``RecordedWalk.from_file``."""
    walk = RecordedWalk.from_file(path)
    geometric = walk.geometric
    tracks = np.array([segment.com_m for segment in geometric.segments.values()])
    edges = np.flatnonzero(np.diff(np.isfinite(tracks).all(axis=(0, 2)).astype(int), prepend=0, append=0))
    first, stop = max(zip(edges[::2], edges[1::2], strict=True), key=lambda pair: pair[1] - pair[0])
    t = geometric.time_s[first:stop]
    rate_hz = float(1.0 / np.median(np.diff(t)))
    total = sum(segment.mass_fraction for segment in geometric.segments.values())
    fraction = {name: segment.mass_fraction / total for name, segment in geometric.segments.items()}
    segment_m = {
        name: low_pass(segment.com_m[first:stop], rate_hz, TRACKS_HZ) for name, segment in geometric.segments.items()
    }

    def accelerate(track: Points) -> Points:
        return np.asarray(make_interp_spline(t, track, k=5)(t, 2))

    com = np.sum([fraction[name] * track for name, track in segment_m.items()], axis=0)
    momentum_rate = np.sum(
        [walk.mass_kg * fraction[k] * np.cross(track - com, accelerate(track - com)) for k, track in segment_m.items()],
        axis=0,
    )
    return ExactWalk(
        time_s=t,
        mass_kg=walk.mass_kg,
        fraction=fraction,
        segment_m=segment_m,
        com_m=com,
        force_n=walk.mass_kg * (accelerate(com) + np.array([0.0, 0.0, GRAVITY_M_S2])),
        momentum_rate_nm=momentum_rate,
        windows=tuple(window for window in walk.windows if window.start_s >= t[0] and window.end_s <= t[-1]),
        sd_m=geometric.sd_m,
    )


def draw_inputs(walk: ExactWalk, errors: TrackErrors, rng: Generator) -> tuple[GeometricCom, WrenchTrack, float]:
    """Geometry, wrench and mass with errors of default size."""
    markers, rolls = errors.markers, errors.rolls
    sizes, t, n = SmootherPriors(), walk.time_s, len(walk.time_s)
    kept = np.exp(-1.0 / (walk.rate_hz * sizes.table_varying_s))
    varying = rng.normal(size=(n, 3))
    for k in range(1, n):
        varying[k] = kept * varying[k - 1] + np.sqrt(1.0 - kept**2) * varying[k]
    table = rng.normal(0.0, walk.sd_m) + sizes.table_varying_m * varying * [1.0, 1.0, 1.0 / 3.0]
    noise = rng.normal(0.0, sizes.marker_m * (markers == "white"), (n, 3))

    def see(track: Points) -> Points:
        return (track if markers == "white" else low_pass(track, walk.rate_hz, MARKERS_HZ)) + table + noise

    frame = walk_frame(np.gradient(walk.com_m, t, axis=0))
    factors = [rng.normal(*size) if rolls else 1.0 for size in TURNS] + [1.0]
    along_nm, lateral_nm = (np.hypot(sizes.plate_moment_nm, rolls * size) for size in sizes.walking_moment_nm)
    moved_n = rng.normal(0.0, sizes.plate_force_n, 3) + rng.normal(0.0, sizes.force_n, (n, 3))
    moved_nm = rng.normal(0.0, [lateral_nm, along_nm, 0.0]) @ frame + rng.normal(0.0, sizes.moment_nm, (n, 3))
    moment = np.cross(walk.com_m, walk.force_n) + (walk.momentum_rate_nm @ frame.T * factors) @ frame
    moment += moved_nm + np.cross(walk.com_m * [1.0, 1.0, 0.0], moved_n)
    late = np.clip(t - rng.normal(0.0, sizes.clock_s), t[0], t[-1])
    read = CubicSpline(t, np.hstack([walk.force_n + moved_n, moment]))(late)
    windows = (Window(float(t[0] + MARGIN_S), float(t[-1] - MARGIN_S)),) if errors.whole else walk.windows
    complete = np.any([(t >= one.start_s - 1e-9) & (t <= one.end_s + 1e-9) for one in windows], axis=0)
    read[~complete] = np.nan
    geometric = GeometricCom(
        time_s=t,
        com_m=see(walk.com_m),
        table="tracks",
        segments={name: SegmentTrack(walk.fraction[name], see(track)) for name, track in walk.segment_m.items()},
        joint_centres_m={},
        sd_m=walk.sd_m,
    )
    mass_kg = walk.mass_kg * (1.0 + float(rng.normal(0.0, sizes.mass_share)))
    return geometric, WrenchTrack(t, read[:, :3], read[:, 3:], complete, windows, 0.0), mass_kg


def compare_clocks(geometric: GeometricCom, wrench: WrenchTrack, mass_kg: float) -> WrenchTrack:
    """The wrench after its clock has been compared, as recordings are prepared.

    Raises ``NotEstimable`` as ``estimate_latency`` does.
    """
    t = wrench.time_s
    both = np.hstack([wrench.force_n, wrench.moment_nm])
    runs = [(i, j) for i, j in true_runs(np.isfinite(both).all(axis=1) & wrench.complete) if j - i > 3]

    def wrench_at(latency_s: float) -> WrenchTrack:
        read, complete = np.full_like(both, np.nan), np.zeros(len(t), dtype=bool)
        for i, j in runs:
            at = t[i:j] + latency_s
            inside = (at >= t[i] - 1e-9) & (at <= t[j - 1] + 1e-9)
            read[i:j][inside] = CubicSpline(t[i:j], both[i:j])(at[inside])
            complete[i:j] = inside
        return replace(
            wrench,
            force_n=read[:, :3],
            moment_nm=read[:, 3:],
            complete=complete,
            latency_applied_s=latency_s,
            clocks_compared=True,
        )

    latency = estimate_latency(geometric, wrench_at, mass_kg)
    applied_s = latency.latency_s if latency.significant else 0.0
    return replace(wrench_at(applied_s), clock_sd_s=float(np.hypot(latency.sd_s, latency.latency_s - applied_s)))
