"""Forces that are cubic splines instead of constants: Bernstein's form, its integrals, and what joins two intervals.

In an interval of length h, with s = t / h,

    f(t) = sum_i B_i(s) f_i,      B_i(s) = C(3, i) s^i (1 - s)^(3 - i)

f(t) is a convex combination of its control points f_0 .. f_3 for every s in [0, 1], so that a friction cone, being
convex, that holds the four holds the whole curve. The inner two are free. Where two intervals meet,

    f_3 of the one = f_0 of the next = (h+ f_2 + h f_1+) / (h + h+)

makes force *and* rate continuous, and is itself a convex combination. At both ends of the motion the rate is zero. A
contact that comes or goes has no f_1, or no f_2, beside that node: its force begins and ends with zero and zero rate.
"""

from collections.abc import Mapping
from functools import cache
from math import comb
from typing import Final, Literal

import numpy as np
from jaxtyping import Float
from numpy.polynomial import Polynomial, legendre

from stridelab.centroidal.free_variables import stays
from stridelab.contacts.sequence import ContactSequence
from stridelab.conventions import Series

Shape = Literal["constant", "cubic"]
DEGREE: Final = 3
INNER: Final[Mapping[Shape, int]] = {"constant": 1, "cubic": 2}
"""Free control points per interval."""
N_GAUSS: Final = 4
"""Instants per interval at which the squares of splines are taken."""


@cache
def _monomials(degree: int) -> Float[np.ndarray, "4 d n"]:
    """``B_0 .. B_degree`` in powers of s, as they are and integrated one to three times from 0."""
    s = Polynomial([0.0, 1.0])
    found = np.zeros((4, degree + 1, degree + 4))
    for i in range(degree + 1):
        basis = comb(degree, i) * s**i * (1.0 - s) ** (degree - i)
        for integrals in range(4):
            coefficients = (basis.integ(integrals) if integrals else basis).coef
            found[integrals, i, : len(coefficients)] = coefficients
    found.flags.writeable = False
    return found


def weights(s: float, degree: int = DEGREE) -> Float[np.ndarray, "4 d"]:
    """What the control points weigh at ``s`` in [0, 1]: in the curve, and in its one to three integrals by s from 0.

    Of degree 0 there is one control point: a constant.
    """
    rows = _monomials(degree)
    return np.asarray(rows @ s ** np.arange(rows.shape[2]))


@cache
def gauss(n: int) -> tuple[tuple[float, float], ...]:
    """Points and weights in [0, 1] of the rule that is exact to degree 2 n - 1."""
    x, w = legendre.leggauss(n)
    return tuple(zip((0.5 * (x + 1.0)).tolist(), (0.5 * w).tolist(), strict=True))


def limb_times_s(time_s: Series, shape: Shape) -> Float[np.ndarray, "times"]:
    """Times between which the rates that limbs take are means.

    Of constants the nodes, of splines as much around every point of Gauss as it weighs: the means add up to the whole.
    """
    if shape == "constant":
        return time_s
    ends = np.cumsum([w for _, w in gauss(N_GAUSS)])
    inside = time_s[:-1, None] + np.diff(time_s)[:, None] * ends[:-1]
    return np.append(np.column_stack([time_s[:-1], inside]).ravel(), time_s[-1])


def joints(step_s: Series) -> Float[np.ndarray, "m 2"]:
    """Per interval the weights of its own inner points in its two ends: ``f_0 = (1 - a) f_2- + a f_1``, ``f_3`` too.

    At the ends of the motion they are 1.
    """
    h = np.asarray(step_s)
    own = np.ones((len(h), 2))
    own[1:, 0] = h[:-1] / (h[:-1] + h[1:])
    own[:-1, 1] = h[1:] / (h[:-1] + h[1:])
    return own


def control_points(inner: Float[np.ndarray, "m 2 *rest"], step_s: Series) -> Float[np.ndarray, "m 4 *rest"]:
    """All four control points from the inner two of every interval."""
    own = joints(step_s).reshape(len(inner), 2, *(1 for _ in inner.shape[2:]))
    first = own[:, 0] * inner[:, 0]
    last = own[:, 1] * inner[:, 1]
    first[1:] += (1.0 - own[1:, 0]) * inner[:-1, 1]
    last[:-1] += (1.0 - own[:-1, 1]) * inner[1:, 0]
    return np.stack([first, inner[:, 0], inner[:, 1], last], axis=1)


def comes_and_goes(sequence: ContactSequence) -> tuple[set[tuple[int, str]], set[tuple[int, str]]]:
    """Phases and effectors that begin to touch at the start of that phase, and that cease at its end, under way."""
    last = len(sequence.phases) - 1
    found = [(stay.contact.effector, stay.first, stay.last) for stay in stays(sequence)]
    return (
        {(first, name) for name, first, _ in found if first > 0},
        {(end, name) for name, _, end in found if end < last},
    )
