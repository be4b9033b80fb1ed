"""Simulated laboratory recording of a human walk, with its ground truth."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float
from numpy.random import Generator

from stridelab.body import segment_tables
from stridelab.conventions import Points, Series, Vector3
from stridelab.recordings.recording import Event, Plate, Recording, Side, Subject
from stridelab.simulation.force_plates import LabName, PlateArea, plate_areas, plate_wrench
from stridelab.simulation.ground_truth import true_motion
from stridelab.simulation.human.body_model import Configurations
from stridelab.simulation.human.gait_plan import GaitPlan
from stridelab.simulation.human.load_sharing import FootWrench
from stridelab.simulation.human.marker_layout import marker_tracks, skin_displacements
from stridelab.simulation.human.walker import Walk
from stridelab.simulation.noise import MeasurementNoise, coloured_noise, perturb_table

MARKER_RATE_HZ: Final = 100.0
FORCE_RATE_HZ: Final = 1000.0
PLATE_TYPE: Final = 2


ReadSeries = Float[np.ndarray, "m"]
ReadPoints = Float[np.ndarray, "m 3"]


@dataclass(frozen=True)
class Truth:
    """Exact motion at the marker instants. Angular momentum about the centre of mass, wrench at the world origin."""

    time_s: Series
    com_m: Points
    l_nms: Points
    force_n: Points
    moment_nm: Points


@dataclass(frozen=True)
class SimulatedRecording:
    """A recording and its ground truth."""

    recording: Recording
    truth: Truth


def record(
    walk: Walk, noise: MeasurementNoise, seed: int, *, lab: LabName = "walkway", skin_moves: bool = False
) -> SimulatedRecording:
    """Record markers at 100 Hz and plates at 1000 Hz; deterministic for the same walk, noise and seed, bit for bit.

    Every part of the noise has its own random stream: disabling one does not change the others. ``skin_moves``: markers
    move with the skin (``marker_layout.skin_displacements``), in the rhythm of the strikes of the left foot; there must
    be two.
    """
    rngs = [np.random.default_rng([seed, part]) for part in range(5)]
    n = round(walk.duration_s * MARKER_RATE_HZ)
    time_s = np.arange(n) / MARKER_RATE_HZ
    truth = true_motion(walk.body, walk.posture, time_s)
    table = walk.body.table
    if noise.mass_model > 0.0:
        table = perturb_table(table, noise.mass_model, rngs[3])
    p = walk.body.proportions
    markers_m = _noisy_markers(walk, time_s, noise, rngs[0], rngs[1])
    if skin_moves:
        moved = skin_displacements(_stride_phase(walk.plan, time_s), rngs[4])
        markers_m = {label: track + moved[label] for label, track in markers_m.items()}
    recording = Recording(
        markers_m=markers_m,
        marker_rate_hz=MARKER_RATE_HZ,
        force_rate_hz=FORCE_RATE_HZ,
        plates=measured_plates(walk.feet, walk.truth.time_s, walk.plan, n, noise, lab, rngs[2]),
        subject=Subject(p.height_m, walk.mass_kg, p.sex),
        events=gait_events(walk.plan),
        up_axis="+z",
        walking_direction=np.array([1.0, 0.0, 0.0]) if walk.plan.walks else None,
        carried={"segment_table": segment_tables.to_json(table)},
    )
    return SimulatedRecording(recording, Truth(time_s, truth.com_m, truth.momentum_nms, truth.force_n, truth.moment_nm))


def _noisy_markers(
    walk: Walk, time_s: Series, noise: MeasurementNoise, joints: Generator, skin: Generator
) -> Mapping[str, Points]:
    q: Configurations = walk.posture(time_s)
    if noise.configuration_rad > 0.0:
        n_joints = q.shape[1] - 6
        q[:, 6:] += coloured_noise(joints, len(q), n_joints, noise.configuration_rad, MARKER_RATE_HZ)
    tracks = marker_tracks(walk.body, q)
    return {label: track + noise.marker_m * skin.standard_normal(track.shape) for label, track in tracks.items()}


def _stride_phase(plan: GaitPlan, time_s: Series) -> Series:
    """Strides of the left foot since its first strike, linear between strikes and beyond them."""
    strikes = sorted(one.strike_s for one in plan.stances if one.side == "left" and np.isfinite(one.strike_s))
    strikes_s = np.array(strikes) - plan.record_from_s
    phase = np.interp(time_s, strikes_s, np.arange(len(strikes_s), dtype=float))
    stride_s = float(np.mean(np.diff(strikes_s)))
    before, after = np.minimum(time_s - strikes_s[0], 0.0), np.maximum(time_s - strikes_s[-1], 0.0)
    return np.asarray(phase + (before + after) / stride_s)


def measured_plates(
    feet: Mapping[Side, FootWrench],
    time_s: Series,
    plan: GaitPlan,
    n_frames: int,
    noise: MeasurementNoise,
    lab: LabName,
    rng: Generator,
) -> tuple[Plate, ...]:
    """Plate measurements of ``feet``, given at ``time_s``, which must extend beyond the recording."""
    read_at_s = np.arange(round(n_frames * FORCE_RATE_HZ / MARKER_RATE_HZ)) / FORCE_RATE_HZ - noise.latency_s
    late = {side: _interpolate_wrench(foot, time_s, read_at_s) for side, foot in feet.items()}
    areas = plate_areas(lab, plan)
    return tuple(_noisy_plate(index, area, late, noise, rng) for index, area in enumerate(areas, start=1))


def _noisy_plate(
    index: int, area: PlateArea, feet: Mapping[Side, FootWrench], noise: MeasurementNoise, rng: Generator
) -> Plate:
    force, moment = plate_wrench(area, feet)
    n = len(force)
    if noise.force_n > 0.0:
        force_noise = coloured_noise(rng, n, 3, noise.force_n, FORCE_RATE_HZ)
        force, moment = force + force_noise, moment + np.cross(area.middle_m, force_noise)
    if noise.moment_nm > 0.0:
        moment = moment + coloured_noise(rng, n, 3, noise.moment_nm, FORCE_RATE_HZ)
    nothing: Vector3 = np.zeros(3)
    return Plate(index, PLATE_TYPE, area.corners_m, force, moment, nothing)


def _interpolate_wrench(foot: FootWrench, time_s: Series, at_s: ReadSeries) -> FootWrench:
    """Interpolate the wrench (linear between samples of 1 ms; exact without latency)."""

    def interpolate_track(track: Points) -> ReadPoints:
        return np.column_stack([np.interp(at_s, time_s, track[:, axis]) for axis in range(3)])

    return FootWrench(
        interpolate_track(foot.force_n), interpolate_track(foot.cop_m), np.interp(at_s, time_s, foot.free_moment_nm)
    )


def gait_events(plan: GaitPlan) -> tuple[Event, ...]:
    """Foot strikes and toe-offs within the recording."""
    all_events = []
    for stance in plan.stances:
        all_events.append(Event(stance.strike_s - plan.record_from_s, "foot_strike", stance.side))
        all_events.append(Event(stance.off_s - plan.record_from_s, "foot_off", stance.side))
    recorded = [event for event in all_events if 0.0 <= event.time_s < plan.duration_s]
    return tuple(sorted(recorded, key=lambda event: event.time_s))
