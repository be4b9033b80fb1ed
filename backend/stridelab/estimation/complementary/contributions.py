"""Contribution of each input to a fused CoM (figure 2.7), and frequency responses of the filters (figure 2.5).

After the projection of the geometry the fusion is linear, initial states included. Each contribution is the fusion of
one input with the two others set to zero, and their sum is the fused trajectory to rounding:

    c = H1 g + H2 a + H3 p
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float

from stridelab.conventions import Points, Series
from stridelab.estimation.complementary.forward_backward import FilterInputs, forward_backward
from stridelab.estimation.complementary.transfer_functions import ComplementaryFilters


@dataclass(frozen=True)
class Contributions:
    """Contributions to the CoM in metres, forward and backward passes averaged."""

    geometry_m: Points
    force_m: Points
    axis_m: Points

    @property
    def total_m(self) -> Points:
        """The fused CoM."""
        return np.asarray(self.geometry_m + self.force_m + self.axis_m)


def split_contributions(filters: ComplementaryFilters, inputs: FilterInputs) -> Contributions:
    """Split ``forward_backward(filters, inputs)`` by input. Near the ends the split shows filter transients."""
    silence = np.zeros_like(inputs.geometry_m)
    return Contributions(
        geometry_m=forward_backward(filters, FilterInputs(inputs.geometry_m, silence, silence)),
        force_m=forward_backward(filters, FilterInputs(silence, inputs.acceleration_m_s2, silence)),
        axis_m=forward_backward(filters, FilterInputs(silence, silence, inputs.axis_point_m)),
    )


@dataclass(frozen=True)
class Bode:
    """Frequency responses of one design: columns H1, s^2 H2, H3."""

    frequency_hz: Series
    response: Complex[np.ndarray, "n 3"]

    @property
    def gain_db(self) -> Float[np.ndarray, "n 3"]:
        """20 log10 of the gain, at least -400 dB."""
        return np.asarray(20.0 * np.log10(np.maximum(np.abs(self.response), 1e-20)))

    @property
    def phase_rad(self) -> Float[np.ndarray, "n 3"]:
        """Phase, unwrapped along the frequency."""
        return np.asarray(np.unwrap(np.angle(self.response), axis=0))


def bode_responses(filters: ComplementaryFilters, frequency_hz: Series) -> Bode:
    """Responses of the discrete filters at the given frequencies, below half their rate."""
    branches = (filters.h1, filters.s2_h2, filters.h3)
    return Bode(frequency_hz, np.column_stack([branch.response(frequency_hz) for branch in branches]))
