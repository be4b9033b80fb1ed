"""Missing samples: converts the encodings of missing values to NaN, fills short gaps, rebuilds markers of rigid bodies.

For a cluster of markers a_k (one frame of the static trial) seen as b_k in a frame of the walk, the rigid motion

    R, t = argmin sum_k w_k |R a_k + t - b_k|^2,   R in SO(3)

is the weighted orthogonal Procrustes solution: with the singular value decomposition U S V^T of
sum_k w_k (b_k - b)(a_k - a)^T, R = U diag(1, 1, det(U V^T)) V^T and t = b - R a (Kabsch 1976).
A missing marker of the cluster is then R a + t.
"""

from collections.abc import Mapping
from typing import Final

import numpy as np
from jaxtyping import Bool, Float
from scipy.interpolate import CubicSpline

from stridelab.conventions import Mask, Points, Rotations
from stridelab.recordings.files.raw import LARGEST_PLAUSIBLE, Cloud
from stridelab.recordings.recording import Remark

MAX_GAP_S = 0.1
"""Longest gap that is interpolated: about 4 cm of a foot's swing, less than a fifth of a step's duration."""

MAX_BRIDGE_S = 0.2
"""Longest gap of a marker that is bridged by the other markers of its segment: half of a running foot's swing."""

MAX_FORCE_GAP_S = 0.03
"""Longest gap of a force channel that is interpolated; zeros in a longer one are found as missing force."""


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


def bridge_force_gaps(
    signals: Float[np.ndarray, "n channels"], rate_hz: float, source: str
) -> tuple[Float[np.ndarray, "n channels"], tuple[Remark, ...]]:
    """Channels of a plate without NaN, and a remark if gaps of ``source`` (``plate 1``) were interpolated.

    Gaps between two samples of at most ``MAX_FORCE_GAP_S`` are interpolated linearly; other missing samples are 0.
    """
    missing = np.isnan(signals)
    filled, bridged = np.where(missing, 0.0, signals), np.zeros(len(signals), dtype=bool)
    for k in np.flatnonzero(missing.any(axis=0)):
        for i, j in true_runs(missing[:, k]):
            if i > 0 and j < len(signals) and j - i <= MAX_FORCE_GAP_S * rate_hz:
                filled[i:j, k] = np.linspace(signals[i - 1, k], signals[j, k], j - i + 2)[1:-1]
                bridged[i:j] = True
    if not bridged.any():
        return filled, ()
    message = f"{int(bridged.sum())} samples of {source} are missing in gaps of at most {1e3 * MAX_FORCE_GAP_S:g} ms, "
    return filled, (Remark("force-samples-missing", f"{message}which are interpolated."),)


def bridge_segment_gaps(tracks: Mapping[str, Points], rate_hz: float) -> dict[str, Points]:
    """Fill interior gaps of at most ``MAX_BRIDGE_S`` in the markers of one segment from its other markers.

    The offset from the mean of the markers that stay visible is interpolated by a cubic spline: it only turns with the
    segment, whereas the marker itself travels. A gap without another visible marker is left.
    """
    bridged = dict(tracks)
    limit = int(MAX_BRIDGE_S * rate_hz + 1e-9)
    if limit < 1:
        return bridged
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


_SIDED: Final = {
    "thigh": ("thigh_t1", "thigh_t2", "thigh_t3", "thigh_t4", "trochanter", "knee_lateral", "knee_medial"),
    "shank": (
        *("knee_lateral", "knee_medial", "fibula_head", "tibial_tuberosity"),
        *("shank_t1", "shank_t2", "shank_t3", "shank_t4", "ankle_lateral", "ankle_medial"),
    ),
    "foot": ("heel", "mt1", "mt2", "mt5", "toe", "foot_t1", "foot_t2", "foot_t3"),
    "forearm": ("elbow_lateral", "elbow_medial", "wrist_radial", "wrist_ulnar", "forearm_t1", "forearm_t2"),
}
CLUSTERS: Final = (
    ("l_asis", "r_asis", "l_psis", "r_psis", "sacrum", "pelvis_t1", "pelvis_t2"),
    ("c7", "t8", "t10", "jugular_notch", "xiphoid", "l_clavicle", "r_clavicle", "trunk_t1", "trunk_t2"),
    ("l_head_front", "r_head_front", "l_head_back", "r_head_back", "l_head_side", "r_head_side", "head_top"),
    *(tuple(f"{side}_{name}" for name in names) for names in _SIDED.values() for side in "lr"),
)
"""Groups of landmarks that move as a rigid body, in order of use."""

