"""Body mass from the plates, by the impulse of the vertical force.

Over an interval of length T in which all contact force is measured, f_z = m (g + z'') gives

    int f_z dt = m (g T + v(T) - v(0)),

with v = z' the upward velocity of the centre of mass measured by the markers. This holds for any movement. In quiet
stance v is zero, and the plate acts as a scale. Both sides are weighted by a taper w that falls to zero over an eighth
of the interval at each end, and the right side is integrated by parts,

    m = int w f_z dt / (g int w dt - int w' v dt),

because a force latency and a velocity error have their largest effect at the ends of an interval: the spread among
walks of one adult falls from 0.44 to 0.36 %. The standard deviation follows from that of the velocity, which grows with
the movement, and from the denominator, to which a flight contributes nothing; calibration errors of the plates add to
it and are common to the trials of a laboratory.

Vertical motion of the body from its markers, to be compared with the vertical force of all contacts.

The height of the centre of mass comes from the segment model. If the model cannot be placed (a marker of the legs is
missing), the mean height of the pelvis markers is used instead, with a larger error.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from stridelab.conventions import GRAVITY_M_S2, Mask, Points, Series
from stridelab.recordings.gap_filling import true_runs
from stridelab.recordings.plate_contacts import filter_both_ways, vertical_force_n, whole_steps
from stridelab.recordings.recording import Recording, Window

BAND_HZ = 4.0
"""Low-pass of accelerations: steps and jumps lie below it; above it, soft tissue and marker noise dominate."""
VELOCITY_BAND_HZ = 10.0
"""Low-pass of velocities: 4 Hz would remove 6 % of those of a walk with 2 steps per second."""
PELVIS = ("l_asis", "r_asis", "l_psis", "r_psis", "sacrum")
_MIN_RUN_S = 0.25


@dataclass(frozen=True)
class VerticalMotion:
    """Height, upward velocity and acceleration of the centre of mass at the marker instants; NaN where unknown.

    The acceleration is low-passed at ``BAND_HZ``, the velocity at ``VELOCITY_BAND_HZ``, the height is not.
    ``from_pelvis`` is true if the pelvis is used instead of the centre of mass.
    """

    height_m: Series
    velocity_m_s: Series
    acceleration_m_s2: Series
    from_pelvis: bool = False

    @property
    def known_frames(self) -> Mask:
        """Frames whose motion is known."""
        return np.asarray(np.isfinite(self.acceleration_m_s2))


def vertical_motion(
    recording: Recording, landmarks: Mapping[str, str], com_m: Points | None = None
) -> VerticalMotion | None:
    """Motion of ``com_m`` (frames x 3, the geometric centre of mass), else of the pelvis; None without either."""
    if com_m is not None:
        return _differentiate_height(com_m[:, 2], recording.marker_rate_hz, from_pelvis=False)
    labels = [landmarks[name] for name in PELVIS if landmarks.get(name) in recording.markers_m]
    if not labels:
        return None
    height_m = np.mean([recording.markers_m[label][:, 2] for label in labels], axis=0)
    return _differentiate_height(height_m, recording.marker_rate_hz, from_pelvis=True)


def low_band(track: Series, rate_hz: float, band_hz: float = BAND_HZ) -> Series:
    """Zero-phase Butterworth low-pass of second order; too slowly sampled tracks are returned unchanged."""
    if rate_hz <= 2.5 * band_hz or len(track) < 3:
        return track
    pad = min(len(track) - 1, round(rate_hz / band_hz))
    return filter_both_ways(track, rate_hz, band_hz, pad)


def _differentiate_height(height_m: Series, rate_hz: float, *, from_pelvis: bool) -> VerticalMotion | None:
    velocity = np.full(len(height_m), np.nan)
    acceleration = velocity.copy()
    for i, j in true_runs(np.isfinite(height_m)):
        if j - i >= max(3.0, _MIN_RUN_S * rate_hz):
            velocity[i:j] = np.gradient(low_band(height_m[i:j], rate_hz, VELOCITY_BAND_HZ)) * rate_hz
            slow = low_band(height_m[i:j], rate_hz)
            acceleration[i:j] = np.gradient(np.gradient(slow)) * rate_hz**2
    if not np.isfinite(velocity).any():
        return None
    return VerticalMotion(height_m, velocity, acceleration, from_pelvis)


MassKind = Literal["standing", "impulse", "whole_steps", "session"]

CALIBRATION_SHARE = 0.01
"""Relative standard deviation of a plate's gain."""
_STILL_M_S, _VELOCITY_SHARE, _PELVIS_SHARE = 0.003, 0.2, 0.4
"""Error of the velocity: in quiet stance, and as a share of the root mean square of the velocity."""
_TAPERED_SHARE = 0.25
ZERO_SD_KG = 0.1
"""Mass that corresponds to a zero offset of 1 N of the plates."""
UNCHECKED_ZERO_SD_KG = 1.0
"""The same for plates that are loaded all the time, so that their zero cannot be read: 11 N (RMS, 15 people)."""
_QUIET_M_S, _QUIET_N, _QUIET_S = 0.03, 0.05, 0.4
"""Quiet stance: limits of the velocity and of the force's deviation from its mean, and the shortest duration."""
_WHOLE_STEPS_SHARE = 0.03
_MIN_SPAN_S = 0.25


