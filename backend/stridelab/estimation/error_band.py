"""Standard deviation of a fused CoM: prior errors of the inputs, propagated through the filters that fuse them.

The fusion is linear in its three signals, so the error of the result is the fusion of the errors. Each source below is
independent of the others; its signals (delta g, delta a, delta p) go through ``forward_backward``, initial states
included, and the squares add up:

- the segment table: a constant offset of g per axis. Its projection on the axis has only the component along the force,
  delta p = (n . delta) n, so the force removes the offset horizontally but not along the force: the band of z is the
  prior of the table.
- angular momentum: L' displaces the axis by f x L' / f^2 (``central_axis``); a line at the step frequency about the
  lateral axis and one at the stride frequency about the walking axis, of unknown phase.
- plates: a constant error of the acceleration (offset of a plate, wrong mass) and a constant error of the moment.
- clocks: force and moment are known up to ``clock_s``, which shifts p by velocity times that and a by jerk times that.
- marker and force noise: white, through the energy of the filters' impulse response in mid-record.

The values are priors, not estimates; the defaults have the size of the errors in real recordings
(docs/theory/complementary-filter.md). The band does not contain a bias that is missing from the priors.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from stridelab.conventions import Points
from stridelab.dynamics.wrench import AXIS_THRESHOLD_N, Wrench, com_acceleration
from stridelab.estimation.complementary.forward_backward import FilterInputs
from stridelab.estimation.differentiation import smoothed_derivatives, walk_frame
from stridelab.estimation.error_priors import ErrorPriors, SdPerAxis

WindowPoints = Float[np.ndarray, "window 3"]


def geometry_sd_m(table_sd_m: SdPerAxis, samples: int, priors: ErrorPriors) -> Points:
    """Standard deviation of the geometry alone: table error and marker noise."""
    return np.tile(np.hypot(np.asarray(table_sd_m), priors.marker_m), (samples, 1))


@dataclass(frozen=True)
class FusedStretch:
    """Filtered stretch: ``wrench`` over the window, ``velocity_m_s`` of the geometry over the whole stretch.

    ``within`` is the window in samples of the stretch.
    """

    wrench: Wrench
    velocity_m_s: Points
    within: slice
    rate_hz: float
    mass_kg: float

    @property
    def zero_signal(self) -> Points:
        """Zeros at every sample of the stretch."""
        return np.zeros_like(self.velocity_m_s)

    def padded_signal(self, signal: WindowPoints) -> Points:
        """Extend a signal of the window to the stretch with zeros."""
        whole = self.zero_signal
        whole[self.within] = signal
        return whole


def propagated_sd_m(
    fuse: Callable[[Sequence[FilterInputs]], Sequence[Points]],
    stretch: FusedStretch,
    table_sd_m: SdPerAxis,
    priors: ErrorPriors,
) -> WindowPoints:
    """Standard deviation per axis at the samples of the window, for any fusion that is linear in its inputs.

    ``fuse`` takes several error signals at once and returns the effect of each on the fused position.
    """
    errors = list(_error_signals(stretch, table_sd_m, priors))
    *fused, geometry, force = fuse([*errors, *_noise_pulses(stretch)])
    white = priors.marker_m**2 * (geometry**2).sum(axis=0)
    white = white + (priors.force_n / stretch.mass_kg) ** 2 * (force**2).sum(axis=0)
    total = white + np.zeros_like(stretch.wrench.force_n)
    for moved in fused:
        total += moved[stretch.within] ** 2
    return np.asarray(np.sqrt(total))


def _error_signals(stretch: FusedStretch, table_sd_m: SdPerAxis, priors: ErrorPriors) -> Iterator[FilterInputs]:
    """Yield one error signal of one standard deviation per independent source."""
    silence, inside = stretch.zero_signal, stretch.padded_signal
    f = stretch.wrench.force_n
    norm = np.linalg.norm(f, axis=1, keepdims=True)
    defined = norm > AXIS_THRESHOLD_N
    n = f / np.maximum(norm, AXIS_THRESHOLD_N)

    def of_moment(nu: WindowPoints) -> FilterInputs:
        p = np.cross(n, nu) / np.maximum(norm, AXIS_THRESHOLD_N) * defined
        return FilterInputs(silence, silence, inside(p))

    for axis, sd in zip(np.eye(3), table_sd_m, strict=True):
        g = silence + sd * axis
        p = g.copy()
        p[stretch.within] = np.where(defined, (n @ (sd * axis))[:, None] * n, sd * axis)
        yield FilterInputs(g, silence, p)
    for axis, sd in zip(np.eye(3), priors.acceleration_m_s2, strict=True):
        yield FilterInputs(silence, inside(np.zeros_like(f) + sd * axis), silence)
    for axis in np.eye(3)[:2]:
        yield of_moment(np.zeros_like(f) + priors.moment_nm * axis)
    t = np.arange(len(f)) / stretch.rate_hz
    ahead = walk_frame(stretch.velocity_m_s)[0]
    lateral = np.array([-ahead[1], ahead[0], 0.0])
    for axis, rate, hz in zip(
        (ahead, lateral), priors.momentum_rate_nm_kg, (priors.step_hz / 2, priors.step_hz), strict=True
    ):
        for wave in (np.cos, np.sin):
            yield of_moment(np.outer(stretch.mass_kg * rate * wave(2 * np.pi * hz * t), axis))
    jerk = smoothed_derivatives(com_acceleration(f, stretch.mass_kg), stretch.rate_hz)[0]
    late = stretch.velocity_m_s[stretch.within] * defined
    yield FilterInputs(silence, inside(priors.clock_s * jerk), inside(priors.clock_s * late))


def _noise_pulses(stretch: FusedStretch) -> tuple[FilterInputs, FilterInputs]:
    """Unit pulses of marker noise (in g, and in p along the force only) and of force noise (in a).

    They lie in the middle of the window; the energy of the response is the gain for white noise.
    """
    silence, pulse = stretch.zero_signal, stretch.zero_signal
    pulse[(stretch.within.start + stretch.within.stop) // 2] = 1.0
    return FilterInputs(pulse, silence, pulse * [0.0, 0.0, 1.0]), FilterInputs(silence, pulse, silence)
