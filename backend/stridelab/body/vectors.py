"""Vector algebra on tracks of points: row i is the vector at frame i; NaN propagates."""

import warnings

import numpy as np

from stridelab.conventions import Points, Series


def unit(v: Points) -> Points:
    """Rows scaled to length one; NaN for a row of zeros."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(v / np.linalg.norm(v, axis=1, keepdims=True))


def dot(a: Points, b: Points) -> Series:
    """Row-wise scalar product."""
    return np.asarray(np.einsum("ij,ij->i", a, b))


def component_along(v: Points, axis: Points) -> Points:
    """Component of ``v`` along the unit vectors ``axis``."""
    return np.asarray(dot(v, axis)[:, None] * axis)


def perpendicular_unit(v: Points, axis: Points) -> Points:
    """Unit vectors of the component of ``v`` perpendicular to the unit vectors ``axis``."""
    return unit(v - component_along(v, axis))


def median_or_nan(values: Series) -> float:
    """Median over the finite values; NaN without any."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="All-NaN slice", category=RuntimeWarning)
        return float(np.nanmedian(values)) if len(values) else float("nan")


def median_distance_m(a: Points, b: Points) -> float:
    """Median distance between two tracks in metres, such as the length of a bone."""
    return median_or_nan(np.linalg.norm(a - b, axis=1))