_FLATNESS: Final = 3e-3
"""Minimum ratio of the second to the first singular value: smaller clusters (width under 5 % of length) are lines."""


Shapes = Mapping[str, Float[np.ndarray, "m 3"]]
"""Landmark tracks of another trial, with its own number of frames."""


def rebuild_markers(tracks: Mapping[str, Points], shapes: Shapes) -> tuple[dict[str, Points], frozenset[str]]:
    """Fill the gaps of ``tracks``, and add landmarks that only ``shapes`` has, if their cluster is visible enough.

    ``shapes`` is a trial with more visible markers (the static trial, or the trial itself). Returns the tracks and the
    names of those that changed.
    """
    filled = dict(tracks)
    for cluster in CLUSTERS:
        shape = _fullest_frame(shapes, cluster)
        for name in shape:
            track = filled.get(name)
            gaps = np.isnan(track[:, 0]) if track is not None else None
            if gaps is not None and not gaps.any():
                continue
            neighbours = [other for other in shape if other != name and other in tracks]
            if len(neighbours) < 3:
                continue
            a = np.array([shape[other] for other in neighbours])
            b = np.stack([tracks[other] for other in neighbours], axis=1)
            R, t = rigid_motion(a, b)
            rebuilt = R @ shape[name] + t
            filled[name] = rebuilt if track is None or gaps is None else np.where(gaps[:, None], rebuilt, track)
    changed = {name for name in filled if filled[name] is not tracks.get(name)}
    return filled, frozenset(name for name in changed if not _is_same_track(filled[name], tracks.get(name)))


def rigid_motion(a: Float[np.ndarray, "k 3"], b: Float[np.ndarray, "n k 3"]) -> tuple[Rotations, Points]:
    """Rotation and translation that map the shape ``a`` onto ``b`` in every frame, in the least-squares sense.

    Hidden markers (NaN) have weight zero. NaN if fewer than three are visible or they are collinear.
    """
    seen: Bool[np.ndarray, "n k"] = np.isfinite(b).all(axis=2)
    w = seen / np.maximum(seen.sum(axis=1, keepdims=True), 1)
    b = np.where(seen[..., None], b, 0.0)
    a_mean = w @ a
    b_mean = np.einsum("nk,nki->ni", w, b)
    H = np.einsum("nk,nki,nkj->nij", w, b - b_mean[:, None], a[None] - a_mean[:, None])
    U, S, Vt = np.linalg.svd(H)
    D = np.ones((len(b), 3))
    D[:, 2] = np.linalg.det(U @ Vt)
    R = (U * D[:, None, :]) @ Vt
    t = b_mean - np.einsum("nij,nj->ni", R, a_mean)
    hopeless = (seen.sum(axis=1) < 3) | (S[:, 1] <= _FLATNESS * S[:, 0])
    R[hopeless], t[hopeless] = np.nan, np.nan
    return R, t


def _fullest_frame(shapes: Shapes, cluster: tuple[str, ...]) -> dict[str, Float[np.ndarray, "3"]]:
    names = [name for name in cluster if name in shapes and len(shapes[name])]
    if len(names) < 4:
        return {}
    seen = np.stack([np.isfinite(shapes[name]).all(axis=1) for name in names], axis=1)
    frame = int(seen.sum(axis=1).argmax())
    return {name: shapes[name][frame] for name, visible in zip(names, seen[frame], strict=True) if visible}


def _is_same_track(track: Points, before: Points | None) -> bool:
    return before is not None and bool(np.array_equal(track, before, equal_nan=True))
