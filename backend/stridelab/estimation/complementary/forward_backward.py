"""One pass of the complementary filter over recorded signals, and the mean of a forward and a backward pass.

Inputs (2.4.1): the geometric CoM g, the acceleration a from the force, the projection p of the geometric CoM on the
central axis. With the filters of ``filters`` the forward pass is

    c = g - (s^2 H2) g + H2 a + H3 (p - g)          which is H1 g + H2 a + H3 p, since H1 = 1 - s^2 H2 - H3.

Offline, forward and backward passes are averaged (2.6.3). The thesis searches the initial states that minimise the
difference of the passes (``joined_passes``); on the short windows of real recordings this increases the error
(docs/theory/complementary-filter.md), so the states are solved for each pass separately, see ``initial_state``.
After the projection everything is linear in (g, a, p): ``error_band`` propagates errors by the same functions.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy import signal

from stridelab.conventions import Points
from stridelab.dynamics.wrench import AXIS_THRESHOLD_N, Wrench, central_axis, com_acceleration
from stridelab.estimation.complementary.transfer_functions import ComplementaryFilters, DigitalFilter

JOINING_RIDGE = 1e-4
State = Float[np.ndarray, "order 3"]


@dataclass(frozen=True)
class FilterInputs:
    """The three input signals of section 2.4.1 at common instants, all about the world origin."""

    geometry_m: Points
    acceleration_m_s2: Points
    axis_point_m: Points

    def time_reversed(self) -> "FilterInputs":
        """Time-reversed signals: the equations of dynamics are symmetric in time (2.6.3)."""
        return FilterInputs(self.geometry_m[::-1], self.acceleration_m_s2[::-1], self.axis_point_m[::-1])


@dataclass(frozen=True)
class FilterState:
    """Delay states of H2, s^2 H2 and H3 (transposed direct form), one column per axis."""

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

    The high-frequency correction ``H2 (a - s^2 g)`` is zero for any motion in which acceleration and geometry agree;
    its unknowns per axis, as many as the order, minimise it over the first 10 tau_1 in the least-squares sense.
    ``H3 (p - g)`` starts at rest at the mean offset of the first 5 tau_2 (its settling time).
    """
    g, a, p = inputs.geometry_m, inputs.acceleration_m_s2, inputs.axis_point_m
    order = len(filters.h2.poles)
    zero = np.zeros((order, 3))
    at_g0 = signal.lfilter_zi(filters.s2_h2.b, filters.s2_h2.a)[:, None] * g[0]
    n = min(len(g), max(8, int(10 * _time_constant_samples(filters.h2))))
    correction = _apply_filter(filters.h2, a[:n], zero) - _apply_filter(filters.s2_h2, g[:n], at_g0)
    silence = np.zeros((n, order))
    free = signal.lfilter([1.0], filters.h2.a, silence, axis=0, zi=np.eye(order))[0]
    m = min(len(g), max(1, int(5 * _time_constant_samples(filters.h3))))
    return FilterState(
        h2=np.linalg.lstsq(free, -correction, rcond=None)[0],
        s2_h2=at_g0,
        h3=signal.lfilter_zi(filters.h3.b, filters.h3.a)[:, None] * (p - g)[:m].mean(axis=0),
    )


def forward_pass(filters: ComplementaryFilters, inputs: FilterInputs, state: FilterState) -> Points:
    """One causal pass over all samples, in metres."""
    g, a, p = inputs.geometry_m, inputs.acceleration_m_s2, inputs.axis_point_m
    high = _apply_filter(filters.h2, a, state.h2) - _apply_filter(filters.s2_h2, g, state.s2_h2)
    return np.asarray(g + high + _apply_filter(filters.h3, p - g, state.h3))


def forward_backward(filters: ComplementaryFilters, inputs: FilterInputs) -> Points:
    """Mean of the forward and the backward pass, each from its own solved initial state, in metres."""
    inputs = replace(inputs, acceleration_m_s2=_bilinear_acceleration(inputs.acceleration_m_s2))
    there = forward_pass(filters, inputs, initial_state(filters, inputs))
    mirror = inputs.time_reversed()
    back = forward_pass(filters, mirror, initial_state(filters, mirror))
    return np.asarray((there + back[::-1]) / 2)


def joined_passes(filters: ComplementaryFilters, inputs: FilterInputs) -> Points:
    """Mean of both passes from the initial states that minimise their difference, as in 2.6.3, in metres.

    Solves for changes of the states of ``initial_state`` by ridge regression: over many seconds both passes forget
    their states, and the difference does not determine them. On short windows ``forward_backward`` is more accurate.
    """
    inputs = replace(inputs, acceleration_m_s2=_bilinear_acceleration(inputs.acceleration_m_s2))
    mirror = inputs.time_reversed()
    there = forward_pass(filters, inputs, initial_state(filters, inputs))
    back = forward_pass(filters, mirror, initial_state(filters, mirror))[::-1]
    order = len(filters.h2.poles)
    silence, each = np.zeros((len(there), order)), np.eye(order)
    free = np.hstack([signal.lfilter([1.0], h.a, silence, axis=0, zi=each)[0] for h in (filters.h2, filters.h3)])
    free /= np.linalg.norm(free, axis=0)
    A = np.hstack([free, -free[::-1]])
    x = np.linalg.solve(A.T @ A + JOINING_RIDGE * np.eye(A.shape[1]), -A.T @ (there - back))
    return np.asarray((there + back + np.hstack([free, free[::-1]]) @ x) / 2)


def _bilinear_acceleration(a: Points) -> Points:
    """Acceleration corrected for the frequency warping of the bilinear s^2.

    The rule replaces ``w`` by ``(2/T) tan(wT/2)``, so its s^2 exceeds -w^2 by the factor ``1 + (wT)^2 / 6``.
    ``a - d2 a / 6`` with d2 the second difference has the same factor, with an error of order ``(wT)^4``. It needs the
    next sample, so the online filter omits it.
    """
    if len(a) < 3:
        return a
    d2 = np.diff(a, 2, axis=0)
    return np.asarray(a - np.concatenate([d2[:1], d2, d2[-1:]]) / 6)


def _apply_filter(h: DigitalFilter, x: Points, state: State) -> Points:
    return np.asarray(signal.lfilter(h.b, h.a, x, axis=0, zi=state)[0])


def _time_constant_samples(h: DigitalFilter) -> float:
    """Time constant of the slowest pole, in samples."""
    return float(-1 / np.log(np.abs(h.poles).max()))
