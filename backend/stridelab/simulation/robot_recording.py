"""Simulated laboratory recording of a walk of a robot: markers on its links, force plates and ground truth.

Plates, noise and seeds are those of the simulated subject (``human_recording``).
"""

import numpy as np
from scipy.interpolate import CubicSpline

from stridelab.body import segment_tables
from stridelab.conventions import Series
from stridelab.recordings.recording import Recording, Subject
from stridelab.simulation.force_plates import LabName
from stridelab.simulation.ground_truth import TrueMotion
from stridelab.simulation.human.load_sharing import share_wrench
from stridelab.simulation.human_recording import (
    FORCE_RATE_HZ,
    MARKER_RATE_HZ,
    SimulatedRecording,
    Truth,
    gait_events,
    measured_plates,
)
from stridelab.simulation.noise import MeasurementNoise, coloured_noise, perturb_table
from stridelab.simulation.robot.markers import marker_tracks, segment_table, stature_m
from stridelab.simulation.robot.walker import RATE_HZ, RobotWalk

_MARGIN_S = 0.1
_EPS_S = 1e-9


def record_robot(
    walk: RobotWalk, noise: MeasurementNoise, seed: int, *, lab: LabName = "walkway"
) -> SimulatedRecording:
    """Record markers at 100 Hz and plates at 1000 Hz; deterministic for the same walk, noise and seed, bit for bit."""
    rngs = [np.random.default_rng([seed, part]) for part in range(4)]
    n, every = round(walk.plan.duration_s * MARKER_RATE_HZ), round(RATE_HZ / MARKER_RATE_HZ)
    first = int(np.searchsorted(walk.motion.time_s, -_EPS_S))
    frames = slice(first, first + every * n, every)
    table = segment_table(walk.robot, walk.motion.q[first])
    if noise.mass_model > 0.0:
        table = perturb_table(table, noise.mass_model, rngs[3])
    q = walk.motion.q[frames].copy()
    if noise.configuration_rad > 0.0:
        q[:, 7:] += coloured_noise(rngs[0], n, q.shape[1] - 7, noise.configuration_rad, MARKER_RATE_HZ)
    markers = {
        label: track + noise.marker_m * rngs[1].standard_normal(track.shape)
        for label, track in marker_tracks(walk.robot, q).items()
    }
    at_s = np.arange(-_MARGIN_S, n / MARKER_RATE_HZ + _MARGIN_S, 1.0 / FORCE_RATE_HZ)
    feet = share_wrench(_resample_motion(walk.truth, at_s), walk.load, walk.motion.time_s)
    recording = Recording(
        markers_m=markers,
        marker_rate_hz=MARKER_RATE_HZ,
        force_rate_hz=FORCE_RATE_HZ,
        plates=measured_plates(feet, at_s, walk.plan, n, noise, lab, rngs[2]),
        subject=Subject(stature_m(walk.robot), walk.robot.mass_kg),
        events=gait_events(walk.plan),
        up_axis="+z",
        walking_direction=np.array([1.0, 0.0, 0.0]) if walk.plan.walks else None,
        carried={"segment_table": segment_tables.to_json(table)},
    )
    truth, time_s = walk.truth, np.arange(n) / MARKER_RATE_HZ
    com_m, l_nms = truth.com_m[frames], truth.momentum_nms[frames]
    return SimulatedRecording(recording, Truth(time_s, com_m, l_nms, truth.force_n[frames], truth.moment_nm[frames]))


def _resample_motion(truth: TrueMotion, at_s: Series) -> TrueMotion:
    """Resample the motion by cubic splines (the forces of a walk have no content above 50 Hz)."""
    tracks = (
        truth.com_m,
        truth.velocity_m_s,
        truth.acceleration_m_s2,
        truth.momentum_nms,
        truth.momentum_rate_nm,
    )
    splines = CubicSpline(truth.time_s, np.stack(tracks, axis=1))(at_s)
    return TrueMotion(at_s, truth.mass_kg, *(np.ascontiguousarray(splines[:, k]) for k in range(len(tracks))))