@dataclass(frozen=True)
class MassEstimate:
    """Body mass with its standard deviation; ``total_sd_kg`` adds the calibration error of the plates.

    ``kind`` is the method: quiet stance, impulse of a movement, whole steps that are assumed periodic, or pooled over
    the trials of a session. ``duration_s`` is the time over which force was measured.
    """

    mass_kg: float
    sd_kg: float
    kind: MassKind
    duration_s: float

    @property
    def total_sd_kg(self) -> float:
        """Standard deviation including the calibration error of the plates."""
        return float(np.hypot(self.sd_kg, CALIBRATION_SHARE * self.mass_kg))


def weigh(
    recording: Recording, windows: Sequence[Window], motion: VerticalMotion | None = None
) -> tuple[MassEstimate, ...]:
    """Estimate the body mass from the force in the ``windows``: at most one estimate of each kind, possibly none.

    ``windows`` are those of ``find_windows``, ``motion`` is the result of ``vertical_motion``. Without a motion, whole
    steps of a walk are assumed periodic (accurate to 3 % at self-selected speed), and in quiet stance the plate is read
    as a scale.
    """
    if not any(plate.use for plate in recording.plates) or not windows:
        return ()
    quiet = [span for window in windows for span in _quiet_spans(recording, window, motion)]
    estimates = [_by_impulse(recording, quiet, motion, "standing")]
    if motion is not None:
        estimates.append(_by_impulse(recording, windows, motion, "impulse"))
    else:
        steps = [Window(*span) for window in windows for span in whole_steps(recording, window)]
        estimates.append(_by_impulse(recording, steps, None, "whole_steps"))
    return tuple(estimate for estimate in estimates if estimate is not None)


def best_mass(estimates: Sequence[MassEstimate]) -> MassEstimate | None:
    """Estimate of one trial with the smallest standard deviation; the others use the same force and add nothing."""
    return min(estimates, key=lambda estimate: estimate.sd_kg, default=None)


def combined_mass(estimates: Sequence[MassEstimate]) -> MassEstimate | None:
    """Mean of *independent* estimates (one per trial), weighted by 1 / sd^2.

    If they differ by more than their standard deviations explain, sd is scaled up by sqrt(chi^2 / dof).
    """
    if len(estimates) < 2:
        return next(iter(estimates), None)
    weights = np.array([1.0 / estimate.sd_kg**2 for estimate in estimates])
    masses = np.array([estimate.mass_kg for estimate in estimates])
    mean_kg = float(weights @ masses / weights.sum())
    chi2 = float(weights @ (masses - mean_kg) ** 2)
    scale = max(1.0, float(np.sqrt(chi2 / max(len(masses) - 1, 1))))
    sharpest = min(estimates, key=lambda estimate: estimate.sd_kg)
    duration_s = sum(estimate.duration_s for estimate in estimates)
    return replace(sharpest, mass_kg=mean_kg, sd_kg=scale / float(np.sqrt(weights.sum())), duration_s=duration_s)


