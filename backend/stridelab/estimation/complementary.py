"""The linear complementary filter of section 2.4, online and offline.

Inputs (2.4.1): the geometric CoM, the acceleration from the force, the projection of the geometric CoM on the central
axis. With the filters of ``filters`` the forward pass is

    c = g - (s^2 H2) g + H2 a + H3 (p - g)          which is H1 g + H2 a + H3 p, since H1 = 1 - s^2 H2 - H3.

Offline, forward and backward passes are averaged (2.6.3). The thesis looks for the initial states that bring the two
passes together; on the short windows of real recordings that makes things worse (docs/theory/complementary-filter.md),
so the states are solved for one pass at a time, see ``initial_state``.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from jaxtyping import Float
from scipy import signal

from stridelab.body.geometric_com import GeometricCom
from stridelab.conventions import Points
from stridelab.dynamics.central_axis import AXIS_THRESHOLD_N, central_axis
from stridelab.dynamics.newton_euler import com_acceleration
from stridelab.dynamics.wrench import Wrench
from stridelab.estimation.derivatives import derivatives
from stridelab.estimation.estimate import ComEstimate
from stridelab.estimation.filters import ComplementaryFilters, DigitalFilter, complementary_filters
from stridelab.estimation.span import Span, require_mass, window_span
from stridelab.recordings.recording import WrenchTrack

State = Float[np.ndarray, "2 3"]
THESIS_LOW_HZ, THESIS_HIGH_HZ = 0.4, 4.0


@dataclass(frozen=True)
class FilterInputs:
    """The three input signals of section 2.4.1 at common instants, all about the world origin."""

    geometry_m: Points
    acceleration_m_s2: Points
    axis_point_m: Points

    def reversed(self) -> "FilterInputs":
        """The same motion told backwards: the equations of dynamics are symmetric in time (2.6.3)."""
        return FilterInputs(self.geometry_m[::-1], self.acceleration_m_s2[::-1], self.axis_point_m[::-1])


@dataclass(frozen=True)
class FilterState:
    """Memory of H2, s^2 H2 and H3 (transposed direct form), one column per axis."""

    h2: State
    s2_h2: State
    h3: State


def filter_inputs(geometry_m: Points, wrench: Wrench, mass_kg: float) -> FilterInputs:
    """The three signals from geometry and total wrench; where the axis is undefined, p is the geometry (2.6.2)."""
    axis = central_axis(wrench, AXIS_THRESHOLD_N)
    p = np.where(axis.defined[:, None], axis.project(geometry_m), geometry_m)
    return FilterInputs(geometry_m, com_acceleration(wrench.force_n, mass_kg), p)


def initial_state(filters: ComplementaryFilters, inputs: FilterInputs) -> FilterState:
    """State from which the forward pass has no transient.

    The high-frequency correction ``H2 (a - s^2 g)`` is zero whenever acceleration and geometry agree, in any motion;
    its two unknowns per axis are the least-squares solution that makes it smallest over the first 10 tau_1.
    ``H3 (p - g)`` starts at rest at the mean offset of the first 5 tau_2 (its settling time).
    """
    g, a, p = inputs.geometry_m, inputs.acceleration_m_s2, inputs.axis_point_m
    zero = np.zeros((2, 3))
    at_g0 = signal.lfilter_zi(filters.s2_h2.b, filters.s2_h2.a)[:, None] * g[0]
    n = min(len(g), max(8, int(10 * _memory(filters.h2))))
    correction = _run(filters.h2, a[:n], zero) - _run(filters.s2_h2, g[:n], at_g0)
    silence = np.zeros((n, 2))
    free = signal.lfilter([1.0], filters.h2.a, silence, axis=0, zi=np.eye(2))[0]
    m = min(len(g), max(1, int(5 * _memory(filters.h3))))
    return FilterState(
        h2=np.linalg.lstsq(free, -correction, rcond=None)[0],
        s2_h2=at_g0,
        h3=signal.lfilter_zi(filters.h3.b, filters.h3.a)[:, None] * (p - g)[:m].mean(axis=0),
    )


def forward(filters: ComplementaryFilters, inputs: FilterInputs, state: FilterState) -> Points:
    """One causal pass over all samples, in metres."""
    g, a, p = inputs.geometry_m, inputs.acceleration_m_s2, inputs.axis_point_m
    high = _run(filters.h2, a, state.h2) - _run(filters.s2_h2, g, state.s2_h2)
    return np.asarray(g + high + _run(filters.h3, p - g, state.h3))


def forward_backward(filters: ComplementaryFilters, inputs: FilterInputs) -> Points:
    """Mean of the forward and the backward pass, each from its own solved initial state, in metres."""
    there = forward(filters, inputs, initial_state(filters, inputs))
    mirror = inputs.reversed()
    back = forward(filters, mirror, initial_state(filters, mirror))
    return np.asarray((there + back[::-1]) / 2)


@dataclass(frozen=True, kw_only=True)
class ComplementaryFilter:
    """The thesis' estimator, offline: ``low_hz`` = f_2 for the central axis, ``high_hz`` = f_1 for the force.

    ``beyond_window`` says what stands in for the force outside the window: "cut" uses the window alone, as the thesis
    does; "geometry" filters the whole recording with p and a taken from the geometry there (the trick of 2.6.2);
    "auto" cuts windows of at least ``LONG_WINDOW_S`` and uses the geometry around shorter ones.
    """

    name: ClassVar[str] = "complementary"
    LONG_WINDOW_S: ClassVar[float] = 2.5

    low_hz: float = THESIS_LOW_HZ
    high_hz: float = THESIS_HIGH_HZ
    beyond_window: Literal["auto", "cut", "geometry"] = "auto"

    @classmethod
    def thesis(cls) -> "ComplementaryFilter":
        """The filter exactly as in the thesis: 0.4 and 4 Hz, on the window alone."""
        return cls(low_hz=THESIS_LOW_HZ, high_hz=THESIS_HIGH_HZ, beyond_window="cut")

    def estimate(self, geometric: GeometricCom, wrench: WrenchTrack, mass_kg: float) -> ComEstimate:
        """Fuse the three inputs over the longest window; the result lies at the window's samples.

        Raises ``NotEstimable`` or ``InvalidInput`` as ``window_span`` does, and ``InvalidInput`` with
        ``mass-out-of-range`` or ``cutoffs-out-of-range``.
        """
        require_mass(mass_kg)
        span = window_span(geometric, wrench)
        filters = complementary_filters(self.low_hz, self.high_hz, span.rate_hz)
        whole = self._uses_whole_recording(span)
        used = span.around if whole else span.inside
        within = span.within if whole else slice(0, span.inside.stop - span.inside.start)
        g = geometric.com_m[used]
        inputs = _masked(g, wrench, used, span, mass_kg)
        c = forward_backward(filters, inputs)
        velocity, acceleration = derivatives(c, span.rate_hz)
        return ComEstimate(
            method=self.name,
            time_s=geometric.time_s[span.inside],
            com_m=c[within],
            velocity_m_s=velocity[within],
            acceleration_m_s2=acceleration[within],
            sd_m=np.tile(np.asarray(geometric.sd_m), (len(c[within]), 1)),
            window=span.window,
            references=("carpentier2017thesis", "carpentier2016spectral"),
            diagnostics={"low_hz": self.low_hz, "high_hz": self.high_hz, "samples_used": float(len(c))},
        )

    def _uses_whole_recording(self, span: Span) -> bool:
        if self.beyond_window == "auto":
            return span.window.duration_s < self.LONG_WINDOW_S
        return self.beyond_window == "geometry"


def _masked(g: Points, wrench: WrenchTrack, used: slice, span: Span, mass_kg: float) -> FilterInputs:
    """Inputs with the force's share taken from the geometry outside the window."""
    within = slice(span.inside.start - used.start, span.inside.stop - used.start)
    total = Wrench(wrench.force_n[span.inside], wrench.moment_nm[span.inside])
    measured = filter_inputs(g[within], total, mass_kg)
    _, a = derivatives(g, span.rate_hz)
    p = g.copy()
    a[within], p[within] = measured.acceleration_m_s2, measured.axis_point_m
    return FilterInputs(g, a, p)


def _run(h: DigitalFilter, x: Points, state: State) -> Points:
    return np.asarray(signal.lfilter(h.b, h.a, x, axis=0, zi=state)[0])


def _memory(h: DigitalFilter) -> float:
    """Time constant of the slowest pole, in samples."""
    return float(-1 / np.log(np.abs(h.poles).max()))
