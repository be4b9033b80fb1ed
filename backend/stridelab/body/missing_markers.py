"""Missing landmarks: the error they add to the CoM, and their reconstruction from rigid neighbours.

For a cluster of markers a_k (one frame of the static trial) seen as b_k in a frame of the walk, the rigid motion

    R, t = argmin sum_k w_k |R a_k + t - b_k|^2,   R in SO(3)

is the weighted orthogonal Procrustes solution: with the singular value decomposition U S V^T of
sum_k w_k (b_k - b)(a_k - a)^T, R = U diag(1, 1, det(U V^T)) V^T and t = b - R a (Kabsch 1976).
A missing marker of the cluster is then R a + t.
"""

from collections.abc import Iterable, Mapping
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from stridelab.conventions import Points, Rotations
from stridelab.recordings.marker_sets import Substitute, all_substitutes

SEX_UNKNOWN: Final = Substitute(
    code="sex-unknown",
    message="The sex of the subject is not stated: the mean of the female and the male body is used",
    landmarks=(),
    horizontal_mm=2.0,
    vertical_mm=5.0,
)


def applied_substitutes(codes: Iterable[str]) -> tuple[Substitute, ...]:
    """The substitutes with these codes; a larger gap replaces the smaller ones in it."""
    codes = frozenset(codes)
    known = all_substitutes()
    return tuple(known[code] for code in known if code in codes and not codes & set(known[code].hidden_by))


def widened_sd_m(sd_m: tuple[float, float, float], gaps: Iterable[Substitute]) -> tuple[float, float, float]:
    """Table error and the errors of the substitutes added in quadrature, per world axis."""
    gaps = tuple(gaps)
    horizontal = sum((gap.horizontal_mm / 1e3) ** 2 for gap in gaps)
    vertical = sum((gap.vertical_mm / 1e3) ** 2 for gap in gaps)
    x, y, z = sd_m
    return (x * x + horizontal) ** 0.5, (y * y + horizontal) ** 0.5, (z * z + vertical) ** 0.5


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