def _by_impulse(
    recording: Recording, spans: Sequence[Window], motion: VerticalMotion | None, kind: MassKind
) -> MassEstimate | None:
    """Impulse of all spans over the required impulse per kilogram; sd from velocity errors at both ends.

    A time in flight requires no impulse: it does not make the velocity errors smaller.
    """
    up_n, rate_hz = vertical_force_n(recording), recording.force_rate_hz
    impulse_ns, at_rest_m_s, changed_m_s, duration_s, variance = 0.0, 0.0, 0.0, 0.0, 0.0
    for span in _with_known_motion(recording, spans, motion):
        i, j = round(span.start_s * rate_hz), min(round(span.end_s * rate_hz), len(up_n) - 1)
        if (j - i) / rate_hz < _MIN_SPAN_S:
            continue
        w = np.ones(j - i + 1)
        if kind != "whole_steps":  # a Tukey window
            from_edge = 2.0 * np.arange(j - i + 1) / (_TAPERED_SHARE * (j - i))
            w = 0.5 - 0.5 * np.cos(np.pi * np.minimum(1.0, np.minimum(from_edge, from_edge[::-1])))
        v = _velocity_m_s(recording, np.arange(i, j + 1) / rate_hz, motion)
        impulse_ns += float(np.trapezoid(w * up_n[i : j + 1])) / rate_hz
        at_rest_m_s += float(GRAVITY_M_S2 * np.trapezoid(w) / rate_hz)
        changed_m_s += float(-np.trapezoid(np.gradient(w) * v))
        duration_s += (j - i) / rate_hz
        share = _PELVIS_SHARE if motion is not None and motion.from_pelvis else _VELOCITY_SHARE
        variance += 2.0 * float(_STILL_M_S**2 + share**2 * np.mean(v**2))
    needed_m_s = at_rest_m_s + changed_m_s
    if duration_s == 0.0 or needed_m_s <= 0.0 or impulse_ns <= 0.0:
        return None
    mass_kg = impulse_ns / needed_m_s
    share = float(np.sqrt(variance)) / (GRAVITY_M_S2 * duration_s) * at_rest_m_s / needed_m_s
    share = _WHOLE_STEPS_SHARE if kind == "whole_steps" else share
    checked = not any(p.use and p.loaded.all() and not p.zero_is_known for p in recording.plates)
    zero_kg = ZERO_SD_KG if checked else UNCHECKED_ZERO_SD_KG
    return MassEstimate(mass_kg, float(np.hypot(mass_kg * share, zero_kg)), kind, duration_s)


def _velocity_m_s(recording: Recording, time_s: Series, motion: VerticalMotion | None) -> Series:
    """Upward velocity at the force samples; zero without a motion (quiet stance, or the mean over a whole step)."""
    if motion is None:
        return np.zeros_like(time_s)
    known = motion.known_frames
    return np.asarray(np.interp(time_s, recording.time_s[known], motion.velocity_m_s[known]))


def _with_known_motion(recording: Recording, spans: Sequence[Window], motion: VerticalMotion | None) -> list[Window]:
    """The parts of the spans in which the motion is known."""
    if motion is None:
        return list(spans)
    rate_hz = recording.marker_rate_hz
    parts = []
    for span in spans:
        i, j = round(span.start_s * rate_hz), round(span.end_s * rate_hz) + 1
        parts += [Window((i + a) / rate_hz, (i + b - 1) / rate_hz) for a, b in true_runs(motion.known_frames[i:j])]
    return parts


def _quiet_spans(recording: Recording, window: Window, motion: VerticalMotion | None) -> list[Window]:
    """Intervals of quiet stance: steady force and, if the motion is known, almost no vertical velocity."""
    rate_hz = recording.marker_rate_hz
    up_n = vertical_force_n(recording)
    force_s = np.arange(len(up_n)) / recording.force_rate_hz
    i, j = round(window.start_s * rate_hz), round(window.end_s * rate_hz) + 1
    at_frames = np.interp(recording.time_s[i:j], force_s, up_n)
    if motion is None:
        still = np.full(len(at_frames), recording.walking_direction is None)
    else:
        still = np.abs(np.nan_to_num(motion.velocity_m_s[i:j], nan=np.inf)) < _QUIET_M_S
    quiet = []
    for a, b in true_runs(still):
        steady = float(np.std(at_frames[a:b])) < _QUIET_N * float(np.mean(at_frames[a:b]))
        if (b - a - 1) / rate_hz >= _QUIET_S and steady:
            quiet.append(Window((i + a) / rate_hz, (i + b - 1) / rate_hz))
    return quiet
