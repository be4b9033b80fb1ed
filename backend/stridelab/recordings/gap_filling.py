"""Missing samples: converts the encodings of missing values to NaN and fills short gaps."""

from collections.abc import Mapping

import numpy as np
from scipy.interpolate import CubicSpline

from stridelab.conventions import Mask, Points
from stridelab.recordings.files.raw import LARGEST_PLAUSIBLE, Cloud

MAX_GAP_S = 0.1
"""Longest gap that is interpolated: about 4 cm of a foot's swing, less than a fifth of a step's duration."""

MAX_BRIDGE_S = 0.2
"""Longest gap of a marker that is bridged by the other markers of its segment: half of a running foot's swing."""


def mark_missing(points_m: Cloud) -> Cloud:
    """Replace missing samples by NaN: NaN, infinity, magnitudes above ``LARGEST_PLAUSIBLE``, and exactly (0, 0, 0)."""
    missing = ~(np.abs(points_m) <= LARGEST_PLAUSIBLE).all(axis=2) | (points_m == 0.0).all(axis=2)
    return np.where(missing[:, :, None], np.nan, points_m)


def true_runs(mask: Mask) -> list[tuple[int, int]]:
    """Half-open index ranges [i, j) in which ``mask`` is true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return [(int(i), int(j)) for i, j in zip(edges[::2], edges[1::2], strict=True)]


def fill_short_gaps(track_m: Points, rate_hz: float, max_gap_s: float = MAX_GAP_S) -> tuple[Points, Mask]:
    """Interpolate interior gaps of at most ``max_gap_s`` by a cubic spline.

    Returns the track and the mask of the filled frames. Gaps at the ends are not extrapolated. Over the longest gap, a
    foot that swings by 5 cm at 2 Hz is reconstructed within 1 mm, and 1 mm of marker noise becomes about 2 mm.
    """
    missing = np.isnan(track_m).any(axis=1)
    filled = np.zeros(len(track_m), dtype=bool)
    limit = int(max_gap_s * rate_hz + 1e-9)
    for i, j in true_runs(missing):
        if i > 0 and j < len(track_m) and j - i <= limit:
            filled[i:j] = True
    if not filled.any():
        return track_m, filled
    seen = np.flatnonzero(~missing)
    out = track_m.copy()
    out[filled] = CubicSpline(seen, track_m[seen], axis=0)(np.flatnonzero(filled))
    return out, filled


def bridge_segment_gaps(tracks: Mapping[str, Points], rate_hz: float) -> dict[str, Points]:
    """Fill interior gaps of at most ``MAX_BRIDGE_S`` in the markers of one segment from its other markers.

    The offset from the mean of the markers that stay visible is interpolated by a cubic spline: it only turns with the
    segment, whereas the marker itself travels. A gap without another visible marker is left.
    """
    bridged = dict(tracks)
    limit = int(MAX_BRIDGE_S * rate_hz + 1e-9)
    for name, track in tracks.items():
        for i, j in true_runs(np.isnan(track).any(axis=1)):
            others = [other for key, other in tracks.items() if key != name and np.isfinite(other[i - 1 : j + 1]).all()]
            if i == 0 or j == len(track) or j - i > limit or not others:
                continue
            reference = np.mean(others, axis=0)
            offset = track - reference
            seen = np.flatnonzero(np.isfinite(offset).all(axis=1))
            seen = seen[(seen >= i - limit) & (seen < j + limit)]
            filled = bridged[name].copy()
            filled[i:j] = reference[i:j] + CubicSpline(seen, offset[seen], axis=0)(np.arange(i, j))
            bridged[name] = filled
    return bridged
