"""The linear complementary filter of section 2.4 as an offline estimator."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Literal

from stridelab.body.geometric_com import GeometricCom
from stridelab.conventions import Points, Vector3
from stridelab.dynamics.wrench import Wrench
from stridelab.errors import Fault, InvalidInput
from stridelab.estimation.complementary.cutoff_selection import cutoffs_from_spectra
from stridelab.estimation.complementary.forward_backward import (
    FilterInputs,
    filter_inputs,
    forward_backward,
    joined_passes,
)
from stridelab.estimation.complementary.online_filter import OnlineComplementaryFilter
from stridelab.estimation.complementary.transfer_functions import (
    AUTO_HIGH_HZ,
    AUTO_LOW_HZ,
    THESIS_HIGH_HZ,
    THESIS_LOW_HZ,
    ComplementaryFilters,
    complementary_filters,
)
from stridelab.estimation.differentiation import Span, require_mass, smoothed_derivatives, window_span
from stridelab.estimation.error_band import FusedStretch, propagated_sd_m
from stridelab.estimation.error_priors import ErrorPriors, SdPerAxis
from stridelab.estimation.estimator import ComEstimate
from stridelab.recordings.recording import WrenchTrack


@dataclass(frozen=True, kw_only=True)
class ComplementaryFilter:
    """``low_hz`` = f_2 for the central axis, ``high_hz`` = f_1 for the force; forward and backward, averaged.

    ``beyond_window`` is the replacement of the force outside the window: "geometry" filters the whole gap-free
    recording with p and a computed from the geometry there (as in 2.6.2), "cut" uses the window alone, as the thesis
    does. The default cut-offs suit windows of one or two steps (see docs/theory/complementary-filter.md).
    ``from_spectra`` selects the cut-offs from the window's spectra instead of ``low_hz`` and ``high_hz``. ``order`` 3
    has steeper skirts, offline only. ``start`` initialises the filter states: "solved" for each pass alone, "joined" so
    that both passes agree (2.6.3). ``priors`` are the input errors behind ``sd_m``.
    """

    name: ClassVar[str] = "complementary"

    low_hz: float = AUTO_LOW_HZ
    high_hz: float = AUTO_HIGH_HZ
    beyond_window: Literal["geometry", "cut"] = "geometry"
    priors: ErrorPriors = field(default_factory=ErrorPriors)
    from_spectra: bool = False
    order: int = 2
    start: Literal["solved", "joined"] = "solved"

    @classmethod
    def thesis(cls) -> "ComplementaryFilter":
        """Filter of the thesis: 0.4 and 4 Hz, on the window alone."""
        return cls(low_hz=THESIS_LOW_HZ, high_hz=THESIS_HIGH_HZ, beyond_window="cut")

    def causal(
        self, mass_kg: float, table_sd_m: SdPerAxis, velocity_m_s: Vector3 | None = None
    ) -> OnlineComplementaryFilter:
        """Online form of the filter: one forward pass, sample by sample.

        ``table_sd_m`` is the error of the segment model per axis, as ``GeometricCom.sd_m``; ``velocity_m_s`` the
        velocity of the first sample, if known. Raises ``InvalidInput`` (``order-out-of-range``,
        ``cutoffs-not-online``).
        """
        if self.order != 2:
            message = "The online complementary filter supports order 2 only."
            raise InvalidInput("order-out-of-range", message, [Fault("order", message)])
        if self.from_spectra:
            message = "An online filter cannot select its cut-offs from the spectra of a recording: state the cut-offs."
            raise InvalidInput("cutoffs-not-online", message, [Fault("cutoffs", message)])
        return OnlineComplementaryFilter(
            low_hz=self.low_hz,
            high_hz=self.high_hz,
            mass_kg=mass_kg,
            table_sd_m=table_sd_m,
            priors=self.priors,
            velocity_m_s=velocity_m_s,
        )

    def estimate(self, geometric: GeometricCom, wrench: WrenchTrack, mass_kg: float) -> ComEstimate:
        """Fuse the three inputs over the longest window; the result lies at the window's samples.

        Velocity and acceleration are derivatives of the position in an 8 Hz band. Raises ``NotEstimable`` or
        ``InvalidInput`` as ``window_span`` does, and ``InvalidInput`` with ``mass-out-of-range`` or
        ``cutoffs-out-of-range``.
        """
        fused = self.input_signals(geometric, wrench, mass_kg)
        both_passes = forward_backward if self.start == "solved" else joined_passes

        def fuse_all(inputs: Sequence[FilterInputs]) -> Sequence[Points]:
            return [both_passes(fused.filters, each) for each in inputs]

        (c,) = fuse_all([fused.inputs])
        span, within = fused.span, fused.stretch.within
        velocity, acceleration = smoothed_derivatives(c, span.rate_hz)
        return ComEstimate(
            method=self.name,
            time_s=geometric.time_s[span.inside],
            com_m=c[within],
            velocity_m_s=velocity[within],
            acceleration_m_s2=acceleration[within],
            sd_m=propagated_sd_m(fuse_all, fused.stretch, geometric.sd_m, self.priors),
            window=span.window,
            references=("carpentier2017thesis", "carpentier2016spectral"),
            diagnostics={"low_hz": fused.low_hz, "high_hz": fused.high_hz, "samples_used": float(len(c))},
        )

    def input_signals(self, geometric: GeometricCom, wrench: WrenchTrack, mass_kg: float) -> "FilteredSignals":
        """Filters and input signals of ``estimate``; raises as it does."""
        require_mass(mass_kg)
        span = window_span(geometric, wrench)
        used = span.around if self.beyond_window == "geometry" else span.inside
        within = slice(span.inside.start - used.start, span.inside.stop - used.start)
        total = Wrench(wrench.force_n[span.inside], wrench.moment_nm[span.inside])

        g = geometric.com_m[used]
        g_velocity, a = smoothed_derivatives(g, span.rate_hz)
        p = g.copy()
        measured = filter_inputs(g[within], total, mass_kg)
        a[within], p[within] = measured.acceleration_m_s2, measured.axis_point_m
        low_hz, high_hz = self.low_hz, self.high_hz
        if self.from_spectra:
            low_hz, high_hz = cutoffs_from_spectra(measured, span.rate_hz, self.order)
        filters = complementary_filters(low_hz, high_hz, span.rate_hz, self.order)
        stretch = FusedStretch(total, g_velocity, within, span.rate_hz, mass_kg)
        return FilteredSignals(filters, FilterInputs(g, a, p), stretch, span, low_hz, high_hz)


@dataclass(frozen=True)
class FilteredSignals:
    """Filters and their three inputs over the stretch that is filtered; ``stretch.within`` is the window in it."""

    filters: ComplementaryFilters
    inputs: FilterInputs
    stretch: FusedStretch
    span: Span
    low_hz: float
    high_hz: float
