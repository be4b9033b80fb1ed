"""Forces as cubic splines instead of constants: Bernstein form, its integrals, and continuity between intervals.

In an interval of length h, with s = t / h,

    f(t) = sum_i B_i(s) f_i,      B_i(s) = C(3, i) s^i (1 - s)^(3 - i)

f(t) is a convex combination of its control points f_0 .. f_3 for every s in [0, 1], so that a friction cone, being
convex, that contains the four contains the whole curve. The inner two are free. At a node between two intervals,

    f_3 of the one = f_0 of the next = (h+ f_2 + h f_1+) / (h + h+)

makes force *and* rate continuous, and is itself a convex combination. At both ends of the motion the rate is zero. At
touch-down and lift-off the missing f_2 or f_1 counts as zero: force and rate begin and end at zero.
"""

from collections.abc import Mapping
from functools import cache
from math import comb
from typing import Final, Literal

import numpy as np
from jaxtyping import Float
from numpy.polynomial import Polynomial, legendre

from stridelab.centroidal.free_variables import contact_spans
from stridelab.contacts.sequence import ContactSequence
from stridelab.conventions import Series

Shape = Literal["constant", "cubic"]
DEGREE: Final = 3
INNER: Final[Mapping[Shape, int]] = {"constant": 1, "cubic": 2}
"""Free control points per interval."""
N_GAUSS: Final = 4
"""Gauss points per interval for the integrals of squared splines."""


@cache
def bernstein_coefficients(degree: int) -> Float[np.ndarray, "4 d n"]:
    """Coefficients of ``B_0 .. B_degree`` in powers of s, and of their first three integrals from 0."""
    s = Polynomial([0.0, 1.0])
    rows = np.zeros((4, degree + 1, degree + 4))
    for i in range(degree + 1):
        basis = comb(degree, i) * s**i * (1.0 - s) ** (degree - i)
        for integrals in range(4):
            coefficients = (basis.integ(integrals) if integrals else basis).coef
            rows[integrals, i, : len(coefficients)] = coefficients
    rows.flags.writeable = False
    return rows


def bernstein_weights(s: float, degree: int = DEGREE) -> Float[np.ndarray, "4 d"]:
    """Weights of the control points at ``s`` in [0, 1]: in the curve, and in its first three integrals from 0.

    Degree 0 has one control point: a constant.
    """
    rows = bernstein_coefficients(degree)
    return np.asarray(rows @ s ** np.arange(rows.shape[2]))


@cache
def gauss_rule(n: int) -> tuple[tuple[float, float], ...]:
    """Points and weights in [0, 1] of the Gauss rule with ``n`` points, exact to degree 2 n - 1."""
    x, w = legendre.leggauss(n)
    return tuple(zip((0.5 * (x + 1.0)).tolist(), (0.5 * w).tolist(), strict=True))


def limb_times_s(time_s: Series, shape: Shape) -> Float[np.ndarray, "times"]:
    """Times that bound the spans over which the momentum rates of the limbs are averaged.

    The nodes for constant forces; for splines one span per Gauss point, as long as its weight.
    """
    if shape == "constant":
        return time_s
    ends = np.cumsum([w for _, w in gauss_rule(N_GAUSS)])
    inside = time_s[:-1, None] + np.diff(time_s)[:, None] * ends[:-1]
    return np.append(np.column_stack([time_s[:-1], inside]).ravel(), time_s[-1])


def junction_weights(step_s: Series) -> Float[np.ndarray, "m 2"]:
    """Weights, per interval, of its own inner points in its end points: ``f_0 = (1 - a) f_2- + a f_1``, same for f_3.

    They are 1 at the ends of the motion.
    """
    h = np.asarray(step_s)
    own = np.ones((len(h), 2))
    own[1:, 0] = h[:-1] / (h[:-1] + h[1:])
    own[:-1, 1] = h[1:] / (h[:-1] + h[1:])
    return own


def control_points(inner: Float[np.ndarray, "m 2 *rest"], step_s: Series) -> Float[np.ndarray, "m 4 *rest"]:
    """All four control points from the inner two of every interval."""
    own = junction_weights(step_s).reshape(len(inner), 2, *(1 for _ in inner.shape[2:]))
    first = own[:, 0] * inner[:, 0]
    last = own[:, 1] * inner[:, 1]
    first[1:] += (1.0 - own[1:, 0]) * inner[:-1, 1]
    last[:-1] += (1.0 - own[:-1, 1]) * inner[1:, 0]
    return np.stack([first, inner[:, 0], inner[:, 1], last], axis=1)


def touchdowns_and_liftoffs(sequence: ContactSequence) -> tuple[set[tuple[int, str]], set[tuple[int, str]]]:
    """Touch-downs at the start and lift-offs at the end of phases, as ``(phase, effector)``, within the motion."""
    last = len(sequence.phases) - 1
    spans = [(span.contact.effector, span.first, span.last) for span in contact_spans(sequence)]
    return (
        {(first, name) for name, first, _ in spans if first > 0},
        {(end, name) for name, _, end in spans if end < last},
    )
