"""Zero-phase smoothed derivatives of a trajectory, exact for uniform motion.

Samples that an estimator may use: the window of its result, and the geometry around it.

Walking frame (along, lateral, vertical): axes for reporting errors independently of the walking direction.
"""

from dataclasses import dataclass

import numpy as np
from scipy import interpolate

from stridelab.body.geometric_com import GeometricCom
from stridelab.conventions import Points, Rotation
from stridelab.errors import Fault, InvalidInput, NotEstimable
from stridelab.recordings.force_windows import require_frames
from stridelab.recordings.gap_filling import true_runs
from stridelab.recordings.plate_contacts import filter_both_ways
from stridelab.recordings.recording import Window, WrenchTrack

BAND_HZ = 8.0
"""Band of the derivatives and of the force residual: above it noise dominates a marker trajectory."""


def low_pass(x: Points, rate_hz: float, band_hz: float = BAND_HZ) -> Points:
    """Second-order Butterworth, forward and backward (so -6 dB at ``band_hz``), with odd extension beyond the ends.

    A signal sampled too slowly to contain the band is returned unchanged.
    """
    if band_hz >= 0.45 * rate_hz:
        return x
    pad = min(len(x) - 1, 5 * int(np.ceil(rate_hz / band_hz)))
    return filter_both_ways(x, rate_hz, band_hz, pad)


def smoothed_derivatives(x: Points, rate_hz: float, band_hz: float = BAND_HZ) -> tuple[Points, Points]:
    """Velocity and acceleration of the low-passed trajectory, from a quintic spline through its samples.

    Needs at least 6 samples. At 1 Hz the low-pass reduces the amplitude by 2.4e-4.
    """
    t = np.arange(len(x)) / rate_hz
    spline = interpolate.make_interp_spline(t, low_pass(x, rate_hz, band_hz), k=5)
    return np.asarray(spline(t, 1)), np.asarray(spline(t, 2))


SHORTEST_WINDOW_S = 0.4
"""Shortest window in which the estimators are better than the geometry alone."""


@dataclass(frozen=True)
class Span:
    """Samples ``inside`` the window, and the longest gap-free run of geometry ``around`` it."""

    window: Window
    inside: slice
    around: slice
    rate_hz: float

    @property
    def within(self) -> slice:
        """The window's samples, counted from the start of ``around``."""
        return slice(self.inside.start - self.around.start, self.inside.stop - self.around.start)


def window_span(geometric: GeometricCom, wrench: WrenchTrack) -> Span:
    """Longest window in which all contact force is measured, as sample indices.

    Frames at the edges without force (a latency reads beyond the recorded end) are excluded. Raises ``NotEstimable``
    (``no-window``, ``window-too-short``, ``recording-too-short``, ``geometry-gaps``), and ``InvalidInput``
    (``clock-mismatch``) if geometry and force have different instants.
    """
    rate_hz = common_rate_hz(geometric, wrench)
    t = wrench.time_s
    measured = np.isfinite(wrench.force_n).all(axis=1) & np.isfinite(wrench.moment_nm).all(axis=1) & wrench.complete
    candidates = [
        run for w in wrench.windows for run in true_runs(measured & (t >= w.start_s - 1e-9) & (t <= w.end_s + 1e-9))
    ]
    if not candidates:
        raise NotEstimable(
            "no-window",
            "At no time is all contact force on the plates, so force and geometry cannot be combined. "
            "Is every foot that touches the ground on an enabled plate?",
        )
    first, stop = max(candidates, key=lambda run: run[1] - run[0])
    if (stop - first) / rate_hz < SHORTEST_WINDOW_S:
        raise NotEstimable(
            "window-too-short",
            f"All contact force is measured for {(stop - first) / rate_hz:.2f} s at a time; "
            f"at least {SHORTEST_WINDOW_S} s are needed.",
        )
    require_frames(stop - first)
    window = Window(float(t[first]), float(t[stop - 1]))
    inside = np.arange(first, stop)
    seen = np.isfinite(geometric.com_m).all(axis=1)
    if not seen[inside].all():
        raise NotEstimable(
            "geometry-gaps",
            "The segment model has no centre of mass for part of the window: markers are missing there.",
            [
                Fault("markers", f"missing from {t[inside[a]]:.2f} s to {t[inside[b - 1]]:.2f} s")
                for a, b in true_runs(~seen[inside])
            ],
        )
    around = next(slice(a, b) for a, b in true_runs(seen) if a <= first < b)
    return Span(window, slice(first, stop), around, rate_hz)


def common_rate_hz(geometric: GeometricCom, wrench: WrenchTrack) -> float:
    """Rate of the shared time axis; raises ``InvalidInput`` (``clock-mismatch``) if the axes differ."""
    t = geometric.time_s
    if len(t) < 2 or t.shape != wrench.time_s.shape or np.abs(t - wrench.time_s).max() > 1e-6:
        apart = ", ".join(
            f"{name} {len(at)} samples" + (f" from {at[0]:.2f} to {at[-1]:.2f} s" if len(at) else "")
            for name, at in (("geometry:", t), ("force:", wrench.time_s))
        )
        raise InvalidInput(
            "clock-mismatch", "Geometry and force are not given at the same instants.", [Fault("time_s", apart)]
        )
    return float((len(t) - 1) / (t[-1] - t[0]))


def require_mass(mass_kg: float) -> None:
    """Raise ``InvalidInput`` (``mass-out-of-range``) unless the mass is plausible for a body."""
    if not 1.0 < mass_kg < 1000.0:
        raise InvalidInput(
            "mass-out-of-range", f"A body mass of {mass_kg:g} kg is impossible.", [Fault("mass_kg", f"{mass_kg:g} kg")]
        )


WALKING_M_S = 0.05
"""Mean speed below which the body counts as staying in place, and the axes are those of the world."""


def walk_frame(velocity_m_s: Points) -> Rotation:
    """Unit vectors along the walk, to its left and up, as rows; ``track @ frame.T`` is in these axes."""
    mean = np.nanmean(velocity_m_s, axis=0) * [1.0, 1.0, 0.0]
    speed = float(np.linalg.norm(mean))
    along = mean / speed if speed > WALKING_M_S else np.array([1.0, 0.0, 0.0])
    up = np.array([0.0, 0.0, 1.0])
    return np.array([along, np.cross(up, along), up])
